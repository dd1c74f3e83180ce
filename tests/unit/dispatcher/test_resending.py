"""Photons that are measured on the way and sent on, within 5 standard errors; the seed is 1."""

import io
from collections.abc import Awaitable, Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import uvloop
from five_sigma import within
from numpy.typing import NDArray

from dispatcher.build import build_layer
from dispatcher.layer.ownership import Block, BlockName
from dispatcher.operations.blocks import Operations
from dispatcher.operations.eavesdropping import ALONE, Resending
from dispatcher.refusal import Refusal
from dispatcher.sabot.backend import Bytes
from evidence.laboratory import JumpingClock, Laboratory
from wire.config import DispatcherConfig, Fiber, FiberEnd
from wire.dispatcher_pb2 import BlockId, CreateRequest, MeasureRequest, ResendRequest
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Detectors, Device, PairSource

COUNT = 100_000
SMALL = 3_000
Z, X, Y = range(3)


def network(**changes: Any) -> DispatcherConfig:
    """Return alice, eve and bob in a row."""
    ways = [("alice-q0", "eve-q0"), ("eve-q1", "bob-q0")]
    fibers = [Fiber(*(FiberEnd(port.split("-")[0], port) for port in way)) for way in ways]
    tokens = {name: name for name in ("alice", "eve", "bob")}
    return replace(DispatcherConfig("", "", 1, tokens, fibers, []), **changes)


def scene(act: Callable[[Laboratory], Awaitable[None]], **changes: Any) -> None:
    """Let something happen in the laboratory."""

    async def inside() -> None:
        await act(Laboratory(network(**changes)))

    uvloop.run(inside())


def attack(random: np.random.Generator, share: float, count: int) -> Bytes:
    """Choose what eve does to each photon: measures Z or X of a share of them."""
    bases = random.integers(0, 2, count, dtype=np.uint8)
    return np.where(random.random(count) < share, bases, ALONE).astype(np.uint8)


async def intercepted(laboratory: Laboratory, half: int, bases: Bytes) -> Bytes:
    """Bring photons from alice to bob by way of eve; return what she found."""
    eve, block = laboratory.host("eve"), (0, half)
    await laboratory.host("alice").send({block: "alice-q0"})
    await eve.receive(block, "eve-q0")
    found = await eve.resend(block, bases)
    await eve.send({block: "eve-q1"})
    await laboratory.host("bob").receive(block, "bob-q0")
    return found


def errors(sent: Bytes, found: Bytes, same: NDArray[np.bool_]) -> tuple[int, int]:
    """Return how many sifted bits differ, and how many there are."""
    sifted = same & (found != NO_CLICK)
    return int((sent != found)[sifted].sum()), int(sifted.sum())


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 1.0])
@pytest.mark.parametrize("source", ["prepared", "pairs"])
def test_a_share_that_is_intercepted_gives_a_quarter_of_it_in_errors(
    source: str, share: float
) -> None:
    async def act(laboratory: Laboratory) -> None:
        random = np.random.default_rng(2)
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        hers, his = (random.integers(0, 2, COUNT, dtype=np.uint8) for _ in range(2))
        bases = attack(random, share, COUNT)
        if source == "prepared":
            bits = random.integers(0, 2, COUNT, dtype=np.uint8)
            await alice.prepare(2 * hers + bits)
            await intercepted(laboratory, 0, bases)
            found = await bob.measure((0, 0), bases=his)
        else:
            await alice.create(COUNT)
            await intercepted(laboratory, 1, bases)
            found = await bob.measure((0, 1), bases=his)
            bits = await alice.measure((0, 0), bases=hers)
        wrong, sifted = errors(bits, found, hers == his)
        assert sifted == (hers == his).sum()
        assert within(wrong, sifted, share / 4)

    scene(act)


@pytest.mark.parametrize("backend", ["chp", "stim", "dense"])
def test_what_was_found_is_sent_on_and_the_rest_is_as_it_was(backend: str) -> None:
    async def act(laboratory: Laboratory) -> None:
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        random = np.random.default_rng(3)
        await alice.create(SMALL)
        bases = random.choice(np.array([Z, X, Y, ALONE], dtype=np.uint8), SMALL)
        seen = await intercepted(laboratory, 1, bases)
        alone = bases == ALONE
        np.testing.assert_array_equal(seen == NO_CLICK, alone)
        asked = np.where(alone, random.integers(0, 3, SMALL), bases).astype(np.uint8)
        found = await bob.measure((0, 1), bases=asked)
        np.testing.assert_array_equal(found[~alone], seen[~alone])
        hers = await alice.measure((0, 0), bases=asked)
        # Of Phi+, both outcomes agree in Z and X, and differ in Y: eve's and alice's as well.
        np.testing.assert_array_equal(hers, found ^ (asked == Y))
        assert laboratory.layer.sabot.live_qubits == 0

    scene(act, backend=backend)


def test_who_measures_in_the_other_basis_learns_nothing_and_leaves_nothing() -> None:
    async def act(laboratory: Laboratory) -> None:
        states = np.tile(np.array([2, 3], dtype=np.uint8), COUNT // 2)  # |+> and |->
        await laboratory.host("alice").prepare(states)
        seen = await intercepted(laboratory, 0, np.zeros(COUNT, np.uint8))
        found = await laboratory.host("bob").measure((0, 0), MeasureRequest.X)
        bits = states & 1
        for report in (seen, found):
            assert within(int((report == bits).sum()), COUNT, 0.5)
        # Three measurements of the same photon draw numbers of their own.
        assert within(int((seen == found).sum()), COUNT, 0.5)

    scene(act)


def test_a_photon_that_is_resent_twice_is_measured_with_new_numbers() -> None:
    async def act(laboratory: Laboratory) -> None:
        eve = laboratory.host("eve")
        await eve.create(COUNT, state=CreateRequest.ZEROS)
        first = await eve.resend((0, 0), np.full(COUNT, X, np.uint8))
        second = await eve.resend((0, 0), np.full(COUNT, Y, np.uint8))
        third = await eve.resend((0, 0), np.full(COUNT, Y, np.uint8))
        assert within(int((first == second).sum()), COUNT, 0.5)
        np.testing.assert_array_equal(second, third)

    scene(act)


def test_her_detectors_lose_photons_and_make_others_of_dark_counts() -> None:
    efficiency, dark = 0.7, 0.05
    detectors = Detectors(efficiency, -np.log(1 - dark) * 1e9, 1e-9)
    fibers = [replace(network().fibers[0], length_km=1, loss_db_per_km=3.0), network().fibers[1]]

    async def act(laboratory: Laboratory) -> None:
        await laboratory.host("alice").create(COUNT, state=CreateRequest.ZEROS)
        bases = np.zeros(COUNT, np.uint8)
        bases[COUNT // 2 :] = ALONE
        seen = await intercepted(laboratory, 0, bases)
        (block,) = laboratory.layer.ownership.parts(BlockName(1, 0, 0))
        there = block.register.present
        np.testing.assert_array_equal(there[: COUNT // 2], seen[: COUNT // 2] != NO_CLICK)
        light = 10**-0.3 * efficiency
        clicks = int(there[: COUNT // 2].sum())
        assert within(clicks, COUNT // 2, 1 - (1 - light) * (1 - dark) ** 2)
        assert within(int(there[COUNT // 2 :].sum()), COUNT // 2, 10**-0.3)
        assert (seen[COUNT // 2 :] == NO_CLICK).all()
        found = await laboratory.host("bob").measure((0, 0))
        np.testing.assert_array_equal(found[: COUNT // 2], seen[: COUNT // 2])

    scene(act, fibers=fibers, devices={"eve": Device(detectors=detectors)})


def test_no_photon_takes_the_place_of_one_that_is_elsewhere() -> None:
    detectors = Detectors(dark_count_hz=1e9, gate_s=1e-9)

    async def act(laboratory: Laboratory) -> None:
        eve, layer = laboratory.host("eve"), laboratory.layer
        await eve.create(SMALL, state=CreateRequest.ZEROS)
        (block,) = layer.ownership.parts(BlockName(1, 0, 0))
        first = np.arange(SMALL) < SMALL // 2
        part = layer.sabot.part(block.register, first)
        layer.ownership.add(Block(block.name, part, "bob", maker="eve"))
        seen = await eve.resend((0, 0), np.zeros(SMALL, np.uint8))
        assert within(int((seen[first] != NO_CLICK).sum()), SMALL // 2, 1 - np.exp(-2))
        np.testing.assert_array_equal(block.register.present, ~first)
        found = await laboratory.host("bob").measure((0, 0))
        np.testing.assert_array_equal(found != NO_CLICK, first)

    scene(act, devices={"eve": Device(detectors=detectors)})


def test_of_a_pulse_of_many_photons_one_is_left() -> None:
    source = PairSource("poisson", 2.0)

    async def act(laboratory: Laboratory) -> None:
        await laboratory.host("alice").create(SMALL)
        bases = np.full(SMALL, Z, np.uint8)
        bases[::2] = ALONE
        await intercepted(laboratory, 1, bases)
        (block,) = laboratory.layer.ownership.parts(BlockName(1, 0, 1))
        assert block.extra_pairs is not None
        left = block.extra_pairs.pulses[block.extra_pairs.register.present]
        assert left.size
        assert not (left % 2).any()

    scene(act, devices={"alice": Device(source=source)})


def test_nothing_is_lost_or_changed_where_there_is_no_room() -> None:
    async def act(laboratory: Laboratory) -> None:
        eve = laboratory.host("eve")
        await eve.create(SMALL, state=CreateRequest.ZEROS)
        with pytest.raises(Refusal, match="exceed the limit of 4000; measure or discard"):
            await eve.resend((0, 0), np.full(SMALL, X, np.uint8))
        assert not (await eve.measure((0, 0))).any()

    scene(act, max_live_qubits=4000)


def test_the_event_counts_bases_and_outcomes_and_tells_of_each_photon() -> None:
    log = io.StringIO()
    layer = build_layer(network(per_qubit=3), JumpingClock(), log)
    request = CreateRequest(session=7, count=4, state=CreateRequest.PREPARED, states=b"\0\3\1\1")
    Operations(layer).create("eve", request)
    log.truncate(log.seek(0))
    bases = bytes((Z, X, ALONE, Z))
    Resending(layer).resend("eve", ResendRequest(block=BlockId(session=7), bases=bases))
    whole, *photons = log.getvalue().splitlines()
    assert " resend " in whole
    assert whole.endswith("Z=2 X=1: 0=1 1=2")
    assert [line.split()[-1] for line in photons] == ["0", "1", "alone"]
