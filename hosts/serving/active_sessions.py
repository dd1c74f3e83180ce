"""The sessions that a host takes part in: each once in a role, and never again; shares of peers.

Photons are named by their session. A set-up message that is sent again, or forged with the
number of another session, must not open a second one: when that ended, the host would discard
the photons of the first.

The set-up messages that a host takes part in: those whose verdict the controller has sealed.

A host with standing light also takes those that no controller has arbitrated: the paths are
there already, and do not rotate. A verdict that there is must be sealed all the same.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

from hosts.middleware.session.errors import SessionError
from wire.light import Role
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Reason, Verdict
from wire.outcomes import Pauli
from wire.verdict import Connection, is_sealed

MAX_SESSIONS = 64  # that others have opened, at a time
MAX_OF_ONE = MAX_SESSIONS // 4  # that one of them has: nobody keeps all others out
MAX_REMEMBERED = 100_000  # sessions that are over


class ActiveSessions:
    def __init__(self) -> None:
        # Session, and whether as its pair source: the address of who opened it, "" for this host.
        self._now: dict[tuple[int, bool], str] = {}
        self._before: dict[tuple[int, bool], None] = {}  # in the order of their ends

    @property
    def sessions(self) -> frozenset[int]:
        return frozenset(session for session, _source in self._now)

    @contextmanager
    def engage(self, session: int, role: Role, opener: str = "") -> Iterator[None]:
        """Take part in a session that an address opens; raise SessionError if this host may not.

        It may not if it does or did, or if all that others may have is taken, or all that one may.
        A host may be the pair source of a session that it also opens or accepts.
        """
        place = session, role == Role.SOURCE
        if place in self._now:
            text = f"session {session:016x} is under way here: is its set-up message a replay?"
            raise SessionError(Reason.BUSY, text)
        if place in self._before:
            text = f"session {session:016x} was here before: is its set-up message a replay?"
            raise SessionError(Reason.UNKNOWN_SESSION, text)
        if role != Role.OPENER:
            self._require_place(opener)
        self._now[place] = "" if role == Role.OPENER else opener
        try:
            yield
        finally:
            del self._now[place]
            self._before[place] = None
            if len(self._before) > MAX_REMEMBERED:
                del self._before[next(iter(self._before))]

    def _require_place(self, opener: str) -> None:
        """Raise SessionError if all that others may have is taken, or all that one of them may."""
        again = "try again when one has ended"
        if len(self._now) >= MAX_SESSIONS:
            text = f"{len(self._now)} sessions are under way here: {again}"
            raise SessionError(Reason.BUSY, text)
        theirs = sum(each == opener for each in self._now.values())
        if theirs >= MAX_OF_ONE:
            text = f"{theirs} sessions of {opener} are under way here, its share: {again}"
            raise SessionError(Reason.BUSY, text)


MAX_VERDICTS = 4096


@dataclass
class Verdicts:
    """Checks verdicts of the controller, each of which counts once."""

    key: str  # the device key, hexadecimal; empty: no controller can grant this host anything
    standing: bool = False  # light stands without a grant
    _taken: dict[bytes, None] = field(default_factory=dict)  # seals, the oldest first

    def checked(self, setup: Setup, connection: Connection) -> Setup:
        """Return the set-up as it was decided on.

        Raise SessionError unless the controller has written this verdict for the connection.
        """
        verdict = Verdict(setup.verdict)
        if verdict == Verdict.PENDING and self.standing:
            wavelength_pm = setup.wavelength_pm or Setup.wavelength_pm
            granted = replace(setup, verdict=Verdict.GRANTED, wavelength_pm=wavelength_pm)
            return replace(granted, rotation=Pauli.I)
        if verdict == Verdict.PENDING:
            raise SessionError(Reason.NOT_ARBITRATED)
        if not self.key or not is_sealed(setup.encode(), self.key, connection):
            text = (
                f"the verdict {verdict.name} does not carry the controller's seal: is it made up, "
            )
            text += "or have host and controller different device keys?"
            raise SessionError(Reason.NOT_ARBITRATED, text)
        if setup.seal in self._taken:
            text = f"this verdict {verdict.name} has come before: was it sent again?"
            raise SessionError(Reason.NOT_ARBITRATED, text)
        if len(self._taken) >= MAX_VERDICTS:
            del self._taken[next(iter(self._taken))]
        self._taken[setup.seal] = None
        return setup
