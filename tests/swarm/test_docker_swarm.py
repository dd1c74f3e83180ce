"""A network over two machines that Docker Swarm joins: two engines, each with a network of its own.

m1, 192.0.2.1: manager, scheduler, run ---- 192.0.2.2: m2, worker
"""

import json
import os
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

import pytest

pytestmark = pytest.mark.timeout(1800)

ROOT = Path(__file__).resolve().parents[2]
IMAGE = "qmn"
ADDRESSES = {"m1": "192.0.2.1", "m2": "192.0.2.2"}
ENDS = {"m1": "swarm1", "m2": "swarm2"}
ON_SECOND = ["--machines", "2", "--place", "bob=m2", "--scheduler", "tcp://scheduler:8786"]
NOISY = ["--seed=7", "--depolarizing=0.0005", "--loss-db-per-km=0.02", "--frame-bytes=32"]
BYTES, PER_PAIR_BYTES = 50_000, 60_000
ENGINE_S, WORKER_S, LOST_S = 60.0, 180.0, 60.0


def done(*words: str | Path, **options: Any) -> str:
    """Return what a command says; fail with its complaint."""
    ended = subprocess.run(words, capture_output=True, text=True, check=False, **options)
    assert ended.returncode == 0, f"{' '.join(map(str, words))}: {ended.stderr}"
    return str(ended.stdout).strip()


def wait_until(condition: Callable[[], object], what: str, timeout_s: float) -> None:
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, f"not in {timeout_s:g} s: {what}"
        time.sleep(0.2)


@dataclass(frozen=True)
class Engine:
    """A Docker engine: one of the machines."""

    name: str
    folder: Path

    @property
    def client(self) -> list[str]:
        return ["docker", f"--host=unix://{self.folder}/socket"]

    def says(self, *words: str) -> str:
        return done(*self.client, *words, timeout=ENGINE_S)

    def answers(self) -> bool:
        asked = [*self.client, "version"]
        return not subprocess.run(asked, capture_output=True, check=False, timeout=5).returncode

    def run(self, runs: Path, *words: str) -> list[str]:
        """Return what runs `qmn` in a container that the others of the swarm reach."""
        options = ["--rm", "--init", "--network=qmn", "--cap-add=NET_ADMIN", "--cap-add=SYS_ADMIN"]
        options += ["--security-opt=apparmor=unconfined", "--device=/dev/net/tun"]
        options += [f"--volume={runs}:/qmn/runs"]
        return [*self.client, "run", *options, IMAGE, "qmn", "run", "sdc", *words]


@contextmanager
def engine(name: str) -> Iterator[Engine]:
    """Run an engine in the network namespace of this name; it ends with all that it has."""
    folder = Path(done("mktemp", "--directory", f"/var/tmp/qmn-{name}.XXXXXX"))
    here = Engine(name, folder)
    # Not `ip netns exec`: that hides the control groups.
    enter = ["nsenter", f"--net=/run/netns/{name}", "unshare", "--uts"]
    words = f"hostname {name}; exec dockerd --host=unix://{folder}/socket --log-level=warn"
    words += f" --pidfile={folder}/pid --exec-root={folder}/exec --data-root={folder}/data"
    with (folder / "log").open("w") as log:
        daemon = subprocess.Popen([*enter, "bash", "-c", words], stdout=log, stderr=log)
    try:
        wait_until(here.answers, f"an engine: {folder}/log", ENGINE_S)
        yield here
    finally:
        daemon.terminate()
        daemon.wait(ENGINE_S)
        left = [*(folder / "exec" / "netns").glob("*")]  # dockerd leaves one behind
        subprocess.run(["umount", *left], capture_output=True, check=False, timeout=10)
        shutil.rmtree(folder)


@contextmanager
def joined() -> Iterator[None]:
    """Have two network namespaces with a cable between them."""
    one, other = ENDS
    try:
        for name in ENDS:
            done("ip", "netns", "add", name)
        cable = f"ip link add {ENDS[one]} netns {one} type veth peer {ENDS[other]} netns {other}"
        done(*cable.split())
        for name, end in ENDS.items():
            done("ip", "-n", name, "addr", "add", f"{ADDRESSES[name]}/24", "dev", end)
            for each in ("lo", end):
                done("ip", "-n", name, "link", "set", each, "up")
        yield
    finally:
        for name in ENDS:
            subprocess.run(["ip", "netns", "delete", name], check=False, timeout=10)


@pytest.fixture(scope="module")
def swarm() -> Iterator[tuple[Engine, Engine]]:
    """Have the stack of docker/swarm.yml on two engines; the image is in both."""
    done(ROOT / "docker" / "build", cwd=ROOT)
    with ExitStack() as stack:
        stack.enter_context(joined())
        first, second = (stack.enter_context(engine(name)) for name in ENDS)
        for each in (first, second):
            words = f"docker save {IMAGE}:latest | {' '.join(each.client)} load"
            done("bash", "-o", "pipefail", "-c", words)
        first.says("swarm", "init", f"--advertise-addr={ADDRESSES['m1']}")
        token = first.says("swarm", "join-token", "--quiet", "worker")
        second.says("swarm", "join", "--token", token, f"{ADDRESSES['m1']}:2377")
        first.says("stack", "deploy", f"--compose-file={ROOT}/docker/swarm.yml", "qmn")
        yield first, second


def workers(first: Engine) -> list[str]:
    """Return the output of workers that had joined."""
    lines = first.says("service", "logs", "--raw", "qmn_worker").splitlines()
    return [line for line in lines if line.startswith("ready: m2 ")]


def facts(run: Path) -> dict[str, Any]:
    """Return what time does not change."""
    result = json.loads((run / "result.json").read_text())
    reports = {name: result["job"]["asking"][name] for name in ("bell_pairs", "lost_pairs")}
    return {**reports, "delivered": result["delivered"], "exact": result["exact"]}


def events(run: Path) -> list[str]:
    """Return what happened to qubits, without when."""
    lines = (run / "quantum.log").read_text().splitlines()
    return sorted(line.split(maxsplit=1)[1] for line in lines)


def test_a_swarm_carries_what_one_machine_does(
    swarm: tuple[Engine, Engine], tmp_path: Path
) -> None:
    first, _second = swarm
    wait_until(lambda: workers(first), "a worker", WORKER_S)
    data = Random(7).randbytes(BYTES)
    for name, words in (("one", []), ("two", ON_SECOND)):
        runs = tmp_path / name
        runs.mkdir()
        (runs / "sent").write_bytes(data)
        done(*first.run(runs, "--file", "/qmn/runs/sent", *NOISY, *words), timeout=ENGINE_S)
    one, two = (next((tmp_path / name).glob("*-sdc")) for name in ("one", "two"))
    assert (two / "received").read_bytes() == data
    assert facts(two) == facts(one)
    assert facts(two)["lost_pairs"] > 0
    assert events(two) == events(one)
    assert json.loads((two / "result.json").read_text())["machines"]["m2"]["hosts"] == ["bob"]


def test_a_worker_that_is_killed_is_named_and_another_one_comes(
    swarm: tuple[Engine, Engine], tmp_path: Path
) -> None:
    first, second = swarm
    wait_until(lambda: workers(first), "a worker", WORKER_S)
    before = len(workers(first))
    (tmp_path / "sent").write_bytes(os.urandom(PER_PAIR_BYTES))
    words = ("--file", "/qmn/runs/sent", "--handshake", "per-pair", *ON_SECOND)
    pipe = subprocess.PIPE
    with subprocess.Popen(first.run(tmp_path, *words), stdout=pipe, stderr=pipe, text=True) as run:
        wait_until(lambda: [*tmp_path.glob("*-sdc/asking.log")], "a session", ENGINE_S)
        (asking,) = tmp_path.glob("*-sdc/asking.log")
        wait_until(lambda: "delivered" in asking.read_text(), f"bytes: {asking}", ENGINE_S)
        second.says("kill", *second.says("ps", "--quiet").split())
        _said, complaint = run.communicate(timeout=LOST_S)
    assert run.returncode == 1
    assert "qmn: the machine m2 (" in complaint
    assert "was lost: its worker has ended, or been killed" in complaint
    wait_until(lambda: len(workers(first)) > before, "another worker", WORKER_S)
