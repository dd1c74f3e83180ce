"""The simulated switch's driver against a real dispatcher, and against one that is silent."""

import asyncio
import signal
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Coroutine, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import grpc
import pytest
from forked_python import Forked
from limits import SOON_S
from stepping import stepping

from dispatcher.build import build_layer
from dispatcher.clock import NetworkClock
from dispatcher.layer.layer import PhysicalLayer
from dispatcher.server.server import Server, build_service
from programs.timeouts import SILENT_S
from qswitch_agent.hardware import simulated as hardware
from qswitch_agent.hardware.optics import (
    Condition,
    CrossConnect,
    Direction,
    HardwareFault,
    HardwareRefusal,
    OpticalHardware,
    Tuning,
)
from qswitch_agent.hardware.optics import Path as LightPath
from qswitch_agent.hardware.simulated import SimulatedSwitch
from wire import dispatcher_service
from wire.analyser_frames import AnalyserCounts
from wire.config import DispatcherConfig, Fiber, FiberEnd, PathOptics, QuantumSwitch
from wire.dispatcher_pb2 import (
    BlockId,
    Connection,
    CreateRequest,
    InjectFaultRequest,
    Launch,
    Order,
    SendRequest,
    Step,
    SwitchStatisticsReply,
)
from wire.dispatcher_pb2_grpc import DispatcherStub
from wire.network_time import SteppedTime
from wire.optical import DEFAULT_FREQUENCY_MHZ

PORTS = (1, 2, 3, 4)


def play(scene: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(scene, SOON_S))


def configuration(folder: Path, **optics: Any) -> DispatcherConfig:
    """Return a network in which alice has fibres to all ports of q1."""
    return DispatcherConfig(
        listen="127.0.0.1:0",
        socket=str(folder / "ed"),
        seed=1,
        tokens={node: f"token of {node}" for node in ("alice", "q1", "q2", "runner")},
        fibers=[Fiber(FiberEnd("alice", f"a{n}"), FiberEnd("q1", str(n))) for n in PORTS],
        switches=[QuantumSwitch("q1", **optics)],
    )


class Bench:
    """A dispatcher, q1's driver, and calls of the other nodes."""

    def __init__(self, layer: PhysicalLayer, server: Any, config: DispatcherConfig) -> None:
        self.layer, self.server = layer, server
        self.switch = SimulatedSwitch("q1", config.socket, "token of q1", config.time)
        self.channel = grpc.aio.insecure_channel(f"unix:{config.socket}")
        self._stub: Any = DispatcherStub(self.channel)  # type: ignore[no-untyped-call]

    @property
    def connections(self) -> dict[int, int]:
        return self.layer.network.switches["q1"].timeline.connections

    async def send(self, photons: int, port: int) -> None:
        """Let alice send photons into the fibre of a port."""
        create = CreateRequest(session=1, number=1, count=photons, state=CreateRequest.ZEROS)
        launch = Launch(block=BlockId(session=1, number=1), port=f"a{port}")
        send = SendRequest(launches=[launch], rate_hz=1_000_000_000)
        order = Order(number=1, steps=[Step(create=create), Step(send=send)])
        metadata = dispatcher_service.metadata("token of alice")
        call = self._stub.Perform(iter([order]), metadata=metadata, timeout=SOON_S)
        assert [outcome.code async for outcome in call] == [0]

    async def inject(self, **fault: Any) -> None:
        request = InjectFaultRequest(switch="q1", **fault)
        metadata = dispatcher_service.metadata("token of runner")
        await self._stub.InjectFault(request, metadata=metadata, timeout=SOON_S)


@asynccontextmanager
async def simulation(folder: Path, scale: float = 1.0, **optics: Any) -> AsyncIterator[Bench]:
    config = replace(
        configuration(folder, **optics), time_scale=scale, time_since_ns=time.time_ns()
    )
    layer, errors = build_layer(config, NetworkClock(config.time), None), list[BaseException]()
    server = Server(config, build_service(config, layer, errors.append))
    await server.start()
    bench = Bench(layer, server, config)
    try:
        yield bench
    finally:
        await bench.switch.close()
        await bench.channel.close(None)
        await server.stop(0)
    assert not errors


@contextmanager
def dispatcher_process(folder: Path) -> Iterator[subprocess.Popen[str]]:
    """Run the dispatcher as a process of its own."""
    path = folder / "dispatcher.json"
    configuration(folder).write(path)
    command = [sys.executable, "-m", "dispatcher", "--config", str(path)]
    with Forked(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout
            assert process.stdout.readline() == "ready\n"
            yield process
        finally:
            process.kill()


def test_exactly_the_wanted_cross_connects_are_made(tmp_path: Path) -> None:
    async def scene() -> None:
        async with simulation(tmp_path) as bench:
            await bench.switch.set_cross_connects({CrossConnect(3, 4), CrossConnect(1, 2)})
            assert bench.connections == {1: 2, 3: 4}
            await bench.switch.set_cross_connects([CrossConnect(1, 2)])
            assert bench.connections == {1: 2}
            await bench.switch.set_cross_connects(())
            assert bench.connections == {}

    play(scene())


def test_switching_time_is_waited_for(tmp_path: Path) -> None:
    async def scene() -> None:
        async with simulation(tmp_path, switching_time_s=0.05) as bench:
            begin_s = time.monotonic()
            await bench.switch.set_cross_connects([CrossConnect(1, 2)])
            assert time.monotonic() - begin_s >= 0.05

    play(scene())


def test_switching_time_is_that_of_the_network(tmp_path: Path) -> None:
    async def scene() -> None:
        async with simulation(tmp_path, scale=20.0, switching_time_s=0.01) as bench:
            begin_s = time.monotonic()
            await bench.switch.set_cross_connects([CrossConnect(1, 2)])
            assert time.monotonic() - begin_s >= 20 * 0.01

    play(scene())


def test_a_switching_time_longer_than_a_call_is_a_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hardware, "CALL_DEADLINE_S", 0.2)

    async def scene() -> None:
        async with simulation(tmp_path, switching_time_s=60.0) as bench:
            with pytest.raises(HardwareFault, match="DEADLINE_EXCEEDED"):
                await bench.switch.set_cross_connects([CrossConnect(1, 2)])

    play(scene())


def test_a_request_that_nobody_waits_for_any_more_does_not_answer_the_next(tmp_path: Path) -> None:
    async def scene() -> None:
        async with simulation(tmp_path, switching_time_s=0.2) as bench:
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(bench.switch.set_cross_connects([CrossConnect(1, 2)]), 0.05)
            begin_s = time.monotonic()
            await bench.switch.set_cross_connects([CrossConnect(3, 4)])
            assert time.monotonic() - begin_s >= 0.2
            assert bench.connections == {3: 4}

    play(scene())


def test_the_token_of_another_switch_is_a_fault(tmp_path: Path) -> None:
    async def scene() -> None:
        async with simulation(tmp_path) as bench:
            socket = str(tmp_path / "ed")
            for token in ("token of alice", "no token"):
                other = SimulatedSwitch("q1", socket, token)
                with pytest.raises(HardwareFault, match="does not accept the token of q1"):
                    await other.set_cross_connects([CrossConnect(1, 2)])
                await other.close()
            assert bench.connections == {}

    play(scene())


def test_photons_are_read_by_port_and_circuit(tmp_path: Path) -> None:
    async def scene() -> None:
        async with simulation(tmp_path) as bench:
            before_ns = time.time_ns()
            await bench.switch.set_cross_connects([CrossConnect(1, 2, circuit=77)])
            await bench.send(100, port=1)
            await bench.switch.set_cross_connects([])
            readings = await bench.switch.read()
            circuit = readings.circuits[77]
            assert circuit.photons == 100
            assert before_ns < circuit.since_ns < circuit.last_ns < time.time_ns()
            counts = {n: (p.photons_in, p.photons_out) for n, p in readings.ports.items()}
            assert counts == {1: (100, 0), 2: (0, 100), 3: (0, 0), 4: (0, 0)}
            assert readings.temperature_c == 25.0

    play(scene())


def test_tuning_reaches_the_port_and_leaves_the_rest(tmp_path: Path) -> None:
    async def scene() -> None:
        async with simulation(tmp_path) as bench:
            await bench.switch.tune(2, DEFAULT_FREQUENCY_MHZ + 50_000, None)
            await bench.switch.tune(2, None, -3.0)
            ports = (await bench.switch.read()).ports
            port, other = ports[2], ports[1]
            assert (port.tx_mhz, port.tx_dbm) == (DEFAULT_FREQUENCY_MHZ + 50_000, -3.0)
            assert (other.tx_mhz, other.tx_dbm) == (DEFAULT_FREQUENCY_MHZ, 0.0)
            assert (other.rx_dbm, other.bias_ma) == (0.0, 20.0)
            await bench.switch.tune(1, DEFAULT_FREQUENCY_MHZ - 50_000, None, Direction.RECEIVE)
            await bench.switch.tune(1, DEFAULT_FREQUENCY_MHZ + 50_000, None, Direction.TRANSMIT)
            turned = (await bench.switch.read()).ports[1]
            assert turned.rx_mhz == DEFAULT_FREQUENCY_MHZ - 50_000
            assert turned.tx_mhz == DEFAULT_FREQUENCY_MHZ + 50_000
            await bench.switch.tune(2, None, 0.0)
            assert (await bench.switch.read()).ports[2].tx_dbm == 0.0

    play(scene())


def test_what_the_switch_cannot_do_is_a_refusal(tmp_path: Path) -> None:
    async def scene() -> None:
        async with simulation(tmp_path) as bench:
            switch = bench.switch
            await bench.inject(stuck=Connection(in_port=1, out_port=2))
            for attempt, text in (
                (switch.set_cross_connects([CrossConnect(1, 9)]), "NOT_FOUND: port 9"),
                (switch.set_cross_connects([CrossConnect(1, 3)]), "1 -> 2 is stuck"),
                (
                    switch.set_cross_connects([CrossConnect(3, 4), CrossConnect(2, 4)]),
                    "INVALID_ARGUMENT: inputs 2 and 3 share",
                ),
                (switch.tune(9, None, -1.0), "NOT_FOUND: port 9"),
                (switch.tune(1, 1, None), "frequency_mhz 1 is not between"),
                (switch.tune(1, 0, None), "cannot be tuned to 0 MHz"),
                (switch.tune(1, 1 << 32, None), "cannot be tuned to 4294967296 MHz"),
                (switch.tune(1, None, 1.0), "power_dbm 1 is not between"),
            ):
                with pytest.raises(HardwareRefusal, match=text):
                    await attempt
            assert bench.connections == {1: 2}

    play(scene())


async def heard(switch: OpticalHardware) -> tuple[asyncio.Queue[Condition], asyncio.Task[None]]:
    """Watch a switch; return what it reports, and the task that does so."""
    conditions: asyncio.Queue[Condition] = asyncio.Queue()
    return conditions, asyncio.create_task(switch.watch(conditions.put_nowait))


def test_the_condition_is_reported_at_once_and_after_each_change(tmp_path: Path) -> None:
    optics: dict[str, Any] = {
        "insertion_loss_db": 1.0,
        "rotation": 2,
        "paths": [PathOptics(1, 3, 2.0, 1)],
    }

    async def scene() -> None:
        async with simulation(tmp_path, **optics) as bench:
            conditions, watching = await heard(bench.switch)
            tuning = Tuning(191_350_000, 196_100_000, 50_000, -20.0, 0.0)
            paths = {(1, 3): LightPath(2.0, 1)}
            assert await conditions.get() == Condition(tuning, LightPath(1.0, 2), paths)
            await bench.inject(temperature_c=70)
            hot = await conditions.get()
            assert (hot.hot, hot.others.loss_db, hot.paths[1, 3].loss_db) == (True, 4.0, 5.0)
            await bench.inject(stuck=Connection(in_port=3, out_port=4))
            assert (await conditions.get()).stuck == {(3, 4)}
            await bench.inject(repair=True)
            assert await conditions.get() == Condition(tuning, LightPath(1.0, 2), paths)
            watching.cancel()
            with suppress(asyncio.CancelledError):
                await watching

    play(scene())


def test_a_wrong_token_is_a_fault_of_every_call(tmp_path: Path) -> None:
    async def scene() -> None:
        async with simulation(tmp_path) as bench:
            switch = SimulatedSwitch("q1", str(tmp_path / "ed"), "token of alice")
            for attempt in (
                switch.set_cross_connects(()),
                switch.tune(1, None, -1.0),
                switch.read(),
                switch.watch(lambda _condition: None),
            ):
                with pytest.raises(HardwareFault, match="does not accept the token of q1"):
                    await attempt
            await switch.close()
            assert not bench.layer.history.count

    play(scene())


def test_watching_a_switch_that_there_is_not_is_a_fault(tmp_path: Path) -> None:
    async def scene() -> None:
        async with simulation(tmp_path):
            switch = SimulatedSwitch("q2", str(tmp_path / "ed"), "token of q2")
            with pytest.raises(HardwareFault, match="no quantum switch q2; there is q1"):
                await switch.watch(lambda _condition: None)
            await switch.close()

    play(scene())


def test_silent_dispatcher_is_a_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hardware, "CALL_DEADLINE_S", 0.5)

    async def scene() -> None:
        switch = SimulatedSwitch("q1", str(tmp_path / "ed"), "token of q1")
        await switch.read()
        process.send_signal(signal.SIGSTOP)
        for attempt in (switch.read(), switch.set_cross_connects(())):
            with pytest.raises(HardwareFault, match="DEADLINE_EXCEEDED"):
                await attempt
        await switch.close()

    with dispatcher_process(tmp_path) as process:
        play(scene())


def test_a_busy_dispatcher_is_waited_for_while_time_stands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hardware, "CALL_DEADLINE_S", 0.2)

    async def scene(stepped: SteppedTime) -> None:
        switch = SimulatedSwitch("q1", str(tmp_path / "ed"), "token of q1", stepped)
        await switch.read()
        process.send_signal(signal.SIGSTOP)
        asyncio.get_running_loop().call_later(0.5, process.send_signal, signal.SIGCONT)
        await switch.read()
        await switch.close()

    with dispatcher_process(tmp_path) as process, stepping() as running:
        play(scene(running.time))


def test_absent_dispatcher_is_a_fault(tmp_path: Path) -> None:
    async def scene() -> None:
        switch = SimulatedSwitch("q1", str(tmp_path / "nobody"), "secret")
        for attempt in (switch.set_cross_connects(()), switch.watch(lambda _condition: None)):
            with pytest.raises(HardwareFault, match="nobody does not answer"):
                await attempt
        await switch.close()

    play(scene())


def test_watch_ends_with_the_dispatcher(tmp_path: Path) -> None:
    async def scene() -> None:
        async with simulation(tmp_path) as bench:
            conditions, watching = await heard(bench.switch)
            await conditions.get()
            assert not watching.done()
            await bench.server.stop(None)
            with pytest.raises(HardwareFault, match="its connection ended"):
                await watching

    play(scene())


def test_watch_notices_at_once_that_the_dispatcher_was_killed(tmp_path: Path) -> None:
    async def scene() -> None:
        switch = SimulatedSwitch("q1", str(tmp_path / "ed"), "token of q1")
        conditions, watching = await heard(switch)
        await conditions.get()
        process.kill()
        begin_s = time.monotonic()
        with pytest.raises(HardwareFault, match="its connection ended"):
            await watching
        assert time.monotonic() - begin_s < SILENT_S  # else keepalive may have noticed it
        await switch.close()

    with dispatcher_process(tmp_path) as process:
        play(scene())


@pytest.mark.parametrize(("oldest_ns", "age_ns"), [(0, 0), (500, 1), (450, 50)])
def test_light_that_has_just_come_into_a_memory_is_not_none(oldest_ns: int, age_ns: int) -> None:
    """An age of 0 says that a memory is empty."""
    memory = SwitchStatisticsReply.Memory(port=61_001, oldest_ns=oldest_ns)
    (counts,) = hardware._readings(SwitchStatisticsReply(memories=[memory]), 500).memories
    assert counts.oldest_ns == age_ns


def test_counts_of_analysers_are_read_field_by_field() -> None:
    counts = AnalyserCounts(*range(60_001, 60_013))
    analyser = SwitchStatisticsReply.Analyser(**vars(counts))
    reply = SwitchStatisticsReply(analysers=[analyser])
    assert hardware._readings(reply, 500).analysers == [counts]
