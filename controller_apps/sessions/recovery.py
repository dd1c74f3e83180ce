"""Sessions taken over from a controller that has died: in doubt until switches confirm them.

    kept --> in doubt, its ports taken --bypass or light entry--> confirmed, as any other
                    `--10 s without either--> torn down

Nothing is opened for a session in doubt, and it is not moved before its switches are here.
Set-up messages that the other controller held come again by TCP and are arbitrated afresh.

Then their hosts are asked whether they live:

taken over --SessionQuery to the opener--> lives: nothing more
            |   `--silence, again and again--> to the acceptor
            `--unknown there--> over, and torn down

A session that ended without a controller has reported it to nobody, and is merely silent. The
acceptor is asked last: a set-up message may still be held up on its way to it. No socket, no clock.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

from controller_apps.light.paths import directions
from controller_apps.packets import FiveTuple
from controller_apps.sessions.actions import Action, Command, RemoveBypass
from controller_apps.sessions.light_paths import Light
from controller_apps.sessions.sessions import Session, Sessions
from controller_apps.timeouts import ASKED_S, DISCOVERY_S, HELD_UP_S, NODE_TIMEOUT_S
from wire.device import SessionQuery
from wire.malformed import MalformedPacket
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
    sessions: Sessions
    _open: dict[int, Enquiry] = field(default_factory=dict)

    def begin(self, session: Session, now: float) -> None:
        self._open[session.number] = Enquiry(session, now)

    def due(self, now: float) -> list[Action]:
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
                actions.append(Command(enquiry.node, SessionQuery(0, number)))
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


PREMATURE = (
    Reason.UNKNOWN_HOST,
    Reason.NO_PATH,
    Reason.LOSS_TOO_HIGH,
    Reason.FIBER_CUT,
    Reason.PATH_BROKEN,
)


@dataclass
class Recovery:
    """Acts on the sessions that were taken over, and on their light."""

    sessions: Sessions
    light: Light
    discovery_s: float = DISCOVERY_S  # until all is known again
    begun: float | None = None  # when this controller took over; None: from nobody

    def resume(self, session: Session, now: float) -> None:
        """Take a session over; raise MalformedPacket if it cannot be beside the others."""
        sessions, path = self.sessions, directions(session.hops)
        taken = set(path) & sessions.occupied.keys()
        exists = session.number in sessions.by_number
        exists = exists or bool(session.requests.keys() & sessions.requests.keys())
        if exists or taken or len(set(path)) < len(path):
            raise MalformedPacket(f"session {session.number:016x} is in the way of another")
        session.saved, session.resumed, session.confirmed = True, now, False
        session.lost_since = now if session.paths else None
        sessions.by_number[session.number] = session
        sessions.requests.update(session.requests)
        sessions.occupied.update(dict.fromkeys(path, session.number))

    def is_premature(self, reason: Reason, now: float) -> bool:
        """Tell whether a refusal may be due to fibres that are still to be discovered again."""
        return (
            self.begun is not None and now - self.begun < self.discovery_s and reason in PREMATURE
        )

    def knows_no_handshakes(self, now: float) -> bool:
        """Tell whether connections may have begun before this controller, and be held up since."""
        return self.begun is not None and now - self.begun < HELD_UP_S

    def bypasses_found(self, dpid: int, entries: Iterable[tuple[int, FiveTuple]]) -> list[Action]:
        """Take what a classical switch lets pass (session and connection of each entry).

        Undo what belongs to no session.
        """
        actions: list[Action] = []
        for number, five_tuple in entries:
            request = self.sessions.requests.get(five_tuple)
            session = self.sessions.of(request) if request is not None else None
            if request is None or session is None or session.number != number:
                actions.append(RemoveBypass(dpid, five_tuple, number))
            else:
                request.bypassed.add(dpid)
                session.confirmed = True
        return actions

    def restored(self) -> list[Action]:
        """Open what switches have lost of sessions that others have confirmed meanwhile."""
        return [
            action
            for session in self.sessions.by_number.values()
            if session.confirmed and session.missing
            for action in self.light.restore(session)
        ]
