"""Seals that the controller has this host open, or take part in, on light that is idle.

node agent --order--> opener: a session of its own, without an application
                      acceptor: takes part in the session of that number, from that opener

Only the controller can order: datagrams of others do not come as far (wire.device).
"""

import asyncio
import logging
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import partial
from typing import Any

from hosts.hardware.replies import HardwareError
from hosts.middleware.session.ends import Answerer
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.session import OpeningSession
from hosts.network_loop import housekeeping_later
from hosts.timeouts import UNUSED_S
from wire.device import DEVICE_PORT
from wire.metadata.setup import Answer, Setup
from wire.metadata.vocabulary import Reason
from wire.monitor_messages import GiveBack, SealOrder
from wire.services import MONITORS

log = logging.getLogger("ordered-seals")

MAX_ORDERS = 256  # that are remembered


class NoApplication:
    """In the place of an application: nobody here waits for what a seal finds."""

    async def tell(self, **_fields: Any) -> None:
        """Go on."""

    async def deliver(self, _data: bytes) -> None:
        """Refuse bytes: the service has none."""
        raise SessionError(Reason.PROTOCOL, "bytes in a seal")

    async def ready(self, _summary: dict[str, Any], _answer: Answerer) -> None:
        """Refuse questions: the service leaves nothing to ask about."""
        raise SessionError(Reason.PROTOCOL, "a seal leaves nothing to ask about")

    async def finish(self, _summary: dict[str, Any]) -> None:
        """Know that it is over."""

    async def fail(self, error: BaseException) -> None:
        """Know why it is over; the stack logs it."""


class OrderedSeals:
    """The orders that this host has, and what it does about them."""

    def __init__(
        self,
        name: str,
        address: str,
        request: Callable[[dict[str, Any], int], OpeningSession],
        opening: Callable[[OpeningSession], AbstractContextManager[None]],
        end: Callable[[int], bool],
    ) -> None:
        self._name, self._address = name, address
        self._request, self._opening, self._end = request, opening, end
        self._answered: dict[int, tuple[Reason, str]] = {}  # by seal: orders are sent again
        self._expected: dict[int, str] = {}  # seals, and the address that opens each
        self._open: set[asyncio.Task[None]] = set()

    def take(self, order: SealOrder) -> Answer:
        """Carry out an order, once; return the reply to the controller."""
        if order.seal not in self._answered:
            self._answered[order.seal] = self._obey(order)
            if len(self._answered) > MAX_ORDERS:
                del self._answered[next(iter(self._answered))]
        return Answer(order.session, *self._answered[order.seal])

    def give_back(self, order: GiveBack) -> Answer:
        """End a seal, because a session wants its light; return the reply to the controller."""
        there = self._end(order.seal)
        return Answer(order.session, Reason.OK if there else Reason.UNKNOWN_SESSION)

    def expected(self, setup: Setup, opener: str) -> NoApplication | None:
        """Return the application of a session that the controller announced, once."""
        if setup.service not in MONITORS or self._expected.get(setup.session) != opener:
            return None
        del self._expected[setup.session]
        return NoApplication()

    def _obey(self, order: SealOrder) -> tuple[Reason, str]:
        if order.acceptor == self._address:
            self._expected[order.seal] = order.opener
            housekeeping_later(UNUSED_S, partial(self._expected.pop, order.seal, None))
            return Reason.OK, ""
        if order.opener != self._address:
            return Reason.NOT_ALLOWED, f"{self._address} is at no end of the seal"
        try:
            session = self._request(_fields(order, self._name), order.seal)
        except SessionError as error:
            return error.reason, str(error)
        task = asyncio.create_task(self._watch(session), name=f"seal {order.seal:016x}")
        self._open.add(task)
        task.add_done_callback(self._open.discard)
        return Reason.OK, ""

    async def _watch(self, session: OpeningSession) -> None:
        try:
            with self._opening(session):
                try:
                    await session.run(NoApplication().tell)
                    await session.finish()
                except (SessionError, HardwareError) as error:
                    await session.give_up(error)
                    raise
                finally:
                    await session.close()
        except (SessionError, HardwareError) as error:
            log.warning("seal %016x: %s", session.setup.session, error)


def _fields(order: SealOrder, opener: str) -> dict[str, Any]:
    """Return the request that an order stands for, of an opener that is given by its name."""
    return {
        "service": "seal",
        "host": order.acceptor,
        "port": DEVICE_PORT,
        "source": opener,
        "count": order.pairs,
        "block_pairs": order.block_pairs,
        "rate_hz": order.rate_hz,
        "whole_error": order.whole_error,
        "fraction": order.fraction,
        "false_alarm": order.false_alarm,
        "missed": order.missed,
    }
