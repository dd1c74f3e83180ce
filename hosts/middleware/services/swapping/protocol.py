"""The protocol of entanglement swapping at all its nodes: no socket, no clock.

Links bring the pairs (link.py). The opener keeps of its halves those that the acceptor has
corrected; a repeater swaps when both its links hold; the acceptor corrects by the bits of all
swaps.
"""

from collections import defaultdict
from collections.abc import Awaitable, Callable
from functools import reduce

import numpy as np

from hosts.hardware.operations import BlockName
from hosts.hardware.qnic import Qnic
from hosts.middleware.services.distribution.pairs import Mask, Pairs
from hosts.middleware.services.swapping.link import (
    IncomingLink,
    Kept,
    OutgoingLink,
    to_the_left_of,
)
from hosts.middleware.services.swapping.spans import Bits, Swapped
from hosts.middleware.session.blocks import RESERVED, keep_of_all, store, take
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.protocol import (
    Concurrently,
    Connection,
    HostSide,
    Now,
    OnConnection,
    OpenerSide,
    Steps,
    Tell,
    Wait,
    coming,
    do,
    hear,
)
from hosts.timeouts import BITS_TIMEOUT_S
from wire.device import MAX_UNDER_WAY, SwapOrder
from wire.metadata.values import Topic, Values
from wire.metadata.vocabulary import MemoryState, Reason

# The last link of a chain, and the order of its right end; it arrives when the chain is complete.
LastLink = Callable[[], Awaitable[tuple[Connection, IncomingLink, SwapOrder]]]


class UnderWay:
    """The blocks of a chain that are under way at a node: as many as were ordered at most.

    Names follow from the numbers of blocks: none may come again. They may come in any order, as
    messages about several blocks do.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._begun: set[int] = set()
        self._numbers: set[int] = set()  # of these, those under way

    def begin(self, number: int) -> None:
        """Note that a block begins; raise SessionError if it must not."""
        fits = 0 < number < RESERVED and number not in self._begun
        if not fits or len(self._numbers) >= self._most:
            text = f"block {number} beside {sorted(self._numbers)}: each number comes once, and "
            raise SessionError(Reason.PROTOCOL, f"{text}{self._most} may be under way")
        self._begun.add(number)
        self._numbers.add(number)

    def end(self, number: int) -> None:
        """Note that nothing of a block takes room for its sake here any more."""
        self._numbers.discard(number)


class Opening:
    """How the opener has a block of pairs made of those of all links."""

    def __init__(
        self, side: OpenerSide, connection: Connection, link: OutgoingLink, order: SwapOrder
    ) -> None:
        self._side, self._connection, self._link = side, connection, link
        self._order = order

    def make(self, pairs: Pairs, number: int, size: int) -> Steps[None]:
        """Have a block made; keep half 0 of each pair."""
        side, link = self._side, self._link
        yield from side.call(number, size)
        sent: Kept = yield OnConnection(self._connection, link.make(number, size))
        there = sent.size
        if self._order.rounds:
            there = yield OnConnection(self._connection, link.purify(number, there, self._order))
            pairs.facts.span_rounds = self._order.rounds
        theirs = yield from hear(Topic.ARRIVED, number, None, 1, BITS_TIMEOUT_S)
        if theirs.size > there:
            text = f"{theirs.size} pairs of block {number}, at most {there} were sent"
            raise SessionError(Reason.PROTOCOL, text)
        pairs.admit(number)
        chosen = np.flatnonzero(theirs)
        if there:
            yield from take(side.block(number), {link.block(number): chosen})
        made = sent.size if side.setup.memory == MemoryState.HERALDED else size
        pairs.add(number, made, chosen.size, sent.since_ns)


def joined(
    names: tuple[BlockName, BlockName],
    kept: tuple[Kept, Kept],
    place: int,
    distinguishable_states: frozenset[int],
) -> Steps[Swapped]:
    """Join the first pairs of the links to both sides, and discard the rest of either."""
    size = min(side.size for side in kept)
    for name, side in zip(names, kept, strict=True):
        if size < side.size:
            yield from take(name, {name: np.arange(size)})
    if not size:
        nothing = np.zeros(0, dtype=np.uint8)
        return Swapped(place, 0, Bits.of_outcomes(nothing, distinguishable_states))
    found = yield from do(Qnic.coincidences, *names)
    waited_ns = found.time_ns - sum(side.since_ns for side in kept) // 2
    bits = Bits.of_outcomes(found.outcomes, distinguishable_states)
    return Swapped(place, max(waited_ns // 1000, 0), bits)


class Accepting:
    """How the acceptor takes in what the last repeater sends, and corrects it."""

    def __init__(self, side: HostSide, last_link: LastLink) -> None:
        """Wait for the link only when it is needed."""
        self._side, self._last_link = side, last_link
        self._under_way = UnderWay(MAX_UNDER_WAY)
        # The waits of all pairs, added up: here, and in the repeaters by their places.
        self._corrected, self._waited_ms = 0, 0.0
        self._repeaters_ms: defaultdict[int, float] = defaultdict(float)

    def share(self, pairs: Pairs, message: Values) -> Steps[None]:
        """Have a block taken in, beside others."""
        number, size = coming(message, self._side.setup.pairs)
        self._under_way.begin(number)
        yield Concurrently(self._share(pairs, number, size))

    def _share(self, pairs: Pairs, number: int, size: int) -> Steps[None]:
        """Take a block in, correct the pairs that all swaps reported, and keep these."""
        side = self._side
        pairs.admit(number)
        yield side.ready(number, size)
        connection, link, order = yield Wait(self._last_link)
        there: Kept
        there, swaps = yield OnConnection(connection, _taken(link, number, size, order))
        bits = reduce(Bits.joined, (swapped.bits for swapped in swaps), Bits.none(there.size))
        name = side.block(number, half=1)
        if there.size:
            yield from take(name, {link.block(number): np.flatnonzero(bits.seen)})
        chosen = yield from self._correct(name, bits, there.since_ns)
        for swapped in swaps:
            waited_ms = np.count_nonzero(bits.seen) * swapped.waited_us / 1e3
            self._repeaters_ms[swapped.place] += waited_ms
        self._under_way.end(number)
        pairs.add(number, size, int(np.count_nonzero(chosen)), there.since_ns)
        if self._corrected:
            pairs.facts.waited_ms = self._waited_ms / self._corrected  # for the bits
            pairs.facts.repeaters_waited_ms = [
                waited_ms / self._corrected
                for _place, waited_ms in sorted(self._repeaters_ms.items())
            ]
        yield side.say(Topic.ARRIVED, number, chosen, 1)
        yield Tell(pairs.summary((yield Now())))

    def _correct(self, name: BlockName, bits: Bits, since_ns: int) -> Steps[Mask]:
        """Return which of the pairs are in memory, corrected."""
        seen = np.flatnonzero(bits.seen)
        chosen = np.zeros(bits.size, dtype=bool)
        if seen.size:
            corrected_ns = yield from do(Qnic.apply, name, bits.operators[seen])
            self._waited_ms += seen.size * (corrected_ns - since_ns) / 1e6
            self._corrected += seen.size
            kept = yield from store(name)
            yield from keep_of_all(name, kept)
            chosen[seen[kept]] = True
        return chosen

    def finish(self) -> Steps[None]:
        """Agree to the end of all links; raise SessionError for anything else."""
        connection, link, _order = yield Wait(self._last_link)
        yield OnConnection(connection, _ended(link))


def _taken(
    link: IncomingLink, number: int, size: int, order: SwapOrder
) -> Steps[tuple[Kept, list[Swapped]]]:
    """Return what pairs of a block have come, and what all repeaters tell of their swaps."""
    yield from link.begun(number, size)
    there = yield from link.take(number, size)
    missing, swaps = to_the_left_of(order.place), list[Swapped]()
    due = len(missing)
    if order.rounds:
        left = yield from link.purify(number, there.size, order, order.seed(number))
        there = there._replace(size=left)
        due = order.to_right  # of the others we have heard
    while len(swaps) < due:
        swaps.append((yield from link.swapped(number, missing)))
    return there, swaps


def _ended(link: IncomingLink) -> Steps[None]:
    if (yield from link.announced()) is not None:
        raise SessionError(Reason.PROTOCOL, "another block after all were delivered")
    yield link.agree()
