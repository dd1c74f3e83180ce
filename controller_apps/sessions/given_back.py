"""Light of seals that sessions want: the hosts are told, and light is taken if they do not heed.

wanted --GiveBack to the opener--> over between two blocks, its light free
                                   `--TAKEN_BACK_S--> torn down

No photon of a seal is under way then, which another path could turn. No socket, no clock.
"""

from dataclasses import dataclass, field

from controller_apps.sessions.actions import Action, Note, Order
from controller_apps.sessions.sessions import Request, Session, Sessions
from controller_apps.timeouts import TAKEN_BACK_S
from wire.metadata.vocabulary import Service
from wire.seal_orders import GiveBack

TAKEN_BACK = "a session wants its light"


@dataclass
class GivenBack:
    """The seals that were told to end."""

    sessions: Sessions
    _told: dict[int, float] = field(default_factory=dict)  # when, by session

    def in_the_way(self, request: Request) -> list[Session]:
        """Return the seals that have light that a request waits for."""
        occupied = self.sessions.occupied
        # Who has the other direction alone is in the way by its tuning.
        holders = {occupied.get(way, occupied.get(way.opposite)) for way in request.obstacles}
        return [
            session
            for number, session in self.sessions.by_number.items()
            if number in holders and session.setup.service == Service.SEAL
        ]

    def tell(self, seal: Session, now: float) -> list[Action]:
        """Tell the opener of a seal to end it, once."""
        if seal.number in self._told:
            return []
        self._told[seal.number] = now
        return [Note("wanted", seal.number), Order(seal.owner.source, GiveBack(0, seal.number))]

    def late(self, now: float) -> list[Session]:
        """Return the seals whose openers have not heeded in time; forget those that are over."""
        standing = self.sessions.by_number
        self._told = {number: since for number, since in self._told.items() if number in standing}
        return [
            standing[number] for number, since in self._told.items() if now - since >= TAKEN_BACK_S
        ]
