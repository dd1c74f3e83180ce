"""Memories that miss photons and herald empty places: closed forms, 5 standard errors, seed 1."""

from collections.abc import Awaitable, Callable

import numpy as np
import pytest
import uvloop
from five_sigma import within
from numpy.typing import NDArray

from evidence.laboratory import Laboratory
from wire.config import DispatcherConfig, Fiber, FiberEnd
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Device, Memory, PairSource

PAIRS = 20_000
PASSED = 0.5  # by the fibre
SEEN, MISTAKEN = 0.8, 0.1
LOSS_DB = -10 * np.log10(PASSED)
IMPERFECT = Memory(herald_efficiency=SEEN, false_herald=MISTAKEN)
Bits = NDArray[np.bool_]


def scene(
    act: Callable[[Laboratory], Awaitable[None]], memory: Memory = IMPERFECT, **source: object
) -> None:
    """Let something happen to alice, who has a source and such a memory, and bob, who has one."""
    alice = Device(source=PairSource(**source), memory=memory)  # type: ignore[arg-type]
    devices = {"alice": alice, "bob": Device(memory=memory)}

    async def inside() -> None:
        ends = FiberEnd("alice", "alice-q0"), FiberEnd("bob", "bob-q0")
        way = Fiber(*ends, length_km=0.01, loss_db_per_km=LOSS_DB / 0.01)
        tokens = dict.fromkeys(("alice", "bob"), "")
        await act(Laboratory(DispatcherConfig("", "", 1, tokens, [way], [], devices=devices)))

    uvloop.run(inside())


async def share(laboratory: Laboratory, rate_hz: int = 1_000_000) -> Bits:
    """Let alice make pairs, and bob store halves 1; return what his memory says has come."""
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    await alice.create(PAIRS)
    await alice.send({(0, 1): "alice-q0"}, rate_hz)
    await bob.receive((0, 1), "bob-q0")
    return np.frombuffer((await bob.store((0, 1))).arrived, bool)


def test_photons_are_missed_and_empty_places_heralded() -> None:
    async def act(laboratory: Laboratory) -> None:
        outcomes = await share(laboratory)
        mine = await laboratory.host("alice").measure((0, 0))
        yours = await laboratory.host("bob").measure((0, 1))
        there = yours != NO_CLICK
        assert within(int(outcomes.sum()), PAIRS, PASSED * SEEN + (1 - PASSED) * MISTAKEN)
        assert within(int(there.sum()), PAIRS, PASSED * SEEN)
        assert not (there & ~outcomes).any()  # what was missed is not kept
        assert (mine[there] == yours[there]).all()

    scene(act)


def test_who_counts_anew_does_not_learn_which_places_are_empty() -> None:
    async def act(laboratory: Laboratory) -> None:
        outcomes = await share(laboratory)
        bob, some = laboratory.host("bob"), np.flatnonzero(outcomes)[::-2]
        await bob.gather((1, 1), {(0, 1): some}, keep_rest=True)
        left = np.frombuffer((await bob.store((0, 1))).arrived, bool)
        expected = outcomes.copy()
        expected[some] = False
        assert (left == expected).all()
        assert np.frombuffer((await bob.store((1, 1))).arrived, bool).all()
        there = await bob.measure((1, 1)) != NO_CLICK
        full = PASSED * SEEN / (PASSED * SEEN + (1 - PASSED) * MISTAKEN)
        assert within(int(there.sum()), some.size, full)

    scene(act)


def test_a_pauli_on_what_is_kept_tells_nobody_what_is_empty() -> None:
    async def act(laboratory: Laboratory) -> None:
        outcomes = await share(laboratory)
        bob = laboratory.host("bob")
        await bob.apply((0, 1), np.ones(PAIRS, np.uint8))
        assert (np.frombuffer((await bob.store((0, 1))).arrived, bool) == outcomes).all()

    scene(act)


def test_a_pulse_of_several_photons_is_heralded_once() -> None:
    """Of Poisson pairs of mean m some photon comes with 1 - e^(-m T); each pulse is one place."""
    mean = 0.5
    came = 1 - np.exp(-mean * PASSED)

    async def act(laboratory: Laboratory) -> None:
        outcomes = await share(laboratory)
        there = await laboratory.host("bob").measure((0, 1)) != NO_CLICK
        assert within(int(outcomes.sum()), PAIRS, came * SEEN + (1 - came) * MISTAKEN)
        assert within(int(there.sum()), PAIRS, came * SEEN)

    scene(act, statistics="poisson", mean_pairs=mean)


def test_an_empty_place_is_given_up_as_a_full_one_by_the_cut_off() -> None:
    """20,000 at 1 MHz: the first half is older than 10 ms when the last one comes."""

    async def act(laboratory: Laboratory) -> None:
        outcomes = await share(laboratory)
        assert not outcomes[: PAIRS // 2 - 1].any()
        young = outcomes[PAIRS // 2 :]
        assert within(int(young.sum()), young.size, PASSED * SEEN + (1 - PASSED) * MISTAKEN)

    memory = Memory(herald_efficiency=SEEN, false_herald=MISTAKEN, cutoff_s=0.01)
    scene(act, memory)


@pytest.mark.parametrize("mistaken", [0.0, 1.0])
def test_what_a_host_makes_itself_needs_no_herald(mistaken: float) -> None:
    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(100)
        assert np.frombuffer((await alice.store((0, 0))).arrived, bool).all()

    scene(act, Memory(herald_efficiency=0.0, false_herald=mistaken))
