"""Keys, tunnels and NetQASM applications with a host on another machine (machine_scene.py)."""

import json
import os
import random
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT, wait_until
from fabric_scene import STANDING
from limits import PROGRAM_S
from machine_scene import ON_SECOND, SCHEDULER, THERE, SecondMachine
from test_results_fit_schema import require_schema
from test_run_vpn import lines_of

from applications.keys.config import KeyLink
from applications.keys.key_managers import KeyService, start_key_managers
from qmn.scripting import start
from topologies.system.confinement.confinement import descendants

SEED = 5
LINK = ("--session-bits", "12000", "--low-mark", "8", "--high-mark", "16", "--seed", str(SEED))
LOST_WITHIN_S = 20.0
CURL = "curl -sS --cert $SAE_CERT --key $SAE_KEY --cacert $KME_CA $KME/api/v1/keys"


@pytest.fixture(autouse=True)
def _nothing_is_left_there(second: SecondMachine) -> Iterator[None]:
    before = second.things()
    yield
    second.require_only(before)


def qmn(*words: str, timeout_s: float = PROGRAM_S) -> subprocess.CompletedProcess[str]:
    """Run a process of its own, which connects to Dask's scheduler, to its end."""
    command = [sys.executable, "-m", "qmn", *words]
    return subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=timeout_s
    )


def run(runs: Path, *words: str, timeout_s: float = PROGRAM_S) -> dict[str, Any]:
    """Run to the end; return the result."""
    done = qmn(*words, "--without", "report", "--runs", str(runs), timeout_s=timeout_s)
    assert done.returncode == 0, done.stdout + done.stderr
    require_schema(runs / "latest")
    result: dict[str, Any] = json.loads((runs / "latest" / "result.json").read_text())
    return result


def stored(folder: Path) -> dict[str, tuple[bytes, int]]:
    """Return what is in the files of a folder, and their modes."""
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {
        str(path.relative_to(folder)): (path.read_bytes(), path.stat().st_mode & 0o777)
        for path in files
    }


@pytest.mark.waits
@pytest.mark.nightly
def test_keys_of_a_host_on_a_second_machine_are_those_of_one_machine_and_come_back(
    second: SecondMachine, tmp_path: Path
) -> None:
    reports = {}
    words = ["run", "keys", *LINK, "--seconds", "6", "--captures", "none", "--without", "events"]
    for name, where in (("one", ()), ("two", ON_SECOND)):
        keys = ("--keys", str(tmp_path / f"{name}-keys"))
        reports[name] = run(tmp_path / name, *words, *keys, *where)
    one, two = (stored(tmp_path / f"{name}-keys") for name in reports)
    assert two == one
    mine, theirs = (
        {path.rpartition("/")[2]: key for path, (key, _mode) in two.items() if path.startswith(way)}
        for way in ("alice/bob/first", "bob/alice/second")
    )
    assert mine == theirs
    assert len(mine) >= 16
    assert {mode for _key, mode in two.values()} == {0o600}
    assert reports["two"]["machines"]["m2"]["hosts"] == ["bob"]
    facts = [
        {**each["job"]["asking"], "elapsed_s": 0, "keys_per_s": 0} for each in reports.values()
    ]
    assert facts[0] == facts[1]
    # What Wireshark needs for what bob's key manager says to others has come back, too.
    log = tmp_path / "two" / "latest" / "kme-bob.keys"
    assert log.read_text().startswith("# TLS secrets log file")
    assert log.stat().st_mode & 0o777 == 0o600


def test_both_ends_of_a_key_link_between_machines_deliver_the_same_key_once(
    second: SecondMachine, tmp_path: Path
) -> None:
    link = KeyLink("", True, low=8, high=16, options={"count": 12_000})
    where = {"machines": 2, "place": ("bob=m2",), "scheduler": SCHEDULER}
    with start("sdc", tmp_path / "run", **where) as network:
        service = KeyService([("alice", "bob")], link, {"sae-web": "bob"})
        start_key_managers(network, service)
        assert sum("-m applications.keys" in each for each in second.things()[0]) == 1

        def curl(host: str, path: str) -> Any:
            return json.loads(network.host(host).cmd(f'{CURL}/"{path}"'))

        def filled() -> bool:
            return bool(curl("bob", "sae-alice/status").get("stored_key_count", 0) >= 8)

        wait_until(filled, "keys")
        got = curl("alice", "sae-bob/enc_keys?size=512")
        path = f"sae-alice/dec_keys?key_ID={got['keys'][0]['key_ID']}"
        assert curl("bob", path) == got
        assert curl("bob", path) == {"message": "one or more keys specified are not found on KME"}
        # Both applications of bob have a certificate there, which nobody else can read.
        bob = network.host("bob")
        folder = bob.cmd("dirname $SAE_KEY").strip()
        listed = bob.cmd(f"stat -c '%a %n' {folder}/*.key").split()
        assert listed == ["600", f"{folder}/sae-bob.key", "600", f"{folder}/sae-web.key"]
        web = CURL.replace("$SAE_CERT", f"{folder}/sae-web.pem")
        web = web.replace("$SAE_KEY", f"{folder}/sae-web.key")
        assert json.loads(bob.cmd(f"{web}/sae-alice/enc_keys"))["keys"]


@pytest.mark.by_day(every=2)
@pytest.mark.waits
@pytest.mark.parametrize(
    ("program", "places"), [("wireguard", ("bob=m2", "eve=m2")), ("tls", ("alice=m2",))]
)
def test_a_tunnel_between_machines_closes_while_eve_listens_and_the_file_arrives(
    program: str, places: tuple[str, ...], second: SecondMachine, tmp_path: Path
) -> None:
    file = tmp_path / "file"
    file.write_bytes(random.Random(SEED).randbytes(4_000_000))
    words = ["run", "vpn", "--with", program, "--file", str(file), "--rotate", "1"]
    words += [
        "--key-lifetime",
        "2",
        "--eve",
        "0.6",
        "--at",
        "2",
        "--until",
        "8",
        "--without",
        "events",
    ]
    words += ["--machines", "2", "--scheduler", SCHEDULER]
    words += [word for place in places for word in ("--place", place)]
    result = run(tmp_path / "runs", *words, timeout_s=PROGRAM_S)
    folder = tmp_path / "runs" / "latest"
    assert (folder / "received").read_bytes() == file.read_bytes()
    report = result["job"]["asking"]
    assert (report["file_intact"], report["received_bytes"]) == (True, 4_000_000)
    assert report["tunnel_closed_s"] > 0
    hosts = result["machines"]["m2"]["hosts"]
    assert [f"{host}=m2" for host in hosts] == sorted(places)
    alarms = [each for each in result["job"]["time_series"] if each["event"] == "alarm"]
    assert alarms
    assert all(abs(each["qber"] - 0.15) < 5 * (0.15 * 0.85 / 1200) ** 0.5 for each in alarms)
    alice, bob = (
        [each["key_ID"] for each in lines_of(folder / f"vpn-{host}.log") if each["event"] == "key"]
        for host in ("alice", "bob")
    )
    assert all(one == other for one, other in zip(alice, bob, strict=False))
    assert len(set(alice)) == len(alice) >= 3
    far = folder / f"{hosts[0]}-eth0.pcap"
    assert far.stat().st_size > file.stat().st_size
    for capture in (far, *folder.glob("s1-*.pcap")):
        assert file.read_bytes()[1000:1032] not in capture.read_bytes()


@pytest.mark.nightly
def test_what_cannot_be_on_the_second_machine_is_named_before_the_start(
    second: SecondMachine, tmp_path: Path
) -> None:
    STANDING.spoil()
    second.says("mount", "--bind", "/dev/null", "/usr/bin/wireguard-go")
    link = application(tmp_path / "app") / "data" / "link"
    link.symlink_to("/etc/hostname")
    for words, text in (
        (["run", "vpn"], "wireguard-go is not installed on m2, where bob is: apt-get install"),
        (["run", "qkd", "--hand-out", str(tmp_path / "out")], "the keys of bob are on m2"),
        (["netqasm", str(tmp_path / "app")], f"{link} is neither a file nor a folder"),
    ):
        done = qmn(*words, *ON_SECOND, "--runs", str(tmp_path / "runs"))
        assert done.returncode == 1
        assert text in done.stderr
        assert "starting the network" not in done.stdout


PAIRS = """
import sys
from pathlib import Path

from netqasm.sdk import EPRSocket
from netqasm.sdk.external import NetQASMConnection

from bases import BASES  # a file beside this one

ROLE, PEER = "{role}", "{peer}"


def main(app_config=None):
    text, found = Path("data", "word.txt").read_text(), []
    socket = EPRSocket(PEER)
    log = app_config.log_config
    with NetQASMConnection(ROLE, log_config=log, epr_sockets=[socket]) as host:
        for basis in BASES:
            (half,) = socket.{ask}(number=1)
            if basis == "X":
                half.H()
            outcome = half.measure()
            host.flush()
            found.append(int(outcome))
    Path("data", "found.txt").write_text(f"{{ROLE}} {{found}}")
    Path(log.comm_log_dir, f"log-{{ROLE}}.txt").write_text(f"{{ROLE}} {{found}}")
    return {{"read": text, "found": found, "role": ROLE}}
"""


def application(folder: Path) -> Path:
    """Write an application of two programs, which read files beside them, and write one."""
    (folder / "data").mkdir(parents=True)
    (folder / "data" / "word.txt").write_text("beside")
    (folder / "bases.py").write_text(f"BASES = {'XZ' * 8!r}")
    for role, peer, ask in (("alice", "bob", "create_keep"), ("bob", "alice", "recv_keep")):
        program = PAIRS.format(role=role, peer=peer, ask=ask)
        (folder / f"app_{role}.py").write_text(program)
    return folder


def test_a_netqasm_application_on_two_machines_returns_and_writes_what_it_does_on_one(
    second: SecondMachine, tmp_path: Path
) -> None:
    app = application(tmp_path / "app")
    words = ["netqasm", str(app), "--captures", "none", *ON_SECOND, "--rounds", "2"]
    report = run(app / "runs", *words)["job"]["outputs"]
    assert len(report) == 2
    for outputs in report:
        found = outputs["alice"]["found"]  # of Phi+, in either order of the measurements
        assert outputs == {
            role: {"read": "beside", "found": found, "role": role} for role in ("alice", "bob")
        }
        assert len(found) == 16
    # Files that bob's program wrote beside itself do not come into the application's folder.
    last, folder = report[1], app / "runs" / "latest" / "netqasm"
    assert (folder / "bob" / "data" / "found.txt").read_text() == f"bob {last['bob']['found']}"
    assert [path.name for path in (folder / "bob").rglob("*") if path.is_file()] == ["found.txt"]
    here = app / "data" / "found.txt"
    assert here.read_text() == f"alice {last['alice']['found']}"
    logs = {path.name: path.read_text() for path in folder.glob("*.txt")}
    assert logs == {f"log-{role}.txt": f"{role} {last[role]['found']}" for role in last}


SEND = """
from pathlib import Path

QUBIT = int(Path("qubit.txt").read_text())

def main(env=None):
    comm = env.comm
    with comm:
        circuit = env.create_circuit(num_qubits=1, num_clbits=1)
        if comm.rank == 0:
            circuit.x(QUBIT)
            comm.qsend(circuit, [QUBIT], 1)
        else:
            comm.qrecv(circuit, [QUBIT], 0)
            circuit.measure(QUBIT, 0)
    print(comm.results)
"""


@pytest.mark.nightly
def test_a_netqmpi_program_finds_on_a_second_machine_what_is_beside_it(
    second: SecondMachine, tmp_path: Path
) -> None:
    """Rank 0 teleports 1."""
    folder = tmp_path / "program"
    folder.mkdir()
    (folder / "send.py").write_text(SEND)
    (folder / "qubit.txt").write_text("0")
    places = ("--place", "rank_0=alice", "--place", "rank_1=bob")
    words = ["netqasm", str(folder / "send.py"), "--ranks", "2", "--rounds", "6"]
    job = run(folder / "runs", *words, *places, *ON_SECOND)["job"]
    assert job["roles"] == {"rank_0": "alice", "rank_1": "bob"}
    assert job["outputs"] == [{"rank_0": {"0": 6}, "rank_1": {"1": 6}}]


KEYS = ("run", "keys", *LINK, "--low-mark", "4000", "--high-mark", "4000")
LASTING = {  # runs, each with a program of bob's, and what its log says when it is at work
    "keys": (KEYS, "kme-bob", "session"),
    "vpn": (("run", "vpn", "--mbit-s", "0.5"), "vpn-bob", "tunnel_opened"),
    "netqasm": (("netqasm", "APP", "--rounds", "100000"), "netqasm-bob", "result"),
}


@pytest.mark.by_day(every=3)
@pytest.mark.parametrize("job", LASTING)
def test_a_worker_that_is_killed_ends_the_job_by_name_and_leaves_nothing(
    job: str, second: SecondMachine, tmp_path: Path
) -> None:
    words, program, text = LASTING[job]
    app = str(application(tmp_path / "app"))
    reports = [app if word == "APP" else word for word in words]
    reports += ["--without", "report", "--runs", str(tmp_path / "runs"), *ON_SECOND]
    log = tmp_path / "runs" / "latest" / f"{program}.log"
    command, pipe = [sys.executable, "-m", "qmn", *reports], subprocess.PIPE
    with subprocess.Popen(command, cwd=ROOT, stdout=pipe, stderr=pipe, text=True) as process:
        wait_until(lambda: log.exists() and text in log.read_text(), f"{program} at work")
        os.kill(next(descendants(second.worker.pid)), signal.SIGKILL)
        STANDING.spoil()
        _said, complaint = process.communicate(timeout=LOST_WITHIN_S)
    assert process.returncode == 1
    assert f"the machine m2 ({THERE}) was lost" in complaint
