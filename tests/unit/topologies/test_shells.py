"""Shells of nodes that end, hang, or never come up, where Mininet alone would wait for ever."""

import os
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from limits import wait_until
from mininet.node import Node
from mininet.topo import Topo

from topologies.networks.network import Network, Signals
from topologies.system.kernel.interfaces import set_up, within
from topologies.system.processes import shells
from topologies.system.processes.owners import owner
from topologies.system.processes.programs import NetworkError
from topologies.system.processes.shells import ShellWatcher
from topologies.system.runs.runtime import Runtime


class Watched(ShellWatcher, Node):
    """A node of no special kind."""


MadeBy = Callable[[str], None]


@pytest.fixture
def mnexec(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> MadeBy:
    """Return what puts another program in the place of mnexec."""

    def make(script: str) -> None:
        program = tmp_path / "mnexec"
        program.write_text(f"#!/bin/sh\n{script}\n")
        program.chmod(0o755)
        monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")

    return make


def test_a_command_in_whose_middle_the_shell_ends_returns() -> None:
    node = Watched("watched", inNamespace=False)
    assert node.cmd("echo here").strip() == "here"
    assert not node.shell_ended
    node.cmd("kill -KILL $$")
    assert node.shell_ended
    assert node.cmd("echo too late") == ""
    node.terminate()


@pytest.mark.parametrize("command", ["sleep 60", "trap '' HUP; sleep 60", "kill -STOP $$"])
def test_a_busy_shell_is_ended_with_its_command(command: str) -> None:
    node = Watched("watched", inNamespace=False)
    shell = node.shell
    node.sendCmd(command)
    node.terminate()
    assert shell.poll() is not None


def test_what_a_shell_left_in_the_background_ends_with_it() -> None:
    """Also what takes no hang-up; it is in the shell's process group."""
    node = Watched("watched", inNamespace=False)
    left = int(node.cmd("(trap '' HUP; exec sleep 600) & echo $!").split()[-1])
    assert owner(left) is not None
    node.terminate()
    wait_until(lambda: has_ended(left), "the program in the background has ended")


def has_ended(pid: int) -> bool:
    """Tell whether a process has: it may be one that nobody has waited for yet."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except (FileNotFoundError, ProcessLookupError):
        return True


@pytest.mark.parametrize(
    ("script", "words"),
    [
        ("echo 'no mounts for you' >&2; exit 1", "ended at its start: no mounts for you"),
        ("kill -KILL $$", "ended at its start: no output, status -9"),
    ],
)
def test_an_mnexec_that_fails_is_said_at_once(mnexec: MadeBy, script: str, words: str) -> None:
    mnexec(script)
    with pytest.raises(NetworkError, match=f"the shell of watched {words}"):
        Watched("watched", inNamespace=False)


def test_an_mnexec_that_hangs_is_given_up_and_ended(
    mnexec: MadeBy, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(shells, "SHELL_TIMEOUT_S", 0.5)
    mnexec(f"echo $$ > {tmp_path}/pid; exec sleep 60")
    with pytest.raises(NetworkError, match=r"the shell of watched had no prompt in 0\.5 s"):
        Watched("watched", inNamespace=False)
    assert not Path("/proc", (tmp_path / "pid").read_text().strip()).exists()


def test_a_terminals_ctrl_c_does_not_reach_a_shell(mnexec: MadeBy) -> None:
    """It has left the runner's process group before it does anything of its own."""
    mnexec('[ "$(ps -o pgid= -p $$ | tr -d " ")" = $$ ] || exit 1; shift; exec "$@"')
    node = Watched("watched", inNamespace=False)
    assert os.getpgid(node.shell.pid) != os.getpgid(0)
    node.terminate()


def test_a_program_that_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(NetworkError, match="mnexec is not installed; run `make setup`"):
        Watched("watched", inNamespace=False)


def test_a_node_with_a_time_limit_waits_for_no_command_for_ever(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(shells, "COMMAND_TIMEOUT_S", 0.2)
    node = Watched("watched", inNamespace=False)
    node.time_limited = True
    with pytest.raises(NetworkError, match=r"watched did not end 'sleep 60' in 0\.2 s"):
        node.cmd("sleep 60")
    node.terminate()


def test_a_shell_that_does_not_answer_at_the_end_is_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shells, "COMMAND_TIMEOUT_S", 0.2)
    node = Watched("watched", inNamespace=False)
    node.ending = True
    assert node.cmd("sleep 60") == node.cmd("echo more") == ""
    assert node.shell_ended
    node.terminate()


def test_at_the_end_a_command_that_was_given_up_is_in_nobodys_way(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(shells, "COMMAND_TIMEOUT_S", 0.5)
    node = Watched("watched", inNamespace=False)
    node.time_limited = True
    with pytest.raises(NetworkError, match=r"watched did not end 'sleep 60' in 0\.5 s"):
        node.cmd("sleep 60")
    node.time_limited, node.ending = False, True
    assert node.cmd("echo here") == ""
    assert node.shell_ended
    node.terminate()


def test_a_shell_that_dies_while_the_network_starts_is_named() -> None:
    node = Watched("watched", inNamespace=False)
    node.time_limited = True
    with pytest.raises(NetworkError, match="watched died at its start: its shell was ended"):
        node.cmd("kill -KILL $$")
    with pytest.raises(NetworkError, match="watched died at its start: its shell was ended"):
        node.cmd("ip link add what-cannot-be")
    node.terminate()


def test_a_shell_that_dies_is_named_where_its_network_is_entered() -> None:
    node = Watched("alice", inNamespace=False)
    node._kill_shell()
    with pytest.raises(NetworkError, match=r"^alice has died: its shell was ended$"):
        within(node, set_up, "lo")
    node.terminate()


def test_a_shell_that_dies_is_named_where_its_links_cannot_be_made() -> None:
    node = Watched("alice", inNamespace=False)
    node._kill_shell()

    def build() -> None:
        raise NetworkError("cannot make the link alice-q0 to q1-eth2: No such process")

    network = Network(Topo, cast(Runtime, None), Signals())
    network.net = cast(Any, SimpleNamespace(build=build, hosts=[node], switches=[], controllers=[]))
    with pytest.raises(NetworkError, match=r"^alice died at its start: cannot make the link"):
        network._build_and_start()
    node.terminate()
