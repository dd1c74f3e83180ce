"""The SCPI driver against a small instrument that runs as a process of its own."""

import asyncio
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from limits import SOON_S

from applications.instruments import scpi
from applications.instruments.scpi import MatrixPort, ScpiSwitch
from qswitch_agent.hardware.optics import (
    Condition,
    CrossConnect,
    HardwareFault,
    HardwareRefusal,
    Quantity,
)
from wire.analyser_frames import AnalyserFrame, Emission, End

INSTRUMENT = Path(__file__).with_name("scpi_instrument.py")
# OpenFlow ports 1 to 4; the instrument's ingress 5 with egress 13 is somebody else's.
PORTS = {port: MatrixPort(ingress=port, egress=8 + port) for port in (1, 2, 3, 4)}


class Bench:
    """The driver, and a connection of the test's own to the instrument."""

    def __init__(
        self, process: subprocess.Popen[str], tcp_port: int, streams: tuple[Any, Any]
    ) -> None:
        self.process = process
        self.switch = ScpiSwitch("127.0.0.1", tcp_port, PORTS)
        self._reader, self._writer = streams

    async def tell(self, *lines: str) -> None:
        """Have the instrument do something, and wait until it has."""
        for line in lines:
            self._writer.write(f"{line}\n".encode())
        await self.ask(":test:log?")

    async def ask(self, query: str) -> str:
        self._writer.write(f"{query}\n".encode())
        answer: bytes = await self._reader.readline()
        return answer.decode().strip()

    async def connections(self) -> str:
        return await self.ask(":oxc:swit:conn:stat?")

    async def log(self) -> list[str]:
        return (await self.ask(":test:log?")).split("|")


@contextmanager
def instrument() -> Iterator[tuple[subprocess.Popen[str], int]]:
    command = [sys.executable, str(INSTRUMENT), "--size", "8"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout
            yield process, int(process.stdout.readline())
        finally:
            process.kill()


@asynccontextmanager
async def bench() -> AsyncIterator[Bench]:
    with instrument() as (process, tcp_port):
        streams = await asyncio.open_connection("127.0.0.1", tcp_port)
        made = Bench(process, tcp_port, streams)
        try:
            yield made
        finally:
            await made.switch.close()
            streams[1].close()


def play(scene: Callable[[Bench], Coroutine[Any, Any, None]]) -> None:
    async def run() -> None:
        async with asyncio.timeout(SOON_S), bench() as made:
            await scene(made)

    asyncio.run(run())


def test_cross_connects_are_made_by_the_instruments_numbers() -> None:
    async def scene(bench: Bench) -> None:
        await bench.switch.set_cross_connects([CrossConnect(1, 2, 7), CrossConnect(2, 1, 8)])
        assert await bench.connections() == "(@1,2),(@10,9)"
        await bench.switch.set_cross_connects([])
        assert await bench.connections() == "(@),(@)"

    play(scene)


def test_those_that_stay_are_not_touched() -> None:
    async def scene(bench: Bench) -> None:
        await bench.switch.set_cross_connects([CrossConnect(1, 2), CrossConnect(3, 4)])
        await bench.switch.set_cross_connects([CrossConnect(1, 2), CrossConnect(4, 3)])
        await bench.switch.set_cross_connects([CrossConnect(1, 2, 99), CrossConnect(4, 3)])
        assert await bench.log() == [
            "add (@1,3),(@10,12)",
            "sub (@3),(@12)",
            "add (@4),(@11)",
        ]

    play(scene)


def test_the_connections_of_others_are_left_alone() -> None:
    async def scene(bench: Bench) -> None:
        await bench.tell(":oxc:swit:conn:add (@5,1),(@13,14)")
        await bench.switch.set_cross_connects([CrossConnect(2, 3)])
        assert await bench.connections() == "(@2,5),(@11,13)"  # ours, and theirs

    play(scene)


def test_the_instruments_settling_time_is_waited_for() -> None:
    async def scene(bench: Bench) -> None:
        await bench.tell(":test:settle 0.2")
        begin_s = time.monotonic()
        await bench.switch.set_cross_connects([CrossConnect(1, 2)])
        assert time.monotonic() - begin_s >= 0.2

    play(scene)


@pytest.mark.parametrize(
    ("wanted", "text"),
    [
        ([CrossConnect(1, 9)], "port 9 is not at the instrument, but 1, 2, 3, 4 are"),
        ([CrossConnect(1, 2), CrossConnect(3, 2)], "3 -> 2: one of the ports is used twice"),
        ([CrossConnect(1, 2), CrossConnect(1, 3)], "1 -> 3: one of the ports is used twice"),
        ([CrossConnect(3, 4)], "error -240, Hardware error; port failed"),
    ],
)
def test_what_cannot_be_done_is_refused_and_changes_nothing(
    wanted: list[CrossConnect], text: str
) -> None:
    async def scene(bench: Bench) -> None:
        await bench.switch.set_cross_connects([CrossConnect(2, 1)])
        await bench.tell(":test:fail (@12)")
        with pytest.raises(HardwareRefusal, match=text):
            await bench.switch.set_cross_connects(wanted)
        assert await bench.connections() == "(@2),(@9)"
        await bench.switch.set_cross_connects([CrossConnect(2, 3)])  # it goes on
        assert await bench.connections() == "(@2),(@11)"

    play(scene)


def test_ports_cannot_be_tuned() -> None:
    async def scene(bench: Bench) -> None:
        with pytest.raises(HardwareRefusal, match="port 1 cannot be tuned"):
            await bench.switch.tune(1, 193_400_000, None)

    play(scene)


def test_a_matrix_switch_has_neither_analysers_nor_memories_nor_sources() -> None:
    async def scene(bench: Bench) -> None:
        await bench.switch.read()
        with pytest.raises(HardwareRefusal, match="has no Bell analysers"):
            await bench.switch.watch_analysers(lambda _report: None)
        with pytest.raises(HardwareRefusal, match="has no memory at port 61001"):
            await bench.switch.keep(AnalyserFrame(61_001, 1, End.STORED, 1))
        with pytest.raises(HardwareRefusal, match="has no source of pairs at port 62001"):
            await bench.switch.emit(62_001, Emission(1, 1, 10, 1000, 193_400_000))
        await bench.switch.set_cross_connects([CrossConnect(2, 1)])  # it goes on
        assert await bench.connections() == "(@2),(@9)"

    play(scene)


def test_monitors_are_read_and_what_is_not_measured_is_named() -> None:
    async def scene(bench: Bench) -> None:
        before_ns = time.time_ns()
        await bench.switch.set_cross_connects([CrossConnect(1, 2, 7)])
        await bench.switch.set_cross_connects([CrossConnect(1, 2, 7), CrossConnect(3, 4, 8)])
        readings = await bench.switch.read()
        powers = {port: (one.rx_dbm, one.tx_dbm) for port, one in readings.ports.items()}
        assert powers == {1: (-1, -9), 2: (-2, -10), 3: (-3, -11), 4: (-4, -12)}
        first, second = readings.circuits[7], readings.circuits[8]
        assert before_ns < first.since_ns == first.last_ns < second.since_ns < time.time_ns()
        assert (first.photons, second.photons) == (0, 0)
        assert readings.not_measured == {
            Quantity.PHOTONS,
            Quantity.FREQUENCY,
            Quantity.BIAS,
            Quantity.TEMPERATURE,
        }

    play(scene)


def test_an_instrument_without_monitors_measures_no_power() -> None:
    async def scene(bench: Bench) -> None:
        await bench.tell(":test:without :pmon")
        for _ in range(2):
            readings = await bench.switch.read()
            assert readings.not_measured == set(Quantity)
        await bench.switch.set_cross_connects([CrossConnect(1, 2)])

    play(scene)


async def heard(switch: ScpiSwitch) -> tuple[asyncio.Queue[Condition], asyncio.Task[None]]:
    """Watch a switch; return what it reports, and the task that does so."""
    conditions: asyncio.Queue[Condition] = asyncio.Queue()
    return conditions, asyncio.create_task(switch.watch(conditions.put_nowait))


async def end(task: asyncio.Task[None]) -> None:
    task.cancel()
    with suppress(asyncio.CancelledError):
        await task


def test_a_failed_port_makes_its_cross_connect_stuck(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scpi, "SCPI_POLL_S", 0.01)

    async def scene(bench: Bench) -> None:
        await bench.switch.set_cross_connects([CrossConnect(1, 2), CrossConnect(3, 4)])
        conditions, watching = await heard(bench.switch)
        assert await conditions.get() == Condition()
        await bench.tell(":test:fail (@1)")
        assert (await conditions.get()).stuck == {(1, 2)}
        with pytest.raises(HardwareRefusal, match="port failed"):
            await bench.switch.set_cross_connects([CrossConnect(3, 4)])
        await bench.tell(":test:fail (@)")
        assert await conditions.get() == Condition()
        await end(watching)
        assert conditions.empty()

    play(scene)


def test_an_instrument_that_does_not_tell_its_ports_states_is_watched_all_the_same() -> None:
    async def scene(bench: Bench) -> None:
        await bench.tell(":test:without :oxc:swit:port")
        conditions, watching = await heard(bench.switch)
        assert await conditions.get() == Condition()
        await end(watching)

    play(scene)


def test_connections_that_others_change_are_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scpi, "SCPI_POLL_S", 0.01)

    async def scene(bench: Bench) -> None:
        await bench.switch.set_cross_connects([CrossConnect(1, 2)])
        conditions, watching = await heard(bench.switch)
        await conditions.get()
        await bench.tell(":oxc:swit:conn:add (@5),(@13)")  # not ours
        await bench.switch.read()
        assert not watching.done()
        await bench.tell(":oxc:swit:conn:sub (@1),(@10)")
        with pytest.raises(HardwareFault, match="somebody else has changed its connections"):
            await watching

    play(scene)


@pytest.mark.parametrize(
    "reply",
    [
        "",
        "hello",
        "(@1,2),(@17)",
        "(@1,1),(@9,10)",
        "(@1,2),(@9,9)",
        "(@x),(@9)",
        "(@1,,2),(@9,10)",
        "(@1),(@9),(@2)",
        '0,"No error"',
        "(@1),(@9)\\n(@1),(@9)",
        "\\xff",
    ],
)
def test_a_garbled_reply_is_a_fault(reply: str) -> None:
    async def scene(bench: Bench) -> None:
        await bench.switch.read()
        await bench.tell(f":test:say {reply}")
        with pytest.raises(HardwareFault, match="garbled reply"):
            await bench.switch.set_cross_connects([CrossConnect(1, 2)])
        with pytest.raises(HardwareFault, match="garbled reply"):  # and there is no other try
            await bench.switch.read()
        assert await bench.connections() == "(@),(@)"

    play(scene)


def test_an_endless_line_is_a_fault() -> None:
    async def scene(bench: Bench) -> None:
        await bench.switch.read()
        for _ in range(2):
            await bench.tell(f":test:say {'(' * 60_000}")
        with pytest.raises(HardwareFault, match="garbled reply"):
            await bench.switch.set_cross_connects([CrossConnect(1, 2)])

    play(scene)


@pytest.mark.parametrize("answers", range(8))
def test_a_silent_instrument_is_a_fault(answers: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scpi, "CALL_DEADLINE_S", 0.3)

    async def scene(bench: Bench) -> None:
        await bench.tell(f":test:mute {answers}")
        with pytest.raises(HardwareFault, match=r"no answer within 0\.3 s"):
            await bench.switch.set_cross_connects([CrossConnect(1, 2)])

    play(scene)


def test_an_instrument_that_settles_too_slowly_is_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scpi, "CALL_DEADLINE_S", 0.3)

    async def scene(bench: Bench) -> None:
        await bench.tell(":test:settle 10")
        with pytest.raises(HardwareFault, match=r"no answer within 0\.3 s"):
            await bench.switch.set_cross_connects([CrossConnect(1, 2)])

    play(scene)


def test_an_instrument_killed_in_mid_call_is_a_fault() -> None:
    async def scene(bench: Bench) -> None:
        await bench.tell(":test:settle 10")
        changing = asyncio.create_task(bench.switch.set_cross_connects([CrossConnect(1, 2)]))
        while await bench.connections() == "(@),(@)":
            assert not changing.done()
        bench.process.kill()
        with pytest.raises(HardwareFault, match="the connection is lost"):
            await changing
        with pytest.raises(HardwareFault, match="the connection is lost"):
            await bench.switch.read()

    play(scene)


def test_watch_notices_that_the_instrument_was_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scpi, "SCPI_POLL_S", 0.05)

    async def scene(bench: Bench) -> None:
        conditions, watching = await heard(bench.switch)
        await conditions.get()
        bench.process.kill()
        with pytest.raises(HardwareFault, match="the connection is lost"):
            await watching

    play(scene)


def test_an_absent_instrument_is_a_fault() -> None:
    async def scene(bench: Bench) -> None:
        bench.process.kill()
        bench.process.wait()
        with pytest.raises(HardwareFault, match="cannot be reached"):
            await bench.switch.set_cross_connects([])

    play(scene)


def test_a_caller_that_gives_up_leaves_no_answer_to_the_next() -> None:
    async def scene(bench: Bench) -> None:
        await bench.tell(":test:settle 0.2")
        changing = asyncio.create_task(bench.switch.set_cross_connects([CrossConnect(1, 2)]))
        while await bench.connections() == "(@),(@)":
            assert not changing.done()
        await end(changing)
        assert (await bench.switch.read()).ports[1].rx_dbm == -1.0
        await bench.switch.set_cross_connects([CrossConnect(1, 3)])
        assert await bench.connections() == "(@1),(@11)"

    play(scene)
