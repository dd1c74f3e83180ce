"""The parts of a network as result.json keeps them: hosts, switches, fibres, copper."""

from dataclasses import asdict, dataclass, field
from typing import Any, ClassVar

from wire.config import QuantumSwitch
from wire.parameters.fiber import Fiber


@dataclass(frozen=True)
class NetworkFacts:
    """A network as it was built."""

    # Results that do not say it are of networks that could call theirs by one name alone.
    EARLIER: ClassVar = {"copper_switches": ["s1"]}

    addresses: dict[str, str]  # of the hosts
    source: str  # the host that makes pairs
    fibers: list[Fiber]
    switches: list[QuantumSwitch]
    copper: list[list[str]]  # of each link: node and interface at one end, and at the other
    # Where nodes are on a map, from left to right and upwards; empty: on none.
    positions: dict[str, tuple[float, float]] = field(default_factory=dict)
    datapath_ids: dict[str, int] = field(default_factory=dict)  # of switches
    copper_switches: list[str] = field(default_factory=list)  # those of copper alone

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)

    def host_at(self, interface: str) -> str:
        """Return the host that a switch's copper interface leads to, "" if there is none."""
        for node1, name1, node2, name2 in self.copper:
            if interface == name1:
                return node2
            if interface == name2:
                return node1
        return ""
