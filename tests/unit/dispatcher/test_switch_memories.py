"""Memories of a switch: light waits there until a cross-connect leads it on, or ends by name."""

import asyncio
import math
from collections.abc import Awaitable, Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import grpc
import numpy as np
import pytest
import uvloop
from dispatcher_network import FAST_HZ, Bench, block, configuration, running
from limits import SOON_S
from test_switch_analysers import PAIRS, PatientClock, Scene, correlated

from wire.dispatcher_pb2 import (
    BellOutcomes,
    CreateRequest,
    EmitRequest,
    KeepRequest,
    MeasureRequest,
    TunePortRequest,
)
from wire.parameters.physics import BadParameter, Device, Memory, PairSource
from wire.parameters.switch import QuantumSwitch

FIRST, SECOND, ONE, TWO = 60_001, 60_002, 61_001, 61_002
STORING = (3, ONE), (4, TWO)  # alice's and bob's fibres
LEADING = (ONE, FIRST), (TWO, SECOND)
TRAIN_S = (PAIRS - 1) / FAST_HZ
SLOW_HZ = 500  # a block takes longer than the clock jumps


def play(
    folder: Path, act: Callable[[Scene], Awaitable[None]], sources: int = 0, **memory: Any
) -> None:
    """Run a scene on the network whose q1 has an analyser and two memories."""

    async def run() -> None:
        clock = PatientClock()
        q1 = QuantumSwitch("q1", analysers=1, sources=sources, memories=2, memory=Memory(**memory))
        async with running(replace(configuration(folder), switches=[q1]), clock) as bench:
            scene = Scene(bench, clock)
            await scene.reports.initial_metadata()
            await act(scene)
            await scene.require_empty()
            for node in ("q1-memory1", "q1-memory2"):
                assert not bench.layer.ownership.at_node(node)
            scene.reports.cancel()

    uvloop.run(run())


async def require_stored(scene: Scene, *ports: int) -> None:
    """Read the heralds of blocks that memories hold, in this order."""
    for port in ports:
        report = await scene.report()
        assert (report.port, report.end) == (port, BellOutcomes.STORED)
        assert report.outcomes == bytes(PAIRS)


async def states(scene: Scene) -> list[tuple[int, ...]]:
    """Return what is held, stored, released, cut off and refused at each memory."""
    found = (await scene.bench.switch.statistics()).memories
    assert [each.port for each in found] == [ONE, TWO]
    return [(each.held, each.stored, each.released, each.cut_off, each.refused) for each in found]


async def oldest(scene: Scene) -> list[int]:
    """Return when the first of what each memory holds came (ns), 0 of an empty one."""
    return [each.oldest_ns for each in (await scene.bench.switch.statistics()).memories]


async def swapped(scene: Scene) -> np.ndarray[Any, Any]:
    """Return the outcomes of a block that was measured."""
    report = await scene.report()
    assert (report.port, report.end) == (FIRST, BellOutcomes.MEASURED)
    return np.frombuffer(report.outcomes, np.uint8)


def agreement(folder: Path, basis: Any, wait_s: float, **memory: Any) -> tuple[float, int]:
    """Let both halves wait in memory, then swap; return how often ends agree, of how many pairs."""
    found: list[float] = []

    async def act(scene: Scene) -> None:
        await scene.bench.switch.connect(*STORING)
        await scene.emit_both()
        await require_stored(scene, ONE, TWO)
        assert await states(scene) == [(PAIRS, PAIRS, 0, 0, 0)] * 2
        came_ns = [b.start_ns for n in (1, 2) for b in at(scene, n)]
        assert await oldest(scene) == came_ns
        scene.clock.time_ns = sum(came_ns) // 2 + round(wait_s * 1e9)  # the sum is twice the wait
        await scene.bench.switch.connect(*STORING, *LEADING)
        report = await scene.report()
        assert (report.port, report.end) == (FIRST, BellOutcomes.MEASURED)
        assert report.waited_ns == round(wait_s * 1e9) + 100  # which the switch takes
        outcomes = np.frombuffer(report.outcomes, np.uint8)
        assert await states(scene) == [(0, PAIRS, PAIRS, 0, 0)] * 2
        assert await oldest(scene) == [0, 0]
        found.append(await correlated(scene, outcomes, basis))
        found.append(int(np.count_nonzero(outcomes != 255)))

    play(folder, act, **memory)
    return found[0], int(found[1])


def at(scene: Scene, memory: int) -> list[Any]:
    return scene.bench.layer.ownership.at_node(f"q1-memory{memory}")


@pytest.mark.parametrize("basis", [MeasureRequest.Z, MeasureRequest.X, MeasureRequest.Y])
def test_halves_that_have_waited_in_ideal_memories_swap(tmp_path: Path, basis: Any) -> None:
    assert agreement(tmp_path, basis, 1e-3) == (1, PAIRS)


def test_a_wait_dephases_and_loses_as_the_closed_forms_say(tmp_path: Path) -> None:
    # Two halves that dephase for t each keep X with (1 + exp(-2 t/T2))/2; both come out with
    # eta^2 exp(-2 t/T) (efficiency, and retrieval of time constant T).
    agreed, seen = agreement(
        tmp_path, MeasureRequest.X, 2e-3, t2_s=5e-3, efficiency=0.9, retrieval_s=10e-3
    )
    kept = 0.81 * math.exp(-0.4)
    assert abs(seen - kept * PAIRS) < 5 * math.sqrt(PAIRS * kept * (1 - kept))
    expected = (1 + math.exp(-0.8)) / 2
    assert abs(agreed - expected) < 5 * math.sqrt(expected * (1 - expected) / seen)


def test_the_first_half_waits_in_memory_for_the_second_which_need_not_wait(tmp_path: Path) -> None:
    # T1 alone: |1> falls with 1 - exp(-t/T1) during the wait of alice's halves.
    t1_s, wait_s, found = 5e-3, 4e-3, list[float]()

    async def act(scene: Scene) -> None:
        await scene.bench.switch.connect((3, ONE), (ONE, FIRST), (4, SECOND))
        await scene.emit(scene.bench.alice, "alice-q0", 0)
        (first,) = at(scene, 1)
        await require_stored(scene, ONE)
        scene.clock.time_ns = first.start_ns + round((wait_s - TRAIN_S) * 1e9)
        await scene.emit(scene.bench.bob, "bob-q0", 1)
        outcomes = await swapped(scene)
        found.append(await correlated(scene, outcomes, MeasureRequest.Z))

    play(tmp_path, act, t1_s=t1_s, t2_s=2 * t1_s)
    expected = (1 + math.exp(-wait_s / t1_s)) / 2
    assert abs(found[0] - expected) < 5 * math.sqrt(expected * (1 - expected) / PAIRS)


def test_blocks_leave_in_the_order_in_which_they_came(tmp_path: Path) -> None:
    async def act(scene: Scene) -> None:
        await scene.bench.switch.connect(*STORING, *LEADING)
        for number in (0, 2):
            await scene.emit(scene.bench.alice, "alice-q0", number)
        assert await states(scene) == [(2 * PAIRS, 2 * PAIRS, 0, 0, 0), (0, 0, 0, 0, 0)]
        await scene.emit(scene.bench.bob, "bob-q0", 1)
        await require_stored(scene, ONE, ONE, TWO)
        assert await correlated(scene, await swapped(scene), MeasureRequest.X) == 1
        assert (await states(scene))[0] == (PAIRS, 2 * PAIRS, PAIRS, 0, 0)
        await scene.bench.switch.connect(*STORING, (ONE, 4))  # to bob, whole
        feedback = await scene.bench.bob.receive(block(2, 1), "bob-q0")
        assert feedback.photons == PAIRS

    play(tmp_path, act)


NAMED = 0.3, 0.7  # of the pulses in each memory


@pytest.mark.parametrize("basis", [MeasureRequest.Z, MeasureRequest.X, MeasureRequest.Y])
def test_pulses_that_are_named_meet_without_gaps(tmp_path: Path, basis: Any) -> None:
    """The i-th named of one meets the i-th named of the other: ideal pairs, by enumeration."""

    async def act(scene: Scene) -> None:
        random = np.random.default_rng(1)
        await scene.bench.switch.connect(*STORING)
        await scene.emit_both()
        await require_stored(scene, ONE, TWO)
        named = [np.flatnonzero(random.random(PAIRS) < share) for share in NAMED]
        for port, pulses in zip((ONE, TWO), named, strict=True):
            await keep(scene, port, 1, pulses)
        await scene.bench.switch.connect(*STORING, *LEADING)
        outcomes = await swapped(scene)
        first, second = (pulses[: outcomes.size] for pulses in named)
        assert outcomes.size == min(pulses.size for pulses in named)
        paulis = np.zeros(PAIRS, np.uint8)
        paulis[second] = outcomes
        await scene.bench.bob.apply(block(1), paulis.tobytes())
        one = await scene.bench.alice.measure(block(0), basis)
        other = await scene.bench.bob.measure(block(1), basis)
        a = np.frombuffer(one.outcomes, np.uint8)[first]
        b = np.frombuffer(other.outcomes, np.uint8)[second]
        assert ((a == b) != (basis == MeasureRequest.Y)).all()

    play(tmp_path, act)


def test_two_blocks_of_which_one_has_no_pulse_left_meet_all_the_same(tmp_path: Path) -> None:
    async def act(scene: Scene) -> None:
        await scene.bench.switch.connect(*STORING)
        await scene.emit_both()
        await require_stored(scene, ONE, TWO)
        with pytest.raises(grpc.aio.AioRpcError, match="no 2000 pulses of number 2 are in"):
            await keep(scene, ONE, 2, np.arange(0))
        await keep(scene, ONE, 1, np.arange(0))
        await keep(scene, TWO, 1, np.arange(PAIRS))
        await scene.bench.switch.connect(*STORING, *LEADING)
        assert not (await swapped(scene)).size

    play(tmp_path, act)


def test_a_memory_of_which_a_block_was_named_keeps_later_ones_until_they_are(
    tmp_path: Path,
) -> None:
    async def act(scene: Scene) -> None:
        everything = np.arange(PAIRS)
        await scene.bench.switch.connect(*STORING, *LEADING)
        await scene.emit(scene.bench.alice, "alice-q0", 0)
        await require_stored(scene, ONE)
        await keep(scene, ONE, 1, everything)
        await scene.emit(scene.bench.bob, "bob-q0", 1)
        await require_stored(scene, TWO)
        assert (await swapped(scene)).size == PAIRS
        await scene.emit(scene.bench.alice, "alice-q0", 2)
        await scene.emit(scene.bench.bob, "bob-q0", 3)
        await require_stored(scene, ONE, TWO)
        assert [each[0] for each in await states(scene)] == [PAIRS, PAIRS]
        await keep(scene, ONE, 2, everything)
        assert (await swapped(scene)).size == PAIRS

    play(tmp_path, act)


def test_a_memory_into_which_no_light_is_led_any_more_forgets_that_blocks_were_named(
    tmp_path: Path,
) -> None:
    async def act(scene: Scene) -> None:
        await scene.bench.switch.connect(*STORING, *LEADING)
        for host, port, number in (
            (scene.bench.alice, "alice-q0", 0),
            (scene.bench.bob, "bob-q0", 1),
        ):
            await scene.emit(host, port, number)
        await require_stored(scene, ONE, TWO)
        await swapped(scene)
        await scene.emit(scene.bench.alice, "alice-q0", 2)
        await require_stored(scene, ONE)
        await keep(scene, ONE, 2, np.arange(PAIRS))
        await scene.emit(scene.bench.bob, "bob-q0", 3)
        await require_stored(scene, TWO)
        assert (await swapped(scene)).size == PAIRS
        await scene.bench.switch.connect()
        await scene.bench.switch.connect(*STORING, *LEADING)
        await scene.emit(scene.bench.alice, "alice-q0", 4)
        await scene.emit(scene.bench.bob, "bob-q0", 5)
        await require_stored(scene, ONE, TWO)
        assert (await swapped(scene)).size == PAIRS

    play(tmp_path, act)


async def keep(scene: Scene, port: int, number: int, pulses: np.ndarray[Any, Any]) -> None:
    unwanted = np.full(PAIRS, 255, np.uint8)
    unwanted[pulses] = 0
    request = KeepRequest(switch="q1", port=port, number=number, outcomes=unwanted.tobytes())
    await scene.bench.switch.call("Keep", request)


@pytest.mark.parametrize(("method", "outcome"), [(1, 0), (6, 0), (9, 0), (0, 12), (2, 254)])
def test_methods_and_outcomes_that_no_frame_has_are_refused(
    tmp_path: Path, method: int, outcome: int
) -> None:
    async def act(scene: Scene) -> None:
        request = KeepRequest(switch="q1", port=ONE, number=1, method=method)
        request.outcomes = bytes([outcome])
        with pytest.raises(grpc.aio.AioRpcError, match=f"method {method} or an outcome"):
            await scene.bench.switch.call("Keep", request)

    play(tmp_path, act)


def test_light_that_nothing_releases_or_that_finds_no_room_ends_by_name(tmp_path: Path) -> None:
    async def act(scene: Scene) -> None:
        await scene.bench.switch.connect(*STORING)
        await scene.emit(scene.bench.alice, "alice-q0", 0)
        await scene.emit(scene.bench.alice, "alice-q0", 2)
        await require_stored(scene, ONE)
        report = await scene.report()
        assert (report.port, report.end, report.photons) == (ONE, BellOutcomes.UNFIT, PAIRS)
        scene.clock.over.set()
        report = await scene.report()
        assert (report.port, report.end, report.number) == (ONE, BellOutcomes.CUT_OFF, 3)
        assert (await states(scene))[0] == (0, PAIRS, 0, PAIRS, PAIRS)

    play(tmp_path, act, capacity=PAIRS + 1)


def test_pairs_of_a_switch_join_the_halves_of_two_hosts(tmp_path: Path) -> None:
    # Three Werner links: (4 F - 1)/3 = w^3, and Werner pairs agree with (2 F + 1)/3.
    werner, found = 0.9, list[float]()
    source = PairSource(fidelity=werner)

    async def run() -> None:
        q1 = QuantumSwitch("q1", analysers=2, memories=4, sources=1, source=source)
        hosts = dict.fromkeys(("alice", "bob"), Device(source=source))
        config = configuration(tmp_path, switches=[q1], devices=hosts)
        async with running(config, PatientClock()) as bench:
            scene = Scene(bench, PatientClock())
            await scene.reports.initial_metadata()
            memories = ONE, TWO, 61_003, 61_004
            inputs = FIRST, SECOND, 60_003, 60_004
            fed = (3, ONE), (62_001, TWO), (62_002, 61_003), (4, 61_004)
            await bench.switch.connect(*fed, *zip(memories, inputs, strict=True))
            await scene.emit_both()
            await emit(bench, session=8, number=1)
            await bench.transport.landed()
            reports = [await scene.report() for _ in range(6)]
            first, second = (
                np.frombuffer(each.outcomes, np.uint8)
                for each in reports
                if each.end == BellOutcomes.MEASURED
            )
            await bench.runner.inject(failed=62_001)
            for wrong in ({"port": ONE}, {"rate_hz": 0}, {}):
                with pytest.raises(grpc.aio.AioRpcError):
                    await emit(bench, session=8, number=2, **wrong)
            found.append(await correlated(scene, first ^ second, MeasureRequest.Y))
            await scene.require_empty()

    uvloop.run(run())
    fidelity = (1 + 3 * ((4 * werner - 1) / 3) ** 3) / 4
    expected = (2 * fidelity + 1) / 3
    assert abs(found[0] - expected) < 5 * math.sqrt(expected * (1 - expected) / PAIRS)


def test_light_of_a_source_leaves_behind_that_of_the_block_before(tmp_path: Path) -> None:
    """A short block does not pass a long one."""

    async def run() -> None:
        q1, clock = QuantumSwitch("q1", analysers=1, memories=2, sources=1), PatientClock()
        async with running(configuration(tmp_path, switches=[q1]), clock) as bench:
            scene = Scene(bench, clock)
            await scene.reports.initial_metadata()
            await bench.switch.connect((62_001, ONE))
            counts = PAIRS, PAIRS // 10, 1
            for number, count in enumerate(counts, 1):
                await emit(bench, session=8, number=number, count=count, rate_hz=SLOW_HZ)
            clock.over.set()
            stored: list[int] = []
            while len(stored) < len(counts):
                report = await scene.report()
                if report.end == BellOutcomes.STORED:  # or let go of, as the clock has jumped
                    stored.append(report.photons)
            assert stored == list(counts)
            scene.reports.cancel()

    uvloop.run(run())


async def emit(bench: Bench, **request: int) -> None:
    """Have the source of q1 emit."""
    fields = {"port": 62_002, "count": PAIRS, "rate_hz": FAST_HZ, **request}
    await bench.switch.call("Emit", EmitRequest(switch="q1", **fields))


@pytest.mark.parametrize("basis", [MeasureRequest.Z, MeasureRequest.X, MeasureRequest.Y])
def test_a_qubit_that_waits_in_a_memory_is_teleported_to_a_host(tmp_path: Path, basis: Any) -> None:
    """Two entries lead it, and a half of the switch's own pairs, to the analyser."""
    bits = np.random.default_rng(5).integers(0, 2, PAIRS, np.uint8)
    first = {MeasureRequest.Z: 0, MeasureRequest.X: 2, MeasureRequest.Y: 4}[basis]
    seen = list[np.ndarray[Any, Any]]()

    async def act(scene: Scene) -> None:
        alice, bob, switch = scene.bench.alice, scene.bench.bob, scene.bench.switch
        pairs = (62_001, TWO), (62_002, 4)
        await switch.connect((3, ONE), *pairs)
        states = (bits + np.uint8(first)).tobytes()
        prepared = CreateRequest(
            session=7, count=PAIRS, state=CreateRequest.PREPARED, states=states
        )
        await alice.act(prepared)
        await alice.send((block(0), "alice-q0"))
        await require_stored(scene, ONE)
        await emit(scene.bench, port=62_001, session=9)
        await require_stored(scene, TWO)
        await bob.receive(block(0, 1, 9), "bob-q0")
        await switch.connect((3, ONE), *pairs, *LEADING)
        await bob.apply(block(0, 1, 9), (await swapped(scene)).tobytes())
        measured = await bob.measure(block(0, 1, 9), basis)
        seen.append(np.frombuffer(measured.outcomes, np.uint8))

    play(tmp_path, act, sources=1)
    assert np.array_equal(seen[0], bits)


def test_light_in_parts_that_fail_ends_by_name_until_they_are_repaired(tmp_path: Path) -> None:
    async def act(scene: Scene) -> None:
        runner = scene.bench.runner
        await scene.bench.switch.connect((3, ONE), (4, SECOND))
        await scene.emit_both()
        await require_stored(scene, ONE)
        for port, at_port in ((ONE, ONE), (SECOND, FIRST)):
            await runner.inject(failed=port)
            report = await scene.report()
            assert (report.port, report.end) == (at_port, BellOutcomes.FAILED)
        for number, host, port in ((2, "alice", ONE), (3, "bob", FIRST)):
            await scene.emit(getattr(scene.bench, host), f"{host}-q0", number)
            report = await scene.report()
            assert (report.port, report.end) == (port, BellOutcomes.FAILED)
        await runner.inject(repair=True)
        await scene.bench.switch.connect((3, FIRST), (4, SECOND))
        await scene.emit(scene.bench.alice, "alice-q0", 4)
        await scene.emit(scene.bench.bob, "bob-q0", 5)
        assert (await swapped(scene)).size == PAIRS
        with pytest.raises(grpc.aio.AioRpcError, match="port 5 of q1 is not an inner port"):
            await runner.inject(failed=5)

    play(tmp_path, act)


def test_a_cut_off_can_be_set_and_is_of_memories_alone(tmp_path: Path) -> None:
    async def act(scene: Scene) -> None:
        await scene.bench.switch.connect(*STORING)
        set_it = TunePortRequest(switch="q1", port=ONE, cutoff_s=0.5)
        await scene.bench.switch.call("TunePort", set_it)  # the clock jumps over less than 1 s
        await scene.emit(scene.bench.alice, "alice-q0", 0)
        await require_stored(scene, ONE)
        await require_cut_off(scene)
        for port, cutoff_s in ((3, 0.5), (FIRST, 0.5), (ONE, 0.0), (ONE, math.nan)):
            wrong = TunePortRequest(switch="q1", port=port, cutoff_s=cutoff_s)
            with pytest.raises(grpc.aio.AioRpcError, match="give more than 0 s to a memory"):
                await scene.bench.switch.call("TunePort", wrong)

    play(tmp_path, act)


def test_photons_that_are_too_old_when_the_last_has_come_are_counted_as_cut_off(
    tmp_path: Path,
) -> None:
    async def act(scene: Scene) -> None:
        await scene.bench.switch.connect(*STORING)
        set_it = TunePortRequest(switch="q1", port=ONE, cutoff_s=TRAIN_S / 2)
        await scene.bench.switch.call("TunePort", set_it)
        await scene.emit(scene.bench.alice, "alice-q0", 0)
        report = await scene.report()
        assert (report.end, report.outcomes[0]) == (BellOutcomes.STORED, 255)
        await require_cut_off(scene)

    play(tmp_path, act)


async def require_cut_off(scene: Scene) -> None:
    """Fail unless the first memory drops all of a block, which ends 5 s after it came."""
    await until_cut_off(scene)
    scene.clock.over.set()
    assert (await scene.report()).end == BellOutcomes.CUT_OFF


async def until_cut_off(scene: Scene) -> None:
    async with asyncio.timeout(SOON_S):
        while (await states(scene))[0] != (0, PAIRS, 0, PAIRS, 0):
            await asyncio.sleep(0.005)


def test_a_block_that_is_cut_off_is_swapped_in_its_turn_as_no_pulse(tmp_path: Path) -> None:
    async def act(scene: Scene) -> None:
        bench, connections = scene.bench, [*STORING]
        for number, cutoff_s in enumerate((0.5, 9.0)):
            tune = TunePortRequest(switch="q1", port=ONE, cutoff_s=cutoff_s)
            await bench.switch.call("TunePort", tune)
            await bench.switch.connect(*connections)
            await scene.emit(bench.alice, "alice-q0", 2 * number)
            await require_stored(scene, ONE)
            if not number:
                await until_cut_off(scene)
            await scene.emit(bench.bob, "bob-q0", 2 * number + 1)
            await require_stored(scene, TWO)
            for port in (ONE, TWO):
                await keep(scene, port, number + 1, np.arange(PAIRS))
            connections = [*STORING, *LEADING]
            await bench.switch.connect(*connections)
            outcomes = await swapped(scene)
            assert (outcomes.size, 255 in outcomes) == (PAIRS * number, False)

    play(tmp_path, act)


def test_memories_that_no_switch_has_are_refused() -> None:
    with pytest.raises(BadParameter, match="without memories has no effect; give memories=1"):
        QuantumSwitch("q1", memory=Memory(capacity=5)).check()
    for wrong in (Memory(kind="emissive"), Memory(false_herald=0.1), Memory(capacity=0)):
        with pytest.raises(BadParameter, match="memories take in light or emit, and tell"):
            QuantumSwitch("q1", memories=1, memory=wrong).check()
    with pytest.raises(BadParameter, match="memories have no noise models of one's own"):
        QuantumSwitch("q1", memories=1, memory=Memory(noise="mine.py:Mine")).check()
    with pytest.raises(BadParameter, match="source without sources has no effect; give sources=1"):
        QuantumSwitch("q1", source=PairSource(fidelity=0.9)).check()
    with pytest.raises(BadParameter, match="q1, sources make pairs"):
        QuantumSwitch("q1", sources=1, source=PairSource(statistics="none")).check()
