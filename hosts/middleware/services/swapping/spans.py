"""Pairs between two nodes of a chain, purified before either of them swaps; no socket, no clock.

left end                 nodes that have swapped               right end
  | <-- PURIFY, ARRIVED ------------|--------------------------- |  of its pairs these are left
  | <-- OUTCOMES -------------------|--------------------------> |  as many rounds as are planned

A message about a block is for the first node that has not swapped it yet; one that has passes
it on. So nothing needs an address: who tells whom follows from the order of swaps.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hosts.hardware.operations import BlockName
from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import Symbols
from hosts.middleware.services.distribution.purification import PHOTONS, Protocol, purify
from hosts.middleware.session.blocks import LOST, Mask, keep, keep_of_all, store, take
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.protocol import Hear, Say, Side, Steps, do, hear
from hosts.middleware.session.values import Numbers, expect
from hosts.timeouts import BITS_TIMEOUT_S
from wire.metadata.values import Topic, Values
from wire.metadata.vocabulary import Reason

MAX_OPERATOR = 3  # a Pauli operator is two bits: X, Z


class Bits(NamedTuple):
    """By which operators the first pairs of a chain are corrected; shape (k,) each.

    Pair i is made of the i-th pairs of all links: there are as many as the poorest link has.
    """

    seen: NDArray[np.bool_]  # whether every analyser on the path has reported
    operators: Symbols  # 0 where not

    @classmethod
    def of_outcomes(cls, outcomes: Symbols, distinguishable_states: frozenset[int]) -> "Bits":
        """Return what a Bell measurement tells: the state's number is the operator.

        States that the analyser does not tell from others count as not seen.
        """
        seen = np.isin(outcomes, list(distinguishable_states))
        return cls(seen, np.where(seen, outcomes, 0).astype(np.uint8))

    @classmethod
    def none(cls, size: int) -> "Bits":
        """Return those of `size` pairs before any swap."""
        return cls(np.ones(size, dtype=bool), np.zeros(size, dtype=np.uint8))

    @property
    def size(self) -> int:
        return self.seen.size

    def first(self, most: int) -> "Bits":
        return Bits(self.seen[:most], self.operators[:most])

    def joined(self, other: "Bits") -> "Bits":
        """Return those of two chains of which one continues the other: operators multiply."""
        size = min(self.size, other.size)
        one, two = self.first(size), other.first(size)
        seen = one.seen & two.seen
        return Bits(seen, np.where(seen, one.operators ^ two.operators, 0).astype(np.uint8))


class Swapped(NamedTuple):
    """A repeater's report of a block when it has swapped."""

    place: int  # in the chain
    waited_us: int  # by each half that it has joined, from its memory's taking it; on average
    bits: Bits


MAX_SEED = (1 << 32) - 1

Parts = list[tuple[Topic, Numbers, int]]  # of one report: topic, numbers, width of each


def correct(name: BlockName, size: int, bits: Bits) -> Steps[Mask]:
    """Make Phi+ of what a swap has left of a block's pairs; return which are there, shape (n,)."""
    if bits.size > size:
        text = f"{bits.size} pairs swapped of block {name.number}, {size} are here"
        raise SessionError(Reason.PROTOCOL, text)
    seen = np.flatnonzero(bits.seen)
    kept = np.zeros(bits.size, dtype=bool)
    if size:
        yield from take(name, {name: seen})
    if seen.size:
        yield from do(Qnic.apply, name, bits.operators[seen])
        there = yield from store(name)
        yield from keep_of_all(name, there)
        kept[seen[there]] = True
    return kept


def lead(
    side: Side, name: BlockName, kept: Mask, protocol: int, rounds: int, seed: int
) -> Steps[int]:
    """Purify pairs as their right end, which knows what is left; return how many there are then."""
    number, size = name.number, int(np.count_nonzero(kept))
    purification = side.words(Topic.PURIFY, number, [protocol, seed], 32)
    yield Say((purification, side.words(Topic.ARRIVED, number, kept, 1)))
    for turn in range(rounds):
        size = yield from _round(side, name, size, protocol, (seed + turn) & MAX_SEED)
    return size


def follow(side: Side, name: BlockName, size: int, rounds: int) -> Steps[int]:
    """Purify pairs as their left end, when the right end says so; return how many are left."""
    number = name.number
    words = yield from hear(Topic.PURIFY, number, 2, MAX_SEED, BITS_TIMEOUT_S)
    kept = yield from hear(Topic.ARRIVED, number, None, 1)
    protocol, seed = words.tolist()
    if protocol not in (Protocol.BBPSSW, Protocol.DEJMPS) or kept.size > size:
        text = f"purification of {kept.size} of {size} pairs by protocol {protocol}"
        raise SessionError(Reason.PROTOCOL, text)
    if size:
        yield from take(name, {name: np.flatnonzero(kept)})
    size = int(np.count_nonzero(kept))
    for turn in range(rounds):
        size = yield from _round(side, name, size, protocol, (seed + turn) & MAX_SEED)
    return size


def _round(side: Side, name: BlockName, size: int, protocol: int, seed: int) -> Steps[int]:
    """Compare pairs two by two; return how many are kept, at both ends."""
    compared, ours = size // PHOTONS, np.zeros(0, dtype=np.uint8)
    if compared:
        ours = yield from purify(name, size, Protocol(protocol), seed)
    yield side.say(Topic.OUTCOMES, name.number, ours, 2)
    theirs: Symbols = (
        yield from hear(Topic.OUTCOMES, name.number, compared, LOST, BITS_TIMEOUT_S)
    ).astype(np.uint8)
    agreed = (ours == theirs) & (ours != LOST)
    if not size:
        return 0
    return (yield from keep(name, agreed))


# Reports that pass nodes which have swapped: number of messages, width of their numbers.
_PASSING: dict[int, tuple[tuple[Topic, int], ...]] = {
    Topic.SWAPPED: ((Topic.SWAPPED, 32), (Topic.ARRIVED, 1), (Topic.CORRECTIONS, 2)),
    Topic.PURIFY: ((Topic.PURIFY, 32), (Topic.ARRIVED, 1)),
    Topic.OUTCOMES: ((Topic.OUTCOMES, 2),),
}


def passing(side: Side, number: int) -> Steps[Parts]:
    """Return the next report of a block, part by part, to be passed on."""
    message: Values = yield Hear(Values, BITS_TIMEOUT_S, number)
    parts = _PASSING.get(message.topic)
    if parts is None:
        text = f"values of topic {message.topic} from {side.peer}, to be passed on"
        raise SessionError(Reason.PROTOCOL, text)
    found = []
    for place, (topic, width) in enumerate(parts):
        if place:
            message = yield Hear(Values, BITS_TIMEOUT_S, number)
        numbers = expect(message, topic, number, None, (1 << width) - 1)
        found.append((topic, numbers, width))
    return found


def told_on(side: Side, number: int, parts: Parts) -> Say:
    return Say(tuple(side.words(topic, number, numbers, width) for topic, numbers, width in parts))
