"""What a host has been told to do in chains of repeaters, and links that have come to it."""

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import NamedTuple

from hosts.middleware.channel import MetadataChannel, SessionError
from wire.metadata import Reason, Setup

ORDER_TIMEOUT_S = 5.0
LINK_TIMEOUT_S = 10.0
MAX_ORDERS = 256
MAX_REPEATERS = 16
SESSIONS = 1 << 64


@dataclass(frozen=True)
class SwapOrder:
    """What one node of a chain does in a session of swapping."""

    session: int  # that the opener has asked for
    place: int  # in the chain: the opener's is 0, the first repeater's 1
    right: str = ""  # IPv4 address of the next node; "" at the acceptor
    after_left: bool = False  # swap after the left neighbour; else as soon as both links hold

    @property
    def incoming(self) -> int:
        """Return the session of the link from the left."""
        return (self.session + self.place) % SESSIONS

    @property
    def outgoing(self) -> int:
        """Return the session of the link to the right."""
        return (self.incoming + 1) % SESSIONS


class Arrived(NamedTuple):
    """A link that has come to its last node."""

    channel: MetadataChannel
    setup: Setup
    over: asyncio.Event  # set by whom it is for


@dataclass
class Swaps:
    """The chains that a host is part of."""

    address: str  # of this host
    _orders: dict[int, SwapOrder] = field(default_factory=dict)  # by session
    _asked: dict[int, asyncio.Future[SwapOrder]] = field(default_factory=dict)
    _expected: dict[int, asyncio.Future[Arrived]] = field(default_factory=dict)

    @property
    def sessions(self) -> frozenset[int]:
        """Return the sessions that there are orders for."""
        return frozenset(self._orders)

    def take(self, order: SwapOrder) -> None:
        """Keep an order until its session is over; raise SessionError if it cannot be."""
        if not 0 <= order.place <= MAX_REPEATERS + 1 or not (order.place or order.right):
            text = f"place {order.place} of a chain: at most {MAX_REPEATERS} repeaters are known"
            raise SessionError(Reason.UNSUPPORTED, text)
        if len(self._orders) >= MAX_ORDERS and order.session not in self._orders:
            del self._orders[next(iter(self._orders))]  # the oldest: its session never came
        self._orders[order.session] = order
        if (asked := self._asked.get(order.session)) and not asked.done():
            asked.set_result(order)

    def forget(self, session: int) -> None:
        """Drop the order of a session that is over."""
        self._orders.pop(session, None)

    async def order(self, session: int) -> SwapOrder:
        """Return the order of a session; raise SessionError if it does not come in time."""
        if session in self._orders:
            return self._orders[session]
        asked = self._asked.setdefault(session, asyncio.get_running_loop().create_future())
        try:
            async with asyncio.timeout(ORDER_TIMEOUT_S):
                return await asked
        except TimeoutError as error:
            text = f"no controller has named the repeaters in {ORDER_TIMEOUT_S:g} s"
            raise SessionError(Reason.NOT_ARBITRATED, text) from error
        finally:
            self._asked.pop(session, None)

    def order_of_link(self, incoming: int) -> SwapOrder:
        """Return the order that a link from the left belongs to; SessionError if there is none."""
        for order in self._orders.values():
            if order.place and order.incoming == incoming:
                return order
        raise SessionError(Reason.UNKNOWN_SESSION)

    @contextmanager
    def expecting(self, session: int) -> Iterator[asyncio.Future[Arrived]]:
        """Give the link that will come for a session of which this host is the acceptor."""
        expected = self._expected[session] = asyncio.get_running_loop().create_future()
        try:
            yield expected
        finally:
            del self._expected[session]
            if expected.done() and not expected.cancelled():
                expected.result().over.set()
            self.forget(session)

    async def hand_over(self, session: int, channel: MetadataChannel, setup: Setup) -> None:
        """Give a link to the session that expects it; return when that has used it."""
        expected = self._expected.get(session)
        if expected is None or expected.done():
            raise SessionError(Reason.UNKNOWN_SESSION)
        arrived = Arrived(channel, setup, asyncio.Event())
        expected.set_result(arrived)
        await arrived.over.wait()
