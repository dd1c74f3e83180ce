"""Time series of keys, of tunnels and of the file through one: events with their times.

Programs of hosts print them as lines of JSON; result.json keeps them. Each kind of event
has a class of its own, by whose names it is read; `vars` gives the fields that it has.
"""

import json
from collections.abc import Mapping
from typing import Any, cast

from wire import typed_json
from wire.results.figures import EveFigures, Figures
from wire.results.service_figures import ServiceFigures


class Moment(Figures):
    """An event that needs no more words, as tunnel_opened."""

    at: float  # s since the run could begin, by the clock of the network
    event: str
    host: str = ""  # empty for events of the run itself


class SessionMoment(Moment):
    """A session of key managers is over: session, alarm (too many errors), or failed."""

    peer: str
    opened: bool  # by this host
    keys: int
    qber: float | None
    mine: int  # keys in the store, for this host to hand out
    theirs: int
    withheld: bool  # no key goes out until a session has few errors
    text: str = ""  # why there are no keys


class KeyMoment(Moment):
    """An end of a tunnel takes another key: key."""

    key_ID: str  # noqa: N815 (as ETSI GS QKD 014 has it)


class HandshakeMoment(Moment):
    """Both ends of a tunnel have the same key: handshake."""

    key_ID: str  # noqa: N815
    seconds: float  # that it took


class ClosedMoment(Moment):
    """An end closes the tunnel, as its key is too old: tunnel_closed."""

    key_age_s: float


class NoKeyMoment(Moment):
    """There is no other key for a tunnel: no_key."""

    text: str  # why


class FileMoment(Moment):
    """The file is on its way, or there: received, downloaded."""

    bytes: int
    sha256: str = ""


class EveComes(Moment):
    """Eve is on the fibre: eve_comes."""

    fraction: float  # of the photons, that she measures


class EveLeaves(Moment, EveFigures):
    """She leaves: eve_leaves. If she was ended before she could tell anything, a plain Moment."""


AnyMoment = (
    Moment
    | SessionMoment
    | KeyMoment
    | HandshakeMoment
    | ClosedMoment
    | NoKeyMoment
    | FileMoment
    | EveComes
    | EveLeaves
)


Line = dict[str, Any]  # `event`, and what belongs to it
NOT_FIGURES = ("event", "peer", "sha256")


def fields_of(line: str | bytes) -> Line:
    """Return the object of a line, {} for a line that is not one: the interpreter also warns."""
    try:
        fields = json.loads(line)
    except (ValueError, RecursionError):
        return {}
    return fields if isinstance(fields, dict) else {}


def figures(line: Mapping[str, Any]) -> ServiceFigures:
    """Return an end's report on a service; raise MalformedPacket for anything else."""
    values = {name: value for name, value in line.items() if name not in NOT_FIGURES}
    return cast("ServiceFigures", typed_json.read(cast("Any", ServiceFigures), values))


def moment(line: Mapping[str, Any], at_s: float) -> AnyMoment:
    """Return what has happened at a time of the run; raise MalformedPacket for anything else."""
    values = {**line, "at": round(at_s, 3)}
    return cast("AnyMoment", typed_json.read(cast("Any", AnyMoment), values))
