"""A network watches its programs, and ends them in an order."""

import signal
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from topologies.networks.network import Network, Signals
from topologies.nodes import gate
from topologies.sdc import SdcTopo
from topologies.system.processes.programs import NetworkError, Program
from topologies.system.runs import runtime
from topologies.system.runs.runtime import Runtime
from wire.config import GateConfig
from wire.leaps import LEAPS


@pytest.fixture
def network(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Return a network that has nodes of no kind: others need root."""
    monkeypatch.setattr(runtime, "RUNTIME_ROOT", tmp_path / "qmn")
    monkeypatch.setattr("topologies.networks.network.DAEMON_END_TIMEOUT_S", 0.0)
    with Signals() as signals:
        made: Any = Network(SdcTopo, Runtime(), signals)
        made.net = SimpleNamespace(hosts=[], switches=[], controllers=[])
        made._disk = SimpleNamespace(check=lambda: None, look_at_disks=lambda: None)
        yield made
        made.runtime.remove()


def started(folder: Path, name: str) -> Program:
    program = Program(name, folder / f"{name}.log")
    program.start(["sleep", "60"])
    return program


@pytest.mark.parametrize("ended_by", ["a stranger", "its runner"])
def test_an_application_that_was_struck_is_named_when_it_is_seen_again(
    network: Any, tmp_path: Path, ended_by: str
) -> None:
    """The end of a program may be seen before that of its host's shell, which caused it."""
    program = started(tmp_path, "asking")
    network._applications.append(program)
    network.check()
    if ended_by == "its runner":
        program.stop()
    else:
        assert program._process is not None
        program._process.send_signal(signal.SIGKILL)
        program._process.wait(10)
    network.check()
    if ended_by == "its runner":
        network.check()
    else:
        with pytest.raises(NetworkError, match="asking died in mid-run: killed by SIGKILL"):
            network.check()


def test_a_program_that_ends_is_named_at_once(network: Any, tmp_path: Path) -> None:
    program = started(tmp_path, "alice")
    network.runtime.programs.append(program)
    network.check()
    program.kill()
    with pytest.raises(NetworkError, match="alice died in mid-run: killed by SIGKILL"):
        network.check()


def test_what_others_need_ends_behind_them(network: Any) -> None:
    """The dispatcher and the copper to it, and then the gate."""
    asked: list[str] = []

    def program(name: str) -> Any:
        return SimpleNamespace(name=name, ask_to_stop=lambda: asked.append(name), stop=lambda: None)

    network.runtime.programs += map(program, ("gate", "dispatcher", "copper", "alice", "c0"))
    network._stop_programs()
    assert [*dict.fromkeys(asked)] == ["alice", "c0", "dispatcher", "copper", "gate"]


@pytest.mark.parametrize("watched", [True, False])
def test_the_gate_knows_whether_somebody_watches(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, watched: bool
) -> None:
    """Then stepped time never leads the wall."""
    monkeypatch.setattr(runtime, "RUNTIME_ROOT", tmp_path / "qmn")
    configurations = []

    def launch(_network: Runtime, _name: str, _module: str, config: GateConfig) -> Program:
        configurations.append(config)
        return Program("gate", tmp_path / "gate.log")

    monkeypatch.setattr(gate, "launch", launch)
    monkeypatch.setattr(gate, "with_own_network", lambda: True)
    monkeypatch.setattr(gate, "repeat_nothing", lambda: None)  # to this machine, whatever is wrong
    (tmp_path / "gate.log").touch()
    made = Runtime(stepped=True, watched=watched, log_folder=tmp_path)
    with pytest.raises(NetworkError, match="gate ended at its start"):
        gate.Start(made)
    made.remove()
    assert configurations == [GateConfig(str(tmp_path / LEAPS), watched)]


def test_stepped_time_changes_no_network_but_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It would leave TCP and ARP of the machine itself waiting for 100 s."""
    monkeypatch.setattr(runtime, "RUNTIME_ROOT", tmp_path / "qmn")
    for name in ("launch", "repeat_nothing"):
        monkeypatch.setattr(gate, name, lambda *_words: pytest.fail("begun"))
    monkeypatch.setattr(gate, "with_own_network", lambda: False)
    made = Runtime(stepped=True, log_folder=tmp_path)
    with pytest.raises(NetworkError, match="stepped time needs a network of its own"):
        gate.Start(made)
    made.remove()
