"""Moments of keys, of tunnels and of the file through one: what has happened, and when.

Programs of hosts say it as lines of JSON (wire.application_lines); result.json keeps it. Each kind
of moment has a class of its own, by whose names it is read; `vars` gives what is told.
"""

from wire.results.figures import EveFigures, Figures


class Moment(Figures):
    """An event that needs no more words, as tunnel_opened."""

    at: float  # s since the run could begin, by the clock of the network
    event: str
    host: str = ""  # not told of what the run itself does


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
