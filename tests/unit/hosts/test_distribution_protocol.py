"""Both ends of entanglement distribution back to back: lists for a network, sets for memories.

The pairs are ideal: a photon is in a memory or lost, and the halves of a pair show the same random
bit in every basis but Y, in which they differ. Which photons arrive is written down here.
"""

from collections import deque
from dataclasses import dataclass, field
from fractions import Fraction
from functools import partial
from itertools import count, permutations
from typing import Any

import numpy as np
import pytest

from hosts.hardware import pair_light
from hosts.hardware.block_name import BlockName
from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import Outcomes, Stored
from hosts.middleware.services.distribution.pairs import Moments, Pairs
from hosts.middleware.services.distribution.protocol import Opening, follow
from hosts.middleware.services.distribution.purification import DistributeOptions, Protocol
from hosts.middleware.services.distribution.sharing import make, share
from hosts.middleware.session import protocol
from hosts.middleware.session.blocks import LOST
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.protocol import Effect, HostSide, Light, OpenerSide, Steps
from hosts.middleware.session.values import Lifetimes, values
from wire.features import EVERYTHING, NodeFeatures
from wire.metadata.decoding import decode
from wire.metadata.header import Message
from wire.metadata.setup import Setup
from wire.metadata.values import Topic
from wire.metadata.vocabulary import Handshake, Service

SETUP = Setup(5, Service.DISTRIBUTE, Handshake.FRAMED, "10.0.0.3", 8, 1, 1_000_000)
FOREVER = Lifetimes(np.inf, np.inf, np.inf, np.inf)
NODE_FEATURES = NodeFeatures(EVERYTHING, 1000)
WAITING = object()  # instead of an outcome that is not there yet
Y = 2


@dataclass
class World:
    """The pairs that were made: the random bit of each, and which halves are lost on their way."""

    lost: tuple[set[int], set[int]]  # numbers of pairs, of the halves 0 and 1
    seen: float = 1.0  # share of the halves 1 of which detectors tell something
    bits: dict[int, int] = field(default_factory=dict)
    made: dict[int, list[int]] = field(default_factory=dict)  # pairs by block


@dataclass
class Host:
    """One end: its steps, what it has heard, and its memory: numbers of pairs, by block."""

    steps: Steps[Pairs]
    half: int
    world: World
    inbox: deque[Message] = field(default_factory=deque)
    memory: dict[BlockName, list[int | None]] = field(default_factory=dict)
    reports: list[dict[str, Any]] = field(default_factory=list)

    def carry_out(self, order: Effect, other: "Host") -> Any:
        """Return the result of an order; WAITING if that is not known yet."""
        match order:
            case protocol.Say(messages):
                other.inbox.extend(decode(message.encode()) for message in messages)
                return None
            case protocol.Hear(kind):
                if not self.inbox:
                    return WAITING
                assert isinstance(self.inbox[0], kind)
                return self.inbox.popleft()
            case protocol.HearNext():
                return self.inbox.popleft() if self.inbox else WAITING
            case protocol.Begin(pair_light.receive_into_memory, (name, *_)):
                return Light(name)
            case protocol.Collect(light):
                assert isinstance(light, BlockName)
                return self._stored(light)
            case protocol.Emit(block, pairs):
                first = len(self.world.bits)
                numbers = range(first, first + pairs)
                draws = np.random.default_rng([7, block])
                self.world.made[block] = list(numbers)
                drawn = draws.integers(0, 2, pairs).tolist()
                self.world.bits |= dict(zip(numbers, drawn, strict=True))
                return None
            case protocol.Do(operation, arguments, named):
                return getattr(self, operation.__name__)(*arguments, **named)
            case protocol.Tell(summary):
                self.reports.append(vars(summary))
                return None
            case protocol.Now():
                return float(len(self.reports) + 1)
        raise AssertionError(order)

    def _stored(self, name: BlockName) -> Stored:
        lost = self.world.lost[self.half]
        there = [None if pair in lost else pair for pair in self.world.made[name.number]]
        self.memory[name] = there
        return Stored(np.array([pair is not None for pair in there]), 0)

    def gather(self, into: BlockName, picks: dict[BlockName, Any], keep_rest: bool = False) -> None:
        """Take photons of blocks into another."""
        taken = [self.memory[name][place] for name, places in picks.items() for place in places]
        for name, places in picks.items():
            if keep_rest:
                for place in places:
                    self.memory[name][place] = None
            else:
                del self.memory[name]
        self.memory[into] = taken

    def discard_block(self, session: int, number: int) -> None:
        """Let go of a block."""
        self.memory = {name: kept for name, kept in self.memory.items() if name.number != number}

    def outcomes(self, name: BlockName, bases: Any) -> Outcomes:
        """Return the bits of a block's photons, those of half 1 the other way round in Y."""
        draws = np.random.default_rng([8, self.half, len(self.world.bits)])
        dark = self.half & (draws.random(len(bases)) >= self.world.seen)
        found = [
            255
            if pair is None or unseen
            else self.world.bits[pair] ^ (self.half and int(basis == Y))
            for pair, basis, unseen in zip(self.memory.pop(name), bases, dark, strict=True)
        ]
        return Outcomes(np.array(found, dtype=np.uint8), 0)


def ends(world: World, **options: Any) -> tuple[Host, Host]:
    """Return both ends of a session for pairs."""
    ports = ("alice-q1",)
    opener = OpenerSide(
        *(SETUP, ports, "10.0.0.2", "alice", np.random.default_rng(1), NODE_FEATURES, FOREVER),
        frozenset(range(4)),
        *("bob", NODE_FEATURES, FOREVER, False),
    )
    acceptor = HostSide(
        *(SETUP, ports, "10.0.0.1", "bob", np.random.default_rng(2), NODE_FEATURES, FOREVER),
        frozenset(range(4)),
    )
    wanted = DistributeOptions("bob", 7, **options)
    alice = Opening(opener, wanted, partial(make, opener), 0.0).run()
    return Host(alice, 0, world), Host(follow(acceptor, partial(share, acceptor), 0.0), 1, world)


def delivered(alice: Host, bob: Host) -> tuple[Pairs, Pairs]:
    """Return what both ends have in the end."""
    done: dict[int, Pairs] = {}
    orders: list[Effect | None] = [None, None]
    for turn in count():
        assert turn < 10_000, "neither end goes on"
        one, other = (alice, bob) if turn % 2 == 0 else (bob, alice)
        if one.half in done:
            continue
        try:
            order = orders[one.half] or next(one.steps)
            while (outcome := one.carry_out(order, other)) is not WAITING:
                order = one.steps.send(outcome)
            orders[one.half] = order
        except StopIteration as end:
            done[one.half] = end.value
            if len(done) == 2:
                return done[0], done[1]
    raise AssertionError


def test_pairs_of_which_both_halves_have_come_are_delivered_in_one_order() -> None:
    world = World(({1, 4}, {4, 6, 9}))
    alice, bob = ends(world, count=10, sample=0.0)
    ours, theirs = delivered(alice, bob)
    assert ours.available == theirs.available == 10
    there = [pair for pair in world.bits if pair not in {1, 4, 6, 9}]
    for host in (alice, bob):
        (block,) = host.memory.values()
        assert block == there[:10]
    assert alice.reports[-1]["pairs"] == 10


def test_pairs_are_sampled_in_every_basis_and_those_are_gone() -> None:
    world = World((set(), set()))
    alice, bob = ends(world, count=20, sample=0.4)
    ours, theirs = delivered(alice, bob)
    assert ours.estimate.fidelity == theirs.estimate.fidelity == 1
    assert (ours.estimate.measured > 0).all()
    (kept,) = alice.memory.values()
    assert [kept] == [*bob.memory.values()]
    assert len(kept) == 20
    assert ours.estimate.total + 20 <= len(world.bits)


def test_pairs_that_no_detector_sees_end_the_session_with_a_reason() -> None:
    world = World((set(), set()), seen=0.0)
    with pytest.raises(SessionError, match=r"none of \d+ pairs that were sacrificed"):
        delivered(*ends(world, count=20, sample=0.4))
    assert len(world.bits) < 40_000


def test_rarely_seen_pairs_are_sacrificed_until_the_fidelity_is_known() -> None:
    """Of 30 outcomes at .02 each 1,500 pairs are needed; of 5 sigma more, 2,200."""
    world = World((set(), set()), seen=0.02)
    ours, _theirs = delivered(*ends(world, count=20, sample=0.1))
    assert ours.estimate.fidelity == 1
    assert ours.estimate.total >= 30
    assert ours.sacrificed < 2_200


def test_an_acceptor_refuses_to_purify_what_it_does_not_have() -> None:
    _alice, bob = ends(World((set(), set())), count=10)
    assert next(bob.steps) == protocol.HearNext()
    with pytest.raises(SessionError, match="there are no pairs of block 1"):
        bob.steps.send(values(SETUP.session, Topic.PURIFY, 1, [2, 1], 32))


def test_a_round_keeps_pairs_of_which_both_ends_measured_the_same() -> None:
    """By enumeration of what two ends can measure: 0, 1 or nothing."""
    cases = [(a, b) for a in (0, 1, LOST) for b in (0, 1, LOST)]
    ours, theirs = np.array(cases, np.uint8).T
    side = HostSide(
        *(SETUP, (), "10.0.0.1", "bob", np.random.default_rng(2), NODE_FEATURES, FOREVER),
        frozenset(),
    )
    pairs, outcome, picked = Pairs(side, 1, 0.0), None, list[dict[BlockName, Any]]()
    pairs.add(1, 2 * len(cases), 2 * len(cases))
    steps = pairs.purify(1, Protocol.DEJMPS, 3)
    try:
        while True:
            match steps.send(outcome):
                case protocol.Do(Qnic.measure):
                    outcome = ours
                case protocol.Do(Qnic.store):
                    outcome = Stored(np.ones(len(cases), bool), 0)
                case protocol.Hear():
                    outcome = values(SETUP.session, Topic.OUTCOMES, 1, theirs, 2)
                case protocol.Do(Qnic.gather, (_into, picks)):
                    picked, outcome = [picks], None
                case _:
                    outcome = None
    except StopIteration:
        ((positions,),) = (each.values() for each in picked)
    same = [place for place, (a, b) in enumerate(cases) if a == b != LOST]
    assert positions.tolist() == same
    assert (pairs.portion(1).size, pairs.compared, pairs.survived) == (2, 9, 2)


def test_the_mean_of_instants_is_exact_in_whatever_order_blocks_come() -> None:
    """Of seconds since a network began, as binary fractions: sums in floats differ by order."""
    blocks = [(3, 1e3 + 257e-9), (7, 1e3 + 306e-9), (11, 1e3 + 355e-9), (6, 1e3 + 453e-9)]
    means = set()
    for each in permutations(blocks):
        moments = Moments()
        for pairs, time_s in each:
            moments.add(pairs, time_s)
        means.add(moments.mean_s)
    assert means == {float(sum(pairs * Fraction(time_s) for pairs, time_s in blocks) / 27)}
