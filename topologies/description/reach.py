"""Refusals of networks in which a part cannot be reached: over copper, by its address, or by light.

alice ---- s1 ---- ed        all that has light reaches ed, which holds the qubits, over switches
alice ==== q1 ==== bob       a fibre has a quantum switch at one end at least
"""

from collections.abc import Mapping
from itertools import pairwise
from typing import Any, NamedTuple

from mininet.topo import Topo

from programs.shortest_paths import Distances, shortest
from topologies.description.checked_graph import is_ours
from topologies.description.clashes import interface_of
from topologies.description.description import is_made
from topologies.links.fiber import FiberLink
from topologies.nodes import (
    ClassicalHost,
    ClassicalSwitch,
    DispatcherHost,
    OpticalSwitch,
    QuantumHost,
)
from wire.parameters.physics import BadParameter

Infos = Mapping[str, Mapping[str, Any]]  # of nodes
NAMED = 5  # hosts in an error, at most


class FirstLink(NamedTuple):
    """The link at the first port of a host, where Mininet puts its address."""

    port: int
    end: str
    is_fiber: bool


def refuse_unreachable(topo: Topo) -> None:
    """Raise BadParameter for fibres between hosts, several IP networks, and hosts without copper.

    A host has its address at its first port alone, and hosts of ours pass nothing on.
    """
    infos = {name: topo.nodeInfo(name) for name in topo.nodes()}
    for one, other, info in topo.links(withInfo=True):
        if is_made(info, FiberLink) and not (topo.isSwitch(one) or topo.isSwitch(other)):
            raise BadParameter(
                f"fibre {one} to {other}: both are hosts; lay it by way of a quantum switch, as "
                f'addFibers("{one}", "q1") and addFibers("q1", "{other}")'
            )
    lit = [name for name in topo.hosts() if is_made(infos[name], QuantumHost)]
    dispatcher = _dispatcher(infos)
    _refuse_other_networks(
        {name: info for name, info in infos.items() if is_made(info, ClassicalHost)}
    )
    if dispatcher:
        _refuse_left_out(topo, infos, lit, dispatcher)
    elif lit or any(is_made(info, OpticalSwitch) for info in infos.values()):
        raise BadParameter(
            "there is no host that holds the qubits: add one of cls=DispatcherHost, or derive from "
            "QuantumTopo, which does"
        )


def _dispatcher(infos: Infos) -> str:
    return next((name for name, info in infos.items() if is_made(info, DispatcherHost)), "")


def _refuse_other_networks(infos: Infos) -> None:
    """Raise BadParameter for hosts of ours in several IP networks: they broadcast in one."""
    addresses = {name: info["ip"] for name, info in infos.items() if info.get("ip")}
    networks = {name: interface_of(name, ip).network for name, ip in addresses.items()}
    for (first, network), (name, other) in pairwise(networks.items()):
        if other != network:
            raise BadParameter(
                f"{first} is in the network {network}, and {name} in {other}: give all hosts an ip "
                "in one network, written ADDRESS/BITS"
            )


def _refuse_left_out(topo: Topo, infos: Infos, lit: list[str], dispatcher: str) -> None:
    """Raise BadParameter unless the copper of all these hosts leads to the dispatcher."""
    first = _first_links(topo)
    for name in (dispatcher, *lit):
        _refuse_elsewhere(name, first, infos)
    ways = _copper_that_passes(topo, infos)
    there = shortest(ways, first[dispatcher].end)
    apart = [name for name in lit if first[name].end not in there]
    if apart:
        end = first[apart[0]].end
        named = [*apart[:NAMED], *([f"{len(apart) - NAMED} more"] if len(apart) > NAMED else [])]
        raise BadParameter(
            f"no copper leads from {', '.join(named)} to {dispatcher}, which holds the qubits: "
            f"{_remedy(end, first[dispatcher].end, infos)}"
        )


def _remedy(end: str, there: str, infos: Infos) -> str:
    if infos[end].get("isSwitch") and not is_made(infos[end], ClassicalSwitch):
        own = f'addSwitch("{end}", cls=ClassicalSwitch)'
        return f"make {end}, and each other switch of copper, of ours, as {own}"
    return f'join the switches, as addLink("{end}", "{there}")'


def _refuse_elsewhere(name: str, first: Mapping[str, FirstLink], infos: Infos) -> None:
    """Raise BadParameter if the first link of a host is not copper to what passes packets on."""
    if name not in first:
        raise BadParameter(f'{name} has no copper: add some, as addLink("{name}", "s1")')
    end = first[name].end
    if first[name].is_fiber:
        raise BadParameter(
            f"{name}: its first link is a fibre, and its address belongs to copper: add the copper "
            "before the fibres, or derive from QuantumTopo, which keeps a port for it"
        )
    if not _passes(infos[end]):
        raise BadParameter(
            f"copper {name} to {end}: both are hosts, and pass nothing on; join {name} to a switch "
            f'before, as addLink("{name}", "s1")'
        )


def _first_links(topo: Topo) -> dict[str, FirstLink]:
    found: dict[str, FirstLink] = {}
    for one, two, info in topo.links(withInfo=True):
        for name, port, other in ((one, info["port1"], two), (two, info["port2"], one)):
            link = FirstLink(port, other, is_made(info, FiberLink))
            if not topo.isSwitch(name):
                found[name] = min(found.get(name, link), link)
    return found


def _copper_that_passes(topo: Topo, infos: Infos) -> Distances:
    ways: Distances = {}
    for one, other, info in topo.links(withInfo=True):
        if not is_made(info, FiberLink) and _passes(infos[one]) and _passes(infos[other]):
            ways.setdefault(one, {})[other] = ways.setdefault(other, {})[one] = 0.0
    return ways


def _passes(info: Mapping[str, Any]) -> bool:
    """Whether a node passes packets on: a switch, or a host of a user's own class, as a router."""
    return bool(info.get("isSwitch")) or not is_ours(info.get("cls"))
