"""The two ends of a link between neighbours: pairs in the memories of both; no socket, no clock.

left                                     right
  | Values(COMING) ----------------------> |  ready for the light
  | <---------------------- Values(COMING) |
  | -- light, half 1; half 0 stays --------> |  into memory
  | Values(ARRIVED) <--------------------> |  both keep what both have, in order
  |    or both attempt, and a station heralds (hosts/middleware/session/blocks.py)
  | Values(SWAPPED, ARRIVED, CORRECTIONS) > |  the bits of each swap to the left

Several blocks may be under way; each says and hears all this by itself, and light is made for one
at a time.
"""

from collections.abc import Callable
from typing import NamedTuple, TypeVar

import numpy as np

from hosts.hardware.operations import BlockName
from hosts.middleware.services.swapping.spans import (
    MAX_OPERATOR,
    MAX_SEED,
    Bits,
    Parts,
    Swapped,
    correct,
    follow,
    lead,
    passing,
    told_on,
)
from hosts.middleware.session.blocks import (
    correct_heralded,
    correct_rotation,
    keep_of_all,
    stored_since,
)
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.offers import unanswered
from hosts.middleware.session.protocol import (
    Say,
    Side,
    Steps,
    WaitUntil,
    hear,
    heralded,
    own_pairs,
    request,
    require_size,
)
from hosts.timeouts import BITS_TIMEOUT_S, IDLE_TIMEOUT_S
from wire.device import NOBODY, SwapOrder
from wire.metadata.blocks import Finish
from wire.metadata.setup import Setup
from wire.metadata.values import Topic
from wire.metadata.vocabulary import MemoryState, Reason, Service

A = TypeVar("A")

NO_DIGEST = bytes(32)
MAX_WAITED_US = (1 << 32) - 1


class Kept(NamedTuple):
    """One end's part of a block: halves of pairs that are at both ends, in order."""

    size: int
    since_ns: int  # the mean time from which they wait


class OutgoingLink:
    """The left end: makes the pairs."""

    def __init__(self, side: Side, port: str) -> None:
        self._side, self._port = side, port
        self._lit = False  # the source makes light for a block

    def block(self, number: int) -> BlockName:
        return self._side.block(number, half=0)

    def make(self, number: int, size: int) -> Steps[Kept]:
        """Make a block of pairs; return what has reached both ends."""
        side = self._side
        if side.setup.memory == MemoryState.HERALDED:
            return (yield from self._herald(number, size))
        stored = yield from self._in_turn(number, size, own_pairs)
        yield side.say(Topic.ARRIVED, number, stored.arrived, 1)
        theirs = yield from hear(Topic.ARRIVED, number, size, 1)
        both = stored.arrived & theirs.astype(bool)
        return Kept((yield from keep_of_all(self.block(number), both)), stored.since_ns)

    def _in_turn(
        self, number: int, size: int, make: Callable[[Side, int, int, str], Steps[A]]
    ) -> Steps[A]:
        """Make the light of a block when that of others is over.

        The right end hears of the block only then: nobody expects light that has to wait.
        """
        yield WaitUntil(lambda: not self._lit)
        self._lit = True
        try:
            yield from self._side.call(number, size)
            return (yield from make(self._side, number, size, self._port))
        finally:
            self._lit = False

    def _herald(self, number: int, size: int) -> Steps[Kept]:
        """Have a station herald pairs; return what is at both ends."""
        side, name = self._side, self.block(number)
        heralds = yield from self._in_turn(number, size, heralded)
        yield side.say(Topic.HERALDED, number, heralds.states, 2)
        kept = yield from hear(Topic.ARRIVED, number, heralds.states.size, 1)
        if not kept.size:
            return Kept(0, 0)
        since_ns = yield from stored_since(name)
        return Kept((yield from keep_of_all(name, kept.astype(bool))), since_ns)

    def purify(self, number: int, size: int, order: SwapOrder) -> Steps[int]:
        """Follow the right ends of all spans that begin here; return how many pairs are left."""
        for _span in range(order.spans_right):
            size = yield from follow(self._side, self.block(number), size, order.rounds)
        return size

    def passing(self, number: int) -> Steps[Parts]:
        return passing(self._side, number)

    def tell(self, number: int, parts: Parts) -> Say:
        return told_on(self._side, number, parts)

    def say(self, number: int, swapped: Swapped) -> Say:
        """Tell the next node, and all behind it, of a swap here or to the left."""
        side, bits = self._side, swapped.bits
        return Say(
            (
                side.words(Topic.SWAPPED, number, [swapped.place, swapped.waited_us], 32),
                side.words(Topic.ARRIVED, number, bits.seen, 1),
                side.words(Topic.CORRECTIONS, number, bits.operators, 2),
            )
        )

    def finish(self) -> Steps[None]:
        return request(Finish(self._side.setup.session, 0, NO_DIGEST), BITS_TIMEOUT_S)


class IncomingLink:
    """The right end: stores what comes."""

    def __init__(self, side: Side, order: SwapOrder) -> None:
        self._side, self._port = side, fiber_of(side.ports, order.left_fiber)

    def block(self, number: int) -> BlockName:
        return self._side.block(number, half=1)

    def announced(self) -> Steps[tuple[int, int] | None]:
        """Return number and size of the block that comes next; None at the end of the link."""
        return self._side.announced(self._side.setup.pairs)

    def begun(self, number: int, size: int) -> Steps[None]:
        """Hear that a block of this number and size comes, or raise SessionError."""
        sizes = yield from hear(Topic.COMING, number, 1, size, IDLE_TIMEOUT_S)
        require_size(int(sizes[0]), size)

    def take(self, number: int, size: int) -> Steps[Kept]:
        """Store a block that was announced; return what has reached both ends."""
        side, name = self._side, self.block(number)
        if side.setup.memory == MemoryState.HERALDED:
            kept, since_ns = yield from correct_heralded(
                side, name, size, self._port, side.ready(number, size)
            )
            return Kept(int(np.count_nonzero(kept)), since_ns)
        light = yield from side.expect_light(name, self._port)
        yield side.ready(number, size)
        theirs = yield from hear(Topic.ARRIVED, number, size, 1)
        stored = yield from side.stored(light, size)
        arrived = yield from correct_rotation(name, stored.arrived, side.setup.rotation)
        yield side.say(Topic.ARRIVED, number, arrived, 1)
        both = arrived & theirs.astype(bool)
        return Kept((yield from keep_of_all(name, both)), stored.since_ns)

    def purify(self, number: int, size: int, order: SwapOrder, seed: int) -> Steps[int]:
        """Purify all spans that end here, each behind the swap that has made it.

        Return how many pairs are left.
        """
        name, kept = self.block(number), np.ones(size, dtype=bool)
        for span in range(order.spans_left):
            if span:
                swapped = yield from self.swapped(number, to_the_left_of(order.place))
                kept = yield from correct(name, size, swapped.bits)
            plan = order.protocol, order.rounds, (seed + span) & MAX_SEED
            size = yield from lead(self._side, name, kept, *plan)
        return size

    def passing(self, number: int) -> Steps[Parts]:
        return passing(self._side, number)

    def tell(self, number: int, parts: Parts) -> Say:
        return told_on(self._side, number, parts)

    def swapped(self, number: int, missing: set[int]) -> Steps[Swapped]:
        """Return what the next repeater tells of a block; it is not missing any more."""
        words = yield from hear(Topic.SWAPPED, number, 2, MAX_WAITED_US, BITS_TIMEOUT_S)
        seen = yield from hear(Topic.ARRIVED, number, None, 1)
        operators = yield from hear(Topic.CORRECTIONS, number, seen.size, MAX_OPERATOR)
        place, waited_us = words.tolist()
        if place not in missing:
            text = f"bits of a swap at place {place}, not of {sorted(missing)}"
            raise SessionError(Reason.PROTOCOL, text)
        missing.remove(place)
        return Swapped(place, waited_us, Bits(seen.astype(bool), operators.astype(np.uint8)))

    def agree(self) -> Say:
        return self._side.agree()


def to_the_left_of(place: int) -> set[int]:
    return set(range(1, place))


def setup_of_link(order: SwapOrder, asked: Setup, address: str) -> Setup:
    return unanswered(
        asked,
        session=order.outgoing,
        service=Service.LINK,
        source=address if order.station == NOBODY else order.station,
        fidelity_ppm=0,
    )


def fiber_of(ports: tuple[str, ...], number: int) -> str:
    """Return the port of the fibre that an order names; raise SessionError if there is none."""
    if number < len(ports):
        return ports[number]
    text = f"ordered to use fibre {number} (counted from 0), this host has {len(ports)}"
    raise SessionError(Reason.UNSUPPORTED, text)
