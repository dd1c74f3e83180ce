"""The quantum part of a topology: hosts with light, quantum switches, fibres, who makes pairs."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from topologies.catalogue.switch_presets import optics_of
from topologies.description.checks import check_clashes, check_reach
from topologies.description.content import Content
from topologies.links.fiber import OPTICS as FIBER_OPTICS
from topologies.nodes import OpticalSwitch, QuantumHost
from topologies.nodes.quantum_host import device_of
from wire.parameters.fiber import FiberOptics, optics
from wire.parameters.physics import Device
from wire.parameters.switch import QuantumSwitch


@dataclass(frozen=True)
class LaidFiber:
    a: str
    b: str
    optics: FiberOptics


@dataclass(frozen=True)
class Description:
    hosts: Mapping[str, Device]  # those that have light
    switches: Mapping[str, QuantumSwitch]
    fibers: tuple[LaidFiber, ...]
    sources: tuple[str, ...]  # of these hosts, those that make pairs for others
    pairs_from: Mapping[str, str] = field(default_factory=dict)  # of hosts that name their source

    def source_for(self, host: str) -> str:
        """Return the host that makes pairs for what one asks, if it names none; "" if none does."""
        return self.pairs_from.get(host) or next(reversed(self.sources), "")


def describe(content: Content) -> Description:
    """Return what a topology describes; raise BadParameter for what cannot be."""
    hosts = content.of(QuantumHost)
    described = Description(
        hosts={host.name: device_of(host.name, host.info) for host in hosts},
        switches={each.name: optics_of(each.name, each.info) for each in content.of(OpticalSwitch)},
        fibers=tuple(
            LaidFiber(link.a.name, link.b.name, optics(str(link), **link.given(FIBER_OPTICS)))
            for link in content.links
            if link.is_fiber
        ),
        sources=tuple(host.name for host in hosts if host.info.get("source")),
        pairs_from={host.name: host.info.get("pairs_from", "") for host in hosts},
    )
    check_clashes(content)
    check_reach(content)
    return described
