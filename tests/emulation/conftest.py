"""The parts that emulation tests share: a running network, and proof that nothing is left."""

import os
import re
import secrets
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp
from typing import Any

import pytest
from fabric_scene import NOISE, STANDING, Crossing, TurningRingTopo, light_paths, started
from fabric_scene import running as running_here
from key_scene import keep_keys
from limits import SOON_S, left_s
from limits import wait_until as wait_until
from loaded import forks, run_qmn, serving
from machine_scene import SecondMachine, second_machine
from mininet.topo import Topo

from topologies.networks.network import Network
from topologies.sdc import SdcTopo
from topologies.system.kernel.interfaces import delete
from topologies.system.namespaces import MACHINE_NETWORK, are_own, running
from topologies.system.open_vswitch import openvswitch
from topologies.system.processes.programs import ROOT as ROOT
from topologies.system.processes.programs import Program
from topologies.system.runs.runtime import RUNTIME_ROOT
from topologies.tapped import TappedTopo

# From 4.4 on Wireshark runs no script for root: this is another user, who may read root's files.
TSHARK = [
    *("setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"),
    *("--inh-caps=+dac_override", "--ambient-caps=+dac_override"),
    *("env", "HOME=/nonexistent", "tshark"),
]
# Networks that tests share, by fixture; tests of one are next to each other.
STANDS: dict[str, tuple[Callable[[], Topo], dict[str, Any]]] = {
    "shared_network": (SdcTopo, {}),
    "noisy_network": (partial(SdcTopo, depolarizing=NOISE), {}),
    "ring_network": (TurningRingTopo, {}),
    "chain_network": (Crossing, {}),
    "queueing_network": (SdcTopo, {"contention": "queue"}),
    "netqasm_network": (TappedTopo, {"state_inspection": True}),
    "keys_network": (SdcTopo, {"contention": "queue", "rest": "127.0.0.1:8181"}),
}
# Further steps of the start of such a network.
BEGINNING: dict[str, Callable[[Network], None]] = {"keys_network": keep_keys}
# Fixtures of another machine, and of a switch without a network, which are shared, too.
SECOND, SWITCH = "second", "switch"
POLICY = "policy.toml"
# The environment of all programs that these tests start, and of no other on this machine.
MARK = ("QMN_TESTS", secrets.token_hex(8))
os.environ.update([MARK])


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Let every third worker begin with tests that mostly wait, and the others with the rest.

    Those that share a network are next to each other.

    Together they use the processors as well as they can; those that have nothing left to do take
    over what others have, from its end. The first of n workers gets the first nth of all tests.
    """
    shared = [*STANDS, SECOND, SWITCH, ""]
    items.sort(key=lambda item: shared.index(stands_for(item.fixturenames)))  # type: ignore[attr-defined]
    workers = getattr(config, "workerinput", {}).get("workercount", 1)
    waiting = [item for item in items if item.get_closest_marker("waits")]
    busy = [item for item in items if item not in waiting]
    if not (patient := workers // 3):
        return
    items.clear()
    for first in range(patient):
        begin = waiting[first::patient]
        rest = (len(waiting) + len(busy)) // workers - len(begin)
        items += [*begin, *busy[:rest]]
        del busy[:rest]
    items += busy


@pytest.hookimpl(tryfirst=True)  # before fixtures
def pytest_runtest_setup(item: pytest.Item) -> None:
    """End the network that stands before a test that shares none."""
    if not stands_for(item.fixturenames):  # type: ignore[attr-defined]
        STANDING.end()


def stands_for(fixtures: Sequence[str]) -> str:
    """Return what a test with these fixtures shares, "" if nothing."""
    return next((name for name in (*STANDS, SECOND, SWITCH) if name in fixtures), "")


def qmn(*arguments: str, runs: Path, report: bool = False) -> subprocess.CompletedProcess[str]:
    """Run the command to its end; a report takes a second more."""
    return run_qmn(*qmn_words(runs, report), *arguments)


def verb(*words: str) -> subprocess.CompletedProcess[str]:
    """Run another verb to its end; fail unless it succeeds."""
    done = run_qmn(*words)
    assert done.returncode == 0, done.stdout + done.stderr
    return done


def qmn_words(runs: Path, report: bool = False) -> list[str]:
    """Return the arguments of the command; the last word names the folder for runs."""
    return ["run", "sdc", *([] if report else ["--without", "report"]), "--runs", str(runs)]


def qmn_command(runs: Path) -> list[str]:
    """Return how the command is called, as by who has not loaded it."""
    return [sys.executable, "-m", "qmn", *qmn_words(runs)]


def interfaces() -> set[str]:
    return set(os.listdir("/sys/class/net"))


def our_processes() -> set[str]:
    """Return id and command line of all programs that these tests have started and that run now.

    Wherever they are: on their own, in a network namespace. The loader of programs for all tests is
    none of them.
    """
    found = set()
    for folder in Path("/proc").iterdir():
        if not folder.name.isdigit() or int(folder.name) in forks().pids:
            continue
        try:
            environment = (folder / "environ").read_bytes().split(b"\0")
            command = (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode()
        except OSError:
            continue
        if "=".join(MARK).encode() in environment:
            found.add(f"{folder.name} {command}")
    return found


def in_runs(pattern: str) -> list[Path]:
    """Return the private files of all runs that go on in namespaces of their own."""
    folders = [Path(f"/proc/{run.first}/root{RUNTIME_ROOT}") for run in running()]
    return [file for folder in folders for file in folder.glob(pattern)]


@pytest.fixture(scope="session", autouse=True)
def _machine() -> None:
    """Let the namespaces of these tests be the machine on whose loopback networks serve."""
    if are_own():
        for words in (["umount"], ["mount", "--bind", "/proc/self/ns/net"]):
            subprocess.run([*words, MACHINE_NETWORK], check=True)


@contextmanager
def open_vswitch() -> Iterator[None]:
    """Run Open vSwitch for bridges that no network of ours makes."""
    with TemporaryDirectory() as folder:
        openvswitch.start(lambda name: Program(name, Path(folder, f"{name}.log")))
        try:
            yield
        finally:
            openvswitch.end()
            delete(openvswitch.DATAPATH_INTERFACE)


@pytest.fixture(scope="module")
def machines_open_vswitch() -> Iterator[None]:
    """Run the Open vSwitch of the machine, which Mininet's own `mn` needs."""
    with open_vswitch():
        yield


@pytest.fixture(scope="session", autouse=True)
def _programs_loaded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Load what networks are made of once."""
    with serving(tmp_path_factory.mktemp("loaded")):
        yield


@contextmanager
def nothing_left() -> Iterator[None]:
    """Check that interfaces, folders and programs are afterwards what they were before."""
    others, before = our_processes(), things()
    yield
    ended_s = time.monotonic()
    while (left := our_processes() - others) and left_s(ended_s, 10.0) > 0:
        time.sleep(0.02)
    assert left == set()
    assert things() == before


def things() -> dict[str, set[str]]:
    """Return the names of what a network makes on this machine."""
    return {
        "interfaces": interfaces(),
        "folders": {path.name for path in RUNTIME_ROOT.glob("*") if path.is_dir()},
    }


@pytest.fixture(scope="session", autouse=True)
def _standing(_programs_loaded: None, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """End the network that stands at the last; its folder is this."""
    yield tmp_path_factory.mktemp("standing")
    STANDING.end()


@contextmanager
def standing(name: str, folder: Path) -> Iterator[Network]:
    """Start a network that stands, with a policy that tests change: see `policy`."""
    topo, settings = STANDS[name]
    with nothing_left(), TemporaryDirectory(dir=folder) as own:
        policy = Path(own, POLICY)
        policy.touch()
        with started(topo, Path(own), policy=str(policy), **settings) as network:
            if name in BEGINNING:
                BEGINNING[name](network)
            yield network


def lent(name: str, folder: Path) -> Any:
    """Return what stands under this name."""
    if name == SECOND:
        return STANDING.take(name, partial(second_machine, folder))
    if name == SWITCH:
        own = Path(mkdtemp(dir=folder))  # for its socket; it may stand more than once
        return STANDING.take(name, partial(scene_of_agents().running_switch, own))
    return STANDING.take(name, partial(standing, name, folder))


@pytest.fixture(autouse=True)
def _nothing_is_left(request: pytest.FixtureRequest, _standing: Path) -> Iterator[None]:
    """Hold each test to account for what it leaves."""
    if name := stands_for(request.fixturenames):
        lent(name, _standing)
    with nothing_left():
        yield


@pytest.fixture
def network(tmp_path: Path) -> Iterator[Network]:
    """Start the superdense-coding network in this process."""
    with running_here(SdcTopo, tmp_path) as network:
        yield network


@contextmanager
def shared(name: str, folder: Path) -> Iterator[Network]:
    """Give a network that stands, dark as a new one; a test mends what it has broken."""
    network: Network = lent(name, folder)
    try:
        yield network
        network.check()
        for switch in network.runtime.switches:
            wait_until(lambda: not light_paths(switch), "the light is free for the next test")  # noqa: B023
    except BaseException:
        STANDING.end()
        raise


def sharing(name: str) -> Callable[..., Iterator[Network]]:
    """Return the fixture that gives a network that stands."""

    @pytest.fixture(name=name)
    def given(_nothing_is_left: None, _standing: Path) -> Iterator[Network]:
        with shared(name, _standing) as network:
            yield network

    return given


(
    shared_network,
    noisy_network,
    ring_network,
    chain_network,
    queueing_network,
    netqasm_network,
    keys_network,
) = map(sharing, STANDS)


def policy_of(network: Network) -> Path:
    """Return the policy file of a network that stands."""
    return network.runtime.logs.parent / POLICY


@pytest.fixture
def second(_nothing_is_left: None, _standing: Path) -> SecondMachine:
    """Give the other machine, on which a worker is ready."""
    machine: SecondMachine = lent(SECOND, _standing)
    return machine


def scene_of_agents() -> Any:
    """Return the module, which loads os-ken and imports this one."""
    return import_module("agent_scene")


@pytest.fixture
def switch(_nothing_is_left: None, _standing: Path) -> Iterator[Any]:
    """Give a switch of four fibre ports with its controller, dark as a new one."""
    lent_switch = lent(SWITCH, _standing)
    try:
        lent_switch.renew()
        yield lent_switch
    except BaseException:
        STANDING.end()
        raise


@pytest.fixture
def own_switch(tmp_path: Path) -> Iterator[Any]:
    """Start a switch for a test that strikes it, or changes how it talks to its controller."""
    with scene_of_agents().running_switch(tmp_path) as own:
        yield own


@contextmanager
def policy(network: Network, text: str) -> Iterator[None]:
    """Let a network that stands have a policy."""
    file = policy_of(network)
    file.write_text(text)
    try:
        verb("set", "policy", "reload")
        yield
    finally:
        file.write_text("")
        verb("set", "policy", "reload")


def typed(page: str, number: int, run: Path) -> str:
    """Return what Python says to a block of code of our documentation, about this run."""
    text = (ROOT / "docs" / page).read_text()
    blocks: list[str] = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    done = subprocess.run(
        [sys.executable, "-i", "-q"],
        input=blocks[number].replace("runs/latest", str(run)),
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
        timeout=SOON_S,
    )
    assert "Traceback" not in done.stderr, done.stderr
    return done.stdout
