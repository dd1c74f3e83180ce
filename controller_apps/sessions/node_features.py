"""The features that hosts have announced, compared with those that a session needs.

A host that has announced nothing of it (one that is not ours) is taken to be able to everything,
with a memory for any block: what it cannot do, it refuses itself.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

from controller_apps.light.paths import Network
from wire.features import STORE, Feature, names
from wire.light import Role
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Reason, Service
from wire.services import WANT_OF, making, needs

ENDS = (Role.OPENER, Role.ACCEPTOR)


@dataclass(frozen=True)
class Want:
    """A host without a feature that a session needs of it."""

    address: str
    feature: Feature
    role: Role

    @property
    def reason(self) -> Reason:
        return WANT_OF[self.feature]

    def __str__(self) -> str:
        return f"{self.address} lacks {names(self.feature)}, which its {self.role.value} needs"


def first_want(setup: Setup, hosts: Mapping[Role, str], network: Network) -> Want | None:
    by = making(setup, hosts[Role.OPENER])
    wants = (
        _want(network, address, role, needs(Service(setup.service), role, by))
        for role, address in hosts.items()
    )
    return next(filter(None, wants), None)


def block_pairs(setup: Setup, hosts: Mapping[Role, str], network: Network) -> int:
    """Return how many pairs a block may have: what is asked for, or what all memories take."""
    service = Service(setup.service)
    keeping = [hosts[role] for role in ENDS if STORE in needs(service, role)]
    memories = map(network.node_features_of, keeping)
    return min([setup.pairs, *(features.memory_qubits for features in memories if features)])


def _want(network: Network, address: str, role: Role, needed: Feature) -> Want | None:
    features = network.node_features_of(address)
    if features is None:
        return None
    missing = _missing(needed, features.features)
    return None if missing is None else Want(address, missing, role)


@cache
def _missing(needed: Feature, there: Feature) -> Feature | None:
    return next(iter(needed & ~there), None)
