"""The decision on a set-up: granted or refused, and over which paths. It changes no state."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from controller_apps.light.obstacles import Obstacle, obstacles, text_of
from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Direction, Network
from controller_apps.light.routing import Leg, LightPath, Limits, cheapest_path, route, why_not
from controller_apps.light.taps import CannotTap, tapped
from controller_apps.light.waypoints import path_over
from controller_apps.packets import FiveTuple
from controller_apps.policy.policy import Tap
from controller_apps.sessions.node_features import block_pairs, first_want
from controller_apps.sessions.returns import returned_on
from controller_apps.sessions.sessions import Refusal, Session, Sessions
from controller_apps.sessions.switch_chains import most_pairs, swapping
from wire.analyser_frames import MAX_UNDER_WAY
from wire.light import Role
from wire.metadata.setup import OBSTACLE_BYTES, Setup
from wire.metadata.vocabulary import Handshake, MemoryState, Reason, Service
from wire.optical import ANY_WAVELENGTH, DEFAULT_FREQUENCY_MHZ, frequency_mhz, wavelength_pm
from wire.services import (
    RETURNS,
    Making,
    beams,
    fibers_needed,
    making,
    memory_of,
    switches_used,
)


@dataclass(frozen=True)
class Admission:
    """The answer: what to open, or why not."""

    reason: Reason = Reason.OK
    paths: tuple[LightPath, ...] = ()
    waits_for_light: bool = False  # refused only because others have the light
    block_pairs: int = 0  # in a block at most, where memories take less than was asked for
    wavelength_pm: int = 0  # of the channel that was chosen
    node: str = ""  # address of the one that the reason is about, if it is about one
    detail: str = ""  # why not, for who runs the network, if the reason does not say it all
    obstacle: str = ""  # the same for the hosts, where they may know it

    @property
    def refusal(self) -> Refusal:
        return Refusal(self.reason, self.detail, self.node, self.obstacle)


def admit(
    setup: Setup,
    five_tuple: FiveTuple,
    sessions: Sessions,
    network: Network,
    budget_mdb: int,
    taps: Sequence[Tap] = (),
) -> Admission:
    """Decide on a set-up that came over the given connection.

    A light path may lose budget_mdb, in thousandths of a dB; taps divide some of them.
    """
    if setup.session == 0:  # the cookie of entries that belong to no session
        return Admission(Reason.PROTOCOL)
    registered = sessions.by_number.get(setup.session)
    if setup.service == Service.PAIR_SOURCE:
        return _pair_source(five_tuple, registered)
    if setup.service != Service.SDC and setup.handshake != Handshake.FRAMED:
        return Admission(Reason.PROTOCOL)
    if setup.handshake == Handshake.ONE_PAIR:
        if not _same_session(setup, five_tuple, registered):
            return Admission(Reason.UNKNOWN_SESSION)
    elif setup.service in RETURNS and returned_on(setup, five_tuple, sessions) is None:
        return Admission(Reason.UNKNOWN_SESSION)
    elif registered is not None:
        return Admission(Reason.BUSY)
    elif full := sessions.no_place(five_tuple.source):
        return Admission(Reason.BUSY, detail=full)
    return find_light(setup, five_tuple, sessions, network, budget_mdb, taps)


def _pair_source(five_tuple: FiveTuple, registered: Session | None) -> Admission:
    belongs = (
        registered is not None
        and registered.open
        and registered.owner.source == five_tuple.source
        and registered.setup.source == five_tuple.destination
    )
    return Admission() if belongs else Admission(Reason.UNKNOWN_SESSION)


def _same_session(setup: Setup, five_tuple: FiveTuple, registered: Session | None) -> bool:
    return (
        registered is not None
        and registered.setup.handshake == Handshake.PER_PAIR
        and registered.setup.source == setup.source
        and registered.wavelength_pm == setup.wavelength_pm
        and registered.owner.source == five_tuple.source
        and registered.owner.destination == five_tuple.destination
    )


def find_light(
    setup: Setup,
    five_tuple: FiveTuple,
    sessions: Sessions,
    network: Network,
    budget_mdb: int,
    taps: Sequence[Tap] = (),
) -> Admission:
    """Return the light paths that a set-up needs, or why it cannot have them now.

    Of the channels that it may have it gets the first that is free (first fit).
    """
    hosts = {
        Role.OPENER: five_tuple.source,
        Role.ACCEPTOR: five_tuple.destination,
        Role.SOURCE: setup.source,
    }
    if not all(map(network.ports_of, hosts.values())):
        return Admission(Reason.UNKNOWN_HOST)
    service = Service(setup.service)
    if setup.memory not in memory_of(service):
        return Admission(Reason.UNSUPPORTED, detail=f"{service.name} with memory {setup.memory}")
    want = first_want(setup, hosts, network)
    if want is not None:
        return Admission(want.reason, detail=str(want), node=want.address)
    try:
        channels = channels_of(setup, five_tuple, sessions, network)
    except ValueError:  # a wavelength outside the optical range
        return Admission(Reason.NO_WAVELENGTH)
    search = Search(setup, five_tuple, hosts, taps, sessions, network)
    return search.first_fit(channels, budget_mdb)


def channels_of(
    setup: Setup, connection: FiveTuple, sessions: Sessions, network: Network
) -> list[int]:
    """Return the frequencies that the light of a set-up may have, the lowest first.

    A session on the light of another one has that one's. Raise ValueError for a
    wavelength outside the optical range.
    """
    if setup.wavelength_pm != ANY_WAVELENGTH:
        return [frequency_mhz(setup.wavelength_pm)]
    if setup.service in RETURNS:
        session = returned_on(setup, connection, sessions)
        return [session.frequency_mhz] if session else [DEFAULT_FREQUENCY_MHZ]
    return network.optics.channels_mhz or [DEFAULT_FREQUENCY_MHZ]


class Search(NamedTuple):
    """The search for the light of a set-up, channel by channel."""

    setup: Setup
    connection: FiveTuple
    hosts: Mapping[Role, str]  # addresses
    taps: Sequence[Tap]
    sessions: Sessions
    network: Network

    def first_fit(self, channels: Sequence[int], budget_mdb: int) -> Admission:
        """Return light of the first free channel, else why there is none."""
        chooses = self.setup.wavelength_pm == ANY_WAVELENGTH
        refusal: Admission | None = None
        for channel in channels:
            limits = limits_of(self.setup, channel, self.sessions, budget_mdb)
            explains = refusal is None or not refusal.waits_for_light
            admission = self._in_channel(limits, explains)
            if admission.reason == Reason.OK:
                return replace(admission, wavelength_pm=wavelength_pm(channel) if chooses else 0)
            if explains and (refusal is None or admission.waits_for_light):
                refusal = admission
        assert refusal is not None
        return refusal

    def _in_channel(self, limits: Limits, explains: bool) -> Admission:
        """Return the light paths of one frequency, or the reason for none, if it is needed."""
        setup, network = self.setup, self.network
        legs = self._legs(limits)
        if isinstance(legs, Admission):
            return legs
        if switches_used(setup):
            return self._in_switches(limits)
        if setup.handshake == Handshake.PER_PAIR:  # light comes with each pair
            limits = limits._replace(blocked=Limits().blocked)
        over = self.sessions.over.get(setup.session)
        paths = _over(network, legs, over, limits) if over else route(network, legs, limits)
        if paths is None:
            return self._no_paths(legs, over, limits) if explains else Admission(Reason.BUSY)
        if setup.handshake == Handshake.PER_PAIR:
            return Admission()
        return Admission(paths=paths, block_pairs=block_pairs(setup, self.hosts, network))

    def _in_switches(self, limits: Limits) -> Admission:
        """Return the light of as many switches that swap as are wanted, or why there are not."""
        network, count = self.network, switches_used(self.setup)
        ends = (self.hosts[role] for role in (Role.OPENER, Role.ACCEPTOR))
        start, end = (network.channel_ports_of(each, limits.frequency_mhz) for each in ends)
        leg = Leg(start[0], end[0])
        # No light goes all the way: the loss budget is of each link.
        path = cheapest_path(network, leg, limits._replace(loss_budget_mdb=None))
        if path is None:
            return self._no_paths([leg], None, limits)
        heralded = self.setup.memory == MemoryState.HERALDED
        paths = swapping(network, path, count, limits, heralded)
        if not isinstance(paths, str):
            pairs = block_pairs(self.setup, self.hosts, network)
            most = most_pairs(network, paths, pairs, 1 if heralded else MAX_UNDER_WAY)
            return Admission(paths=paths, block_pairs=most)
        free = limits._replace(blocked=Limits().blocked)
        if not isinstance(swapping(network, path, count, free, heralded), str):
            return Admission(Reason.BUSY, waits_for_light=True)
        at_any_loss = free._replace(loss_budget_mdb=None)
        lossy = not isinstance(swapping(network, path, count, at_any_loss, heralded), str)
        reason = Reason.LOSS_TOO_HIGH if lossy else Reason.NO_CHAIN
        return Admission(reason, detail=paths, obstacle=paths)

    def _legs(self, limits: Limits) -> list[Leg] | Admission:
        """Return the ports that light must connect, or why it cannot."""
        frequency, network = limits.frequency_mhz, self.network
        assert frequency is not None
        ports = {
            role: network.channel_ports_of(address, frequency)
            for role, address in self.hosts.items()
        }
        service, by = Service(self.setup.service), making(self.setup, self.hosts[Role.OPENER])
        if few := _too_few_fibers(service, by, self.hosts, ports, network):
            return few
        legs = [
            Leg(ports[start.role][start.place], ports[end.role][end.place])
            for start, end in beams(service, by)
        ]
        try:
            return tapped(legs, network, self.taps, frequency)
        except CannotTap as error:
            return Admission(error.reason, detail=str(error))

    def _no_paths(self, legs: list[Leg], over: frozenset[str] | None, limits: Limits) -> Admission:
        """Return why no paths connect the legs: others have the light, or there are none."""
        if over:
            free = limits._replace(blocked=Limits().blocked)
            is_there = _over(self.network, legs, over, free) is not None
            return Admission(Reason.BUSY if is_there else Reason.NO_PATH, waits_for_light=is_there)
        reason = why_not(self.network, legs, limits)
        if reason == Reason.NO_PATH and (broken := obstacles(self.network, legs)):
            return _broken(broken)
        return Admission(reason, waits_for_light=reason == Reason.BUSY)


def _over(
    network: Network, legs: Sequence[Leg], over: frozenset[str], limits: Limits
) -> tuple[LightPath, ...] | None:
    """Return the paths of a link monitor, of which one has to cross a fibre between switches."""
    for place, leg in enumerate(legs):
        path = path_over(network, leg, over, limits)
        if path is None:
            continue
        others = route(network, [*legs[:place], *legs[place + 1 :]], limits, [path])
        if others is not None:
            return (*others[:place], path, *others[place:])
    return None


def _broken(broken: Sequence[Obstacle]) -> Admission:
    detail = "; ".join(obstacle.text for obstacle in broken)
    host = next((obstacle.address for obstacle in broken if obstacle.address), "")
    reason = Reason.FIBER_CUT if host else Reason.PATH_BROKEN
    return Admission(reason, detail=detail, node=host, obstacle=text_of(broken, OBSTACLE_BYTES))


def _too_few_fibers(
    service: Service,
    by: Making,
    hosts: Mapping[Role, str],
    ports: Mapping[Role, list[SwitchPort]],
    network: Network,
) -> Admission | None:
    """Return the refusal that names a host with fewer fibres than its role takes; None: all do."""
    for role, at in ports.items():
        needed = fibers_needed(service, role, by)
        if len(at) < needed:
            name = network.hosts[network.ports_of(hosts[role])[0]].host
            count = f"{len(at)} fibre{'' if len(at) == 1 else 's'}"
            text = f"{name} has {count}, {service.name} needs {needed} there"
            return Admission(Reason.NO_PATH, node=hosts[role], detail=text, obstacle=text)
    return None


def limits_of(setup: Setup, frequency: int, sessions: Sessions, budget_mdb: int) -> Limits:
    """Return what the light paths of a session at this frequency (MHz) must keep to."""

    def blocked(direction: Direction) -> bool:
        return sessions.blocks(direction, setup.session, frequency)

    return Limits(blocked, frequency, budget_mdb)
