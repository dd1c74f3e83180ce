"""Whether a set-up is granted, and which paths it needs. Pure decisions, no state change."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Network
from controller_apps.light.routing import Leg, LightPath, Limits, route, why_not
from controller_apps.light.taps import CannotTap, tapped
from controller_apps.policy import Tap
from controller_apps.sessions.chains import Chain, find_chain
from controller_apps.sessions.segments import FiveTuple
from controller_apps.sessions.sessions import Session, Sessions
from wire.metadata import Handshake, Reason, Service, Setup
from wire.optical import frequency_mhz
from wire.services import LIGHT, Role, fibers_needed


@dataclass(frozen=True)
class Admission:
    """The answer: what to open, or why not."""

    reason: Reason = Reason.OK
    paths: tuple[LightPath, ...] = ()
    waits_for_light: bool = False  # refused only because others have the light
    chain: Chain = ()  # of repeaters, where it is wanted
    detail: str = ""  # why not, for a person, if the reason does not say it all


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
    elif registered is not None or len(sessions.by_number) >= sessions.max_sessions:
        return Admission(Reason.BUSY)
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
        and registered.setup.wavelength_pm == setup.wavelength_pm
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
    """Return the light paths that a set-up needs, or why it cannot have them now."""
    hosts = {
        Role.OPENER: five_tuple.source,
        Role.ACCEPTOR: five_tuple.destination,
        Role.SOURCE: setup.source,
    }
    ports = {role: network.ports_of(address) for role, address in hosts.items()}
    if not all(ports.values()):
        return Admission(Reason.UNKNOWN_HOST)
    service = Service(setup.service)
    legs = legs_of(service, ports)
    if legs is None:
        return Admission(Reason.NO_PATH)
    try:
        legs = tapped(legs, network, taps)
    except CannotTap as error:
        return Admission(error.reason, detail=str(error))
    try:
        limits = limits_of(setup, sessions, budget_mdb)
    except ValueError:  # a wavelength that is none of light
        return Admission(Reason.NO_WAVELENGTH)
    if service == Service.SWAP:  # light comes with each link
        limits = limits._replace(blocked=Limits().blocked)
        chain = find_chain(network, hosts[Role.OPENER], hosts[Role.ACCEPTOR], limits)
        return Admission(Reason.NO_PATH) if chain is None else Admission(chain=chain)
    if setup.handshake == Handshake.PER_PAIR:  # light comes with each pair
        limits = limits._replace(blocked=Limits().blocked)
    paths = route(network, legs, limits)
    if paths is None:
        reason = why_not(network, legs, limits)
        return Admission(reason, waits_for_light=reason == Reason.BUSY)
    return Admission() if setup.handshake == Handshake.PER_PAIR else Admission(paths=paths)


def limits_of(setup: Setup, sessions: Sessions, budget_mdb: int) -> Limits:
    """Return what the light paths of a session must keep to.

    Raise ValueError for a wavelength that is none of light.
    """
    frequency = frequency_mhz(setup.wavelength_pm)
    return Limits(lambda way: sessions.blocks(way, setup.session, frequency), frequency, budget_mdb)


def legs_of(service: Service, ports: Mapping[Role, list[SwitchPort]]) -> list[Leg] | None:
    """Return which ports light must connect, None if a host has too few."""
    if any(len(at) < fibers_needed(service, role) for role, at in ports.items()):
        return None
    return [
        Leg(ports[start.role][start.place], ports[end.role][end.place])
        for start, end in LIGHT[service]
    ]
