"""The properties of light besides its qubits, through fibres and a switch; 5 sigma, seed 1."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import grpc
import numpy as np
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
from noise_cases import within

from dispatcher.fiber.noise import Effect
from dispatcher.layer import pulses
from dispatcher.layer.layer import block_name
from dispatcher.layer.ownership import Block, Pulses
from dispatcher.operations.limits import MAX_EMISSION_S
from dispatcher.switch.timeline import REMEMBERED_NS
from wire.config import DispatcherConfig, PathOptics, QuantumSwitch
from wire.dispatcher_pb2 import AdjustFiberRequest, MeasureRequest
from wire.parameters.fiber import FiberOptics
from wire.parameters.physics import Device, PairSource

COUNT = 20_000
SECOND_NS = 1_000_000_000


def play(config: DispatcherConfig, scene: Callable[[Bench], Awaitable[Any]]) -> Any:
    """Run a scene on a network whose clock jumps; return what it returns."""

    async def run() -> Any:
        async with running(config, JumpingClock()) as bench:
            return await scene(bench)

    return uvloop.run(run())


def held(bench: Bench, node: str, number: int = 0, half: int = 0) -> Block:
    """Return a block that is at a node."""
    return bench.layer.ownership.require(block_name(block(number, half)), node)


async def send(
    bench: Bench, count: int = COUNT, number: int = 0, extras: int | None = None
) -> Block:
    """Send light from charlie by ports 1 and 3 to alice, with more photons in each pulse."""
    await bench.charlie.create(count, number=number)
    if extras is not None:
        for half in range(2):
            shared = np.full(count, extras, dtype=np.uint8)
            held(bench, "charlie", number, half).pulses.extras = shared
    await bench.charlie.send((block(number), "charlie-q0"))
    await bench.alice.receive(block(number), "alice-q0")
    return held(bench, "alice", number)


def test_extra_pairs_photons_come_through_as_likely_as_any_and_without_the_pulse_s_own(
    tmp_path: Path,
) -> None:
    async def scene(bench: Bench) -> None:
        await bench.switch.connect((1, 3))
        arrived = await send(bench, extras=3)
        passed = 10**-0.5  # two fibres of 1 dB, 3 dB in the switch
        extras, present = arrived.pulses.extras, arrived.register.present
        assert extras is not None
        assert within(int(present.sum()), passed, COUNT)
        assert within(int(extras.sum()), passed, 3 * COUNT)
        assert within(int(extras[present].sum()), passed, 3 * int(present.sum()))
        assert within(int(np.count_nonzero(extras == 0)), (1 - passed) ** 3, COUNT)
        left_behind = held(bench, "charlie", half=1).pulses.extras
        assert left_behind is not None
        assert (left_behind == 3).all()

    config = configuration(tmp_path, switches=[QuantumSwitch("q1", insertion_loss_db=3)])
    play(with_fibers(config, connectors_db=1.0), scene)


def test_pulses_arrive_whose_own_photons_are_all_lost(tmp_path: Path) -> None:
    async def scene(bench: Bench) -> None:
        await bench.switch.connect((1, 3))
        arrived = await send(bench, count=10, extras=255)
        assert arrived.register.remaining == 0
        assert arrived.pulses.extras is not None
        assert arrived.pulses.extras.any()
        first_ns = int(np.flatnonzero(arrived.pulses.extras)[0]) + 2 * DELAY_NS
        assert arrived.first_ns == bench.layer.history._events[2].time_ns + first_ns

    play(with_fibers(configuration(tmp_path), connectors_db=10.0), scene)


def test_light_that_nobody_lets_out_is_gone_with_all_its_photons(tmp_path: Path) -> None:
    async def scene(bench: Bench) -> None:
        await bench.charlie.create(10)
        held(bench, "charlie").pulses.extras = np.full(10, 2, dtype=np.uint8)
        await bench.charlie.send((block(), "charlie-q0"))
        assert "dark" in [event.kind for event in bench.layer.history._events]
        assert bench.layer.ownership.count == 1  # the other half

    play(configuration(tmp_path), scene)


@pytest.mark.parametrize("with_their_own", [True, False])
def test_extra_pairs_photons_go_the_way_that_was_open_and_meet_again(
    tmp_path: Path, with_their_own: bool
) -> None:
    async def run() -> None:
        clock = ManualClock()
        async with running(configuration(tmp_path), clock) as bench:

            async def later(call: Awaitable[Any], time_ns: int) -> Any:
                task = asyncio.ensure_future(call)
                await clock.waiters(1)
                await clock.set(time_ns)
                return await task

            await later(bench.switch.connect((1, 4), (2, 5)), START_NS + 101)
            await bench.charlie.create(1000)
            one = held(bench, "charlie")
            one.pulses.extras = np.arange(1000).astype(np.uint8)
            one.pulses.delays_ps = np.arange(1000.0)
            one.pulses.angles_rad = np.arange(1000.0)
            if not with_their_own:
                bench.layer.sabot.lose(one.register, np.ones(1000, dtype=bool))
            sending = asyncio.ensure_future(bench.charlie.send((block(), "charlie-q0")))
            await clock.waiters(2)
            await clock.set(START_NS + 101 + DELAY_NS + 500)
            switching = asyncio.ensure_future(bench.switch.connect((1, 5)))
            await clock.waiters(3)
            await clock.set(START_NS + 10_000)
            await asyncio.gather(sending, switching)
            await bench.transport.landed()
            for port, half in (("bob-q0", slice(0, 500)), ("bob-q1", slice(600, 1000))):
                part = bench.layer.ownership.at(block_name(block()), "bob", port)
                assert part is not None
                extras = part.pulses.extras
                assert extras is not None
                expected = np.zeros(1000, dtype=np.uint8)
                expected[half] = np.arange(1000)[half].astype(np.uint8)
                assert (extras == expected).all()
                await bench.bob.receive(block(), port)
            whole = held(bench, "bob").pulses
            assert whole.extras is not None
            assert whole.delays_ps is not None
            assert whole.angles_rad is not None
            there = pulses.lit(held(bench, "bob"))
            # A hundred came while it switched; without their own photons, 256 k have no light.
            assert there.sum() == (900 if with_their_own else 897)
            for found in (whole.extras, whole.delays_ps, whole.angles_rad):
                kept = found[there]
                assert (kept == np.arange(1000)[there].astype(found.dtype)).all()

    uvloop.run(run())


def test_angles_of_fibres_add_up_and_a_flip_turns_them_around(tmp_path: Path) -> None:
    async def scene(bench: Bench) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        await bench.switch.connect((1, 3))
        arrived = (await send(bench, count=1)).pulses
        assert not arrived.exact
        assert arrived.angles_rad is not None
        ways = [("charlie", "charlie-q0"), ("q1", "3")]
        met = [bench.layer.history.of_model(*way, "0 PhaseDrift").latest for way in ways]
        assert met[0] is not None
        assert met[1] is not None
        return np.array([arrived.angles_rad[0], met[0][1], met[1][1]])

    bins = {"charlie": Device(PairSource(encoding="time-bin"))}
    config = with_fibers(configuration(tmp_path, devices=bins), phase_drift_rad_per_sqrt_km=5.0)
    total, first, second = play(config, scene)
    assert first != second
    assert total == pytest.approx(first + second)
    flipping = QuantumSwitch("q1", paths=[PathOptics(1, 3, rotation=1)])
    total, first, second = play(
        configuration(tmp_path, switches=[flipping], fibers=config.fibers, devices=bins), scene
    )
    assert total == pytest.approx(second - first)


def test_a_flip_in_a_fibre_turns_the_angle_of_before_around(tmp_path: Path) -> None:
    async def scene(bench: Bench) -> None:
        await bench.switch.connect((1, 3))
        angles = (await send(bench)).pulses.angles_rad
        assert angles is not None
        first = bench.layer.history.of_model("charlie", "charlie-q0", "0 PhaseDrift").latest
        assert first is not None
        assert abs(first[1]) > 0.1
        assert np.abs(angles) == pytest.approx(abs(first[1]))
        turned = int(np.count_nonzero(angles == -first[1]))
        assert within(turned, 0.4, COUNT)  # X or XZ, each with a quarter of .8

    fibers = configuration(tmp_path).fibers
    drifting = [replace(fibers[0], phase_drift_rad_per_sqrt_km=10.0)]
    noisy = [replace(fiber, depolarizing=0.8) for fiber in fibers[1:]]
    bins = {"charlie": Device(PairSource(encoding="time-bin"))}
    play(configuration(tmp_path, fibers=drifting + noisy, devices=bins), scene)


def test_a_fibre_adds_to_those_pulses_alone_that_pass_it() -> None:
    light, members = Pulses(), np.array([True, False, True])
    for _ in range(2):
        pulses.pass_on(light, members, Effect(angles_rad=np.array([0.1, 0.2, 0.3])))
    assert light.angles_rad is not None
    assert light.angles_rad.tolist() == [0.2, 0.0, 0.6]


def test_a_pulse_has_no_more_photons_of_noise_than_a_byte_holds() -> None:
    few, many = (np.array(counts, np.uint8) for counts in ([1, 2, 3], [100, 200, 254]))
    light, members = Pulses(few), np.array([False, True, True])
    pulses.pass_on(light, members, Effect(extras=many))
    assert light.extras is not None
    assert light.extras.tolist() == [1, 202, 255]
    pulses.unite(light, Pulses(many), members)
    assert light.extras.tolist() == [101, 255, 255]


def test_parts_that_meet_keep_what_each_has_met() -> None:
    here = Pulses(np.array([1, 2, 3], dtype=np.uint8), delays_ps=np.array([1.0, 2.0, 3.0]))
    there = Pulses(
        np.array([0, 5, 0], dtype=np.uint8),
        delays_ps=np.array([10.0, 20.0, 30.0]),
        angles_rad=np.array([0.1, 0.2, 0.3]),
    )
    pulses.unite(here, there, np.array([False, True, False]))
    assert here.extras is not None
    assert here.delays_ps is not None
    assert here.angles_rad is not None
    assert here.extras.tolist() == [1, 7, 3]  # photons of one pulse that came different ways
    assert here.delays_ps.tolist() == [1.0, 20.0, 3.0]
    assert here.angles_rad.tolist() == [0.0, 0.2, 0.0]


def test_loss_and_pauli_noise_are_exact(tmp_path: Path) -> None:
    async def scene(bench: Bench) -> None:
        await bench.switch.connect((1, 3))
        light = (await send(bench)).pulses
        assert light.exact
        assert (light.extras, light.delays_ps, light.angles_rad) == (None, None, None)

    noise = {"connectors_db": 1.0, "depolarizing": 0.1, "burst_depolarizing": 0.5}
    play(with_fibers(configuration(tmp_path), **noise), scene)


def test_a_path_drifts_until_it_is_calibrated(tmp_path: Path) -> None:
    async def delay_ps(bench: Bench, number: int) -> float:
        delays = (await send(bench, count=1, number=number)).pulses.delays_ps
        assert delays is not None
        return float(delays[0])

    async def scene(bench: Bench) -> None:
        await bench.switch.connect((1, 3))
        assert await delay_ps(bench, 0) == 0
        assert isinstance(bench.layer.clock, JumpingClock)
        bench.layer.clock.time_ns += 10 * SECOND_NS
        assert await delay_ps(bench, 1) == pytest.approx(10 * 2 * 40.2, rel=1e-3)
        reply = await bench.runner.call(
            "AdjustFiber", AdjustFiberRequest(a="q1", b="charlie", calibrate=True)
        )
        assert reply.fibers == 2
        bench.layer.clock.time_ns += 5 * SECOND_NS
        assert await delay_ps(bench, 2) == pytest.approx((15 + 5) * 40.2, rel=1e-3)
        event = bench.layer.history._events
        assert ("charlie", "calibrate", "charlie-q0") in [(e.node, e.kind, e.port) for e in event]

    play(with_fibers(configuration(tmp_path), length_km=1, temperature_slope_k_per_s=1.0), scene)


def test_classical_light_is_turned_on_and_off_while_the_network_runs(tmp_path: Path) -> None:
    async def extras(bench: Bench, number: int) -> int:
        found = (await send(bench, number=number)).pulses.extras
        return 0 if found is None else int(found.sum())

    async def turn(bench: Bench, power_mw: float) -> None:
        request = AdjustFiberRequest(a="alice", b="q1", classical_mw=power_mw)
        assert (await bench.runner.call("AdjustFiber", request)).fibers == 1

    async def scene(bench: Bench) -> None:
        await bench.switch.connect((1, 3))
        assert await extras(bench, 0) == 0
        await turn(bench, 10.0)
        # As in test_noise.py, without its 2 dB: .0625 photons for each milliwatt.
        assert abs(await extras(bench, 1) - 0.625 * COUNT) < 5 * (0.625 * COUNT) ** 0.5 + 10
        await turn(bench, 0.0)
        assert await extras(bench, 2) == 0

    play(with_fibers(configuration(tmp_path), length_km=10), scene)


def test_who_taps_a_fibre_disturbs_both_bases_alike_until_gone(tmp_path: Path) -> None:
    """Intercept and resend of a fraction f in Z or X: one in four of those is wrong in either."""

    bases = MeasureRequest.Z, MeasureRequest.X

    async def wrong(bench: Bench, first: int) -> list[int]:
        counts = []
        for number, basis in enumerate(bases, first):
            await send(bench, number=number)
            ours = await bench.charlie.measure(block(number, 1), basis)
            theirs = await bench.alice.measure(block(number), basis)
            counts.append(sum(a != b for a, b in zip(ours.outcomes, theirs.outcomes, strict=True)))
        return counts

    async def tap(bench: Bench, fraction: float) -> None:
        request = AdjustFiberRequest(a="alice", b="q1", tapped=fraction)
        assert (await bench.runner.call("AdjustFiber", request)).fibers == 1

    async def scene(bench: Bench) -> None:
        await bench.switch.connect((1, 3))
        assert await wrong(bench, 0) == [0, 0]
        for number, fraction in enumerate((0.04, 0.4, 1.0), 1):
            await tap(bench, fraction)
            assert all(within(each, fraction / 4, COUNT) for each in await wrong(bench, 2 * number))
        await tap(bench, 0.0)
        assert await wrong(bench, 8) == [0, 0]

    play(configuration(tmp_path), scene)


@pytest.mark.parametrize(
    ("caller", "request_", "code", "text"),
    [
        ("alice", {"calibrate": True}, "PERMISSION_DENIED", "only runner may"),
        ("runner", {}, "INVALID_ARGUMENT", "name calibrate, classical_mw or tapped"),
        (
            "runner",
            {"calibrate": False},
            "INVALID_ARGUMENT",
            "name calibrate, classical_mw or tapped",
        ),
        ("runner", {"classical_mw": -1}, "INVALID_ARGUMENT", "classical_mw -1.0: choose 0 to 1000"),
        ("runner", {"classical_mw": float("nan")}, "INVALID_ARGUMENT", "nan: choose 0 to 1000"),
        ("runner", {"tapped": 1.5}, "INVALID_ARGUMENT", "tapped 1.5: choose 0 to 1"),
        ("runner", {"tapped": float("nan")}, "INVALID_ARGUMENT", "tapped nan: choose 0 to 1"),
        ("runner", {"a": "bob", "calibrate": True}, "NOT_FOUND", "bob is joined to alice, q1"),
        ("runner", {"a": "nobody", "calibrate": True}, "NOT_FOUND", "joined to nothing"),
    ],
)
def test_an_adjustment_that_cannot_be_is_refused(
    tmp_path: Path, caller: str, request_: dict[str, Any], code: str, text: str
) -> None:
    async def scene(bench: Bench) -> None:
        request = AdjustFiberRequest(**{"a": "alice", "b": "charlie", **request_})
        if "a" not in request_:
            request.b = "q1"
        with pytest.raises(grpc.aio.AioRpcError) as refused:
            await getattr(bench, caller).call("AdjustFiber", request)
        assert refused.value.code().name == code
        assert text in str(refused.value.details())
        assert not bench.layer.history._events

    play(configuration(tmp_path), scene)


def test_what_a_photon_meets_does_not_depend_on_how_its_block_was_divided(tmp_path: Path) -> None:
    noise = {"length_km": 1.0, "loss_db_per_km": 2.0, "depolarizing": 0.3, "dephasing": 0.2}
    config = with_fibers(configuration(tmp_path), **noise)
    count = 2000

    async def run(divided: bool) -> list[int]:
        """Send light to alice, or its second half to bob; measure the pairs' other halves."""
        clock = ManualClock()
        async with running(config, clock) as bench:
            connecting = asyncio.ensure_future(bench.switch.connect((1, 3)))
            await clock.waiters(1)
            await clock.set(START_NS + 101)
            await connecting
            await bench.charlie.create(count)
            sending = asyncio.ensure_future(bench.charlie.send((block(), "charlie-q0")))
            await clock.waiters(2)
            await clock.set(START_NS + 101 + 4902 + count // 2 - 100)
            await sending
            calls: list[asyncio.Future[Any]] = []
            if divided:
                calls.append(asyncio.ensure_future(bench.switch.connect((1, 4))))
                await clock.waiters(2)
            await clock.set(START_NS + SECOND_NS)
            await asyncio.gather(*calls)
            await bench.transport.landed()
            seen = np.full(count, 255)
            for client, port in ((bench.alice, "alice-q0"), (bench.bob, "bob-q0"))[: 1 + divided]:
                await client.receive(block(), port)
                outcomes = np.array(list((await client.measure(block())).outcomes))
                seen[outcomes != 255] = outcomes[outcomes != 255]
            other = np.array(list((await bench.charlie.measure(block(half=1))).outcomes))
            return [int(v) for v in np.where(seen == 255, 255, seen ^ other)]

    whole, parts = (np.array(uvloop.run(run(divided))) for divided in (False, True))
    dark = slice(count // 2 - 100, count // 2)  # while it switched
    assert (np.delete(whole, dark) == np.delete(parts, dark)).all()
    assert 0.3 < np.mean(whole == 255) < 0.7
    assert np.mean(whole == 1) > 0.05


def test_what_switches_remember_covers_the_longest_fibre_and_block() -> None:
    longest = FiberOptics(length_km=2_000)
    longest.check("the longest")
    assert MAX_EMISSION_S + longest.delay_s < REMEMBERED_NS / SECOND_NS
