"""Light in a quantum switch, over a real gRPC server with real clients."""

import asyncio
import math
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest
import uvloop
from dispatcher_network import (
    DELAY_NS,
    START_NS,
    Bench,
    JumpingClock,
    ManualClock,
    block,
    configuration,
    running,
    with_fibers,
)

from dispatcher.layer.layer import block_name
from dispatcher.switch.timeline import REMEMBERED_NS
from wire.config import DispatcherConfig, PathOptics, QuantumSwitch
from wire.dispatcher_pb2 import Connection, SwitchStatisticsReply, TunePortRequest
from wire.optical import DEFAULT_FREQUENCY_MHZ

GRID_MHZ = 50_000
OPEN_NS = START_NS + 101  # the switch has switched
AT_SWITCH_NS = OPEN_NS + DELAY_NS  # the first photon has arrived


def play(config: DispatcherConfig, scene: Callable[[Bench], Awaitable[None]]) -> None:
    """Run a scene on a network whose clock jumps."""

    async def run() -> None:
        async with running(config, JumpingClock()) as bench:
            await scene(bench)

    uvloop.run(run())


def optics(folder: Path, **changes: Any) -> DispatcherConfig:
    """Return the network with other optics in its switch."""
    return configuration(folder, switches=[QuantumSwitch("q1", **changes)])


def within(found: int, count: int, probability: float) -> bool:
    """Return whether a count is what a probability lets expect, within 5 sigma."""
    sigma = math.sqrt(count * probability * (1 - probability))
    return abs(found - count * probability) < 5 * sigma


def port(statistics: SwitchStatisticsReply, number: int) -> tuple[int, int, int]:
    """Return photons in, out and lost of a port."""
    (found,) = [port for port in statistics.ports if port.port == number]
    return found.photons_in, found.photons_out, found.photons_lost


async def clicks(bench: Bench, count: int, number: int, frequency_mhz: int = 0) -> int:
    """Send light from charlie by ports 1 and 3 to alice; return how much has come."""
    await bench.charlie.create(count, number=number)
    await bench.charlie.send((block(number), "charlie-q0"), frequency_mhz=frequency_mhz)
    name = block_name(block(number))
    if not [part for part in bench.layer.ownership.parts(name) if part.port]:
        return 0
    await bench.alice.receive(block(number), "alice-q0")
    return (await bench.alice.measure(block(number))).clicks


def test_each_path_has_its_own_loss_and_rotation(tmp_path: Path) -> None:
    async def scene(bench: Bench) -> None:
        await bench.switch.connect((1, 3), (2, 4))
        await bench.charlie.create(10_000)
        await bench.charlie.send((block(half=0), "charlie-q0"), (block(half=1), "charlie-q1"))
        await bench.alice.receive(block(half=0), "alice-q0")
        await bench.bob.receive(block(half=1), "bob-q0")
        ours = await bench.alice.measure(block(half=0))
        theirs = await bench.bob.measure(block(half=1))
        assert within(ours.clicks, 10_000, 10**-0.3)
        assert within(theirs.clicks, 10_000, 10**-0.1)
        both = [
            pair for pair in zip(ours.outcomes, theirs.outcomes, strict=True) if 255 not in pair
        ]
        assert len(both) > 3000
        assert all(one != other for one, other in both)  # one path flips

    path = PathOptics(1, 3, insertion_loss_db=3.0, rotation=1)
    play(optics(tmp_path, insertion_loss_db=1.0, paths=[path]), scene)


def test_ports_and_circuits_count_photons(tmp_path: Path) -> None:
    async def scene(bench: Bench) -> None:
        ready_ns = await bench.switch.connect((1, 3), circuit=5)
        passed = await clicks(bench, 1000, 0)
        statistics = await bench.switch.statistics()
        assert 0 < passed < 1000
        assert port(statistics, 1) == (1000, 0, 1000 - passed)
        assert port(statistics, 3) == (0, passed, 0)
        assert port(statistics, 2) == (0, 0, 0)
        (circuit,) = statistics.circuits
        assert (circuit.circuit, circuit.photons, circuit.since_ns) == (5, passed, ready_ns)
        assert AT_SWITCH_NS < circuit.last_ns <= AT_SWITCH_NS + 999
        assert (await bench.runner.statistics()) == statistics

    play(optics(tmp_path, insertion_loss_db=3.0), scene)


def test_light_at_a_dark_port_came_in_and_was_lost(tmp_path: Path) -> None:
    async def scene(bench: Bench) -> None:
        assert await clicks(bench, 100, 0) == 0
        assert port(await bench.switch.statistics(), 1) == (100, 0, 100)

    play(configuration(tmp_path), scene)


async def change_in_the_middle(
    bench: Bench, clock: ManualClock, change: Callable[[], Awaitable[Any]], waits: bool
) -> None:
    """Send 1000 photons by circuit 5, and change something when 500 have passed."""
    connecting = asyncio.ensure_future(bench.switch.connect((1, 3), circuit=5))
    await clock.waiters(1)
    await clock.set(OPEN_NS)
    await connecting
    await bench.charlie.create(1000)
    sending = asyncio.ensure_future(bench.charlie.send((block(), "charlie-q0")))
    await clock.waiters(2)
    await clock.set(AT_SWITCH_NS + 500)
    changing = asyncio.ensure_future(change())
    if waits:
        await clock.waiters(3)
    else:
        await changing
    await clock.set(AT_SWITCH_NS + 10_000)
    await asyncio.gather(changing, sending)
    await bench.transport.landed()


def test_photons_of_a_circuit_count_also_after_it_has_closed(tmp_path: Path) -> None:
    async def run() -> None:
        clock = ManualClock()
        async with running(configuration(tmp_path), clock) as bench:
            await change_in_the_middle(bench, clock, bench.switch.connect, waits=True)
            (circuit,) = (await bench.switch.statistics()).circuits
            assert (circuit.photons, circuit.last_ns) == (500, AT_SWITCH_NS + 499)
            await clock.set(AT_SWITCH_NS + 500 + REMEMBERED_NS + 1)
            assert not (await bench.switch.statistics()).circuits

    uvloop.run(run())


def test_a_path_that_stays_is_not_interrupted_by_a_new_circuit(tmp_path: Path) -> None:
    async def run() -> None:
        clock = ManualClock()
        async with running(configuration(tmp_path), clock) as bench:
            await change_in_the_middle(
                bench, clock, lambda: bench.switch.connect((1, 3), circuit=6), waits=True
            )
            statistics = await bench.switch.statistics()
            counts = {circuit.circuit: circuit.photons for circuit in statistics.circuits}
            assert counts == {5: 500, 6: 500}
            assert port(statistics, 3) == (0, 1000, 0)

    uvloop.run(run())


def test_ports_on_different_wavelengths_do_not_connect(tmp_path: Path) -> None:
    other_mhz = DEFAULT_FREQUENCY_MHZ + GRID_MHZ

    async def scene(bench: Bench) -> None:
        await bench.switch.connect((1, 3))
        await bench.switch.tune(1, other_mhz)
        assert await clicks(bench, 10, 0) == 0
        assert await clicks(bench, 10, 1, other_mhz) == 0
        await bench.switch.tune(3, other_mhz)
        assert await clicks(bench, 10, 2) == 0
        assert await clicks(bench, 10, 3, other_mhz) == 10
        assert await clicks(bench, 10, 4, other_mhz + GRID_MHZ // 2 - 1) == 10
        assert await clicks(bench, 10, 5, other_mhz + GRID_MHZ // 2) == 0
        statistics = await bench.switch.statistics()
        assert port(statistics, 1) == (60, 0, 40)
        assert statistics.ports[0].frequency_mhz == other_mhz

    play(configuration(tmp_path), scene)


def test_each_direction_of_a_port_has_a_filter_of_its_own(tmp_path: Path) -> None:
    other_mhz = DEFAULT_FREQUENCY_MHZ + GRID_MHZ

    async def scene(bench: Bench) -> None:
        await bench.switch.connect((1, 3))
        # Charlie's light comes in by port 1 and leaves by port 3.
        await bench.switch.tune(1, other_mhz, direction=TunePortRequest.TRANSMIT)
        await bench.switch.tune(3, other_mhz, direction=TunePortRequest.RECEIVE)
        assert await clicks(bench, 10, 0) == 10
        await bench.switch.tune(1, other_mhz, direction=TunePortRequest.RECEIVE)
        await bench.switch.tune(3, other_mhz, direction=TunePortRequest.TRANSMIT)
        await bench.switch.tune(3, DEFAULT_FREQUENCY_MHZ, direction=TunePortRequest.RECEIVE)
        assert await clicks(bench, 10, 1, other_mhz) == 10
        third = (await bench.switch.statistics()).ports[2]
        assert third.port == 3
        tuned = third.frequency_mhz, third.rx_frequency_mhz
        assert tuned == (other_mhz, DEFAULT_FREQUENCY_MHZ)

    play(configuration(tmp_path), scene)


def test_light_is_judged_by_the_tuning_of_its_moment(tmp_path: Path) -> None:
    async def run() -> None:
        clock = ManualClock()
        async with running(configuration(tmp_path), clock) as bench:
            await change_in_the_middle(
                bench, clock, lambda: bench.switch.tune(3, DEFAULT_FREQUENCY_MHZ + GRID_MHZ), False
            )
            assert port(await bench.switch.statistics(), 3) == (0, 500, 0)
            await bench.alice.receive(block(), "alice-q0")
            outcomes = (await bench.alice.measure(block())).outcomes
            assert [value != 255 for value in outcomes] == [True] * 500 + [False] * 500

    uvloop.run(run())


def test_a_port_with_less_power_attenuates_what_leaves_there(tmp_path: Path) -> None:
    async def scene(bench: Bench) -> None:
        await bench.switch.connect((1, 3))
        await bench.switch.tune(1, power_dbm=-10)  # nothing leaves there
        assert await clicks(bench, 1000, 0) == 1000
        await bench.switch.tune(3, power_dbm=-3)
        assert within(await clicks(bench, 10_000, 1), 10_000, 10**-0.3)
        first, _second, third, *_rest = (await bench.switch.statistics()).ports
        assert (first.power_dbm, third.power_dbm) == (-10.0, -3.0)
        assert (first.bias_ma, third.bias_ma) == pytest.approx((11.0, 10 + 10 * 10**-0.3))

    play(configuration(tmp_path), scene)


def test_received_power_is_what_the_far_end_launches_less_the_fibre(tmp_path: Path) -> None:
    async def scene(bench: Bench) -> None:
        for found in (await bench.switch.statistics()).ports:
            assert found.rx_power_dbm == pytest.approx(-0.4)

    play(with_fibers(configuration(tmp_path), length_km=2, loss_db_per_km=0.2), scene)


def test_crosstalk_sends_photons_to_other_outputs_in_use(tmp_path: Path) -> None:
    count = 40_000

    async def scene(bench: Bench) -> None:
        await bench.switch.connect((1, 3), (2, 4), circuit=1)
        assert await clicks(bench, count, 0) < count
        stray = port(await bench.switch.statistics(), 4)[1]
        assert within(stray, count, 0.1)
        statistics = await bench.switch.statistics()
        assert port(statistics, 1) == (count, 0, 0)
        assert port(statistics, 3) == (0, count - stray, 0)
        assert port(statistics, 5) == (0, 0, 0)
        assert statistics.circuits[0].photons == count - stray  # strays are in no circuit
        await bench.switch.connect((1, 3), (2, 4), (3, 5))
        await clicks(bench, count, 1)
        statistics = await bench.switch.statistics()
        assert within(port(statistics, 4)[1] - stray, count, 0.05)
        assert within(port(statistics, 5)[1], count, 0.05)

    play(optics(tmp_path, crosstalk_db=10.0), scene)


def test_a_lonely_path_loses_its_crosstalk_into_dark_ports(tmp_path: Path) -> None:
    async def scene(bench: Bench) -> None:
        await bench.switch.connect((1, 3))
        count = 40_000
        left = await clicks(bench, count, 0)
        assert within(left, count, 0.9)
        statistics = await bench.switch.statistics()
        assert port(statistics, 1) == (count, 0, count - left)
        assert port(statistics, 4) == (0, 0, 0)

    play(optics(tmp_path, crosstalk_db=10.0), scene)


def test_a_stray_photon_undergoes_the_path_that_it_really_takes(tmp_path: Path) -> None:
    async def scene(bench: Bench) -> None:
        await bench.switch.connect((1, 3), (2, 4))
        await bench.charlie.create(10_000)
        await bench.charlie.send((block(), "charlie-q0"))
        await bench.bob.receive(block(), "bob-q0")
        ours = (await bench.bob.measure(block())).outcomes
        theirs = (await bench.charlie.measure(block(half=1))).outcomes
        both = [pair for pair in zip(ours, theirs, strict=True) if 255 not in pair]
        assert within(len(both), 10_000, 0.5 * 10**-0.3)
        assert all(one != other for one, other in both)

    path = PathOptics(1, 4, insertion_loss_db=3.0, rotation=1)
    play(optics(tmp_path, crosstalk_db=3.0103, paths=[path]), scene)


def test_a_hot_switch_loses_more_on_every_path(tmp_path: Path) -> None:
    async def scene(bench: Bench) -> None:
        await bench.switch.connect((1, 3))
        await bench.runner.inject(temperature_c=60.0)
        assert await clicks(bench, 1000, 0) == 1000
        await bench.runner.inject(temperature_c=60.5)
        assert within(await clicks(bench, 10_000, 1), 10_000, 10**-0.3)
        assert (await bench.switch.statistics()).temperature_c == 60.5
        await bench.runner.inject(repair=True)
        assert await clicks(bench, 1000, 2) == 1000

    play(configuration(tmp_path), scene)


def test_heat_takes_nothing_from_light_that_has_passed(tmp_path: Path) -> None:
    async def run() -> None:
        clock = ManualClock()
        async with running(optics(tmp_path, hot_loss_db=100.0), clock) as bench:
            await change_in_the_middle(
                bench, clock, lambda: bench.runner.inject(temperature_c=80.0), False
            )
            assert port(await bench.switch.statistics(), 3) == (0, 500, 0)

    uvloop.run(run())


def test_a_stuck_cross_connect_is_made_and_stays(tmp_path: Path) -> None:
    async def scene(bench: Bench) -> None:
        await bench.switch.connect((1, 4), (2, 3))
        await bench.runner.inject(stuck=Connection(in_port=1, out_port=3, circuit=8))
        open_now = bench.layer.network.switches["q1"].timeline
        assert open_now.connections == {1: 3}
        await bench.switch.connect((2, 4))
        assert open_now.connections == {1: 3, 2: 4}
        assert await clicks(bench, 10, 0) == 10
        await bench.switch.connect((1, 3), circuit=9)
        assert await clicks(bench, 10, 1) == 10
        counts = {c.circuit: c.photons for c in (await bench.switch.statistics()).circuits}
        assert counts == {0: 0, 8: 10, 9: 10}

    play(configuration(tmp_path), scene)


def test_a_repaired_switch_does_what_it_was_told_last(tmp_path: Path) -> None:
    async def scene(bench: Bench) -> None:
        await bench.switch.connect((1, 4), (2, 5), circuit=3)
        await bench.runner.inject(stuck=Connection(in_port=1, out_port=3))
        await bench.runner.inject(repair=True)
        timeline = bench.layer.network.switches["q1"].timeline
        assert timeline.connections == {1: 4, 2: 5}
        assert timeline.open_circuits == {1: 3, 2: 3}
        kinds = [(e.kind, e.detail) for e in bench.layer.history._events]
        assert [detail for kind, detail in kinds if kind == "fault"] == ["stuck 1 -> 3", "repaired"]

    play(configuration(tmp_path), scene)


def test_tuning_goes_into_the_history(tmp_path: Path) -> None:
    async def scene(bench: Bench) -> None:
        await bench.switch.tune(3, DEFAULT_FREQUENCY_MHZ + GRID_MHZ, -2.5)
        event = bench.layer.history._events[-1]
        assert (event.node, event.kind, event.port) == ("q1", "tune", "3")
        assert event.detail == "193450000 MHz -2.5 dBm"

    play(configuration(tmp_path), scene)
