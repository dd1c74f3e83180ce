"""The request behind an operation on qubits, for those who write it down."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

from dispatcher.layer.ownership import BlockName
from wire.dispatcher_pb2 import BlockId

_origin: ContextVar[str] = ContextVar("origin", default="")


@contextmanager
def caused_by(text: str) -> Iterator[None]:
    """Let what is done meanwhile, and by tasks that are begun, have this origin."""
    token = _origin.set(text)
    try:
        yield
    finally:
        _origin.reset(token)


def origin() -> str:
    """Return the origin of what is done just now, empty if nobody has said."""
    return _origin.get()


def causer() -> str:
    """Return the node that has asked for what is done just now, empty if nobody has."""
    return origin().partition(":")[0]


def describe_request(node: str, kind: str, request: Any) -> str:
    """Return a request of a host as the origin of what it asks for."""
    act = f"{node}: {kind.replace('_', ' ')}"
    if kind == "create":
        return f"{act} block {request.number} of session {request.session:016x}"
    for field in ("block", "first", "into"):
        name = getattr(request, field, None)
        if isinstance(name, BlockId):
            return f"{act} {BlockName(name.session, name.number, name.half)}"
    return act
