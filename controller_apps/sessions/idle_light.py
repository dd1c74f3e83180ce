"""Unused light as a sensor: link monitors that the controller itself begins.

    due --acceptor, then opener obey--> the opener's session --over--> due every_s later
     |  `--refusal, silence---------------------------------^
     `--light is in use, or wanted, or there is none--> looked at again

Commands go to node agents, sealed as all messages of the controller to hosts. No socket, no clock.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import inf

from controller_apps.light.paths import Network, directions
from controller_apps.packets import FiveTuple
from controller_apps.policy.policy import Watch
from controller_apps.sessions.actions import Action, Command, Note
from controller_apps.sessions.admission import Admission
from controller_apps.sessions.sessions import Sessions
from controller_apps.timeouts import DISCOVERY_S, MONITOR_BEGIN_S, QUEUE_LOOK_S
from wire.device import DEVICE_PORT
from wire.metadata.header import METADATA_PORT
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Handshake, Reason
from wire.monitor_messages import MonitorCommand
from wire.optical import ANY_WAVELENGTH
from wire.services import MONITORS

MOST_AT_ONCE = 8  # searches for light that is idle, in one tick
ANY_PORT = 0  # of the opener's end, which is not known before it connects
Find = Callable[[Setup, FiveTuple], Admission]


@dataclass
class Begun:
    """A link monitor that the controller has requested."""

    watch: Watch
    number: int  # of its session
    opener: str  # address
    acceptor: str
    until: float  # when it is forgotten, unless its session stands by then
    heeded: bool = False  # by the acceptor


@dataclass
class WhyNot:
    text: str
    since: float
    noted: bool = False


@dataclass
class IdleLight:
    """The link monitors that are due, and those that have begun."""

    network: Network
    sessions: Sessions
    find: Find  # light for a set-up, as admission finds it
    numbers: Callable[[], int]  # of new sessions
    _due: dict[Watch, float] = field(default_factory=dict)
    _begun: dict[int, Begun] = field(default_factory=dict)
    _why_not: dict[Watch, WhyNot] = field(default_factory=dict)
    _waiting: set[Watch] = field(default_factory=set)  # for light that others have

    def follow(self, watches: Sequence[Watch], now: float) -> None:
        """Watch these from now on; link monitors that have begun go on to their end."""
        self._due = {watch: self._due.get(watch, now) for watch in watches}
        self._why_not.clear()
        self._waiting.clear()

    @property
    def next_s(self) -> float:
        """Return when the next link monitor is due; sessions give light back at unknown times."""
        begun = {begun.watch for begun in self._begun.values()}
        free = self._due.keys() - begun - self._waiting
        return min((self._due[watch] for watch in free), default=inf)

    def ordered(self, setup: Setup, connection: FiveTuple) -> bool:
        """Return whether a set-up is of a requested link monitor, between its hosts."""
        begun = self._begun.get(setup.session)
        return (
            begun is not None
            and setup.service in MONITORS
            and (begun.opener, begun.acceptor) == (connection.source, connection.destination)
            and setup.source == begun.opener
        )

    def tick(self, now: float) -> list[Action]:
        """Begin what is due where light is idle; forget what has not begun in time."""
        for begun in list(self._begun.values()):
            if begun.until <= now and begun.number not in self.sessions.by_number:
                self.over(begun.number, now)
        busy = {begun.watch for begun in self._begun.values()}
        due = [watch for watch, when in self._due.items() if when <= now and watch not in busy]
        due.sort(key=self._due.__getitem__)
        actions: list[Action] = []
        for watch in due[:MOST_AT_ONCE]:
            self._due[watch] = now + QUEUE_LOOK_S  # unless it begins: then when it is over
            self._waiting.add(watch)
            actions += self._begin(watch, now)
        return actions

    def _begin(self, watch: Watch, now: float) -> list[Action]:
        if not MONITORS:
            return self._unwatched(watch, "no package adds a link monitor: install one", now)
        addresses = {host.host: host.address for host in self.network.hosts.values()}
        ends = [addresses.get(name) for name in watch.between]
        opener, acceptor = ends
        if opener is None or acceptor is None:
            name = watch.between[ends.index(None)]
            return self._unwatched(watch, f"{name} has announced no fibre", now)
        number = self.numbers()
        self.sessions.over[number] = watch.over
        setup = _setup(watch, number, opener)
        light = self.find(setup, FiveTuple(opener, ANY_PORT, acceptor, METADATA_PORT))
        if light.reason != Reason.OK or self._is_wanted(light):
            del self.sessions.over[number]
            if light.reason in (Reason.OK, Reason.BUSY):
                return []  # it is not idle
            reason = f"{light.reason.name}: {light.detail}" if light.detail else light.reason.name
            return self._unwatched(watch, reason, now)
        self._why_not.pop(watch, None)
        self._begun[number] = Begun(watch, number, opener, acceptor, now + MONITOR_BEGIN_S)
        note = Note("watch", number, detail=str(watch))
        return [note, Command(acceptor, _command(self._begun[number]))]

    def _is_wanted(self, light: Admission) -> bool:
        """Tell whether a session waits for some of this light."""
        hops = [hop for path in light.paths for hop in path.hops]
        path = directions(hops)
        needed = {*path, *(direction.opposite for direction in path)}
        waiting = self.sessions.queue.values()
        return any(not needed.isdisjoint(request.obstacles) for request in waiting)

    def _unwatched(self, watch: Watch, text: str, now: float) -> list[Action]:
        """Note why a way is not watched, once, if that does not change soon."""
        cause = self._why_not.get(watch)
        if cause is None or cause.text != text:
            cause = self._why_not[watch] = WhyNot(text, now)
        if cause.noted or now - cause.since < DISCOVERY_S:
            return []
        cause.noted = True
        return [Note("unwatched", 0, detail=f"{watch}: {text}")]

    def node_answered(self, number: int, node: str, reason: Reason, now: float) -> list[Action]:
        """Note what a host (its address) says to its order; order the opener after the acceptor."""
        begun = self._begun.get(number)
        if begun is None:
            return []
        if reason != Reason.OK:
            self.over(number, now)
            return [Note("unwatched", number, detail=f"{begun.watch}: {reason.name} at {node}")]
        if node != begun.acceptor or begun.heeded:
            return []
        begun.heeded = True
        return [Command(begun.opener, _command(begun))]

    def over(self, number: int, now: float) -> None:
        """Note that the session of a link monitor has ended, or was refused."""
        begun = self._begun.pop(number, None)
        self.sessions.over.pop(number, None)
        if begun is not None and begun.watch in self._due:
            self._due[begun.watch] = now + begun.watch.every_s
            self._waiting.discard(begun.watch)


def _setup(watch: Watch, number: int, opener: str) -> Setup:
    return Setup(
        number,
        min(MONITORS),
        Handshake.FRAMED,
        opener,
        watch.block_pairs,
        1,
        watch.rate_hz,
        DEVICE_PORT,
        wavelength_pm=ANY_WAVELENGTH,
    )


def _command(begun: Begun) -> MonitorCommand:
    watch = begun.watch
    return MonitorCommand(
        session=0,
        monitor=begun.number,
        opener=begun.opener,
        acceptor=begun.acceptor,
        pairs=watch.pairs,
        block_pairs=watch.block_pairs,
        rate_hz=watch.rate_hz,
        whole_error=watch.whole_error,
        fraction=watch.fraction,
        false_alarm=watch.false_alarm,
        missed=watch.missed,
    )
