"""Orders to this host as a repeater, and the links of chains that have come to it."""

import asyncio
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

from hosts.hardware.replies import HardwareError
from hosts.middleware.session.channel import MetadataChannel
from hosts.middleware.session.errors import SessionError
from hosts.network_loop import housekeeping_later
from hosts.timeouts import ORDER_TIMEOUT_S, UNUSED_S
from wire.device import SwapOrder
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Reason

MAX_ORDERS = 256


class Arrived(NamedTuple):
    """A link that has come to its last node."""

    channel: MetadataChannel
    setup: Setup
    order: SwapOrder  # this host's part in it
    over: asyncio.Future[None]  # done by whom it is for, or failed with


@dataclass
class Swaps:
    """The chains that a host is part of."""

    address: str  # of this host
    _orders: dict[int, SwapOrder] = field(default_factory=dict)  # by session
    _used: set[int] = field(default_factory=set)  # sessions whose order has been asked for
    _expected: dict[int, asyncio.Future[Arrived]] = field(default_factory=dict)
    _news: asyncio.Event = field(default_factory=asyncio.Event)  # another one after each order

    @property
    def sessions(self) -> frozenset[int]:
        return frozenset(self._orders)

    def opens(self, session: int) -> bool:
        return any(not order.last and order.outgoing == session for order in self._orders.values())

    def take(self, order: SwapOrder) -> None:
        """Keep an order until its session is over."""
        if len(self._orders) >= MAX_ORDERS and order.chain not in self._orders:
            self.forget(next(iter(self._orders)))  # the oldest: its session never came
        self._orders[order.chain] = order
        housekeeping_later(UNUSED_S, partial(self._drop_unused, order))
        self._news.set()
        self._news = asyncio.Event()

    def forget(self, session: int) -> None:
        self._orders.pop(session, None)
        self._used.discard(session)

    def _drop_unused(self, order: SwapOrder) -> None:
        if self._orders.get(order.chain) is order and order.chain not in self._used:
            del self._orders[order.chain]

    async def order(self, session: int) -> SwapOrder:
        """Return the order of a session; raise SessionError if it does not come in time."""
        return await self._found(lambda order: order.chain == session)

    async def order_of_link(self, incoming: int) -> SwapOrder:
        """Return the order that a link from the left belongs to; SessionError if none comes."""
        return await self._found(lambda order: order.place > 0 and order.incoming == incoming)

    async def _found(self, matches: Callable[[SwapOrder], bool]) -> SwapOrder:
        try:
            async with asyncio.timeout(ORDER_TIMEOUT_S):
                while not (found := list(filter(matches, self._orders.values()))):
                    await self._news.wait()
                self._used.add(found[0].chain)
                return found[0]
        except TimeoutError as error:
            text = f"no controller gave {self.address} its place in a chain of repeaters in "
            raise SessionError(Reason.NOT_ARBITRATED, f"{text}{ORDER_TIMEOUT_S:g} s") from error

    @contextmanager
    def expecting(self, session: int) -> Iterator[asyncio.Future[Arrived]]:
        """Give the link that will come for a session of which this host is the acceptor."""
        expected = self._expected[session] = asyncio.get_running_loop().create_future()
        error: SessionError | HardwareError | None = None
        try:
            yield expected
        except (SessionError, HardwareError) as why:
            error = why
            raise
        finally:
            del self._expected[session]
            if _arrived(expected) and not expected.result().over.done():
                _end(expected.result().over, error)
            self.forget(session)

    async def hand_over(self, order: SwapOrder, channel: MetadataChannel, setup: Setup) -> None:
        """Give a link to the session that expects it; return when that has used it.

        Raise what that session ends with.
        """
        expected = self._expected.get(order.chain)
        if expected is None or expected.done():
            raise SessionError(Reason.UNKNOWN_SESSION)
        arrived = Arrived(channel, setup, order, asyncio.get_running_loop().create_future())
        expected.set_result(arrived)
        await arrived.over


def _end(over: asyncio.Future[None], error: Exception | None) -> None:
    if error is None:
        over.set_result(None)
    else:
        over.set_exception(error)


def _arrived(expected: asyncio.Future[Arrived]) -> bool:
    return expected.done() and not expected.cancelled()
