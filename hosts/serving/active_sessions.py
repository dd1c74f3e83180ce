"""The sessions that a host takes part in: each once in a role, and never again.

Photons are named by their session. A set-up message that is sent again, or forged with the
number of another session, must not open a second one: when that ended, the host would let go of
the photons of the first.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from hosts.middleware.session.errors import SessionError
from wire.metadata import Reason
from wire.services import Role

MAX_SESSIONS = 64  # that others have opened, at a time
MAX_REMEMBERED = 100_000  # sessions that are over


class ActiveSessions:
    """Which sessions there are, by role, and which there were."""

    def __init__(self, opens_link: Callable[[int], bool]) -> None:
        """Begin with none; a host knows otherwise of links that it opens as a repeater."""
        self._opens_link = opens_link
        self._now: set[tuple[int, bool]] = set()  # session, and whether as its pair source
        self._before: dict[tuple[int, bool], None] = {}  # in the order of their ends

    @property
    def sessions(self) -> frozenset[int]:
        """Return the sessions that are under way."""
        return frozenset(session for session, _source in self._now)

    @contextmanager
    def engage(self, session: int, role: Role) -> Iterator[None]:
        """Take part in a session; raise SessionError if this host does or did.

        A host may be the pair source of a session that it also opens or accepts.
        """
        place = session, role == Role.SOURCE
        if place in self._now or self._opens_link(session):
            text = f"session {session:016x} is under way here: is its set-up message a replay?"
            raise SessionError(Reason.BUSY, text)
        if place in self._before:
            text = f"session {session:016x} was here before: is its set-up message a replay?"
            raise SessionError(Reason.UNKNOWN_SESSION, text)
        if role != Role.OPENER and len(self._now) >= MAX_SESSIONS:
            text = f"{len(self._now)} sessions are under way here: try again when one has ended"
            raise SessionError(Reason.BUSY, text)
        self._now.add(place)
        try:
            yield
        finally:
            self._now.remove(place)
            self._before[place] = None
            if len(self._before) > MAX_REMEMBERED:
                del self._before[next(iter(self._before))]
