"""Link monitors that the controller has this host open, or take part in, on idle light.

node agent --command--> opener: a session of its own, without an application
                      acceptor: takes part in the session of that number, from that opener

Only the controller sends commands: datagrams of others do not come as far (wire.device).
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
from wire.monitor_messages import MonitorCommand, PreemptMonitor
from wire.services import MONITORS

log = logging.getLogger("link-monitors")

MAX_COMMANDS = 256  # that are remembered


class NoApplication:
    """In the place of an application: no program here waits for a link monitor."""

    async def tell(self, **_fields: Any) -> None:
        """Go on."""

    async def deliver(self, _data: bytes) -> None:
        """Refuse bytes: the service has none."""
        raise SessionError(Reason.PROTOCOL, "bytes for a link monitor")

    async def ready(self, _summary: dict[str, Any], _answer: Answerer) -> None:
        """Refuse questions: the service leaves nothing to ask about."""
        raise SessionError(Reason.PROTOCOL, "a link monitor leaves nothing to ask about")

    async def finish(self, _summary: dict[str, Any]) -> None:
        """Know that it is over."""

    async def fail(self, error: BaseException) -> None:
        """Know why it is over; the stack logs it."""


class LinkMonitors:
    """The link monitors of this host, by command of the controller."""

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
        self._answered: dict[int, tuple[Reason, str]] = {}  # by monitor: commands are sent again
        self._expected: dict[int, str] = {}  # monitors, and the address that opens each
        self._open: set[asyncio.Task[None]] = set()

    def take(self, command: MonitorCommand) -> Answer:
        """Carry out a command, once; return the reply to the controller."""
        if command.monitor not in self._answered:
            self._answered[command.monitor] = self._obey(command)
            if len(self._answered) > MAX_COMMANDS:
                del self._answered[next(iter(self._answered))]
        return Answer(command.session, *self._answered[command.monitor])

    def preempt(self, command: PreemptMonitor) -> Answer:
        """End a monitor whose light a session wants; return the reply to the controller."""
        there = self._end(command.monitor)
        return Answer(command.session, Reason.OK if there else Reason.UNKNOWN_SESSION)

    def expected(self, setup: Setup, opener: str) -> NoApplication | None:
        """Return the application of a session that the controller announced, once."""
        if setup.service not in MONITORS or self._expected.get(setup.session) != opener:
            return None
        del self._expected[setup.session]
        return NoApplication()

    def _obey(self, command: MonitorCommand) -> tuple[Reason, str]:
        if command.acceptor == self._address:
            self._expected[command.monitor] = command.opener
            housekeeping_later(UNUSED_S, partial(self._expected.pop, command.monitor, None))
            return Reason.OK, ""
        if command.opener != self._address:
            return Reason.NOT_ALLOWED, f"{self._address} is at no end of the link monitor"
        try:
            session = self._request(_fields(command, self._name), command.monitor)
        except SessionError as error:
            return error.reason, str(error)
        task = asyncio.create_task(self._watch(session), name=f"monitor {command.monitor:016x}")
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
            log.warning("link monitor %016x: %s", session.setup.session, error)


def _fields(command: MonitorCommand, opener: str) -> dict[str, Any]:
    return {
        "service": "seal",
        "host": command.acceptor,
        "port": DEVICE_PORT,
        "source": opener,
        "count": command.pairs,
        "block_pairs": command.block_pairs,
        "rate_hz": command.rate_hz,
        "whole_error": command.whole_error,
        "fraction": command.fraction,
        "false_alarm": command.false_alarm,
        "missed": command.missed,
    }
