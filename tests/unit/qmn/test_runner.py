"""How a runner follows programs, ends those that a failure leaves, and sums up light."""

from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from recorded_run import service_run
from rich.console import Console
from stepping import SINCE_NS, stands, stepping

from applications.teleportation.teleport import TeleportOptions
from qmn.jobs import run_context, runner, transfer
from qmn.jobs.runner import Job
from qmn.jobs.transfer import Lines, TransferError, follow_all
from topologies.system.processes.programs import NetworkError, Program
from wire.dispatcher_pb2 import StatusReply
from wire.network_time import GateClient, NetworkTime, SteppedTime
from wire.results.run_result import ServiceJob


class Standing:
    """A network of which a fault is known, or none; one of our own would need root."""

    def __init__(self, folder: Path, fault: str = "", time: NetworkTime | None = None) -> None:
        self.runtime = SimpleNamespace(
            time=time or NetworkTime(1.0), logs=folder, socket=lambda host: f"{host}.sock"
        )
        self._folder, self._fault = folder, fault
        self.commands: dict[str, list[str]] = {}

    def check(self) -> None:
        if self._fault:
            raise NetworkError(self._fault)

    explain = check

    def run_on(self, _host: str, name: str, command: list[str]) -> Program:
        self.commands[name] = command
        program = Program(name, self._folder / f"{name}.log")
        program.start(["sleep", "60"])
        return program


def job(**more: Any) -> Job:
    options = TeleportOptions(host="bob", port=7)
    request: Any = None
    return Job(
        "teleport", options, "alice", "bob", request=request, announcement="", unit="states",
        total=1, done=lambda _figures: 0, **more,
    )  # fmt: skip


@pytest.mark.parametrize("cut", range(1, 24))
def test_a_line_that_is_cut_anywhere_is_read_once_when_it_is_whole(
    tmp_path: Path, cut: int
) -> None:
    data = '{"event": "ä"}\n{"a": 1}\n'.encode()
    program = Program("asking", tmp_path / "asking.log")
    program.log.write_bytes(data[:cut])
    lines = Lines(program)
    found = lines.new()
    with program.log.open("ab") as log:
        log.write(data[cut:])
    assert [*found, *lines.new()] == [{"event": "ä"}, {"a": 1}]


class Clock:
    """Time that passes only in pauses."""

    def __init__(self, pause_s: float) -> None:
        self._now_s, self._pause_s = 0.0, pause_s

    def monotonic(self) -> float:
        return self._now_s

    def sleep(self, _duration_s: float) -> None:
        self._now_s += self._pause_s


def test_a_program_that_goes_on_speaking_may_take_longer_than_a_silent_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(transfer, "time", Clock(0.75))
    log = tmp_path / "asking.log"
    log.touch()
    lines = iter([*(f'{{"n": {n}}}\n' for n in range(9)), '{"event": "done"}\n'])

    def speak() -> None:
        with log.open("a") as file:
            file.write(next(lines, ""))

    program: Any = SimpleNamespace(name="asking", log=log, running=True)
    network: Any = Standing(tmp_path)
    heard: list[object] = []
    last = follow_all(network, [program], lambda _, line: heard.append(line["n"]), speak, 1.0)
    assert last == {"asking": {"event": "done"}}
    assert heard == [*range(9)]


@pytest.mark.parametrize(
    ("fault", "words"), [("q1 is gone", "q1 is gone"), ("", "asking ended: killed")]
)
def test_a_program_ends_for_a_fault_of_the_network_first(
    tmp_path: Path, fault: str, words: str
) -> None:
    log = tmp_path / "asking.log"
    log.touch()
    program: Any = SimpleNamespace(name="asking", log=log, running=False, end=lambda: "killed")
    network: Any = Standing(tmp_path, fault)
    with pytest.raises((NetworkError, TransferError), match=words):
        follow_all(network, [program], lambda *_: None, lambda: None)


@pytest.mark.parametrize("fault", ["alice's fibre is gone", ""])
def test_programs_that_a_failure_leaves_end_and_the_network_says_why(
    tmp_path: Path, fault: str
) -> None:
    network: Any = Standing(tmp_path, fault)
    started = []

    def fail() -> None:
        with runner._programs(network, job(), "1-") as start:
            started.append(start("alice", "asking", ["bob"]))
            assert started[0].running
            raise TransferError("no answer")

    with pytest.raises((NetworkError, TransferError), match=fault or "no answer"):
        fail()
    assert not started[0].running
    assert network.commands["1-asking"][-4:] == ["alice.sock", "teleport", "7", "bob"]


def test_who_sends_a_file_knows_the_time_of_the_network(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While programs start, stepped time stands."""
    monkeypatch.setattr(runner, "follow", lambda *_: {"event": "done"})
    started: dict[str, list[str]] = {}
    stood: list[bool] = []
    file = tmp_path / "message"

    def asking(time: NetworkTime) -> list[str]:
        def start(_host: str, role: str, given: list[str]) -> Any:
            started[role] = given
            return SimpleNamespace(
                wait_for=lambda *_: stood.append(isinstance(time, SteppedTime) and stands(time))
            )

        network: Any = Standing(tmp_path, time=time)
        left = tmp_path, ServiceJob()
        runner._use(network, job(file=file), start, left, lambda _: None, lambda: None)  # type: ignore[arg-type]
        assert started["asked"] == ["--output", str(tmp_path / "received")]
        return started["asking"][-4:]

    assert asking(NetworkTime(5.0)) == ["--file", str(file), "--time-scale", "5.0"]
    with stepping() as gate, closing(GateClient(gate.time)) as other:
        other.wait_for(SINCE_NS + 1)
        assert asking(gate.time) == ["--file", str(file), "--time-folder", gate.time.folder]
    assert stood == [False, True]


def test_what_a_job_has_done_is_delivered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    @contextmanager
    def running(*_: object) -> Iterator[None]:
        yield

    monkeypatch.setattr(runner, "running_network", running)
    context: Any = SimpleNamespace(folder=tmp_path, console=Console(quiet=True))
    for perform, delivered in ((lambda *_: None, True), (_fail, False)):
        monkeypatch.setattr(runner, "perform", perform)
        facts = service_run()
        facts.delivered = False
        try:
            runner.use_network(job(), context, facts, ServiceJob())
        except TransferError:
            assert not delivered
        assert facts.delivered is delivered


def _fail(*_: object) -> None:
    raise TransferError("no light")


def test_light_of_a_job_is_what_there_was_since_it_began(monkeypatch: pytest.MonkeyPatch) -> None:
    now = StatusReply(exact=True, pairs_created=900, photons_lost=80, photons_lost_waiting=7)
    before = StatusReply(exact=True, pairs_created=300, photons_lost=50, photons_lost_waiting=2)
    monkeypatch.setattr(run_context, "status", lambda _network: now)
    monkeypatch.setattr(run_context, "worst", lambda _runtime: None)
    network: Any = SimpleNamespace(runtime=None)
    facts = service_run()
    run_context.note_light(facts, network, before)
    assert (facts.pairs_made, facts.photons_lost, facts.photons_lost_waiting) == (600, 30, 5)
