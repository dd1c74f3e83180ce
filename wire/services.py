"""The services that hosts ask for, and the light that each needs.

A service is an entry here and in wire.metadata.Service, and a file in
hosts/middleware/services. The controller opens the paths of LIGHT and knows no more of it.
"""

from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType
from typing import NamedTuple

from wire.metadata import Service


class Role(Enum):
    """What a host is in a session."""

    OPENER = "opener"
    ACCEPTOR = "acceptor"
    SOURCE = "source"


class FiberOf(NamedTuple):
    """A fibre of the host in a role, by its place among those of this host; -1 is its last."""

    role: Role
    place: int


class Beam(NamedTuple):
    """One way of light, from fibre to fibre."""

    start: FiberOf
    end: FiberOf


OPENER, ACCEPTOR, SOURCE = Role.OPENER, Role.ACCEPTOR, Role.SOURCE

PAIRS = (
    Beam(FiberOf(SOURCE, 0), FiberOf(OPENER, 0)),  # half 0 of each pair
    Beam(FiberOf(SOURCE, 1), FiberOf(ACCEPTOR, 0)),  # half 1
)
LIGHT: Mapping[Service, tuple[Beam, ...]] = MappingProxyType(
    {
        # One photon of each pair goes by way of the opener, the other straight to the acceptor.
        Service.SDC: (
            Beam(FiberOf(SOURCE, 0), FiberOf(OPENER, 0)),
            Beam(FiberOf(OPENER, 0), FiberOf(ACCEPTOR, 1)),
            Beam(FiberOf(SOURCE, 1), FiberOf(ACCEPTOR, 0)),
        ),
        Service.DISTRIBUTE: PAIRS,
        Service.TELEPORT: PAIRS,
        Service.BBM92: PAIRS,
        Service.BB84: (Beam(FiberOf(OPENER, 0), FiberOf(ACCEPTOR, 0)),),
        Service.SWAP: (),  # its links have it
        Service.LINK: (Beam(FiberOf(OPENER, -1), FiberOf(ACCEPTOR, 0)),),
    }
)


def fibers_needed(service: Service, role: Role) -> int:
    """Return how many fibres a host in this role needs."""
    ends = [end for beam in LIGHT[service] for end in beam if end.role == role]
    return max((1 + max(end.place, 0) for end in ends), default=0)
