"""The protocol of a repeater, which has two connections: no socket, no clock.

Its steps are carried out by way of the connection to the left, and go through that to the right.
Blocks follow each other before the first of them is done: each has steps of its own, and hears by
its number.
"""

from hosts.middleware.services.swapping.link import (
    IncomingLink,
    Kept,
    OutgoingLink,
    to_the_left_of,
)
from hosts.middleware.services.swapping.protocol import UnderWay, joined
from hosts.middleware.session.protocol import (
    Concurrently,
    Connection,
    OnConnection,
    Say,
    Steps,
    WaitUntil,
    saying,
    together,
)
from wire.device import SwapOrder


class Repeater:
    """Joins the links to its left and to its right."""

    def __init__(
        self,
        right: Connection,
        links: tuple[IncomingLink, OutgoingLink],
        order: SwapOrder,
        distinguishable_states: frozenset[int],
    ) -> None:
        """Join two open links as ordered; these Bell states are distinguishable here."""
        self._right, self._order = right, order
        self._distinguishable_states = distinguishable_states
        self._incoming, self._outgoing = links
        self._under_way = UnderWay(order.blocks)
        self._not_over = 0  # blocks with messages to come

    def run(self) -> Steps[None]:
        """Swap blocks, several beside each other, until the opener ends it.

        Raise SessionError if it fails: the first failure ends all.
        """
        while (block := (yield from self._incoming.announced())) is not None:
            self._under_way.begin(block[0])
            self._not_over += 1
            yield Concurrently(self._block(*block))
        yield WaitUntil(lambda: not self._not_over)
        yield OnConnection(self._right, self._outgoing.finish())
        yield self._incoming.agree()

    def _block(self, number: int, size: int) -> Steps[None]:
        yield from self._swap(number, size)
        self._not_over -= 1

    def _swap(self, number: int, size: int) -> Steps[None]:
        kept = yield from together(self._incoming.take(number, size), self._made(number, size))
        if self._order.rounds:
            yield from self._purify_and_join(number, kept)
            return
        yield from together(self._pass_on(number), self._tell_of_swap(number, kept))

    def _made(self, number: int, size: int) -> Steps[Kept]:
        kept: Kept = yield OnConnection(self._right, self._outgoing.make(number, size))
        return kept

    def _purify_and_join(self, number: int, kept: tuple[Kept, Kept]) -> Steps[None]:
        """Swap what is left when all that ends here is purified; then pass on what others tell."""
        order, (left, right) = self._order, kept
        sizes = yield from together(
            self._incoming.purify(number, left.size, order, order.seed(number)),
            self._purified(number, right.size),
        )
        purified = left._replace(size=sizes[0]), right._replace(size=sizes[1])
        yield from self._tell_of_swap(number, purified)
        yield from together(self._relay_right(number), self._relay_left(number))

    def _purified(self, number: int, size: int) -> Steps[int]:
        left: int = yield OnConnection(
            self._right, self._outgoing.purify(number, size, self._order)
        )
        return left

    def _relay_right(self, number: int) -> Steps[None]:
        for _ in range(self._order.to_right):
            parts = yield from self._incoming.passing(number)
            yield from self._say_right(self._outgoing.tell(number, parts))

    def _relay_left(self, number: int) -> Steps[None]:
        for _ in range(self._order.to_left):
            parts = yield OnConnection(self._right, self._outgoing.passing(number))
            yield self._incoming.tell(number, parts)

    def _tell_of_swap(self, number: int, kept: tuple[Kept, Kept]) -> Steps[None]:
        names = self._incoming.block(number), self._outgoing.block(number)
        swapped = yield from joined(names, kept, self._order.place, self._distinguishable_states)
        self._under_way.end(number)
        yield from self._say_right(self._outgoing.say(number, swapped))

    def _pass_on(self, number: int) -> Steps[None]:
        missing = to_the_left_of(self._order.place)
        while missing:
            swapped = yield from self._incoming.swapped(number, missing)
            yield from self._say_right(self._outgoing.say(number, swapped))

    def _say_right(self, message: Say) -> Steps[None]:
        yield OnConnection(self._right, saying(message))
