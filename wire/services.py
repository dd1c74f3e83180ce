"""The services that hosts ask for, the light that each needs, and what its hosts must be able to.

A service of the core is an entry here and in wire.metadata.vocabulary.Service, and a file in
hosts/middleware/services; packages add others (wire.light). The controller opens the paths of
LIGHT between hosts with the features of NEEDS, and knows no more of it.
"""

from collections.abc import Mapping
from enum import Enum
from functools import cache
from types import MappingProxyType

from wire.features import ABSORB, EMIT, GATE, HERALD, INTERFERE, MEASURE, NOTHING, STORE, Feature
from wire.light import (
    ACCEPTOR,
    OPENER,
    PAIRS,
    SOURCE,
    TO_NEXT,
    Beam,
    FiberOf,
    Role,
    registered_services,
)
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import MemoryState, Reason, Service


class Making(Enum):
    """The maker of the pairs of a session."""

    SOURCE = "source"  # a third host, which sends a half of each to either end
    OPENER = "opener"  # which keeps a half of each
    STATION = "station"  # of a quantum switch: it heralds pairs of qubits that emit at either end


REGISTERED = {Service(service.number): service for service in registered_services()}
LIGHT: Mapping[Service, tuple[Beam, ...]] = MappingProxyType(
    {
        # One photon of each pair goes by way of the opener, the other straight to the acceptor.
        Service.SDC: (
            Beam(FiberOf(SOURCE, 0), FiberOf(OPENER, 0)),
            Beam(FiberOf(OPENER, 0), FiberOf(ACCEPTOR, 1)),
            Beam(FiberOf(SOURCE, 1), FiberOf(ACCEPTOR, 0)),
        ),
        Service.DISTRIBUTE: PAIRS,
        Service.SWAP: (),  # who programs the switches, opens it
        # Its pairs come by the light of the session that it goes back on: either half of them
        # is at hand at either host, and who sends passes its own on.
        Service.SDC_RETURN: (Beam(FiberOf(OPENER, 0), FiberOf(ACCEPTOR, 1)),),
        **{service: each.light for service, each in REGISTERED.items()},
    }
)
# Services whose pairs come by light of a session that stands between the same hosts, and was
# opened by the other one: of this service, with the same source and the same wavelength.
RETURNS: Mapping[Service, Service] = MappingProxyType({Service.SDC_RETURN: Service.SDC})
# Services of photons that their ends prepare, without pairs.
PREPARED = frozenset(service for service, each in REGISTERED.items() if each.prepares_states)
# Services whose light is chosen and measured by keys: its blocks may be long.
BY_KEY = frozenset(service for service, each in REGISTERED.items() if each.by_key)
# Link monitors, which the controller begins on idle light.
MONITORS = frozenset(service for service, each in REGISTERED.items() if each.monitors)
# Services of lines of hosts, each of which opens a session with the next: they count on from the
# number of the first.
LINES = frozenset(service for service, each in REGISTERED.items() if each.line)


# Where the opener is the source, of services that can do with that: it keeps half of each pair.
OWN_LIGHT: Mapping[Service, tuple[Beam, ...]] = MappingProxyType(
    {Service.DISTRIBUTE: TO_NEXT}
    | {service: each.own_light for service, each in REGISTERED.items() if each.own_light}
)
# Whose pairs stations in switches herald, if memories emit.
HERALDED = frozenset({Service.DISTRIBUTE, Service.SWAP})
# Hosts report further needs of a session: MEASURE to estimate, GATE to purify.
NEEDS: Mapping[Service, Mapping[Role, Feature]] = MappingProxyType(
    {
        Service.SDC: {SOURCE: EMIT, ACCEPTOR: MEASURE},
        Service.SDC_RETURN: {SOURCE: EMIT, ACCEPTOR: MEASURE},
        Service.DISTRIBUTE: {SOURCE: EMIT, OPENER: ABSORB | STORE, ACCEPTOR: ABSORB | STORE},
        Service.SWAP: {OPENER: EMIT | STORE, ACCEPTOR: EMIT | STORE},
        **{service: each.needs for service, each in REGISTERED.items()},
    }
)
HERALDED_NEEDS: Mapping[Role, Feature] = MappingProxyType(
    {OPENER: HERALD | STORE, ACCEPTOR: HERALD | STORE}
)

# Why a session is refused for want of a feature.
WANT_OF: Mapping[Feature, Reason] = MappingProxyType(
    {
        EMIT: Reason.CANNOT_EMIT,
        STORE: Reason.CANNOT_STORE,
        GATE: Reason.CANNOT_GATE,
        MEASURE: Reason.CANNOT_MEASURE,
        HERALD: Reason.CANNOT_HERALD,
        INTERFERE: Reason.CANNOT_INTERFERE,
        ABSORB: Reason.CANNOT_ABSORB,
    }
)


def is_heralded(service: Service, features: Feature, source: str = "") -> bool:
    """Tell whether pairs of a host are heralded: it has no other light, and names no source."""
    emits = HERALD in features and EMIT not in features
    return emits and service in HERALDED and not source


def switches_used(setup: Setup) -> int:
    """Return how many switches the controller has measure for a session."""
    if setup.service == Service.SWAP:
        return setup.block
    return int(setup.memory == MemoryState.HERALDED)


def memory_of(service: Service) -> tuple[MemoryState, ...]:
    return (MemoryState.ANY, MemoryState.HERALDED)[: 1 + (service in HERALDED)]


def making(setup: Setup, opener: str) -> Making:
    """Return who makes the pairs that a set-up asks for; opener: an address."""
    if setup.memory == MemoryState.HERALDED:
        return Making.STATION
    return Making.OPENER if setup.source == opener else Making.SOURCE


def beams(service: Service, by: Making = Making.SOURCE) -> tuple[Beam, ...]:
    """Return the light of a service, but for that which goes to switches alone."""
    if by == Making.STATION:
        return ()
    return OWN_LIGHT.get(service, LIGHT[service]) if by == Making.OPENER else LIGHT[service]


def is_relayed(service: Service) -> bool:
    """Return whether the light of both ends goes to the source, which lets it interfere."""
    return INTERFERE in NEEDS.get(service, {}).get(SOURCE, NOTHING)


def uses_source(service: Service, by: Making = Making.SOURCE) -> bool:
    makes_its_own = by == Making.OPENER and service in OWN_LIGHT
    return SOURCE in NEEDS.get(service, {}) and not makes_its_own and by != Making.STATION


@cache
def needs(service: Service, role: Role, by: Making = Making.SOURCE) -> Feature:
    table = HERALDED_NEEDS if by == Making.STATION else NEEDS.get(service, {})
    needed = table.get(role, NOTHING)
    keeps_its_own = by == Making.OPENER and role == OPENER
    return needed & ~ABSORB if keeps_its_own else needed


def used_parts(service: Service, role: Role) -> tuple[str, ...]:
    """Return the parts of a device that a package's service uses beside those of its needs."""
    return REGISTERED[service].uses.get(role, ()) if service in REGISTERED else ()


def joins(service: Service, role: Role) -> bool:
    """Return whether a role of a package's service measures its halves with states of its own."""
    return service in REGISTERED and role in REGISTERED[service].joins


@cache
def fibers_needed(service: Service, role: Role, by: Making = Making.SOURCE) -> int:
    ends = [end for beam in beams(service, by) for end in beam if end.role == role]
    return max((1 + max(end.place, 0) for end in ends), default=0)
