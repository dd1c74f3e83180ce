"""The content of a topology: hosts with light, quantum switches, fibres, and who makes pairs.

Ours, one of a user's own file and what `mn --custom` is given are Mininet's Topo, all alike.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from mininet.topo import Topo

from topologies.catalogue.switch_presets import optics_of
from topologies.links.fiber import OPTICS as FIBER_OPTICS
from topologies.links.fiber import FiberLink
from topologies.nodes import OpticalSwitch, QuantumHost
from topologies.nodes.quantum_host import device_of
from wire.parameters.fiber import FiberOptics, optics
from wire.parameters.physics import Device
from wire.parameters.switch import QuantumSwitch


@dataclass(frozen=True)
class LaidFiber:
    """A fibre between two nodes."""

    a: str
    b: str
    optics: FiberOptics

    def __str__(self) -> str:
        return f"fibre {self.a} to {self.b}"


@dataclass(frozen=True)
class Description:
    """The quantum part of a network."""

    hosts: Mapping[str, Device]  # those that have light
    switches: Mapping[str, QuantumSwitch]
    fibers: tuple[LaidFiber, ...]
    sources: tuple[str, ...]  # of these hosts, those that make pairs for others
    pairs_from: Mapping[str, str] = field(default_factory=dict)  # of hosts that name their source

    def source_for(self, host: str) -> str:
        """Return the host that makes pairs for what one asks, if it names none; "" if none does."""
        return self.pairs_from.get(host) or next(reversed(self.sources), "")


def describe(topo: Topo) -> Description:
    """Return what a topology describes; raise BadParameter for what cannot be."""
    nodes = {name: topo.nodeInfo(name) for name in topo.nodes()}
    hosts = [name for name in topo.hosts() if is_made(nodes[name], QuantumHost)]
    switches = [name for name in topo.switches() if is_made(nodes[name], OpticalSwitch)]
    return Description(
        hosts={name: device_of(name, nodes[name]) for name in hosts},
        switches={name: switch_of(name, nodes[name]) for name in switches},
        fibers=tuple(
            LaidFiber(one, other, optics(f"fibre {one} to {other}", **_own(info, FIBER_OPTICS)))
            for one, other, info in topo.links(withInfo=True)
            if is_made(info, FiberLink)
        ),
        sources=tuple(name for name in hosts if nodes[name].get("source")),
        pairs_from={name: nodes[name].get("pairs_from", "") for name in hosts},
    )


def switch_of(name: str, info: Mapping[str, Any]) -> QuantumSwitch:
    """Return the optics of a quantum switch; raise BadParameter if a value is out of range."""
    return optics_of(name, info)


def is_made(info: Mapping[str, Any], kind: type) -> bool:
    made = info.get("cls")
    return isinstance(made, type) and issubclass(made, kind)


def _own(info: Mapping[str, Any], names: frozenset[str]) -> dict[str, Any]:
    return {name: info[name] for name in names & info.keys()}
