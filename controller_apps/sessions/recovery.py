"""Sessions taken over from a controller that has died: in doubt until switches confirm them.

    kept --> in doubt, its ports taken --bypass or light entry--> confirmed, as any other
                    `--10 s without either--> torn down

Nothing is opened for a session in doubt, and it is not moved before its switches are here.
Set-up messages that the other controller held come again by TCP and are arbitrated afresh.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from controller_apps.light.paths import directions
from controller_apps.packets.segments import FiveTuple
from controller_apps.sessions.actions import Action, RemoveBypass
from controller_apps.sessions.light_paths import Light
from controller_apps.sessions.sessions import Session, Sessions
from controller_apps.timeouts import DISCOVERY_S, HELD_UP_S
from wire.malformed import MalformedPacket
from wire.metadata.vocabulary import Reason

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
        """Tell whether a refusal may only come of what is still to be discovered again."""
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
