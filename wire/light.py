"""The light that a service needs, and the services that packages add by entry points.

An entry point of the group `qmn.services` names a RegisteredService, in a module that imports of
wire/ nothing but this module, wire.features and wire.results.figures: every process loads it.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import cache
from typing import Any, NamedTuple

from wire.features import Feature
from wire.registered import Registry

GROUP = "qmn.services"
HIGHEST_NUMBER = 255  # a byte of set-up messages


class Role(Enum):
    OPENER = "opener"
    ACCEPTOR = "acceptor"
    SOURCE = "source"


OPENER, ACCEPTOR, SOURCE = Role


class FiberOf(NamedTuple):
    """A fibre of the host in a role, by its place among those of this host; -1 is its last."""

    role: Role
    place: int


class Beam(NamedTuple):
    """One way of light, from fibre to fibre."""

    start: FiberOf
    end: FiberOf


PAIRS = (
    Beam(FiberOf(SOURCE, 0), FiberOf(OPENER, 0)),  # half 0 of each pair
    Beam(FiberOf(SOURCE, 1), FiberOf(ACCEPTOR, 0)),  # half 1
)
TO_NEXT = (Beam(FiberOf(OPENER, -1), FiberOf(ACCEPTOR, 0)),)  # of a line of hosts


@dataclass(frozen=True)
class RegisteredService:
    """A service of a package, as all processes know it."""

    name: str  # as users call it
    number: int  # in set-up messages; 100 to 255 are for services that are not in this tree
    title: str  # of its runs, on pages
    light: tuple[Beam, ...]
    needs: Mapping[Role, Feature]
    ends: str  # MODULE:NAME of a hosts.middleware.session.ends.ServiceKind, which hosts load
    own_light: tuple[Beam, ...] = ()  # if the opener may make the pairs, and keep half of each
    figures: tuple[type[Any], ...] = ()  # subclasses of Figures: what its ends report
    prepares_states: bool = False  # photons that its ends prepare, in place of pairs
    by_key: bool = False  # keys choose and measure its light, of which blocks may be long
    third: str = "a third host that makes pairs"  # what its source is, if it needs one
    monitors: bool = False  # it watches links, and gives its light back to other sessions
    line: bool = False  # each of several hosts opens a session with the next
    # Parts of devices that a role uses, beside those that its needs name (wire.parameters.physics).
    uses: Mapping[Role, tuple[str, ...]] = field(default_factory=dict)
    # Roles that Bell-measure their halves with states that they prepare.
    joins: frozenset[Role] = frozenset()

    def __post_init__(self) -> None:
        if not 0 < self.number <= HIGHEST_NUMBER:
            text = f"service {self.name}: number {self.number}"
            raise ValueError(f"{text}: choose 100 to 255; 1 to 99 are qmn's own")


@cache
def registered_services() -> tuple[RegisteredService, ...]:
    """Return the services of packages by number; one that cannot be loaded is logged and left out.

    Raise ValueError for two of one name or one number.
    """
    added = Registry[RegisteredService](GROUP, lambda each: isinstance(each, RegisteredService), {})
    services = list(added.values())
    for name in ("name", "number"):
        counted = Counter(getattr(service, name) for service in services)
        for value, count in counted.items():
            if count > 1:
                raise ValueError(f"two registered services have the {name} {value}: remove one")
    return tuple(sorted(services, key=lambda service: service.number))
