"""The features that hosts have announced, compared with those that a session needs.

A host that has announced nothing of it (one that is not ours) is taken to be able to everything,
with a memory for any block: what it cannot do, it refuses itself.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache

from controller_apps.light.paths import Network
from wire.device import MAX_UNDER_WAY
from wire.features import EMIT, INTERFERE, STORE, Feature, names
from wire.light import Role
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import MemoryState, Reason, Service
from wire.services import WANT_OF, Making, making, needs

MOST_HERALDED = 2  # blocks of a chain of heralded links, under way at once
HALVES = 2  # that a repeater keeps of each pair it makes, and that its memory has to take
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


def want_of_repeater(network: Network, address: str, by: Making = Making.SOURCE) -> Want | None:
    """Return what a host lacks to be a repeater, None if nothing; `by`: who makes its pairs."""
    want = _want(network, address, Role.REPEATER, needs(Service.SWAP, Role.REPEATER, by))
    features = network.node_features_of(address)
    if want is None and features is not None and features.memory_qubits < HALVES:
        return Want(address, STORE, Role.REPEATER)
    return want


def is_station(network: Network, address: str) -> bool:
    """Tell whether a host is known to herald pairs of others, and to make none itself."""
    features = network.node_features_of(address)
    return features is not None and INTERFERE in features.features and EMIT not in features.features


def block_pairs(
    setup: Setup, hosts: Mapping[Role, str], repeaters: Iterable[str], network: Network
) -> int:
    """Return how many pairs a block may have: what is asked for, or what all memories take."""
    return min([setup.pairs, *_pairs_in_memories(setup, hosts, repeaters, network)])


def blocks_under_way(
    setup: Setup, hosts: Mapping[Role, str], repeaters: Iterable[str], network: Network
) -> int:
    """Return how many blocks of a chain may be under way at once.

    As many as fit into the smallest memory, and one at least. Two at most where links are heralded,
    which takes long: what a quick link has waits for a slow one.
    """
    most = MOST_HERALDED if setup.memory == MemoryState.HERALDED else MAX_UNDER_WAY
    pairs = block_pairs(setup, hosts, repeaters, network)
    capacities = _pairs_in_memories(setup, hosts, repeaters, network)
    return max(min([most, *(qubits // pairs for qubits in capacities)]), 1)


def _pairs_in_memories(
    setup: Setup, hosts: Mapping[Role, str], repeaters: Iterable[str], network: Network
) -> list[int]:
    service = Service(setup.service)
    keeping = [hosts[role] for role in ENDS if STORE in needs(service, role)]
    taken = [(address, 1) for address in keeping] + [(address, HALVES) for address in repeaters]
    memories = [(network.node_features_of(address), qubits) for address, qubits in taken]
    return [features.memory_qubits // qubits for features, qubits in memories if features]


def _want(network: Network, address: str, role: Role, needed: Feature) -> Want | None:
    features = network.node_features_of(address)
    if features is None:
        return None
    missing = _missing(needed, features.features)
    return None if missing is None else Want(address, missing, role)


@cache
def _missing(needed: Feature, there: Feature) -> Feature | None:
    return next(iter(needed & ~there), None)
