"""Each qubit waits from its own arrival: against sums over arrivals, within 5 standard errors."""

from collections.abc import Awaitable, Callable, Iterable

import numpy as np
import pytest
import uvloop
from five_sigma import within
from numpy.typing import NDArray

from dispatcher.approximations import FREE_WAIT
from evidence.laboratory import BlockKey, Laboratory
from wire.config import DispatcherConfig, Fiber, FiberEnd
from wire.dispatcher_pb2 import MeasureRequest
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Device, Memory

PAIRS, BLOCKS = 1_000, 60
RATE_HZ = 1_000
T2_S = 0.1
WAITS_S = (PAIRS - 1 - np.arange(PAIRS)) / RATE_HZ  # of pair k when the last one comes
X = MeasureRequest.X
Each = NDArray[np.float64]


def between(act: Callable[[Laboratory], Awaitable[None]], **devices: Device) -> None:
    """Let something happen to alice and bob, whom two ideal fibres of 10 m join."""

    async def inside() -> None:
        ends = [[FiberEnd(host, f"{host}-q{i}") for host in ("alice", "bob")] for i in (0, 1)]
        fibers = [Fiber(a, b) for a, b in ends]
        tokens = dict.fromkeys(("alice", "bob"), "")
        await act(Laboratory(DispatcherConfig("", "", 1, tokens, fibers, [], devices=devices)))

    uvloop.run(inside())


def agree(probabilities: Iterable[float], agreeing: int, trials: int) -> bool:
    """Return whether a count agrees with the mean of a number of probabilities."""
    return within(agreeing, trials, float(np.mean(list(probabilities))))


async def share(laboratory: Laboratory, number: int) -> None:
    """Let alice store one half of new pairs and bob the other."""
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    await alice.create(PAIRS, number)
    await alice.store((number, 0))
    await laboratory.wait(10.0)  # before the source has to emit: there are no pairs yet
    await alice.send({(number, 1): "alice-q0"}, RATE_HZ)
    await bob.receive((number, 1), "bob-q0")
    await bob.store((number, 1))


@pytest.mark.parametrize(
    ("mine_s", "yours_s"), [(T2_S, T2_S), (T2_S, np.inf), (np.inf, T2_S)], ids=str
)
def test_pairs_that_come_one_by_one_have_waited_one_by_one(mine_s: float, yours_s: float) -> None:
    """1,000 pairs a second long: X and X agree with (1 + e^(-t/T2) e^(-t/T2')) / 2."""
    expected = (1 + np.exp(-WAITS_S / mine_s - WAITS_S / yours_s)) / 2

    async def act(laboratory: Laboratory) -> None:
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        equal = np.zeros(PAIRS, np.int64)
        for number in range(BLOCKS):
            await share(laboratory, number)
            mine, yours = await alice.measure((number, 0), X), await bob.measure((number, 1), X)
            equal += mine == yours
        for part in (slice(None), slice(0, 900), slice(900, None)):
            assert agree(expected[part], int(equal[part].sum()), BLOCKS * equal[part].size)

    between(act, alice=Device(memory=Memory(t2_s=mine_s)), bob=Device(memory=Memory(t2_s=yours_s)))


def test_the_figure_of_a_thousand_pairs_at_one_kilohertz() -> None:
    assert np.mean((1 + np.exp(-2 * WAITS_S / T2_S)) / 2) == pytest.approx(0.5253, abs=5e-5)


@pytest.mark.parametrize(("t2_s", "damping"), [(0.3, "twirl"), (0.6, "twirl"), (0.5, "dense")])
def test_what_comes_later_has_relaxed_less(t2_s: float, damping: str) -> None:
    """Photons in |1>: one that has waited for t is still in it with e^(-t / T1)."""
    t1_s = 0.3
    # The twirl of relaxation flips with (1 - e^(-t / T1)) / 2, reset and damping to |0> with twice
    # that; of |0> and |1> alike the twirl is right, and of |1> alone it is not.
    relaxed = 1 - np.exp(-WAITS_S / t1_s)
    expected = 1 - relaxed / 2 if t2_s > t1_s and damping == "twirl" else 1 - relaxed

    async def act(laboratory: Laboratory) -> None:
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        ones = np.zeros(PAIRS, np.int64)
        for number in range(BLOCKS):
            await alice.prepare(np.ones(PAIRS, np.uint8), number)
            await alice.send({(number, 0): "alice-q0"}, RATE_HZ)
            await bob.receive((number, 0), "bob-q0")
            await bob.store((number, 0))
            ones += await bob.measure((number, 0))
        for part in (slice(0, 500), slice(500, None)):
            assert agree(expected[part], int(ones[part].sum()), BLOCKS * ones[part].size)

    between(act, bob=Device(memory=Memory(t1_s=t1_s, t2_s=t2_s, damping=damping)))


def test_a_stored_half_waits_for_the_light_that_it_is_measured_with() -> None:
    """Half 1 comes so long before half 0, pair by pair: Phi- with (1 - e^(-t / T2)) / 2."""

    async def act(laboratory: Laboratory) -> None:
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        phases, bob.asked_ns = 0, 1
        for number in range(BLOCKS):
            await alice.create(PAIRS, number)
            first = await alice.send({(number, 1): "alice-q0"}, RATE_HZ)
            await bob.receive((number, 1), "bob-q0")
            await bob.store((number, 1))
            second = await alice.send({(number, 0): "alice-q1"}, RATE_HZ)
            await bob.receive((number, 0), "bob-q1")
            await laboratory.wait(5.0)  # to simulate it: the host had asked before
            apart_s = (second.first_ns - first.first_ns) / 1e9
            outcomes = await bob.bell_measure((number, 0), (number, 1))
            phases += int(np.count_nonzero(outcomes == 2))
            assert not (outcomes == NO_CLICK).any()
        assert apart_s > 0.9
        assert within(phases, BLOCKS * PAIRS, (1 - np.exp(-apart_s / 2.0)) / 2)

    between(act, bob=Device(memory=Memory(t2_s=2.0)))


def test_decay_within_a_stretch_of_a_large_block_is_each_qubits_own() -> None:
    """Of 100,000 |+> the last thousand have waited 0 to 5 T2, in steps: wrong (1 - e^(-t/T2))/2."""
    count, t2_s = 100_000, 2e-5
    waits_s = (count - 1 - np.arange(count)) / 10_000_000
    expected = (1 - np.exp(-waits_s / t2_s)) / 2

    async def act(laboratory: Laboratory) -> None:
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        await alice.prepare(np.full(count, 2, np.uint8))
        await alice.send({(0, 0): "alice-q0"}, 10_000_000)
        await bob.receive((0, 0), "bob-q0")
        await bob.store((0, 0))
        wrong = await bob.measure((0, 0), X) == 1
        for part in (slice(-1000, None), slice(-300, None), slice(-100, None), slice(None)):
            assert agree(expected[part], int(wrong[part].sum()), wrong[part].size)

    between(act, bob=Device(memory=Memory(t2_s=t2_s)))


HELD_S = 0.06


async def agreement(laboratory: Laboratory, mine: BlockKey, yours: BlockKey) -> tuple[int, int]:
    """Let alice measure a half along X, and another; return how many are there, and agree."""
    alice = laboratory.host("alice")
    alice.asked_ns = 1  # before either came
    one, other = await alice.measure(mine, X), await alice.measure(yours, X)
    there = (one != NO_CLICK) & (other != NO_CLICK)
    return int(there.sum()), int((one == other)[there].sum())


@pytest.mark.parametrize("stored", [False, True])
def test_light_that_is_sent_on_has_waited_stored_or_not(stored: bool) -> None:
    """Held for .06 s behind its last photon: .8 is left, and X agrees with (1 + e^(-t/T2)) / 2."""

    async def act(laboratory: Laboratory) -> None:
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        there = equal = 0
        for number in range(BLOCKS):
            await alice.create(PAIRS, number)
            await alice.send({(number, 1): "alice-q0"}, RATE_HZ)
            await bob.receive((number, 1), "bob-q0")
            if stored:
                await bob.store((number, 1))
            await laboratory.wait(HELD_S)
            await bob.send({(number, 1): "bob-q1"}, RATE_HZ)
            await alice.receive((number, 1), "alice-q1")
            found = await agreement(laboratory, (number, 0), (number, 1))
            there, equal = there + found[0], equal + found[1]
        assert within(there, BLOCKS * PAIRS, 0.8)
        assert agree((1 + np.exp(-(WAITS_S + HELD_S) / T2_S)) / 2, equal, there)

    between(act, bob=Device(memory=Memory(t2_s=T2_S, efficiency=0.8)))


@pytest.mark.parametrize("stored", [False, True])
def test_the_half_that_its_source_keeps_has_waited_stored_or_not(stored: bool) -> None:
    """From the emission of the other, pair by pair, to when its host asks."""

    async def act(laboratory: Laboratory) -> None:
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        bob.asked_ns, there, equal = 1, 0, 0
        for number in range(BLOCKS):
            await alice.create(PAIRS, number)
            await laboratory.wait(1.0)  # nothing is emitted yet
            await alice.send({(number, 1): "alice-q0"}, RATE_HZ)
            await bob.receive((number, 1), "bob-q0")
            if stored:
                await alice.store((number, 0))
            await laboratory.wait(HELD_S)
            mine, yours = await alice.measure((number, 0), X), await bob.measure((number, 1), X)
            there += int((mine != NO_CLICK).sum())
            equal += int((mine == yours).sum())
        assert within(there, BLOCKS * PAIRS, 0.8)
        assert agree((1 + np.exp(-(WAITS_S + HELD_S) / T2_S)) / 2, equal, there)

    between(act, alice=Device(memory=Memory(t2_s=T2_S, efficiency=0.8)))


def test_who_asks_while_light_comes_has_kept_what_came_before() -> None:
    """Asked when half has come: the first photons wait until then, the others are as they come."""
    waits_s = np.maximum(WAITS_S - WAITS_S[PAIRS // 2], 0)
    passes = np.where(np.arange(PAIRS) < PAIRS // 2, 0.8, 1.0)

    async def act(laboratory: Laboratory) -> None:
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        wrong = np.zeros(PAIRS, np.int64)
        there = np.zeros(PAIRS, np.int64)
        for number in range(BLOCKS):
            await alice.prepare(np.full(PAIRS, 2, np.uint8), number)  # |+>
            sent = await alice.send({(number, 0): "alice-q0"}, RATE_HZ)
            received = await bob.receive((number, 0), "bob-q0")
            assert received is not None
            bob.asked_ns = received.first_ns + (sent.last_ns - sent.first_ns) // 2
            await laboratory.wait(HELD_S)
            found = await bob.measure((number, 0), X)
            there += found != NO_CLICK
            wrong += found == 1
        for part in (slice(0, PAIRS // 2), slice(PAIRS // 2 + 1, None)):
            trials = BLOCKS * waits_s[part].size
            assert agree(passes[part], int(there[part].sum()), trials)
            expected = passes[part] * (1 - np.exp(-waits_s[part] / T2_S)) / 2
            assert agree(expected, int(wrong[part].sum()), trials)

    between(act, bob=Device(memory=Memory(t2_s=T2_S, efficiency=0.8)))


def test_light_waits_in_memory_for_light_that_a_memory_elsewhere_has_kept() -> None:
    """alice keeps half 0 for .06 s more; bob, who has asked before, does half 1 meanwhile."""

    async def act(laboratory: Laboratory) -> None:
        alice, bob, phases = laboratory.host("alice"), laboratory.host("bob"), 0
        bob.asked_ns = 1
        for number in range(BLOCKS):
            await alice.create(PAIRS, number)
            first = await alice.send({(number, 1): "alice-q0"}, RATE_HZ)
            await bob.receive((number, 1), "bob-q0")
            await laboratory.wait(HELD_S)
            await alice.store((number, 0))
            second = await alice.send({(number, 0): "alice-q1"}, RATE_HZ)
            await bob.receive((number, 0), "bob-q1")
            phases += int(np.count_nonzero(await bob.bell_measure((number, 0), (number, 1)) == 2))
        apart_s = (second.first_ns - first.first_ns) / 1e9
        assert apart_s == pytest.approx(WAITS_S[0] + HELD_S, abs=1e-6)
        assert within(phases, BLOCKS * PAIRS, (1 - np.exp(-apart_s / 2.0)) / 2)

    between(act, bob=Device(memory=Memory(t2_s=2.0)))


@pytest.mark.parametrize("asked_before", [False, True])
def test_light_at_a_host_without_a_memory_waits_in_a_fibre_and_the_result_says_so(
    asked_before: bool,
) -> None:
    """100 us are 20.4 km, of which standard fibre loses 4.08 dB: 1 - 10^-.408 of the light."""

    async def act(laboratory: Laboratory) -> None:
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        await alice.prepare(np.zeros(1, np.uint8))
        await alice.send({(0, 0): "alice-q0"}, RATE_HZ)
        await bob.receive((0, 0), "bob-q0")
        bob.asked_ns = 1 if asked_before else 0
        await laboratory.wait(1e-4)
        assert (await bob.measure((0, 0))).tolist() == [0]
        sizes = laboratory.layer.approximations.sizes
        if asked_before:
            assert sizes == {}
        else:
            assert sizes == {FREE_WAIT: pytest.approx(1 - 10**-0.408, rel=1e-4)}

    between(act, bob=Device(memory=Memory(capacity=0)))
