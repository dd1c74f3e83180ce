"""Chains of swaps of Bell-diagonal pairs against the Pauli convolution, within 5 standard errors.

Every block has 100,000 members; the seed is the number of swaps.
"""

from functools import reduce
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import uvloop
from five_sigma import within

from dispatcher.sabot.backend import Bytes
from evidence.laboratory import Laboratory
from wire.config import DispatcherConfig, Fiber, FiberEnd
from wire.parameters.physics import Device, Memory, PairSource

COUNT = 100_000
Bell = tuple[float, ...]  # how likely Phi+, Psi+, Phi- and Psi- are

# No two coefficients of a pair are alike: what is exchanged by mistake is seen.
LINKS: list[Bell] = [(0.9, 0.06, 0.03, 0.01), (0.8, 0.02, 0.05, 0.13), (0.85, 0.04, 0.1, 0.01)]
GOOD: Bell = (0.982, 0.01, 0.005, 0.003)


def convolved(one: Bell, other: Bell) -> Bell:
    """Return the pair that a swap makes of two: the Pauli operators of both, multiplied."""
    return tuple(sum(one[a] * other[a ^ state] for a in range(4)) for state in range(4))


def fiber(one: str, other: str, **noise: Any) -> Fiber:
    """Return the fibre between two hosts; its ports are named after both."""
    return Fiber(FiberEnd(one, f"{one}-{other}"), FiberEnd(other, f"{other}-{one}"), **noise)


def swapped(links: list[Bell], memory: Memory | None = None, wait_s: float = 0.0) -> Bytes:
    """Return the Bell states that alice and bob hold after all links have been joined.

    All links are made, then wait in the memories, then are joined from left to right.
    """
    nodes = ["alice", *[f"r{place}" for place in range(1, len(links))], "bob"]
    devices = {
        node: Device(source=PairSource(bell_diagonal=bell), memory=memory or Memory())
        for node, bell in zip(nodes, [*links, (1.0, 0.0, 0.0, 0.0)], strict=True)
    }
    fibers = [fiber(*link) for link in pairwise(nodes)] + [fiber("bob", "alice")]
    tokens = {node: node for node in nodes}
    config = DispatcherConfig("", "", len(links) - 1, tokens, fibers, [], devices=devices)

    async def inside() -> Bytes:
        laboratory = Laboratory(config)
        hosts = [laboratory.host(node) for node in nodes]
        for number, (near, far) in enumerate(pairwise(hosts)):
            await near.create(COUNT, number)
            await near.send({(number, 1): f"{near.name}-{far.name}"})
            await far.receive((number, 1), f"{far.name}-{near.name}")
            await near.store((number, 0))
            await far.store((number, 1))
        await laboratory.wait(wait_s)
        operators = np.zeros(COUNT, dtype=np.uint8)
        for number, repeater in enumerate(hosts[1:-1]):
            operators ^= await repeater.bell_measure((number, 1), (number + 1, 0))
        alice, bob, last = hosts[0], hosts[-1], len(links) - 1
        await bob.apply((last, 1), operators)
        await bob.send({(last, 1): "bob-alice"})
        await alice.receive((last, 1), "alice-bob")
        found = await alice.bell_measure((0, 0), (last, 1))
        assert laboratory.layer.sabot.live_qubits == 0
        return found

    return uvloop.run(inside())


def require_states(found: Bytes, expected: Bell) -> None:
    for state, share in enumerate(expected):
        assert within(int((found == state).sum()), COUNT, share), (state, share)


@pytest.mark.parametrize("links", [LINKS[:2], LINKS, [*LINKS[::-1], LINKS[0]], [GOOD] * 17])
def test_a_chain_of_swaps_convolves_the_pairs_of_its_links(links: list[Bell]) -> None:
    require_states(swapped(links), reduce(convolved, links))


def test_the_closed_form_is_that_of_a_dephased_pair() -> None:
    """Two pairs dephased to F swap to F^2 + (1-F)^2; two Werner pairs to another fidelity."""
    dephased, werner = (0.86, 0.0, 0.14, 0.0), (0.86, *[0.14 / 3] * 3)
    assert convolved(dephased, dephased)[0] == pytest.approx(0.7592)
    assert convolved(werner, werner)[0] == pytest.approx(0.86**2 + 0.14**2 / 3)


def test_waiting_for_the_swap_dephases_both_halves_of_every_link() -> None:
    """T2 = 1 s, 0.1 s of waiting, three links: six halves have waited."""
    memory = Memory(t1_s=1e9, t2_s=1.0)
    found = swapped([(1.0, 0.0, 0.0, 0.0)] * 3, memory, wait_s=0.1)
    flipped = (1 - np.exp(-6 * 0.1)) / 2
    require_states(found, (1 - flipped, 0.0, flipped, 0.0))
