"""Whether a set-up is granted, and which paths it needs. Pure decisions, no state change."""

from collections.abc import Callable
from dataclasses import dataclass

from controller_apps.paths import Direction, Hop, Network, SwitchPort, directions
from controller_apps.segments import FiveTuple
from controller_apps.sessions import Session, Sessions
from wire.metadata import Handshake, Reason, Service, Setup


@dataclass(frozen=True)
class Admission:
    """The answer: what to open, or why not."""

    reason: Reason = Reason.OK
    hops: tuple[Hop, ...] = ()


def admit(setup: Setup, five_tuple: FiveTuple, sessions: Sessions, network: Network) -> Admission:
    """Decide on a set-up that came over the given connection."""
    if setup.session == 0:  # the cookie of entries that belong to no session
        return Admission(Reason.PROTOCOL)
    registered = sessions.by_number.get(setup.session)
    if setup.service == Service.PAIR_SOURCE:
        return _pair_source(five_tuple, registered)
    if setup.handshake == Handshake.ONE_PAIR:
        if not _same_session(setup, five_tuple, registered):
            return Admission(Reason.UNKNOWN_SESSION)
    elif registered is not None or len(sessions.by_number) >= sessions.max_sessions:
        return Admission(Reason.BUSY)
    return _light(setup, five_tuple, sessions, network)


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
        and registered.owner.source == five_tuple.source
        and registered.owner.destination == five_tuple.destination
    )


def _light(setup: Setup, five_tuple: FiveTuple, sessions: Sessions, network: Network) -> Admission:
    ends = [
        network.ports_of(address)
        for address in (five_tuple.source, five_tuple.destination, setup.source)
    ]
    if not all(ends):
        return Admission(Reason.UNKNOWN_HOST)
    wanted = superdense_coding(*ends)
    if wanted is None or _route(wanted, network, lambda _: False) is None:
        return Admission(Reason.NO_PATH)
    if setup.handshake == Handshake.PER_PAIR:
        return Admission()
    hops = _route(
        wanted, network, lambda way: sessions.occupied.get(way, setup.session) != setup.session
    )
    return Admission(Reason.BUSY) if hops is None else Admission(hops=hops)


def superdense_coding(
    sender: list[SwitchPort], receiver: list[SwitchPort], source: list[SwitchPort]
) -> list[tuple[SwitchPort, SwitchPort]] | None:
    """Return which ports light must connect, None if a host has too few.

    One photon of each pair goes by way of the sender, the other straight to the receiver.
    """
    if len(receiver) < 2 or len(source) < 2:
        return None
    return [(source[0], sender[0]), (sender[0], receiver[1]), (source[1], receiver[0])]


def _route(
    wanted: list[tuple[SwitchPort, SwitchPort]],
    network: Network,
    others: Callable[[Direction], bool],
) -> tuple[Hop, ...] | None:
    hops: tuple[Hop, ...] = ()
    for start, end in wanted:
        own = set(directions(hops))
        path = network.path(start, end, lambda way, own=own: way in own or others(way))  # type: ignore[misc]
        if path is None:
            return None
        hops += path
    return hops
