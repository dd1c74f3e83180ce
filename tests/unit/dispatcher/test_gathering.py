"""Photons that are gathered are the same photons, whatever has happened to them before."""

import io
from collections.abc import Awaitable, Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import uvloop
from five_sigma import within
from numpy.typing import NDArray

from dispatcher.approximations import PHASE, UNLIKE_LIGHT, approximation
from dispatcher.devices.decay import decay
from dispatcher.layer.ownership import Block, BlockName
from dispatcher.refusal import Refusal
from dispatcher.sabot.dense import TooLarge
from evidence.laboratory import BlockKey, Laboratory, block_id
from wire.config import DispatcherConfig, Fiber, FiberEnd, QuantumSwitch
from wire.dispatcher_pb2 import CreateRequest, Gate
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Device, Memory, PairSource

COUNT = 6_000
EVEN, ODD = np.arange(0, COUNT, 2), np.arange(1, COUNT, 2)
Order = NDArray[np.int64]


def network(**changes: Any) -> DispatcherConfig:
    """Return alice and bob, joined by a fibre; the seed is 1."""
    ends = FiberEnd("alice", "alice-q0"), FiberEnd("bob", "bob-q0")
    tokens = {name: name for name in ("alice", "bob")}
    return replace(DispatcherConfig("", "", 1, tokens, [Fiber(*ends)], []), **changes)


def scene(act: Callable[[Laboratory], Awaitable[None]], **changes: Any) -> None:
    """Let something happen in the laboratory."""

    async def inside() -> None:
        await act(Laboratory(network(**changes)))

    uvloop.run(inside())


async def share(laboratory: Laboratory, number: int, count: int = COUNT) -> None:
    """Let alice make pairs and send half 1 of them to bob."""
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    await alice.create(count, number)
    await alice.send({(number, 1): "alice-q0"})
    await bob.receive((number, 1), "bob-q0")


def held(laboratory: Laboratory, block: BlockKey) -> Block:
    """Return the only part of a block."""
    (part,) = laboratory.layer.ownership.parts(BlockName(1, *block))
    return part


@pytest.mark.parametrize("colour_mhz", [193_400_000, 193_412_500])
def test_light_of_several_colours_in_one_block_marks_the_result(colour_mhz: int) -> None:
    """All phases of a Bell measurement may be wrong then: by 1/2."""

    async def act(laboratory: Laboratory) -> None:
        bob = laboratory.host("bob")
        for number, frequency_mhz in enumerate((193_400_000, colour_mhz)):
            await laboratory.host("alice").create(COUNT, number)
            launch = {(number, 1): "alice-q0"}
            await laboratory.host("alice").send(launch, frequency_mhz=frequency_mhz)
            await bob.receive((number, 1), "bob-q0")
        await bob.gather((5, 1), {(0, 1): EVEN, (1, 1): ODD})
        found = held(laboratory, (5, 1)).pulses.approximations.sizes
        assert found == ({} if colour_mhz == 193_400_000 else {UNLIKE_LIGHT: 0.5})

    scene(act)


def orders(seed: int) -> dict[int, Order]:
    """Choose a third of two blocks, in no order."""
    random = np.random.default_rng(seed)
    return {number: random.permutation(COUNT)[: COUNT // 3] for number in (0, 1)}


@pytest.mark.parametrize("backend", ["chp", "stim", "dense"])
def test_members_of_the_new_blocks_are_pairs_whatever_happened_to_each(backend: str) -> None:
    fibers = [replace(network().fibers[0], length_km=10, loss_db_per_km=0.1)]

    async def act(laboratory: Laboratory) -> None:
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        random = np.random.default_rng(3)
        expected, seen = [], []
        chosen = orders(4)
        for number in (0, 1):
            await share(laboratory, number)
            paulis = random.integers(0, 4, COUNT, dtype=np.uint8)
            await alice.apply((number, 0), paulis)
            expected.append(paulis[chosen[number]])
            seen.append(held(laboratory, (number, 1)).register.present[chosen[number]])
        await bob.gather((5, 1), {(number, 1): chosen[number] for number in (1, 0)})
        await alice.gather((5, 0), {(number, 0): chosen[number] for number in (1, 0)})
        fiber = {(5, 0): "alice-q0"}
        await alice.send(fiber)
        await bob.receive((5, 0), "bob-q0")
        found = await bob.bell_measure((5, 0), (5, 1))
        wanted = np.concatenate(expected[::-1])
        both = found != NO_CLICK
        np.testing.assert_array_equal(found[both], wanted[both])
        there = np.concatenate(seen[::-1])
        assert not both[~there].any()
        assert within(int(both.sum()), int(there.sum()), 10**-0.1)
        assert laboratory.layer.sabot.live_qubits == 0

    scene(act, fibers=fibers, backend=backend)


@pytest.mark.parametrize("first", ["alice", "bob"])
def test_one_end_may_use_its_new_blocks_before_the_other_has_gathered(first: str) -> None:
    """CX at both ends, target of it measured: without noise the parities agree always."""

    async def act(laboratory: Laboratory) -> None:
        await share(laboratory, 0)
        ends = [("alice", 0), ("bob", 1)]
        parities = []
        for name, half in ends if first == "alice" else ends[::-1]:
            host = laboratory.host(name)
            await host.gather((1, half), {(0, half): EVEN}, keep_rest=True)
            await host.gather((2, half), {(0, half): ODD})
            gate = Gate(name=Gate.CX, target=block_id((2, half)))
            await host.apply((1, half), gates=[gate])
            parities.append(await host.measure((2, half)))
        np.testing.assert_array_equal(parities[0], parities[1])
        assert within(int(parities[0].sum()), COUNT // 2, 0.5)
        mine = await laboratory.host("alice").measure((1, 0), 1)  # type: ignore[arg-type]
        yours = await laboratory.host("bob").measure((1, 1), 1)  # type: ignore[arg-type]
        np.testing.assert_array_equal(mine, yours)

    scene(act)


def test_the_new_block_may_have_the_name_of_one_that_it_is_made_of() -> None:
    async def act(laboratory: Laboratory) -> None:
        await share(laboratory, 0)
        await laboratory.host("alice").gather((0, 0), {(0, 0): ODD})
        await laboratory.host("bob").gather((0, 1), {(0, 1): ODD})
        mine = await laboratory.host("alice").measure((0, 0))
        np.testing.assert_array_equal(mine, await laboratory.host("bob").measure((0, 1)))
        assert mine.size == COUNT // 2
        assert laboratory.layer.ownership.count == laboratory.layer.ownership.places == 0

    scene(act)


def test_photons_that_are_let_go_draw_no_numbers_that_others_draw_too() -> None:
    """Released qubits look random to the partners: twice the same numbers would show."""

    async def act(laboratory: Laboratory) -> None:
        await share(laboratory, 0)
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        await alice.gather((0, 0), {(0, 0): EVEN})  # lets go of the odd ones, at their positions
        await alice.gather((0, 0), {(0, 0): np.arange(COUNT // 4)})
        await alice.discard((0, 0))
        found = await bob.measure((0, 1))
        # Photon 2 n was let go at position n, by the second gathering or at the end.
        odd = np.arange(1, COUNT // 2, 2)
        for positions in (odd[odd < COUNT // 4], odd[odd >= COUNT // 4]):
            same = int((found[positions] == found[2 * positions]).sum())
            assert within(same, positions.size, 0.5)

    scene(act)


@pytest.mark.parametrize("backend", ["chp", "stim"])
def test_a_block_whose_photons_are_entangled_with_each_other_has_a_basis_for_each(
    backend: str,
) -> None:
    """Alice's CX between even and odd members entangle bob's, until she undoes it."""

    async def act(laboratory: Laboratory) -> None:
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        bases = np.random.default_rng(5).integers(0, 3, COUNT, dtype=np.uint8)
        await share(laboratory, 0)
        await alice.gather((1, 0), {(0, 0): EVEN}, keep_rest=True)
        await alice.gather((2, 0), {(0, 0): ODD})
        for _ in range(2):
            await alice.apply((1, 0), gates=[paired_with((2, 0))])
        yours = await bob.measure((0, 1), bases=bases)
        mine = np.empty_like(yours)
        for number, photons in ((1, EVEN), (2, ODD)):
            mine[photons] = await alice.measure((number, 0), bases=bases[photons])
        np.testing.assert_array_equal(mine ^ yours, bases == 2)

    scene(act, backend=backend)


def test_what_the_light_is_like_comes_along() -> None:
    async def act(laboratory: Laboratory) -> None:
        await share(laboratory, 0, 4)
        await share(laboratory, 1, 4)
        one = held(laboratory, (0, 0)).pulses
        one.extras, one.delays_ps = np.arange(4, dtype=np.uint8), np.arange(4.0)
        other = held(laboratory, (1, 0)).pulses
        other.angles_rad, other.approximations = np.arange(4.0), approximation(PHASE, 0.25)
        alice = laboratory.host("alice")
        picks = {(1, 0): np.array([3, 0]), (0, 0): np.array([2, 3, 0])}
        await alice.gather((2, 0), picks, keep_rest=True)
        light = held(laboratory, (2, 0)).pulses
        assert light.extras is not None
        assert light.extras.tolist() == [0, 0, 2, 3, 0]
        assert light.delays_ps is not None
        assert light.delays_ps.tolist() == [0, 0, 2, 3, 0]
        assert light.angles_rad is not None
        assert light.angles_rad.tolist() == [3, 0, 0, 0, 0]
        assert not light.exact
        left = held(laboratory, (0, 0))
        assert left.pulses.extras is not None
        assert left.pulses.extras.tolist() == [0, 1, 0, 0]
        assert left.register.present.tolist() == [False, True, False, False]

    scene(act)


WAITED_S = 0.3
T2_S = 0.5


def memory(**device: Any) -> dict[str, Device]:
    """Return such a memory at alice's."""
    return {"alice": Device(memory=Memory(**device))}


async def fidelity_counts(laboratory: Laboratory, block: BlockKey, other: BlockKey) -> list[int]:
    """Bell-measure at alice's, what is not stored as it comes; return how often each was found."""
    alice = laboratory.host("alice")
    alice.asked_ns = 1
    found = await alice.bell_measure(block, other)
    return [int((found == state).sum()) for state in range(4)]


@pytest.mark.parametrize("moments", [(0.0, 1.0), (0.2, 0.7, 1.0), (1.0,)])
def test_stored_photons_decay_by_the_time_they_really_waited(moments: tuple[float, ...]) -> None:
    """Waits are cut by gathering at these parts of it; T1 = T2, one half of each pair stored."""

    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        alice.asked_ns = 1  # before there was anything: what is not stored does not wait
        await alice.create(2 * COUNT)
        await alice.store((0, 0))
        waited, size = 0.0, 2 * COUNT
        for moment in moments:
            await laboratory.wait((moment - waited) * WAITED_S)
            waited = moment
            order = np.arange(size)[::-1]
            await alice.gather((0, 0), {(0, 0): order})
            await alice.gather((0, 1), {(0, 1): order})
            assert laboratory.layer.memories.holds(held(laboratory, (0, 0)))
            assert not laboratory.layer.memories.holds(held(laboratory, (0, 1)))
        found = await fidelity_counts(laboratory, (0, 0), (0, 1))
        happened = decay(Memory(t1_s=T2_S, t2_s=T2_S), WAITED_S)
        reset, z = float(happened.reset), float(happened.z)
        expected = [1 - reset - z + reset / 4, reset / 4, z + reset / 4, reset / 4]
        assert all(within(n, size, p) for n, p in zip(found, expected, strict=True))

    scene(act, devices=memory(t1_s=T2_S, t2_s=T2_S))


def test_gathering_stored_photons_reads_none_of_them_out() -> None:
    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(COUNT)
        await alice.store((0, 0))
        for _ in range(3):
            await alice.gather((0, 0), {(0, 0): np.arange(COUNT)})
        assert held(laboratory, (0, 0)).register.remaining == COUNT
        found = await fidelity_counts(laboratory, (0, 0), (0, 1))
        assert within(sum(found), COUNT, 0.8)

    scene(act, devices=memory(efficiency=0.8))


def test_what_is_gathered_from_stored_photons_and_others_is_at_hand() -> None:
    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        alice.asked_ns = 1  # likewise
        for number in (0, 1):
            await alice.create(COUNT, number)
        await alice.store((0, 0))
        await laboratory.wait(WAITED_S)
        await alice.gather((2, 0), {(n, 0): np.arange(COUNT) for n in (0, 1)})
        await alice.gather((2, 1), {(n, 1): np.arange(COUNT) for n in (0, 1)})
        assert not laboratory.layer.memories.holds(held(laboratory, (2, 0)))
        await laboratory.wait(10.0)
        found = await alice.bell_measure((2, 0), (2, 1))
        there = found[:COUNT] != NO_CLICK
        assert within(int(there.sum()), COUNT, 0.8)
        flipped = int((found[:COUNT][there] == 2).sum())
        assert within(flipped, int(there.sum()), (1 - np.exp(-WAITED_S / T2_S)) / 2)
        assert not found[COUNT:].any()

    scene(act, devices=memory(t2_s=T2_S, efficiency=0.8))


def test_the_place_in_the_memory_goes_with_the_photons() -> None:
    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(100)
        await alice.store((0, 0))
        await alice.gather((1, 0), {(0, 0): np.arange(40)}, keep_rest=True)
        with pytest.raises(Refusal, match="100 stored"):
            await alice.store((0, 1))
        await alice.gather((2, 0), {(0, 0): np.arange(40, 60)})
        await alice.gather((0, 1), {(0, 1): np.arange(40)})
        await alice.store((0, 1))
        await alice.create(1, 3)
        with pytest.raises(Refusal, match="100 stored"):
            await alice.store((3, 0))

    scene(act, devices=memory(capacity=100))


def test_a_wait_that_cannot_be_simulated_leaves_all_as_it_was() -> None:
    """State vectors of damped qubits have room for block 0, and not for block 1 besides."""

    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        for number, count in enumerate((100, 1_000_000)):
            await alice.create(count, number)
            await alice.store((number, 0))
        await laboratory.wait(1.0)
        blocks = [held(laboratory, (number, 0)) for number in (0, 1)]
        with pytest.raises(TooLarge, match="amplitudes"):
            await alice.gather((2, 0), {(n, 0): np.arange(50) for n in (0, 1)})
        assert [held(laboratory, (number, 0)) for number in (0, 1)] == blocks
        assert all(map(laboratory.layer.memories.holds, blocks))
        assert not laboratory.layer.ownership.parts(BlockName(1, 2, 0))

    scene(act, devices=memory(t1_s=1.0, t2_s=2.0, damping="dense"))


def test_a_block_with_parts_elsewhere_keeps_its_name() -> None:
    """Half of bob's photons have come to his other port, where they wait."""
    ends = [("alice", "alice-q0", "1"), ("bob", "bob-q0", "2"), ("bob", "bob-q1", "3")]
    fibers = [Fiber(FiberEnd(host, port), FiberEnd("q1", n)) for host, port, n in ends]

    async def act(laboratory: Laboratory) -> None:
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        await alice.create(10)
        block = held(laboratory, (0, 1))
        mask = np.arange(10) < 5
        register = laboratory.layer.sabot.part(block.register, mask)
        ownership = laboratory.layer.ownership
        ownership.add(Block(block.name, register, "bob", "bob-q0"))
        ownership.move(block, "bob")
        with pytest.raises(Refusal, match=r"block 0/1 .* exists"):
            await bob.gather((0, 1), {(0, 1): np.arange(5)})
        await bob.gather((1, 1), {(0, 1): np.arange(10)})
        assert held(laboratory, (1, 1)).register.present.tolist() == [False] * 5 + [True] * 5
        await bob.receive((0, 1), "bob-q0")
        found = [await alice.measure((0, 0)), await bob.measure((0, 1)), await bob.measure((1, 1))]
        np.testing.assert_array_equal(found[0], np.where(mask, found[1], found[2]))

    scene(act, fibers=fibers, switches=[QuantumSwitch("q1")])


def test_dividing_what_has_gone_again_and_again_is_refused() -> None:
    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(1_000, state=CreateRequest.ZEROS)
        everything = {(0, 0): np.arange(1_000)}
        await alice.gather((1, 0), everything, keep_rest=True)
        with pytest.raises(Refusal, match=r"1000 more places .* with 2000.* limit of 2000"):
            await alice.gather((2, 0), everything, keep_rest=True)
        await alice.gather((2, 0), everything)
        assert (await alice.measure((2, 0))).tolist() == [NO_CLICK] * 1_000
        assert not (await alice.measure((1, 0))).any()

    scene(act, max_live_qubits=1_000)


@pytest.mark.parametrize("count", [COUNT, 33])
def test_pairs_that_meet_each_other_in_a_long_ring_are_refused_and_stay_as_they_are(
    count: int,
) -> None:
    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(count)
        await alice.gather((1, 1), {(0, 1): np.roll(np.arange(count), 1)})
        gates = [Gate(name=Gate.H), paired_with((1, 1))]
        with pytest.raises(TooLarge, match="across each other"):
            await alice.apply((0, 0), np.ones(count, dtype=np.uint8), gates)
        with pytest.raises(TooLarge, match="across each other"):
            await alice.bell_measure((0, 0), (1, 1))
        await alice.gather((1, 1), {(1, 1): np.roll(np.arange(count), -1)})
        assert not (await alice.bell_measure((0, 0), (1, 1))).any()

    scene(act)


def paired_with(target: BlockKey) -> Gate:
    """Return the gate that pairs photons with those of a target."""
    return Gate(name=Gate.CX, target=block_id(target))


def test_short_rings_are_simulated() -> None:
    """Swapping two pairs by both of their ends gives twice the same outcome."""

    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(COUNT)
        swapped = np.arange(COUNT) ^ 1
        await alice.gather((1, 1), {(0, 1): swapped})
        found = await alice.bell_measure((0, 0), (1, 1))
        np.testing.assert_array_equal(found[EVEN], found[ODD])
        assert all(within(int((found[EVEN] == n).sum()), COUNT // 2, 0.25) for n in range(4))

    scene(act)


def test_a_hundred_thousand_members_stay_in_few_components() -> None:
    count = 100_000
    source = Device(source=PairSource(fidelity=0.9))

    async def act(laboratory: Laboratory) -> None:
        random = np.random.default_rng(7)
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        await share(laboratory, 0, 2 * count)
        order = random.permutation(2 * count)
        for host, half in ((alice, 0), (bob, 1)):
            await host.gather((1, half), {(0, half): order[:count]}, keep_rest=True)
            await host.gather((2, half), {(0, half): order[count:]})
            await host.apply((1, half), gates=[paired_with((2, half))])
            await host.measure((2, half))
        await alice.create(count, 3)
        await alice.bell_measure((3, 0), (1, 0))
        await bob.apply((1, 1), random.integers(0, 4, count, dtype=np.uint8))
        assert len(held(laboratory, (1, 1)).register.components) <= 2

    scene(act, devices={"alice": source})


def test_the_events_say_what_was_gathered_from_where() -> None:
    log = io.StringIO()

    async def act(laboratory: Laboratory) -> None:
        laboratory.layer.history._log = log
        laboratory.layer.history._photons = 3
        alice = laboratory.host("alice")
        for number in (0, 1):
            await alice.create(5, number, CreateRequest.ZEROS)
            await alice.store((number, 0))
        log.truncate(0)
        await alice.gather((2, 0), {(1, 0): np.array([4]), (0, 0): np.array([2, 0, 1])})
        await alice.gather((3, 0), {(2, 0): np.array([1])}, keep_rest=True)
        await alice.gather((4, 0), {(3, 0): np.array([0])})  # all that there is

    scene(act)
    lines = [line for line in log.getvalue().splitlines() if " gather " in line]
    assert lines[0].endswith("1 of 5 of 1/0, 3 of 5 of 0/0, still stored, the rest let go")
    assert lines[4].endswith("1 of 4 of 2/0, still stored")
    assert lines[6].endswith("1 of 1 of 3/0, still stored")
    origins = [line.split("photons=1 ")[1] for line in lines[1:4]]
    assert origins == ["photon 5 of 1/0", "photon 3 of 0/0", "photon 1 of 0/0"]
