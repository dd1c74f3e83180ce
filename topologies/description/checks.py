"""Checks of a whole topology: clashes between its parts, and parts that nothing reaches.

alice ---- s1 ---- ed        all that has light reaches ed, which holds the qubits, over switches
alice ==== q1 ==== bob       a fibre has a quantum switch at one end at least
"""

from collections import defaultdict
from collections.abc import Mapping
from itertools import pairwise
from typing import NamedTuple

from programs.shortest_paths import Distances, shortest
from topologies.description.content import Content, Link, Node
from topologies.nodes import (
    ClassicalHost,
    ClassicalSwitch,
    DispatcherHost,
    OpticalSwitch,
    QuantumHost,
)
from topologies.system.runs.node_names import check_name
from wire.parameters.physics import BadParameter

MOST_LETTERS = 15  # of an interface's name: IFNAMSIZ of netdevice(7) less its end
NAMED = 5  # hosts in an error, at most


class FirstLink(NamedTuple):
    """The link at the first port of a host, where Mininet puts its address."""

    port: int
    end: Node
    is_fiber: bool


def check_clashes(content: Content) -> None:
    """Raise BadParameter for nodes of one address or ID, bad names, loops and dark fibres."""
    nodes = content.nodes.values()
    for node in nodes:
        check_name(node.name)
    _refuse_same("address", "an ip", {n.name: str(n.address.ip) for n in nodes if n.address})
    _refuse_same("MAC address", "a mac", {n.name: n.mac for n in nodes if n.mac})
    _refuse_same(
        "datapath ID", "a dpid", {n.name: f"{n.dpid:x}" for n in nodes if n.dpid is not None}
    )
    for link in content.links:
        _check_link(link)
    _refuse_loops(content)


def _refuse_same(what: str, what_else: str, values: Mapping[str, str]) -> None:
    """Raise BadParameter for a value that several nodes have."""
    having = defaultdict[str, list[str]](list)
    for name, value in values.items():
        having[value].append(name)
    for value, names in having.items():
        if len(names) > 1:
            raise BadParameter(
                f"{' and '.join(names)} have one {what}, {value}: give each {what_else}"
            )


def _check_link(link: Link) -> None:
    """Raise BadParameter for ends that a link, its interfaces or its light cannot have."""
    refuse_self_link(link.a.name, link.b.name)
    for node, port, _other in link.ends:
        _check_interface(node, port, link.is_fiber)
        if link.is_fiber and not issubclass(node.kind, (QuantumHost, OpticalSwitch)):
            raise BadParameter(
                f"{link}: {node.name} has no light; make it of cls=QuantumHost or cls=OpticalSwitch"
            )


def refuse_self_link(one: str, other: str) -> None:
    """Raise BadParameter for a link that ends where it begins."""
    if one == other:
        raise BadParameter(f"a link from {one} to {one} leads nowhere: join two different nodes")


def _check_interface(node: Node, port: int, is_fiber: bool) -> None:
    """Raise BadParameter if the interface has too long a name, as Mininet makes it.

    Those of hosts' fibres are shorter than that of their copper.
    """
    interface = f"{node.name}-eth{port}"
    if len(interface) > MOST_LETTERS and (node.is_switch or not is_fiber):
        raise BadParameter(
            f"{node.name}: its interface {interface} would have {len(interface)} letters, and "
            f"Linux takes {MOST_LETTERS}: choose a name of at most "
            f"{MOST_LETTERS - len(interface) + len(node.name)}"
        )


def _refuse_loops(content: Content) -> None:
    """Raise BadParameter for copper that closes a loop of switches without a spanning tree."""
    switches = (node for node in content.nodes.values() if node.is_switch)
    joined = {node.name: {node.name} for node in switches if not node.info.get("stp")}
    for link in content.links:
        one, other = link.a.name, link.b.name
        if link.is_fiber or not {one, other} <= joined.keys():
            continue
        if other in joined[one]:
            raise BadParameter(
                f"{link} closes a loop of switches, in which broadcasts would "
                "circle without end: leave it out, or another link of the loop"
            )
        together = joined[one] | joined[other]
        joined |= dict.fromkeys(together, together)


def check_reach(content: Content) -> None:
    """Raise BadParameter for fibres between hosts, several IP networks, and hosts without copper.

    A host has its address at its first port alone, and hosts of ours pass nothing on.
    """
    for link in content.links:
        one, other = link.a, link.b
        if link.is_fiber and not (one.is_switch or other.is_switch):
            raise BadParameter(
                f"{link}: both are hosts; lay it by way of a quantum switch, as "
                f'addFibers("{one.name}", "q1") and addFibers("q1", "{other.name}")'
            )
    _refuse_other_networks(content.of(ClassicalHost))
    lit, dispatchers = content.of(QuantumHost), content.of(DispatcherHost)
    if dispatchers:
        _refuse_left_out(content, lit, dispatchers[0])
    elif lit or content.of(OpticalSwitch):
        raise BadParameter(
            "there is no host that holds the qubits: add one of cls=DispatcherHost, or derive from "
            "QuantumTopo, which does"
        )


def _refuse_other_networks(hosts: list[Node]) -> None:
    """Raise BadParameter for hosts of ours in several IP networks: they broadcast in one."""
    networks = {host.name: host.address.network for host in hosts if host.address}
    for (first, network), (name, other) in pairwise(networks.items()):
        if other != network:
            raise BadParameter(
                f"{first} is in the network {network}, and {name} in {other}: give all hosts an ip "
                "in one network, written ADDRESS/BITS"
            )


def _refuse_left_out(content: Content, lit: list[Node], dispatcher: Node) -> None:
    """Raise BadParameter unless the copper of all these hosts leads to the dispatcher."""
    first = _first_links(content)
    for host in (dispatcher, *lit):
        _check_first_link(host.name, first.get(host.name))
    centre = first[dispatcher.name].end.name
    reached = shortest(_copper_that_passes(content), centre)
    apart = [host.name for host in lit if first[host.name].end.name not in reached]
    if apart:
        named = [*apart[:NAMED], *([f"{len(apart) - NAMED} more"] if len(apart) > NAMED else [])]
        raise BadParameter(
            f"no copper leads from {', '.join(named)} to {dispatcher.name}, which holds the "
            f"qubits: {_remedy(first[apart[0]].end, centre)}"
        )


def _remedy(end: Node, centre: str) -> str:
    if end.is_switch and not issubclass(end.kind, ClassicalSwitch):
        example = f'addSwitch("{end.name}", cls=ClassicalSwitch)'
        return f"make {end.name}, and each other switch of copper, of ours, as {example}"
    return f'join the switches, as addLink("{end.name}", "{centre}")'


def _check_first_link(name: str, first: FirstLink | None) -> None:
    """Raise BadParameter if the first link of a host is not copper to what passes packets on."""
    if first is None:
        raise BadParameter(f'{name} has no copper: add some, as addLink("{name}", "s1")')
    if first.is_fiber:
        raise BadParameter(
            f"{name}: its first link is a fibre, and its address belongs to copper: add the copper "
            "before the fibres, or derive from QuantumTopo, which keeps a port for it"
        )
    if not first.end.passes_packets:
        raise BadParameter(
            f"copper {name} to {first.end.name}: both are hosts, and pass nothing on; join {name} "
            f'to a switch before, as addLink("{name}", "s1")'
        )


def _first_links(content: Content) -> dict[str, FirstLink]:
    links: dict[str, FirstLink] = {}
    for link in content.links:
        for node, port, other in link.ends:
            here = FirstLink(port, other, link.is_fiber)
            if not node.is_switch:
                links[node.name] = min(links.get(node.name, here), here, key=lambda each: each.port)
    return links


def _copper_that_passes(content: Content) -> Distances:
    distances: Distances = {}
    for link in content.links:
        one, other = link.a, link.b
        if not link.is_fiber and one.passes_packets and other.passes_packets:
            distances.setdefault(one.name, {})[other.name] = 0.0
            distances.setdefault(other.name, {})[one.name] = 0.0
    return distances
