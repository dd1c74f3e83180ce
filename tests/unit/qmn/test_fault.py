"""The verb against a real dispatcher that runs as a process of its own."""

import argparse
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from forked_python import Forked
from limits import SOON_S

from qmn.__main__ import described
from qmn.changes import fault
from qmn.running import network as running
from topologies.system.processes.owners import owner
from topologies.system.processes.programs import NetworkError
from wire.config import DispatcherConfig, Fiber, FiberEnd, QuantumSwitch
from wire.dispatcher_service import RUNNER


@contextmanager
def network(folder: Path) -> Iterator[tuple[subprocess.Popen[str], Path]]:
    """Run a dispatcher whose private folder is as the runner makes it; give its event log."""
    config = DispatcherConfig(
        listen="127.0.0.1:0",
        socket=str(folder / "d.sock"),
        seed=1,
        tokens={node: f"token of {node}" for node in ("alice", "q1", RUNNER)},
        fibers=[Fiber(FiberEnd("alice", f"a{n}"), FiberEnd("q1", str(n))) for n in (2, 3)],
        switches=[QuantumSwitch("q1")],
        event_log=str(folder / "quantum.log"),
    )
    config.write(folder / "config.json")
    command = [sys.executable, "-m", "dispatcher", "--config", str(folder / "config.json")]
    with Forked(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout
            assert process.stdout.readline() == "ready\n"
            private = folder / str(owner(process.pid))
            private.mkdir()
            config.write(private / "dispatcher.json")
            yield process, folder / "quantum.log"
        finally:
            process.kill()


def parse(*words: str) -> argparse.Namespace:
    whole = ["set", "fault", *words]
    return described(whole).parse_args(whole)


def run(
    root: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, *words: str
) -> tuple[int, str]:
    """Run the verb with private folders under a root; return its status and what it says."""
    monkeypatch.setattr(
        fault,
        "dispatcher_of_running_network",
        lambda: running.dispatcher_of_running_network(root),
    )
    arguments = parse(*words)
    status = arguments.call(arguments)
    output = capsys.readouterr()
    return status, output.out + output.err


def logged(log: Path, text: str, count: int) -> list[str]:
    """Return the lines of an event log that have a text, once there are this many: it is late."""
    deadline = time.monotonic() + SOON_S
    while True:
        found = [line for line in log.read_text().splitlines() if text in line]
        if len(found) == count:
            return found
        assert time.monotonic() < deadline, f"{len(found)} of {count} events {text!r}"
        time.sleep(0.005)


def test_faults_reach_the_running_network(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with network(tmp_path) as (_process, log):
        for words, output, text in (
            ("q1 stuck 2 3", "q1: cross-connect 2 -> 3 is stuck\n", "stuck 2 -> 3"),
            (
                "q1 temperature 80",
                "q1: 80 C, above its limit of 60 C: every path loses 3 dB more\n",
                "temperature 80 C, every path loses 3 dB more",
            ),
            ("q1 temperature -5", "q1: -5 C, within its limit of 60 C\n", "temperature -5 C"),
            ("q1 repair", "q1: repaired, 25 C\n", "repaired"),
        ):
            assert run(tmp_path, capsys, monkeypatch, *words.split()) == (0, output)
            (line,) = logged(log, text, 1)
            assert " fault " in line
            assert line.endswith(text)


@pytest.mark.parametrize(
    ("words", "text"),
    [
        ("q2 repair", "unknown quantum switch 'q2': choose one of q1"),
        ("q1 stuck 2 9", "port 9 of q1 has no fibre: choose one of 2, 3"),
        ("q1 stuck -1 2", "port -1 of q1 has no fibre: choose one of 2, 3"),
        ("q1 failed 2", "port 2 of q1 is not an inner port: choose one of none"),
        ("q1 temperature 1000", "temperature_c 1000 is not between -100 and 300"),
        ("q1 temperature nan", "temperature_c nan is not between"),
    ],
)
def test_a_fault_that_cannot_be_is_named_and_ends_with_a_status(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    words: str,
    text: str,
) -> None:
    with network(tmp_path) as (_process, log):
        status, output = run(tmp_path, capsys, monkeypatch, *words.split())
        assert status == 1
        assert text in output
        assert output.count("\n") == 1
        assert log.read_text() == ""


def test_a_second_stuck_cross_connect_in_the_way_of_the_first_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with network(tmp_path):
        run(tmp_path, capsys, monkeypatch, "q1", "stuck", "2", "3")
        status, output = run(tmp_path, capsys, monkeypatch, "q1", "stuck", "2", "2")
        assert (status, "2 -> 3 is stuck" in output) == (1, True)


def test_a_dispatcher_that_was_killed_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with network(tmp_path) as (process, _log):
        config = running.dispatcher_of_running_network(tmp_path)
        process.kill()
        with pytest.raises(NetworkError, match="does not answer"):
            fault.inject(config, "q1", fault.Repair())


def test_where_no_network_runs_the_verb_says_so(tmp_path: Path) -> None:
    dead = subprocess.Popen(["true"])
    dead.wait()
    (tmp_path / f"{dead.pid}-1-00000000").mkdir()
    (tmp_path / "lock").touch()
    for root in (tmp_path, tmp_path / "nowhere"):
        with pytest.raises(
            NetworkError,
            match="no network runs on this machine: start one, for example by `qmn cli",
        ):
            running.dispatcher_of_running_network(root)


def test_a_network_that_is_still_starting_is_said_to_be(tmp_path: Path) -> None:
    (tmp_path / str(owner(1))).mkdir()
    with pytest.raises(NetworkError, match="still starting"):
        running.dispatcher_of_running_network(tmp_path)


def test_a_configuration_of_another_version_is_named(tmp_path: Path) -> None:
    (tmp_path / str(owner(1))).mkdir()
    (tmp_path / str(owner(1)) / "dispatcher.json").write_text("{}")
    with pytest.raises(NetworkError, match="of another version"):
        running.dispatcher_of_running_network(tmp_path)
