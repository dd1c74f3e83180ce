"""The verb against a real dispatcher in a process of its own, and on the file that it leaves."""

import argparse
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import grpc
import pytest
from forked_python import Forked
from limits import SOON_S, wait_until

from hosts.quantum_socket import STACK_VARIABLE
from qmn.running import network as running
from topologies.system.processes.owners import owner
from topologies.system.runs.runtime import EVENT_CAPTURE
from views.verbs import spy
from wire.config import DispatcherConfig, Fiber, FiberEnd
from wire.dispatcher_pb2 import (
    BlockId,
    CreateRequest,
    Launch,
    Order,
    SendRequest,
    Step,
    TellRequest,
)
from wire.dispatcher_pb2_grpc import DispatcherStub
from wire.dispatcher_service import RUNNER, metadata

BLOCKS = 60  # in one order
PROGRAM = """
import sys
from pathlib import Path
from qmn import __main__
from qmn.running import network as running
from views.verbs import spy
from topologies.system import namespaces
root = Path(sys.argv.pop(1))
find = running.dispatcher_of_running_network
namespaces.running = list  # runs of this machine, which have no part in it
spy.dispatcher_of_running_network = lambda: find(root)
sys.exit(__main__.main())
"""


class Scene:
    """A dispatcher, a host that makes events, and the verb."""

    def __init__(self, folder: Path, process: subprocess.Popen[str]) -> None:
        self.folder, self.process = folder, process

    def act(self, session: int, count: int = 1, pairs: int = 4) -> None:
        """Let alice make blocks of pairs and send half 0 of each to bob: three events each."""
        for first in range(0, count, BLOCKS):
            numbers = range(first, min(count, first + BLOCKS))
            creates = [CreateRequest(session=session, number=n, count=pairs) for n in numbers]
            blocks = [BlockId(session=session, number=number) for number in numbers]
            launches = [Launch(block=block, port="alice-q0") for block in blocks]
            send = Step(send=SendRequest(launches=launches, rate_hz=10**9))
            steps = [*(Step(create=create) for create in creates), send]
            before = self._logged()
            self._perform("alice", [Order(number=1, steps=steps)])
            self._await_lines(before + 3 * len(numbers))

    def _await_lines(self, count: int) -> None:
        wait_until(lambda: self._logged() >= count, "light to arrive")

    def _logged(self) -> int:
        return (self.folder / "quantum.log").read_bytes().count(b"\n")

    def tell(self, node: str, text: str, count: int) -> None:
        """Let a host say so often what it executes: an event each."""
        steps = [Step(tell=TellRequest(text=text))]
        self._perform(node, (Order(number=number, steps=steps) for number in range(count)))

    def _perform(self, node: str, orders: Iterable[Order]) -> None:
        with grpc.insecure_channel(f"unix:{self.folder}/d.sock") as channel:
            stub = DispatcherStub(channel)  # type: ignore[no-untyped-call]
            token = metadata(f"token of {node}")
            for outcome in stub.Perform(iter(orders), metadata=token, timeout=SOON_S):
                assert not outcome.code, outcome.text

    def spy(self, *words: str) -> subprocess.Popen[str]:
        """Start the verb; it is attached when it has shown what is remembered."""
        return Forked(
            [sys.executable, "-c", PROGRAM, str(self.folder), "spy", *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def spied(self, *words: str) -> tuple[int, list[str], str]:
        """Run the verb to its end; return status, lines and what it says of itself."""
        with self.spy(*words) as process:
            lines, text = process.communicate(timeout=SOON_S)
        return process.returncode, lines.splitlines(), text


@pytest.fixture
def scene(tmp_path: Path) -> Iterator[Scene]:
    with dispatcher(tmp_path) as started:
        yield started


@contextmanager
def dispatcher(folder: Path) -> Iterator[Scene]:
    config = DispatcherConfig(
        listen="127.0.0.1:0",
        socket=str(folder / "d.sock"),
        seed=1,
        tokens={node: f"token of {node}" for node in ("alice", "bob", RUNNER)},
        fibers=[Fiber(FiberEnd("alice", "alice-q0"), FiberEnd("bob", "bob-q0"))],
        switches=[],
        event_log=str(folder / "quantum.log"),
        event_capture=str(folder / EVENT_CAPTURE),
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
            yield Scene(folder, process)
        finally:
            process.kill()


def kinds(lines: list[str]) -> list[str]:
    return [line.split()[2] for line in lines]


def test_the_file_of_a_run_holds_the_lines_of_its_log(scene: Scene) -> None:
    scene.act(session=3)
    status, lines, text = scene.spied(str(scene.folder))
    assert (status, text) == (0, "qmn: 3 events shown, 0 dropped\n")
    assert lines == (scene.folder / "quantum.log").read_text().splitlines()
    assert kinds(lines) == ["create", "send", "arrive"]


def test_filters_choose(scene: Scene) -> None:
    scene.act(session=3)
    scene.act(session=0xABC)
    folder = str(scene.folder)
    assert kinds(scene.spied(folder, "--node", "bob")[1]) == ["arrive"] * 2
    assert (
        kinds(scene.spied(folder, "--kind", "send", "--kind", "create")[1])
        == [
            "create",
            "send",
        ]
        * 2
    )
    lines = scene.spied(folder, "--session", "0abc", "--json")[1]
    events: list[dict[str, Any]] = [json.loads(line) for line in lines]
    assert [event["kind"] for event in events] == ["create", "send", "arrive"]
    assert {event["session"] for event in events} == {"0000000000000abc"}
    assert scene.spied(folder, "--session", "3", "--node", "bob", "--kind", "send")[1] == []


def test_an_attached_spy_sees_events_as_they_happen_and_ends_with_the_network(
    scene: Scene,
) -> None:
    scene.act(session=1)
    with scene.spy("--history", "--session", "1", "--session", "2") as process:
        assert process.stdout
        assert kinds([process.stdout.readline() for _ in range(3)]) == ["create", "send", "arrive"]
        scene.act(session=2)
        scene.act(session=4)
        lines = [process.stdout.readline() for _ in range(3)]
        assert all("session=0000000000000002" in line for line in lines)
        scene.process.terminate()
        rest, text = process.communicate(timeout=SOON_S)
        assert (process.returncode, rest) == (0, "")
        assert text == "qmn: 6 events shown, 0 dropped\n"


@pytest.mark.parametrize("attached", [True, False])
def test_ctrl_c_ends_it_cleanly(scene: Scene, attached: bool) -> None:
    scene.act(session=1)
    words = ["--history"] if attached else [str(scene.folder), "--follow"]
    with scene.spy(*words) as process:
        assert process.stdout
        for _ in range(3):
            process.stdout.readline()
        process.send_signal(signal.SIGINT)
        rest, text = process.communicate(timeout=SOON_S)
        assert (process.returncode, rest) == (0, "")
        assert text == "qmn: 3 events shown, 0 dropped\n"


def test_a_closed_pipe_ends_it_without_a_word(scene: Scene) -> None:
    scene.tell("alice", "x" * 1000, count=200)  # more than a pipe holds: it cannot end before
    with scene.spy(str(scene.folder)) as process:
        assert process.stdout
        assert process.stderr
        process.stdout.close()
        assert process.wait(timeout=SOON_S) == 128 + signal.SIGPIPE
        assert process.stderr.read() == ""


def test_a_spy_that_does_not_read_is_told_what_was_dropped(scene: Scene) -> None:
    scene.act(session=1)
    with scene.spy("--history", "--per-qubit") as process:
        assert process.stdout
        process.stdout.readline()
        os.kill(process.pid, signal.SIGSTOP)
        scene.act(session=2, count=20, pairs=1000)
        os.kill(process.pid, signal.SIGCONT)
        shown = []
        while "dropped" not in shown:
            shown += kinds([process.stdout.readline()])
        scene.process.terminate()
        shown += kinds(process.stdout.read().splitlines())
        assert process.wait(timeout=SOON_S) == 0
        assert process.stderr
        text = process.stderr.read()
    assert "dropped" in shown, text
    words = text.split()
    count, dropped = int(words[1].replace(",", "")), int(words[4].replace(",", ""))
    assert dropped > 0
    assert len(shown) + 1 == count + shown.count("dropped")


def ends_within(process: subprocess.Popen[str], seconds: float) -> bool:
    """Return whether a process ends in time; one that does not is killed."""
    try:
        process.wait(seconds)
    except subprocess.TimeoutExpired:
        process.kill()
        return False
    return True


@pytest.mark.parametrize(("words", "before"), [([], 3), (["--node", "bob"], 1)])
def test_what_the_networks_end_takes_from_a_slow_spy_is_counted(
    scene: Scene, words: list[str], before: int
) -> None:
    """Bob says more than the socket between them holds: some 200 KiB of 1.6 MB."""
    scene.act(session=1)
    with scene.spy("--history", *words) as process:
        assert process.stdout
        process.stdout.readline()
        os.kill(process.pid, signal.SIGSTOP)
        scene.tell("bob", "H" * 4000, count=400)
        scene.process.terminate()
        ended = ends_within(scene.process, 4.5)  # the runner waits for 5 s
        os.kill(process.pid, signal.SIGCONT)
        process.stdout.read()
        assert process.wait(timeout=SOON_S) == 0
        assert process.stderr
        lines = process.stderr.read().split()
    count, dropped = (int(lines[place].replace(",", "")) for place in (1, 4))
    assert dropped > 0
    assert count + dropped == before + 400
    assert ended


def test_a_spy_that_keeps_up_loses_nothing_at_the_end(scene: Scene) -> None:
    with scene.spy("--history") as process:
        assert process.stdout
        scene.act(session=1, count=3)
        for _ in range(9):
            process.stdout.readline()
        scene.process.terminate()
        rest, text = process.communicate(timeout=SOON_S)
    assert (rest, text) == ("", "qmn: 9 events shown, 0 dropped\n")


def test_following_a_run_ends_when_it_has_left_its_result(scene: Scene) -> None:
    scene.act(session=1)
    with scene.spy(str(scene.folder), "--follow") as process:
        assert process.stdout
        for _ in range(3):
            process.stdout.readline()
        scene.act(session=2)
        for _ in range(3):
            assert "session=0000000000000002" in process.stdout.readline()
        (scene.folder / "result.json").touch()
        assert process.wait(timeout=SOON_S) == 0


def test_without_following_the_running_network_shows_what_was(scene: Scene) -> None:
    scene.act(session=1)
    assert kinds(scene.spied("--no-follow")[1]) == ["create", "send", "arrive"]


@pytest.mark.parametrize(
    ("words", "output"),
    [
        (["--node", "carol"], "unknown node 'carol': choose one of alice, bob, runner"),
        (["/etc"], "no quantum events at /etc/quantum.pcapng: name the folder of a run that has"),
        (["/etc/hostname"], "not a pcapng file of ours"),
        (["--session", "x"], "'x' is not 1 to 16 hexadecimal digits"),
    ],
)
def test_what_cannot_be_shown_is_said(scene: Scene, words: list[str], output: str) -> None:
    status, lines, text = scene.spied(*words)
    assert status > 0
    assert lines == []
    assert output in text
    assert "Traceback" not in text


def test_without_a_network_it_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    find = running.dispatcher_of_running_network
    monkeypatch.setattr(spy, "dispatcher_of_running_network", lambda: find(tmp_path))
    arguments = argparse.ArgumentParser()
    spy.add_parser(arguments.add_subparsers())
    parsed = arguments.parse_args(["spy"])
    assert parsed.call(parsed) == 1
    assert "no network runs on this machine" in capsys.readouterr().err


def test_what_a_network_does_not_write_can_only_be_followed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    config = DispatcherConfig(listen="", socket="", seed=1, tokens={}, fibers=[], switches=[])
    monkeypatch.setattr(spy, "dispatcher_of_running_network", lambda: config)
    monkeypatch.delenv(STACK_VARIABLE, raising=False)
    arguments = argparse.ArgumentParser()
    spy.add_parser(arguments.add_subparsers())
    parsed = arguments.parse_args(["spy", "--no-follow"])
    assert parsed.call(parsed) == 1
    assert "writes no events (--without events)" in capsys.readouterr().err
