"""The order in which the dispatcher does things, and at whose request, written down.

The physical layer changes without a pause, from the beginning of a request or from
the end of a wait until the next wait. The order of these stretches, and the clock in
them, decide all that happens; a journal hears of each. This one ignores them.
"""

import asyncio
from contextlib import AbstractAsyncContextManager, AbstractContextManager, nullcontext
from contextvars import ContextVar
from typing import Any, NamedTuple

from dispatcher.layer.ownership import BlockName
from programs.network_timers import timeout
from wire.dispatcher_pb2 import BlockId
from wire.network_time import REAL_TIME, NetworkTime

_origin: ContextVar["Origin | None"] = ContextVar("origin", default=None)


class Journal:
    """Notes when a request begins and when a wait is over."""

    def __init__(self, network_time: NetworkTime = REAL_TIME) -> None:
        self._time = network_time

    def request(self, _node: str, _kind: str, _request: Any) -> AbstractContextManager[None]:
        """Begin a request; it lasts as long as the context, its flights may last longer."""
        return nullcontext()

    def begun(self, task: asyncio.Task[Any]) -> None:
        """Count a task of the request now, as it may be cancelled before it comes to a wait."""

    async def resumed(self) -> None:
        """Go on after a wait that is not the clock's."""

    def timeout(self, limit_s: float) -> AbstractAsyncContextManager[object]:
        """Return the time-out of a wait, in seconds of the network."""
        return timeout(self._time, limit_s)


class Origin(NamedTuple):
    """A node, what it asks for, and the request."""

    node: str
    kind: str
    request: Any


class CausedBy:
    """Let what is done meanwhile, and by tasks that are begun, have this origin."""

    def __init__(self, node: str, kind: str, request: Any) -> None:
        self._origin = Origin(node, kind, request)

    def __enter__(self) -> None:
        self._token = _origin.set(self._origin)

    def __exit__(self, *_error: object) -> None:
        _origin.reset(self._token)


def origin() -> str:
    """Return the origin of the current operation, empty if it is unknown."""
    cause = _origin.get()
    return "" if cause is None else _described(*cause)


def asked_ns() -> int:
    """Return when the host's request for the current operation came, 0 if it is unknown."""
    cause = _origin.get()
    return 0 if cause is None else int(getattr(cause.request, "asked_ns", 0))


def causer() -> str:
    """Return the node that has asked for what is done just now, empty if nobody has."""
    cause = _origin.get()
    return "" if cause is None else cause.node


def _described(node: str, kind: str, request: Any) -> str:
    act = f"{node}: {kind.replace('_', ' ')}"
    if kind == "create":
        return f"{act} block {request.number} of session {request.session:016x}"
    for field in ("block", "first", "into"):
        name = getattr(request, field, None)
        if isinstance(name, BlockId):
            return f"{act} {BlockName(name.session, name.number, name.half)}"
    return act
