"""The graph of a topology that refuses what cannot be where it is added, and not at the start.

    class Lab(Topo):
        def build(self):
            self.addHost("h1", cls=QuantumHost, sauce=True)     BadParameter is raised here

Nodes and links of a user's own classes are checked when they are made.
"""

from collections.abc import Container
from functools import wraps
from typing import Any

from mininet.link import Intf
from mininet.topo import MultiGraph, Topo

from topologies.catalogue.switch_presets import optics_of
from topologies.description.checks import refuse_self_link
from topologies.description.content import Info, dpid_of, is_made, is_ours
from topologies.links.copper_link import CopperLink
from topologies.links.fiber import OPTICS as FIBER_OPTICS
from topologies.links.fiber import FiberLink, resolved
from topologies.links.keywords import refuse_unknown
from topologies.nodes import ClassicalSwitch, OpticalSwitch, QuantumHost
from topologies.nodes.quantum_host import device_of
from topologies.system.runs.node_names import check_name
from wire.parameters.fiber import optics
from wire.parameters.physics import BadParameter
from wire.parameters.switch import OPTICS as SWITCH_OPTICS

OF_LINKS = {"node1", "node2", "port1", "port2"}  # that Topo itself adds


def checked(kind: type[Topo]) -> type[Topo]:
    @wraps(kind.build)
    def build(self: Topo, *arguments: Any, **params: Any) -> None:
        self.g = CheckedGraph()
        kind.build(self, *arguments, **params)

    return type(kind.__name__, (kind,), {"build": build})


class CheckedNodes(dict[str, Info]):
    def __missing__(self, name: str) -> Info:
        """Refuse one that is not there, as Topo asks for it when a link is added."""
        raise BadParameter(
            f"there is no node {name!r} by then: add it with addHost or addSwitch before its links"
        )


class CheckedGraph(MultiGraph):
    """Nodes and links that can be made; raise BadParameter for others."""

    def __init__(self) -> None:
        super().__init__()
        self.node = CheckedNodes()

    def add_node(self, node: str, attr_dict: Info | None = None, **attrs: Any) -> None:
        check_new(node, self.node)
        check_node(node, {**(attr_dict or {}), **attrs})
        super().add_node(node, attr_dict, **attrs)

    def add_edge(
        self,
        src: str,
        dst: str,
        key: int | None = None,
        attr_dict: Info | None = None,
        **attrs: Any,
    ) -> int:
        """Add a link; return its number among those of the same nodes."""
        check_link(src, dst, {**(attr_dict or {}), **attrs})
        number: int = super().add_edge(src, dst, key, attr_dict, **attrs)
        return number


def check_new(name: str, there: Container[str]) -> None:
    """Raise BadParameter for a name that no node can have, or that another node has."""
    check_name(name)
    if name in there:
        raise BadParameter(f"there is a node {name} already: give each a name of its own")


def check_node(name: str, info: Info) -> None:
    """Raise BadParameter for a node that cannot be made."""
    kind: Any = info.get("cls")
    if is_made(info, ClassicalSwitch):
        dpid_of(name, info)
    if not is_ours(kind):
        return
    refuse_unknown(name, info, kind, also=SWITCH_OPTICS if is_made(info, OpticalSwitch) else ())
    if is_made(info, QuantumHost):
        device_of(name, info)
    if is_made(info, OpticalSwitch):
        optics_of(name, info)


def check_link(one: str, other: str, info: Info) -> None:
    """Raise BadParameter for a link that cannot be made."""
    refuse_self_link(one, other)
    kind = info.get("cls") or CopperLink
    if not is_ours(kind):
        return
    settings = info.keys() - OF_LINKS
    if is_made(info, FiberLink):
        where = f"fibre {one} to {other}"
        refuse_unknown(where, settings, kind, Intf, also=FIBER_OPTICS)
        resolved(optics(where, **{name: info[name] for name in FIBER_OPTICS & settings}))
    else:
        refuse_unknown(f"copper {one} to {other}", settings, kind, Intf)
