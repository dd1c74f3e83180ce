"""Light of link monitors that sessions want: a monitor ends, or loses its light.

wanted --PreemptMonitor to the opener--> over between two blocks, its light free
                                   `--PREEMPTION_S--> torn down

No photon of a monitor is under way then, which another path could turn. No socket, no clock.

Links that link monitors watch, and those that are closed because of an alarm.

    granted(session)   the monitor's links are known, also when it is over
    watched(number)    links its light crosses: the policy may close them at an alarm
    forget(number)     its light was taken: its last measurements mean nothing

A host is believed only about monitors that it has opened. No socket, no clock.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Hop, Network
from controller_apps.sessions.actions import Action, Command, Note
from controller_apps.sessions.sessions import Request, Session, Sessions
from controller_apps.timeouts import PREEMPTION_S
from wire.monitor_messages import PreemptMonitor
from wire.services import MONITORS

Links = frozenset[frozenset[str]]  # pairs of switches, by their names
MAX_MONITORS = 1024  # that are remembered
NO_LINKS: Links = frozenset()


class LinkMonitors:
    def __init__(self, network: Network) -> None:
        self._network = network
        self._watched: dict[int, tuple[str, Links]] = {}  # the opener's address, and its links
        self.closed: Links = NO_LINKS  # by alarms

    def granted(self, session: Session | None) -> None:
        if session is None or session.setup.service not in MONITORS:
            return
        self._watched.pop(session.number, None)
        self._watched[session.number] = session.owner.source, self._links(session.hops)
        if len(self._watched) > MAX_MONITORS:
            del self._watched[next(iter(self._watched))]

    def watched(self, number: int, host: str) -> Links:
        """Return the links of a monitor; none if the host (its address) has not opened it."""
        opener, links = self._watched.get(number, ("", NO_LINKS))
        return links if opener == host else NO_LINKS

    def is_of(self, number: int, host: str) -> bool:
        return self._watched.get(number, ("", NO_LINKS))[0] == host

    def forget(self, number: int) -> None:
        self._watched.pop(number, None)

    def close(self, links: Links) -> None:
        """Keep links closed until the policy is read again."""
        self.closed |= links

    def _links(self, hops: Iterable[Hop]) -> Links:
        network, links = self._network, set()
        for hop in hops:
            far = network.links.get(SwitchPort(hop.dpid, hop.out_port))
            if far is not None:
                links.add(frozenset({network.name_of(hop.dpid), network.name_of(far.dpid)}))
        return frozenset(links)


def names_of(links: Links) -> list[str]:
    return sorted("-".join(sorted(link)) for link in links)


PREEMPTED = "a session wants its light"


@dataclass
class Preempted:
    """The link monitors that have been asked to end."""

    sessions: Sessions
    _since: dict[int, float] = field(default_factory=dict)  # by session

    def holders(self, request: Request) -> list[Session]:
        occupied = self.sessions.occupied
        # A monitor that has only the other direction is in the way by its tuning.
        numbers = {occupied.get(path, occupied.get(path.opposite)) for path in request.obstacles}
        return [
            session
            for number, session in self.sessions.by_number.items()
            if number in numbers and session.setup.service in MONITORS
        ]

    def end(self, monitor: Session, now: float) -> list[Action]:
        """Ask the opener of a link monitor to end it, once."""
        if monitor.number in self._since:
            return []
        self._since[monitor.number] = now
        request = Command(monitor.owner.source, PreemptMonitor(0, monitor.number))
        return [Note("wanted", monitor.number), request]

    def late(self, now: float) -> list[Session]:
        """Return the link monitors that have not ended in time; forget those that are over."""
        standing = self.sessions.by_number
        self._since = {number: since for number, since in self._since.items() if number in standing}
        return [
            standing[number] for number, since in self._since.items() if now - since >= PREEMPTION_S
        ]
