"""Sessions taken over from a controller that has died: their hosts are asked whether they live.

taken over --SessionQuery to the opener--> lives: nothing more
            |   `--silence, again and again--> to the acceptor
            `--unknown there--> over, and torn down

What ended while no controller was there told nobody, and a switch would only find it silent. The
acceptor is asked last: a set-up message may still be held up on its way to it. No socket, no clock.
"""

from dataclasses import dataclass, field

from controller_apps.sessions.actions import Action, Order
from controller_apps.sessions.sessions import Session, Sessions
from controller_apps.timeouts import ASKED_S, HELD_UP_S, NODE_TIMEOUT_S
from wire.device import SessionQuery
from wire.metadata.vocabulary import Reason


@dataclass
class Enquiry:
    """A session that nobody has spoken for yet."""

    session: Session
    begun: float
    asked: float | None = None
    node: str = ""  # address, of the one that was asked last


@dataclass
class Enquiries:
    """All of them, by session."""

    sessions: Sessions
    _open: dict[int, Enquiry] = field(default_factory=dict)

    def begin(self, session: Session, now: float) -> None:
        self._open[session.number] = Enquiry(session, now)

    def due(self, now: float) -> list[Action]:
        """Return the questions that are to be asked now."""
        self._open = {
            number: enquiry
            for number, enquiry in self._open.items()
            if self.sessions.by_number.get(number) is enquiry.session
            and now - enquiry.begun < ASKED_S
        }
        actions: list[Action] = []
        for number, enquiry in self._open.items():
            if enquiry.asked is None or now - enquiry.asked >= NODE_TIMEOUT_S:
                owner = enquiry.session.owner
                waited = now - enquiry.begun >= HELD_UP_S
                enquiry.asked, enquiry.node = now, owner.destination if waited else owner.source
                actions.append(Order(enquiry.node, SessionQuery(0, number)))
        return actions

    def reported(self, number: int, node: str, reason: Reason) -> Session | None:
        """Note a host's (its address) report on a session; return the session if it is over."""
        enquiry = self._open.get(number)
        if enquiry is None or enquiry.node != node:
            return None
        del self._open[number]
        if reason != Reason.UNKNOWN_SESSION:
            return None
        return self.sessions.by_number.get(number)
