"""The cut-off of memories, beside sums over geometric gaps; 5 standard errors, seed 1."""

from collections.abc import Awaitable, Callable
from typing import Any

import numpy as np
import pytest
import uvloop
from five_sigma import within
from heralding_scene import FIRST, PORTS, SECOND, attempted

from dispatcher.refusal import Refusal
from evidence.laboratory import Laboratory
from wire.config import DispatcherConfig, Fiber, FiberEnd
from wire.dispatcher_pb2 import BellOutcomes, MeasureRequest
from wire.outcomes import NO_CLICK
from wire.parameters.physics import BellAnalyser, Device, Emitter, Memory
from wire.parameters.switch import QuantumSwitch

X = MeasureRequest.X
EFFICIENCY = 0.6
CHANCE = EFFICIENCY**2 / 2  # of an attempt: Barrett and Kok
ATTEMPT_S = 1e-3
PSI_MINUS = 3
PAIRS, RATE_HZ = 100, 1_000
CUTOFF_S = 0.0405  # 41 of them have come within it, of those at 1 kHz: 0 to 40 ms ago
YOUNG = np.arange(PAIRS) >= PAIRS - 41


def scene(act: Callable[[Laboratory], Awaitable[None]], **memory: Any) -> None:
    """Let something happen to alice and bob, with a fibre between them and to a station in q1."""
    emitter = Emitter("two-click", EFFICIENCY, preparation_s=ATTEMPT_S)
    device = Device(memory=Memory(**memory), emitter=emitter)

    async def inside() -> None:
        ends = {("alice", "alice-q0"): ("q1", "1"), ("bob", "bob-q0"): ("q1", "2")}
        ends["alice", "alice-q1"] = "bob", "bob-q1"
        fibers = [
            Fiber(FiberEnd(*one), FiberEnd(*other), length_km=0.01) for one, other in ends.items()
        ]
        switch = QuantumSwitch("q1", analysers=1, analyser=BellAnalyser("linear"))
        devices, tokens = dict.fromkeys(PORTS, device), dict.fromkeys(PORTS, "")
        config = DispatcherConfig("", "", 1, tokens, fibers, [switch], devices=devices)
        laboratory = Laboratory(config)
        await laboratory.connect("q1", {1: FIRST, 2: SECOND})
        await laboratory.wait(1e-3)
        await act(laboratory)

    uvloop.run(inside())


@pytest.mark.parametrize("cutoff_s", [None, 0.0035], ids=["own", "requested"])
def test_two_pairs_are_there_when_one_comes_soon_enough_behind_another(
    cutoff_s: float | None,
) -> None:
    """Of geometric gaps one is short enough with s = 1 - (1 - p)^m: (1 + 1/s) / p attempts.

    The older of both pairs has waited for a gap, which is geometric up to m.
    """
    blocks, rounds, t2_s = 150, 3, 4e-3
    short = 1 - (1 - CHANCE) ** rounds
    gaps = np.arange(1, rounds + 1)
    weights = CHANCE * (1 - CHANCE) ** (gaps - 1) / short
    older = float(weights @ (1 + np.exp(-2 * gaps * ATTEMPT_S / t2_s))) / 2

    async def act(laboratory: Laboratory) -> None:
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        attempts, right = [], np.zeros(2, int)
        for number in range(blocks):
            reports = {"timeout_s": 60.0, "cutoff_s": cutoff_s}
            found, _took_s = await laboratory.heralded("q1", PORTS, 2, number, **reports)
            attempts.append(found.attempts)
            states = np.frombuffer(found.outcomes, np.uint8)
            mine, yours = await alice.measure((number, 0), X), await bob.measure((number, 1), X)
            right += (mine ^ yours) == (states == PSI_MINUS)
        error = np.std(attempts) / np.sqrt(blocks)
        assert abs(np.mean(attempts) - (1 + 1 / short) / CHANCE) < 5 * error
        assert within(int(right[0]), blocks, older)
        assert right[1] == blocks  # it has just come

    scene(act, t2_s=t2_s, cutoff_s=0.0035 if cutoff_s is None else np.inf)


async def stored(laboratory: Laboratory, cutoff_s: float | None = None) -> None:
    """Let bob store light that comes for a tenth of a second."""
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    await alice.create(PAIRS)
    await alice.send({(0, 1): "alice-q1"}, RATE_HZ)
    await bob.receive((0, 1), "bob-q1")
    await bob.store((0, 1), cutoff_s)


def test_a_memory_drops_what_came_too_long_ago() -> None:
    async def act(laboratory: Laboratory) -> None:
        await stored(laboratory)
        assert (await laboratory.host("bob").measure((0, 1)) != NO_CLICK).tolist() == YOUNG.tolist()

    scene(act, cutoff_s=CUTOFF_S)


def test_who_stores_again_is_told_what_is_left() -> None:
    async def act(laboratory: Laboratory) -> None:
        bob = laboratory.host("bob")
        await stored(laboratory)
        await laboratory.wait(0.01)
        arrived = np.frombuffer((await bob.store((0, 1))).arrived, bool)
        assert arrived.tolist() == (np.arange(PAIRS) >= PAIRS - 31).tolist()

    scene(act, cutoff_s=CUTOFF_S)


def test_neither_a_gate_nor_counting_anew_makes_qubits_younger() -> None:
    async def act(laboratory: Laboratory) -> None:
        bob = laboratory.host("bob")
        await stored(laboratory)
        await bob.apply((0, 1), np.ones(PAIRS, np.uint8))
        await bob.store((0, 1))
        await bob.gather((1, 1), {(0, 1): np.arange(PAIRS)[::-1]})
        await laboratory.wait(0.01)
        left = await bob.measure((1, 1)) != NO_CLICK
        assert left.tolist() == (np.arange(PAIRS) < 31).tolist()

    scene(act, cutoff_s=CUTOFF_S)


def test_nothing_is_dropped_that_is_stored_for_good_but_its_age_is_known() -> None:
    async def act(laboratory: Laboratory) -> None:
        bob = laboratory.host("bob")
        await stored(laboratory, CUTOFF_S)
        await bob.store((0, 1), np.inf)
        await laboratory.wait(10.0)
        await bob.gather((1, 1), {(0, 1): np.flatnonzero(YOUNG)})
        assert np.frombuffer((await bob.store((1, 1), np.inf)).arrived, bool).all()
        assert not np.frombuffer((await bob.store((1, 1), 9.0)).arrived, bool).any()

    scene(act)


def test_half_a_pair_that_stays_is_as_old_as_its_emission() -> None:
    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(PAIRS)
        await alice.store((0, 0))
        await alice.send({(0, 1): "alice-q1"}, RATE_HZ)
        assert (await alice.measure((0, 0)) != NO_CLICK).tolist() == YOUNG.tolist()

    scene(act, cutoff_s=CUTOFF_S)


@pytest.mark.parametrize(("cutoff_s", "words"), [(np.nan, "nan"), (0.0, "0.0"), (-1.0, "-1")])
def test_a_cutoff_that_cannot_be_is_refused(cutoff_s: float, words: str) -> None:
    async def act(laboratory: Laboratory) -> None:
        bob = laboratory.host("bob")
        await bob.create(1)
        with pytest.raises(Refusal, match=f"cut-off of {words}"):
            await bob.store((0, 0), cutoff_s)
        with pytest.raises(Refusal, match=f"cut-off of {words}"):
            await attempted(laboratory, "bob", cutoff_s=cutoff_s)

    scene(act)


def test_pairs_that_would_be_too_old_at_once_are_refused() -> None:
    async def act(laboratory: Laboratory) -> None:
        found, _took_s = await laboratory.heralded("q1", PORTS, 2)
        assert found.end == BellOutcomes.UNFIT

    scene(act, cutoff_s=1e-9)
