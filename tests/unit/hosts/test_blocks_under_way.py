"""Chains whose blocks are under way at once, in any order of messages and hardware; no network.

The protocols, repeaters and channels are the real ones; the bytes between nodes are lists, and what
hardware does is over when a seeded driver says so. Pairs are ideal: the halves of one differ by a
Pauli operator, which swaps add up and corrections take away. Which photons are lost is drawn. Time
is the number of things that have happened; memories may have a cut-off.
"""

import asyncio
from collections import Counter
from collections.abc import Callable, Coroutine
from dataclasses import dataclass, field
from itertools import pairwise
from math import inf
from typing import Any, cast

import numpy as np
import pytest
from test_distribution_protocol import FOREVER, NODE_FEATURES

from controller_apps.sessions.actions import SwapsOrdered
from controller_apps.sessions.chains import orders
from controller_apps.sessions.sessions import Stop
from hosts.hardware.operations import BlockName
from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import Coincidences, Outcomes, Stored
from hosts.middleware.services.distribution.pairs import Pairs
from hosts.middleware.services.distribution.protocol import Opening as Opener
from hosts.middleware.services.distribution.protocol import follow
from hosts.middleware.services.distribution.purification import DistributeOptions
from hosts.middleware.services.swapping.link import IncomingLink, OutgoingLink, setup_of_link
from hosts.middleware.services.swapping.protocol import Accepting, Opening, UnderWay
from hosts.middleware.services.swapping.repeater import Repeater
from hosts.middleware.session import protocol
from hosts.middleware.session.channel import MetadataChannel
from hosts.middleware.session.ends import ConnectionEnd
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.protocol import Effect, HostSide, OpenerSide
from hosts.middleware.session.values import Lifetimes
from wire.device import SwapOrder
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Handshake, Service
from wire.outcomes import NO_CLICK

PAIRS = 8  # in a block
CHAIN = Setup(5, Service.SWAP, Handshake.FRAMED, "10.0.0.1", PAIRS, 1, 1_000_000)
STATES = frozenset(range(4))
X, Z = 1, 2
FLIPS = {0: X, 1: Z, 2: X | Z}  # which operators flip outcomes in bases Z, X and Y
FOR_GOOD = 10**9  # when a qubit "came" that is never too old
SETTLED = 20  # turns of the event loop in which nothing is left to do but what the driver does


@dataclass
class World:
    """All pairs: who the other half of each is, by which operator they differ, and their bits."""

    draws: np.random.Generator
    loss: float
    partner: dict[int, int] = field(default_factory=dict)
    operator: dict[frozenset[int], int] = field(default_factory=dict)
    bits: dict[frozenset[int], int] = field(default_factory=dict)
    flying: dict[BlockName, "asyncio.Future[list[int]]"] = field(default_factory=dict)
    ready: list["asyncio.Future[None]"] = field(default_factory=list)  # operations to be done
    wires: list["Wire"] = field(default_factory=list)
    happened: int = 0
    came: dict[int, int] = field(default_factory=dict)  # when each qubit came where it is
    vain: int = 0  # swaps of which a half had been dropped

    def light(self, name: BlockName) -> "asyncio.Future[list[int]]":
        """Return the photons of a block that will come."""
        return self.flying.setdefault(name, asyncio.get_running_loop().create_future())

    def join(self, one: int, other: int, operator: int) -> None:
        """Let two halves be a pair."""
        self.partner |= {one: other, other: one}
        self.operator[frozenset((one, other))] = operator

    async def done(self) -> None:
        """Wait until the driver lets an operation be done."""
        turn = asyncio.get_running_loop().create_future()
        self.ready.append(turn)
        await turn

    def go_on(self) -> bool:
        """Let one thing happen: an operation, or a message; return whether there was one."""
        wires = [wire for wire in self.wires if wire.messages]
        if not self.ready and not wires:
            return False
        self.happened += 1
        chosen = int(self.draws.integers(len(self.ready) + len(wires)))
        if chosen < len(self.ready):
            self.ready.pop(chosen).set_result(None)
        else:
            wires[chosen - len(self.ready)].deliver()
        return True


@dataclass
class Wire:
    """One direction of a connection; the writer of one end, and what feeds the other's reader."""

    reader: asyncio.StreamReader
    messages: list[bytes] = field(default_factory=list)

    def write(self, data: bytes) -> None:
        """Say something: it is delivered when the driver says so."""
        self.messages.append(data)

    def deliver(self) -> None:
        """Let the other end hear the oldest."""
        self.reader.feed_data(self.messages.pop(0))

    def get_extra_info(self, what: str) -> Any:
        """Return addresses, or what takes an option."""
        return self if what == "socket" else ("10.0.0.9", 9)

    def setsockopt(self, *_option: int) -> None:
        """Take an option."""

    def is_closing(self) -> bool:
        """Tell that it is open."""
        return False

    async def drain(self) -> None:
        """Return: all is written."""


@dataclass
class Memory:
    """The hardware of one node: photons by block, each name once."""

    world: World
    ports: list[str] = field(default_factory=lambda: ["q0", "q1"])
    blocks: dict[BlockName, list[int | None]] = field(default_factory=dict)
    most: int = 0  # qubits at once
    lit: Counter[str] = field(default_factory=Counter)  # ports that light is sent into just now
    cutoff: float = inf  # things that may happen while a qubit waits: then it is dropped
    held: set[int] = field(default_factory=set)  # all qubits that have ever been here

    def put(self, name: BlockName, photons: list[int | None]) -> None:
        """Keep photons under a name that nobody else has."""
        assert name not in self.blocks, f"{name} is taken twice"
        self.blocks[name] = photons
        self.held |= {photon for photon in photons if photon is not None}
        for photon in photons:
            if photon is not None:
                self.world.came.setdefault(photon, self.world.happened)
        kept = (photon for block in self.blocks.values() for photon in block)
        self.most = max(self.most, sum(photon is not None for photon in kept))

    def drop_old(self, name: BlockName) -> None:
        """Let go of the qubits of a block that have been here for too long."""
        world, block = self.world, self.blocks[name]
        for place, photon in enumerate(block):
            if photon is not None and world.happened - world.came[photon] > self.cutoff:
                block[place] = None

    async def share_pairs(
        self, session: int, number: int, count: int, port: str, *_light: int
    ) -> Stored:
        """Make pairs; the far halves have come, or are lost, when this is done."""
        self.lit[port] += 1
        assert self.lit[port] == 1, "light of two blocks at once"
        world, first = self.world, 2 * len(self.world.operator)
        halves = [first + 2 * place for place in range(count)]
        for half in halves:
            world.join(half, half + 1, 0)
        self.put(BlockName(session, number, 0), [*halves])
        await world.done()
        self.lit[port] -= 1
        lost = world.draws.random(count) < world.loss
        came = [-1 if gone else half + 1 for half, gone in zip(halves, lost, strict=True)]
        world.light(BlockName(session, number, 1)).set_result(came)
        return Stored(np.ones(count, dtype=bool), 1)

    async def receive_into_memory(self, name: BlockName, _port: str, _timeout_s: float) -> Stored:
        """Keep the result of a block."""
        came = await self.world.light(name)
        self.put(name, [None if photon < 0 else photon for photon in came])
        return Stored(np.array(came) >= 0, 1)

    async def gather(
        self, into: BlockName, picks: dict[BlockName, Any], keep_rest: bool = False
    ) -> None:
        """Take photons of blocks into another."""
        await self.world.done()
        taken = [self.blocks[name][place] for name, places in picks.items() for place in places]
        for name, places in picks.items():
            for place in places:
                self.blocks[name][place] = None
            if not keep_rest:
                del self.blocks[name]
        self.put(into, taken)

    async def discard_block(self, session: int, number: int) -> None:
        """Let go of both halves of a block, as far as they are here."""
        await self.world.done()
        for half in (0, 1):
            self.blocks.pop(BlockName(session, number, half), None)

    async def store(self, name: BlockName, for_good: bool = False) -> Stored:
        """Tell which photons are here; keep them however old they get."""
        await self.world.done()
        if for_good:
            here = [photon for photon in self.blocks[name] if photon is not None]
            self.world.came |= dict.fromkeys(here, FOR_GOOD)
        self.drop_old(name)
        return Stored(np.array([photon is not None for photon in self.blocks[name]]), 1)

    async def apply(self, name: BlockName, paulis: Any) -> int:
        """Apply an operator to each half."""
        await self.world.done()
        for half, pauli in zip(self.blocks[name], paulis, strict=True):
            if half is not None:
                self.world.operator[frozenset((half, self.world.partner[half]))] ^= int(pauli)
        return 2

    async def coincidences(self, first: BlockName, second: BlockName) -> Coincidences:
        """Join pairs: the operators of both and that of the outcome are that of the new one."""
        await self.world.done()
        world, found = self.world, []
        self.drop_old(first)
        self.drop_old(second)
        for one, other in zip(self.blocks.pop(first), self.blocks.pop(second), strict=True):
            if one is None or other is None:
                world.vain += 1
                found.append(NO_CLICK)
                continue
            ends = world.partner[one], world.partner[other]
            before = frozenset((one, ends[0])), frozenset((other, ends[1]))
            outcome = int(world.draws.integers(4))
            world.join(*ends, world.operator[before[0]] ^ world.operator[before[1]] ^ outcome)
            found.append(outcome)
        return Coincidences(np.array(found, dtype=np.uint8), len(found), 2)

    async def outcomes(self, name: BlockName, bases: Any) -> Outcomes:
        """Measure: halves of a pair agree as those of Phi+ do, but for their operator."""
        await self.world.done()
        world, found = self.world, []
        self.drop_old(name)
        for half, basis in zip(self.blocks.pop(name), bases, strict=True):
            if half is None:
                found.append(NO_CLICK)
                continue
            pair = frozenset((half, world.partner[half]))
            bit = world.bits.setdefault(pair, int(world.draws.integers(2)))
            flips = (world.operator[pair] & FLIPS[int(basis)]).bit_count() + (basis == 2)
            found.append(bit ^ (int(flips) & 1 if half == max(pair) else 0))
        return Outcomes(np.array(found, dtype=np.uint8), 3)


class Node(ConnectionEnd):
    """One end of a connection, whose application hears nothing."""

    async def carry_out(self, order: Effect) -> Any:
        """Do what is ordered."""
        return None if isinstance(order, protocol.Tell) else await super().carry_out(order)


def connection(world: World, setup: Setup, left: Memory, right: Memory) -> tuple[Node, Node]:
    """Return both ends of a connection between two nodes."""
    readers = asyncio.StreamReader(), asyncio.StreamReader()
    wires = Wire(readers[1]), Wire(readers[0])
    world.wires += wires
    nodes = []
    for memory, reader, wire in zip((left, right), readers, wires, strict=True):
        channel = MetadataChannel(reader, cast(asyncio.StreamWriter, wire))
        channel.sort()
        nodes.append(Node(cast(Qnic, memory), setup, channel))
    return nodes[0], nodes[1]


@dataclass
class Scene:
    """The state of a chain."""

    world: World
    memories: list[Memory]
    pairs: tuple[Pairs, Pairs]


async def chain(
    seed: int,
    repeaters: int,
    blocks: int,
    loss: float,
    cutoffs: tuple[float, float] = (inf, inf),  # of both ends, and of repeaters
    **options: Any,
) -> Scene:
    """Run a chain to its end, in an order that follows from the seed."""
    world = World(np.random.default_rng(seed), loss)
    at_ends, between = cutoffs
    lifetimes = FOREVER._replace(cutoff_s=at_ends)
    memories = [Memory(world, cutoff=at_ends)]
    memories += [Memory(world, cutoff=between) for _repeater in range(repeaters)]
    memories.append(Memory(world, cutoff=at_ends))
    addresses = [f"10.0.0.{place + 1}" for place in range(repeaters + 2)]
    stops = tuple(
        Stop(address, 0, 0 if not place else 1) for place, address in enumerate(addresses)
    )
    told = [*orders(SwapsOrdered(CHAIN.session, stops, blocks=blocks), 1).values()]
    setups = [setup_of_link(order, CHAIN, "10.0.0.1") for order in told[:-1]]
    links = [
        connection(world, setup, *both)
        for setup, both in zip(setups, pairwise(memories), strict=True)
    ]
    alice, bob = connection(world, CHAIN, memories[0], memories[-1])
    ends = (
        asyncio.create_task(_opener(alice, links[0][0], told[0], blocks, lifetimes, options)),
        asyncio.create_task(_acceptor(bob, links[-1][1], told[-1], lifetimes)),
    )
    going: list[asyncio.Task[Any]] = [
        *ends,
        *(
            asyncio.create_task(_repeater((one[1], other[0]), order))
            for (one, other), order in zip(pairwise(links), told[1:-1], strict=True)
        ),
    ]
    await _driven(world, going)
    return Scene(world, memories, (ends[0].result(), ends[1].result()))


async def _driven(world: World, going: list["asyncio.Task[Any]"]) -> None:
    try:
        while not all(task.done() for task in going):
            await _settled(world)
            for task in going:
                if task.done():
                    task.result()
            went_on = world.go_on()
            assert went_on or all(task.done() for task in going), "nobody goes on"
    finally:
        for task in going:
            task.cancel()
        await asyncio.gather(*going, return_exceptions=True)


async def _settled(world: World) -> None:
    """Let all do what they can; for longer where the driver would have nothing to do."""
    for turn in range(100 * SETTLED):
        if turn >= SETTLED and (world.ready or any(wire.messages for wire in world.wires)):
            return
        await asyncio.sleep(0)


async def _opener(
    end: Node,
    first: Node,
    order: SwapOrder,
    blocks: int,
    lifetimes: Lifetimes,
    options: dict[str, Any],
) -> Pairs:
    side = OpenerSide(
        *(CHAIN, ("q0",), "bob", "alice", np.random.default_rng(1), NODE_FEATURES, lifetimes),
        *(STATES, "bob", NODE_FEATURES, lifetimes, True),
    )
    link = OutgoingLink(first.side, "q0")
    opening = Opening(side, first, link, order)
    wanted = DistributeOptions("bob", 7, **options)
    pairs = await end.perform_together(Opener(side, wanted, opening.make, 0.0, blocks).run())
    await first.perform(link.finish())
    return pairs


async def _acceptor(end: Node, last: Node, order: SwapOrder, lifetimes: Lifetimes) -> Pairs:
    side = HostSide(
        *(CHAIN, ("q0",), "alice", "bob", np.random.default_rng(2), NODE_FEATURES, lifetimes),
        STATES,
    )

    async def last_link() -> tuple[Node, IncomingLink, SwapOrder]:
        return last, IncomingLink(last.side, order), order

    accepting = Accepting(side, last_link)
    pairs = await end.perform_together(follow(side, accepting.share, 0.0))
    await end.perform(accepting.finish())
    return pairs


async def _repeater(ends: tuple[Node, Node], order: SwapOrder) -> None:
    links = IncomingLink(ends[0].side, order), OutgoingLink(ends[1].side, "q1")
    await ends[0].perform_together(Repeater(ends[1], links, order, STATES).run())


def delivered(memory: Memory) -> list[int | None]:
    """Return the halves that are left at an end."""
    (block,) = memory.blocks.values()
    return block


def require_pairs(scene: Scene, count: int) -> None:
    """Fail unless both ends hold this number of pairs Phi+, in one order, and repeaters nothing."""
    alice, *between, bob = scene.memories
    halves = delivered(alice), delivered(bob)
    assert len(halves[0]) == len(halves[1]) == count
    for one, other in zip(*halves, strict=True):
        assert one is not None
        assert scene.world.partner[one] == other
        assert scene.world.operator[frozenset((one, other))] == 0
    assert not any(memory.blocks for memory in between)
    for pairs in scene.pairs:
        assert pairs.estimate.fidelity in (1, None)


def run(scene: Callable[..., Coroutine[Any, Any, Scene]], *arguments: Any, **options: Any) -> Scene:
    return asyncio.run(scene(*arguments, **options))


@pytest.mark.by_day(every=4)
@pytest.mark.parametrize("blocks", [2, 4])
@pytest.mark.parametrize("seed", range(8))
def test_blocks_under_way_do_not_disturb_each_other_in_any_order_of_events(
    seed: int, blocks: int
) -> None:
    """Whatever comes first: halves of one pair have the same number at both ends, corrected."""
    scene = run(chain, seed, 3, blocks, 0.3, count=40, sample=0.3)
    require_pairs(scene, 40)
    for memory in scene.memories[1:-1]:
        assert memory.most <= 2 * PAIRS * blocks


def test_as_many_blocks_are_under_way_as_are_ordered_and_not_one_more() -> None:
    """Repeaters hold two halves of each pair: of four blocks if all of them wait for the last."""
    most = {}
    for blocks in (1, 2, 4):
        scenes = [run(chain, seed, 2, blocks, 0.0, count=80, sample=0) for seed in range(8)]
        most[blocks] = max(memory.most for scene in scenes for memory in scene.memories[1:-1])
    assert most[1] == 2 * PAIRS
    assert 2 * PAIRS < most[2] <= 4 * PAIRS < most[4] <= 8 * PAIRS


@pytest.mark.by_day(every=4)
@pytest.mark.parametrize(
    ("blocks", "cutoffs"), [(4, (inf, 60)), (1, (inf, 20)), (4, (140, inf)), (4, (200, 65))]
)
def test_what_memories_drop_of_blocks_under_way_is_made_again(
    blocks: int, cutoffs: tuple[float, float]
) -> None:
    """Ends count as shared just those pairs that all repeaters have joined, and agree on the rest.

    Whichever half of a link was dropped, and when: halves of one pair are delivered.
    """
    dropped = vain = 0
    for seed in range(8):
        scene = run(chain, seed, 2, blocks, 0.2, cutoffs=cutoffs, count=12, sample=0.2)
        require_pairs(scene, 12)
        alice, *_repeaters, bob = scene.memories
        joined = sum(len(p & alice.held) == len(p & bob.held) == 1 for p in scene.world.operator)
        ours, theirs = scene.pairs
        assert ours.shared == theirs.shared == joined
        assert ours.dropped == theirs.dropped
        dropped, vain = dropped + ours.dropped, vain + scene.world.vain
    assert dropped > 20 if cutoffs[0] < inf else dropped == 0
    assert vain > 20 if cutoffs[1] < inf else vain == 0


def test_with_one_block_at_a_time_pairs_are_the_same() -> None:
    require_pairs(run(chain, 1, 3, 1, 0.3, count=40, sample=0.3), 40)


def test_a_block_of_a_number_that_has_been_or_beyond_those_ordered_is_refused() -> None:
    under_way = UnderWay(2)
    under_way.begin(2)
    with pytest.raises(SessionError, match="block 2 beside"):
        under_way.begin(2)
    under_way.begin(1)  # messages about two blocks may come in either order
    with pytest.raises(SessionError, match="2 may be under way"):
        under_way.begin(3)
    under_way.end(1)
    under_way.begin(3)
    under_way.end(3)
    with pytest.raises(SessionError, match="block 1 beside"):
        under_way.begin(1)
