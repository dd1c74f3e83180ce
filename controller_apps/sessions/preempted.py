"""Light of link monitors that sessions want: a monitor ends, or loses its light.

wanted --GiveBack to the opener--> over between two blocks, its light free
                                   `--PREEMPTION_S--> torn down

No photon of a monitor is under way then, which another path could turn. No socket, no clock.
"""

from dataclasses import dataclass, field

from controller_apps.sessions.actions import Action, Note, Order
from controller_apps.sessions.sessions import Request, Session, Sessions
from controller_apps.timeouts import PREEMPTION_S
from wire.metadata.vocabulary import Service
from wire.seal_orders import GiveBack

PREEMPTED = "a session wants its light"


@dataclass
class Preempted:
    """The link monitors that have been asked to end."""

    sessions: Sessions
    _since: dict[int, float] = field(default_factory=dict)  # by session

    def holders(self, request: Request) -> list[Session]:
        """Return the link monitors that have light which a request waits for."""
        occupied = self.sessions.occupied
        # A monitor that has only the other direction is in the way by its tuning.
        numbers = {occupied.get(path, occupied.get(path.opposite)) for path in request.obstacles}
        return [
            session
            for number, session in self.sessions.by_number.items()
            if number in numbers and session.setup.service == Service.SEAL
        ]

    def end(self, monitor: Session, now: float) -> list[Action]:
        """Ask the opener of a link monitor to end it, once."""
        if monitor.number in self._since:
            return []
        self._since[monitor.number] = now
        request = Order(monitor.owner.source, GiveBack(0, monitor.number))
        return [Note("wanted", monitor.number), request]

    def late(self, now: float) -> list[Session]:
        """Return the link monitors that have not ended in time; forget those that are over."""
        standing = self.sessions.by_number
        self._since = {number: since for number, since in self._since.items() if number in standing}
        return [
            standing[number] for number, since in self._since.items() if now - since >= PREEMPTION_S
        ]
