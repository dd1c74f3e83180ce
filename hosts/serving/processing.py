"""The door for a processing unit, which a package registers by an entry point of GROUP.

The entry point names a function of Begin's form. A host without a unit refuses PROCESS.
"""

import asyncio
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Any, Protocol

from hosts.hardware.qnic import Qnic
from hosts.middleware.session.ends import Answerer
from hosts.middleware.session.session import Application, OpeningSession
from wire.config import HostConfig

GROUP = "qmn.processing_units"
REGISTERED = entry_points(group=GROUP)


class Attending(Application, Protocol):
    """The application, or its substitute, at the end that accepts a session."""

    async def ready(self, summary: dict[str, Any], answer: Answerer) -> None:
        """Continue: the service is over, but its light is still there to ask about."""

    async def finish(self, statistics: dict[str, Any]) -> None:
        """Note that the session has ended well."""

    async def fail(self, error: BaseException) -> None:
        """Note why the session has failed."""


@dataclass(frozen=True)
class Sessions:
    """Functions of the stack that open sessions, and accept them on ports."""

    request: Callable[[dict[str, Any]], OpeningSession]
    opening: Callable[[OpeningSession], AbstractContextManager[None]]
    expecting: Callable[[int, tuple[str, ...], Attending], AbstractContextManager[None]]


class ProcessingUnit(Protocol):
    port: int  # TCP, for the units of other hosts

    async def serve_unit(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve a unit of another host."""

    async def serve_application(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        """Serve an application that has sent PROCESS; raise SessionError for a bad call."""


Begin = Callable[[HostConfig, Qnic, Sessions, Callable[[], int]], ProcessingUnit]


def preload() -> None:
    """Import what is registered; the fork server does so once for all hosts."""
    for entry in REGISTERED:
        entry.load()


def processing_unit(
    config: HostConfig, qnic: Qnic, sessions: Sessions, new_session: Callable[[], int]
) -> ProcessingUnit | None:
    """Return the unit that a package registers, None if none does; ValueError for several."""
    if not REGISTERED:
        return None
    (entry,) = REGISTERED
    begin: Begin = entry.load()
    return begin(config, qnic, sessions, new_session)
