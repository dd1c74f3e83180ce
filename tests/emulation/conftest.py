"""What the emulation tests share: a running network, and proof that nothing is left."""

import os
import secrets
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from topologies import openvswitch
from topologies.network import Network, Signals
from topologies.runtime import RUNTIME_ROOT, Runtime
from topologies.sdc import SdcTopo

ROOT = Path(__file__).resolve().parents[2]
# What all programs that these tests start inherit, and no other program on this machine has.
MARK = ("QMN_TESTS", secrets.token_hex(8))
os.environ.update([MARK])


def wait_until(condition: Callable[[], object], what: str, timeout_s: float = 10.0) -> None:
    """Wait for a condition; fail naming it when the deadline passes."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, f"not in {timeout_s:g} s: {what}"
        time.sleep(0.02)


def qmn(*arguments: str, runs: Path) -> subprocess.CompletedProcess[str]:
    """Run the command to its end."""
    return subprocess.run(
        [*qmn_command(runs), *arguments],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=100,
    )


def verb(*words: str) -> subprocess.CompletedProcess[str]:
    """Run another verb to its end; fail unless it succeeds."""
    return subprocess.run(
        [sys.executable, "-m", "qmn", *words],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
        timeout=30,
    )


def qmn_command(runs: Path) -> list[str]:
    """Return how the command is called; its last argument names the folder for runs."""
    return [sys.executable, "-m", "qmn", "run", "sdc", "--runs", str(runs)]


def interfaces() -> set[str]:
    return set(os.listdir("/sys/class/net"))


def our_processes() -> set[str]:
    """Return id and command line of all programs that these tests have started and that run now.

    Wherever they are: on their own, as a daemon, in a network namespace.
    """
    found = set()
    for folder in Path("/proc").iterdir():
        if not folder.name.isdigit():
            continue
        try:
            environment = (folder / "environ").read_bytes().split(b"\0")
            command = (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode()
        except OSError:
            continue
        if "=".join(MARK).encode() in environment:
            found.add(f"{folder.name} {command}")
    return found


@pytest.fixture(scope="session", autouse=True)
def _open_vswitch() -> Iterator[None]:
    """Let Open vSwitch run, so that the bridges before and after a test can be compared."""
    started = not openvswitch.running()
    if started:
        openvswitch.start("tests")
    yield
    if started:
        openvswitch.stop_if_ours("tests")


@pytest.fixture(autouse=True)
def _nothing_is_left(_open_vswitch: None) -> Iterator[None]:
    """Check that bridges, interfaces and processes are afterwards what they were before."""
    before = (set(openvswitch.bridges()), interfaces() - {"ovs-netdev"})
    others = our_processes()
    yield
    deadline = time.monotonic() + 10
    while (left := our_processes() - others) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert left == set()
    after = (set(openvswitch.bridges()), interfaces() - {"ovs-netdev"})
    assert after == before
    assert [path for path in RUNTIME_ROOT.glob("*") if path.is_dir()] == []


@pytest.fixture
def network(tmp_path: Path) -> Iterator[Network]:
    """Start the superdense-coding network in this process."""
    settings = Runtime(log_folder=tmp_path / "run")
    with Signals() as signals, Network(SdcTopo, settings, signals) as running:
        yield running
