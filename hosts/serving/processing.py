"""The doors for a processing unit and for an interception, which packages register by entry points.

They name functions of the forms Begin and Prepare. A host without a unit refuses PROCESS, a host
without an interception INTERCEPT.
"""

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Protocol

from hosts.hardware.qnic import Qnic
from hosts.middleware.session.ends import Answerer
from hosts.middleware.session.errors import unsupported
from hosts.middleware.session.session import Application, OpeningSession
from wire.config import HostConfig
from wire.device import kinds
from wire.registered import registered
from wire.results.figures import EveFigures

REGISTERED = registered("qmn.processing_units").values()
INTERCEPTIONS = registered("qmn.interceptions").values()


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


class Interception(Protocol):
    """An attack on the light that goes by way of this host."""

    @property
    def summary(self) -> EveFigures:
        """Counts so far."""

    async def run(self, tell: Callable[..., Awaitable[None]]) -> None:
        """Go on until cancelled; report each block. Raise HardwareError if it cannot go on."""


Prepare = Callable[[HostConfig, Callable[[int], Qnic], dict[str, Any]], Interception]


def preload() -> None:
    """Import what is registered; the fork server does so once for all hosts."""
    for entry in (*REGISTERED, *INTERCEPTIONS):
        entry.load()
    kinds()


def processing_unit(
    config: HostConfig, qnic: Qnic, sessions: Sessions, new_session: Callable[[], int]
) -> ProcessingUnit | None:
    """Return the unit that a package registers, None if none does; ValueError for several."""
    if not REGISTERED:
        return None
    (entry,) = REGISTERED
    begin: Begin = entry.load()
    return begin(config, qnic, sessions, new_session)


def interception(
    config: HostConfig, qnic_at: Callable[[int], Qnic], fields: dict[str, Any]
) -> Interception:
    """Prepare what an application asks for; raise SessionError if it cannot be had.

    `qnic_at` returns the QNIC that sends at a wavelength (pm).
    """
    if not INTERCEPTIONS:
        raise unsupported("this host attacks no light: install the package applications")
    (entry,) = INTERCEPTIONS
    prepare: Prepare = entry.load()
    return prepare(config, qnic_at, fields)
