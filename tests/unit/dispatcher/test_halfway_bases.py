"""Measurements halfway between Z and X, within 5 standard errors; the seed is 1.

(Z+X)/sqrt 2 is read of |0> with cos^2(pi/8), and agrees with Z of the other half of Phi+ as often.
"""

from collections.abc import Awaitable, Callable
from math import cos, pi
from typing import Any, Literal

import numpy as np
import pytest
import uvloop
from five_sigma import within

from dispatcher.refusal import Refusal
from evidence.laboratory import Laboratory
from wire.config import DispatcherConfig, Fiber, FiberEnd
from wire.dispatcher_pb2 import MeasureRequest
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Device, PairSource

Backend = Literal["chp", "stim", "dense"]
LIKELY = cos(pi / 8) ** 2
COUNT = 40_000
Z, X, Y, PLUS, MINUS = range(5)
backends = pytest.mark.parametrize("backend", ["chp", "stim", "dense"])


def scene(act: Callable[[Laboratory], Awaitable[None]], **changes: Any) -> None:
    """Let something happen at alice and bob."""
    ends = FiberEnd("alice", "alice-q0"), FiberEnd("bob", "bob-q0")
    config = DispatcherConfig(
        "", "", 1, {"alice": "", "bob": ""}, [Fiber(*ends, connectors_db=1.0)], [], **changes
    )
    uvloop.run(_act(act, config))


async def _act(act: Callable[[Laboratory], Awaitable[None]], config: DispatcherConfig) -> None:
    await act(Laboratory(config))


@backends
@pytest.mark.parametrize(
    ("state", "plus", "minus"),
    [(0, LIKELY, LIKELY), (1, 1 - LIKELY, 1 - LIKELY), (2, LIKELY, 1 - LIKELY), (4, 0.5, 0.5)],
)
def test_single_qubits(backend: Backend, state: int, plus: float, minus: float) -> None:
    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.prepare(np.full(COUNT, state, np.uint8))
        bases = np.tile(np.array([PLUS, MINUS], np.uint8), COUNT // 2)
        found = await alice.measure((0, 0), bases=bases)
        for basis, likely in ((PLUS, plus), (MINUS, minus)):
            assert within(int((found[bases == basis] == 0).sum()), COUNT // 2, likely)

    scene(act, backend=backend)


@backends
@pytest.mark.parametrize("first", ["alice", "bob"])
def test_halves_of_phi_plus_beside_measurements_of_all_other_bases(
    backend: Backend, first: str
) -> None:
    """E(Z, Z+X) = E(X, Z+X) = E(Z, Z-X) = -E(X, Z-X) = 1/sqrt 2, and 0 with Y; some are lost."""
    correlated = {(Z, PLUS): 1, (X, PLUS): 1, (Z, MINUS): 1, (X, MINUS): -1}

    async def act(laboratory: Laboratory) -> None:
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        random = np.random.default_rng(5)
        await alice.create(COUNT)
        await alice.send({(0, 1): "alice-q0"})
        await bob.receive((0, 1), "bob-q0")
        hers, his = (random.integers(0, 5, COUNT, dtype=np.uint8) for _ in range(2))
        found = {}
        for name in (first, "bob" if first == "alice" else "alice"):
            own = (alice, (0, 0), hers) if name == "alice" else (bob, (0, 1), his)
            found[name] = await own[0].measure(own[1], bases=own[2])
        there = found["bob"] != NO_CLICK
        assert within(int(there.sum()), COUNT, 10**-0.1)
        for mine in range(5):
            for yours in range(5):
                some = there & (hers == mine) & (his == yours)
                alike = int((found["alice"] == found["bob"])[some].sum())
                e = correlated.get((mine, yours), correlated.get((yours, mine), 0)) / 2**0.5
                if mine == yours:
                    e = -1 if mine == Y else 1
                assert within(alike, int(some.sum()), (1 + e) / 2), (mine, yours)
        assert laboratory.layer.sabot.live_qubits == 0

    scene(act, backend=backend)


def test_all_photons_of_a_pulse_are_measured_in_its_basis() -> None:
    """Of a pulse with n photons in |0> nobody sees a 1 with cos^2n(pi/8); ideal detectors."""
    mean = 2.0

    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.prepare(np.zeros(COUNT, np.uint8))
        found = await alice.measure((0, 0), basis=MeasureRequest.Z_PLUS_X)
        zeros, ones = 1 - np.exp(-mean * LIKELY), 1 - np.exp(-mean * (1 - LIKELY))
        wrong = ones * (1 - zeros) + zeros * ones / 2  # both at once: at random
        assert within(int((found == 1).sum()), COUNT, wrong)

    scene(act, devices={"alice": Device(PairSource("poisson", mean))})


def test_what_takes_too_large_vectors_is_refused_and_nothing_changes() -> None:
    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(2_000_000)
        with pytest.raises(Exception, match="exceed the limit"):
            await alice.measure((0, 0), basis=MeasureRequest.Z_MINUS_X)
        hers, his = [await alice.measure((0, half)) for half in (0, 1)]
        np.testing.assert_array_equal(hers, his)

    scene(act)


def test_photons_cannot_be_sent_on_in_these_states() -> None:
    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(10)
        with pytest.raises(Refusal, match=r"bases\[0\] is 3"):
            await alice.resend((0, 0), np.full(10, PLUS, np.uint8))

    scene(act)
