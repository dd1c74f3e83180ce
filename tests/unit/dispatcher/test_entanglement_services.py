"""Swapping, teleportation and purification against closed forms, within 5 standard errors.

Every block has 100,000 members; the seeds are written at each test.
"""

from collections.abc import Awaitable, Callable
from typing import Any

import numpy as np
import pytest
import uvloop
from five_sigma import within
from numpy.typing import NDArray

from dispatcher.layer.ownership import BlockName
from dispatcher.operations.emission import STATES
from dispatcher.sabot.backend import Bytes
from evidence.laboratory import BlockKey, Laboratory, LaboratoryHost, block_id
from wire.config import DispatcherConfig, Fiber, FiberEnd
from wire.dispatcher_pb2 import Gate
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Device, PairSource

COUNT = 100_000
PAIR = (0, 1)  # halves
Scene = Callable[[Laboratory], Awaitable[None]]


def fidelity(depolarizing: float) -> float:
    """Return that of a pair after one of its halves is depolarised (X, Y, Z each a quarter)."""
    return 1 - 0.75 * depolarizing


def run(scene: Scene, seed: int, fibers: list[Fiber] | None = None, **devices: Device) -> None:
    """Let a scene happen among alice, bob and charlie."""
    tokens = {name: name for name in ("alice", "bob", "charlie")}
    config = DispatcherConfig("", "", seed, tokens, fibers or [], [], devices=devices)

    async def inside() -> None:
        await scene(Laboratory(config))

    uvloop.run(inside())


def fiber(one: str, other: str, **noise: Any) -> Fiber:
    """Return the fibre between two hosts; its ports are named after both."""
    return Fiber(FiberEnd(one, f"{one}-{other}"), FiberEnd(other, f"{other}-{one}"), **noise)


async def carry(laboratory: Laboratory, block: BlockKey, one: str, other: str) -> None:
    """Send a block from a host to another."""
    await laboratory.host(one).send({block: f"{one}-{other}"})
    await laboratory.host(other).receive(block, f"{other}-{one}")


def source(fidelity: float) -> Device:
    """Return a host that emits Werner pairs."""
    return Device(source=PairSource(fidelity=fidelity))


@pytest.mark.parametrize(("left", "right"), [(0.1, 0.2), (0.4, 0.05), (0.0, 0.3)])
def test_swapping_gives_the_fidelity_of_two_werner_pairs(left: float, right: float) -> None:
    """Charlie's pairs to alice and to bob, each depolarised on its way; seed 11."""

    async def scene(laboratory: Laboratory) -> None:
        bob, charlie = laboratory.host("bob"), laboratory.host("charlie")
        for number, other in enumerate(("alice", "bob")):
            await charlie.create(COUNT, number)
            await carry(laboratory, (number, 1), "charlie", other)
        outcomes = await charlie.bell_measure((0, 0), (1, 0))
        await bob.apply((1, 1), outcomes)
        await carry(laboratory, (0, 1), "alice", "bob")
        found = await bob.bell_measure((0, 1), (1, 1))
        near, far = fidelity(left), fidelity(right)
        expected = near * far + (1 - near) * (1 - far) / 3
        assert within(int((found == 0).sum()), COUNT, expected)
        for state in (1, 2, 3):
            assert within(int((found == state).sum()), COUNT, (1 - expected) / 3)

    fibers = [fiber("charlie", "alice", depolarizing=left)]
    fibers += [fiber("charlie", "bob", depolarizing=right), fiber("alice", "bob")]
    run(scene, 11, fibers)


def test_swapping_gathered_pairs_with_losses_pairs_the_right_members() -> None:
    """A chain of three: of each link the survivors are gathered, as many as all have; seed 12."""
    links = [("alice", "charlie"), ("charlie", "bob")]
    fibers = [fiber(*link, length_km=10, loss_db_per_km=0.1) for link in links]
    fibers.append(fiber("alice", "bob"))

    async def scene(laboratory: Laboratory) -> None:
        alice, bob, charlie = (laboratory.host(n) for n in ("alice", "bob", "charlie"))
        random, survivors = np.random.default_rng(12), []
        for number, (one, other) in enumerate(links):
            await laboratory.host(one).create(COUNT, number)
            await carry(laboratory, (number, 1), one, other)
            # Which have come is known here by looking; hosts have heralds.
            (part,) = laboratory.layer.ownership.parts(BlockName(1, number, 1))
            survivors.append(random.permutation(np.flatnonzero(part.register.present)))
        count = min(chosen.size for chosen in survivors)
        assert within(count, COUNT, 10**-0.1)
        first, second = (chosen[:count] for chosen in survivors)
        paulis = random.integers(0, 4, COUNT, dtype=np.uint8)
        await charlie.apply((1, 0), paulis)
        await charlie.gather((2, 1), {(0, 1): first})
        await charlie.gather((3, 0), {(1, 0): second})
        outcomes = await charlie.bell_measure((2, 1), (3, 0))
        await bob.gather((3, 1), {(1, 1): second})
        await bob.apply((3, 1), outcomes ^ paulis[second])
        await bob.store((3, 1))
        await alice.gather((2, 0), {(0, 0): first})
        await carry(laboratory, (2, 0), "alice", "bob")
        assert not (await bob.bell_measure((2, 0), (3, 1))).any()
        assert laboratory.layer.sabot.live_qubits == 0

    run(scene, 12, fibers)


@pytest.mark.parametrize("depolarizing", [0.0, 0.1, 0.6])
def test_teleporting_the_cardinal_states_gives_two_thirds_f_plus_one_third(
    depolarizing: float,
) -> None:
    """Alice teleports to bob by pairs whose half was depolarised on its way; seed 13."""

    async def scene(laboratory: Laboratory) -> None:
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        states = np.random.default_rng(13).integers(0, len(STATES), COUNT, dtype=np.uint8)
        await alice.create(COUNT)
        await carry(laboratory, PAIR, "alice", "bob")
        await alice.prepare(states, 1)
        outcomes = await alice.bell_measure((1, 0), (0, 0))
        await bob.apply(PAIR, outcomes)
        found = await bob.measure(PAIR, bases=states // np.uint8(2))
        right = int((found == (states & 1)).sum())
        expected = (2 * fidelity(depolarizing) + 1) / 3
        assert right == COUNT if depolarizing == 0 else within(right, COUNT, expected)

    run(scene, 13, [fiber("alice", "bob", depolarizing=depolarizing)])


def test_what_is_lost_is_not_teleported_and_the_rest_is() -> None:
    """Half of alice's halves are lost before she uses them; seed 14."""

    async def scene(laboratory: Laboratory) -> None:
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        states = np.random.default_rng(14).integers(0, len(STATES), COUNT, dtype=np.uint8)
        await bob.create(COUNT)
        await carry(laboratory, PAIR, "bob", "alice")
        await alice.prepare(states, 1)
        outcomes = await alice.bell_measure((1, 0), PAIR)
        came = outcomes != NO_CLICK
        assert within(int(came.sum()), COUNT, 10**-0.3)
        await bob.apply((0, 0), np.where(came, outcomes, 0).astype(np.uint8))
        right = await bob.measure((0, 0), bases=states // np.uint8(2)) == (states & 1)
        assert right[came].all()
        assert within(int(right[~came].sum()), int((~came).sum()), 0.5)

    run(scene, 14, [fiber("alice", "bob", length_km=15, loss_db_per_km=0.2)])


Survivors = NDArray[np.intp]
Rotations = tuple[list[Gate.Name], ...]


async def bbpssw(
    ends: list[tuple[LaboratoryHost, int]], block: int, into: tuple[int, int]
) -> Survivors:
    """Compare neighbours of a block of Werner pairs; return which members of into[0] survive.

    Bennett et al., Phys. Rev. Lett. 76, 722: bilateral CX, and the targets' parities agree.
    """
    parities: list[Bytes] = []
    for host, half in ends:
        size = (await host.apply((block, half))).photons
        even, odd = np.arange(0, size - 1, 2), np.arange(1, size, 2)
        await host.gather((into[0], half), {(block, half): even}, keep_rest=True)
        await host.gather((into[1], half), {(block, half): odd})
        target = block_id((into[1], half))
        await host.apply((into[0], half), gates=[Gate(name=Gate.CX, target=target)])
        parities.append(await host.measure((into[1], half)))
    return np.flatnonzero(parities[0] == parities[1])


def purified(werner: float) -> tuple[float, float]:
    """Return fidelity and success of a round (the same paper, equation 7)."""
    wrong = (1 - werner) / 3
    success = werner**2 + 2 * werner * wrong + 5 * wrong**2
    return (werner**2 + wrong**2) / success, success


def test_the_closed_form_is_that_of_the_literature() -> None:
    assert purified(0.9) == pytest.approx((0.926396, 0.875556), abs=5e-7)


def test_a_round_of_purification_gives_its_fidelity_and_success() -> None:
    """F = 0.9 from the source, both halves gathered and used at either end alone; seed 15."""

    async def scene(laboratory: Laboratory) -> None:
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        await alice.create(2 * COUNT)
        await carry(laboratory, PAIR, "alice", "bob")
        survivors = await bbpssw([(alice, 0), (bob, 1)], 0, (1, 2))
        expected, success = purified(0.9)
        assert within(survivors.size, COUNT, success)
        await bob.gather((3, 1), {(1, 1): survivors})
        await alice.gather((3, 0), {(1, 0): survivors})
        await carry(laboratory, (3, 0), "alice", "bob")
        found = await bob.bell_measure((3, 0), (3, 1))
        assert within(int((found == 0).sum()), survivors.size, expected)

    run(scene, 15, [fiber("alice", "bob")], alice=source(0.9))


# Bilateral rotations that leave Phi+ as it is and exchange the other three: the other end has the
# complex conjugate of each gate. By a third of the members each of them, and Paulis, twirl.
CYCLES: Rotations = ([], [Gate.S, Gate.H], [Gate.H, Gate.S_DAG])
CONJUGATES: Rotations = ([], [Gate.S_DAG, Gate.H], [Gate.H, Gate.S])


async def twirl(
    ends: list[tuple[LaboratoryHost, int]], block: int, chosen: NDArray[np.int64], into: int
) -> None:
    """Make any pairs Werner pairs: members are rotated together by random Cliffords."""
    for (host, half), gates in zip(ends, (CYCLES, CONJUGATES), strict=True):
        for third in range(3):
            mine = np.flatnonzero(chosen == third)
            await host.gather((into + third, half), {(block, half): mine}, keep_rest=True)
            rotation = [Gate(name=name) for name in gates[third]]
            await host.apply((into + third, half), gates=rotation)
        sizes = np.bincount(chosen, minlength=3)
        await host.gather(
            (into, half), {(into + third, half): np.arange(sizes[third]) for third in range(3)}
        )
        ranks = np.argsort(np.argsort(chosen, kind="stable"))
        await host.gather((into, half), {(into, half): ranks})  # in the order that they had


def test_two_rounds_with_a_twirl_between_them() -> None:
    """The first round's pairs are not Werner pairs any more until they are twirled; seed 16."""

    async def scene(laboratory: Laboratory) -> None:
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        ends = [(alice, 0), (bob, 1)]
        await alice.create(2 * COUNT)
        await carry(laboratory, PAIR, "alice", "bob")
        survivors = await bbpssw(ends, 0, (1, 2))
        survivors = survivors[: survivors.size // 2 * 2]
        for host, half in ends:
            await host.gather((3, half), {(1, half): survivors})
        chosen = np.random.default_rng(16).integers(0, 3, survivors.size)
        await twirl(ends, 3, chosen, 10)
        last = await bbpssw(ends, 10, (20, 21))
        once, _success = purified(0.8)
        twice, success = purified(once)
        assert within(last.size, survivors.size // 2, success)
        for host, half in ends:
            await host.gather((30, half), {(20, half): last})
        await carry(laboratory, (30, 0), "alice", "bob")
        found = await bob.bell_measure((30, 0), (30, 1))
        assert within(int((found == 0).sum()), last.size, twice)

    run(scene, 16, [fiber("alice", "bob")], alice=source(0.8))
