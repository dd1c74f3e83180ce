"""Mininet's Topo for networks with light, with defaults for all that these have.

    class Lab(QuantumTopo):
        def build(self):
            self.addHost("h1", cls=QuantumHost, source=True)
            self.addSwitch("q1", cls=OpticalSwitch)
            self.addFibers("h1", "q1", 2, length_km=0.5)

What `build` has left out is added after it: s1, a switch of copper; ed, the host that holds all
qubits; copper to s1 for hosts that have none, and for quantum switches that no copper joins to it;
addresses, 10.0.0.1 the first.
"""

from collections.abc import Sequence
from ipaddress import IPv4Network
from typing import Any

from mininet.topo import Topo

from topologies.description.checked_graph import check_new
from topologies.description.content import interface_of, is_made
from topologies.links.copper_lengths import assign_copper_lengths
from topologies.links.fiber import FiberLink
from topologies.nodes import ClassicalSwitch, DispatcherHost, OpticalSwitch
from wire.parameters.physics import BadParameter

CLASSICAL_SWITCH, DISPATCHER = "s1", "ed"
NETWORK = IPv4Network("10.0.0.0/8")  # Mininet's
KEPT = ("", 0)  # a port of a node that no link has yet


class QuantumTopo(Topo):
    """Nodes and fibres, as `build` says; the classical network where it does not."""

    def __init__(self, *arguments: Any, **params: Any) -> None:
        super().__init__(*arguments, **params)
        self._add_nodes()
        self._add_copper()
        self._add_addresses()
        assign_copper_lengths(self)  # when all fibres are there

    def addNode(self, name: str, **opts: Any) -> str:  # noqa: N802 (Mininet's name)
        """Add a node; BadParameter for a name that another has."""
        check_new(name, self.g.node)
        added: str = super().addNode(name, **opts)
        return added

    def addFibers(  # noqa: N802 (as Mininet's addLink)
        self, node1: str, node2: str, count: int = 1, **params: Any
    ) -> None:
        """Add `count` links of FiberLink, with its keywords; BadParameter for fewer than one."""
        if not isinstance(count, int) or count < 1:
            raise BadParameter(f"{count!r} fibres between {node1} and {node2}: choose 1 or more")
        for _ in range(count):
            self.addLink(node1, node2, **{"cls": FiberLink, **params})

    def addLink(  # noqa: N802 (Mininet's name)
        self,
        node1: str,
        node2: str,
        port1: int | None = None,
        port2: int | None = None,
        key: int | None = None,
        **params: Any,
    ) -> int:
        """Add a link; copper has a node's first port, also if it comes after the fibres."""
        is_fiber = is_made(params or self.lopts, FiberLink)
        ports = [
            self._port(node, is_fiber) if port is None else port
            for node, port in ((node1, port1), (node2, port2))
        ]
        number: int = super().addLink(node1, node2, *ports, key, **params)
        return number

    def _port(self, node: str, is_fiber: bool) -> int | None:
        """Return the first port for the first copper, None for the next free one."""
        ports, first = self.ports.setdefault(node, {}), 1 if self.isSwitch(node) else 0
        if is_fiber:
            ports.setdefault(first, KEPT)
        return first if not is_fiber and ports.get(first) == KEPT else None

    def _named(self, kind: type) -> list[str]:
        """Return the nodes of a kind, in the order in which they were added."""
        return [name for name in self.nodes(sort=False) if is_made(self.nodeInfo(name), kind)]

    def _classical_switches(self) -> list[str]:
        quantum = self._named(OpticalSwitch)
        return [name for name in self._named(ClassicalSwitch) if name not in quantum]

    def _add_nodes(self) -> None:
        """Add s1 and ed, if there is no other to be in their place."""
        for name, there, add, kind in (
            (CLASSICAL_SWITCH, self._classical_switches(), self.addSwitch, ClassicalSwitch),
            (DISPATCHER, self._named(DispatcherHost), self.addHost, DispatcherHost),
        ):
            if there:
                continue
            if name in self.nodes():
                remedy = (
                    f"give it, and each other switch of copper, cls={kind.__name__}"
                    if kind is ClassicalSwitch and self.isSwitch(name)
                    else "add one of another name"
                )
                raise BadParameter(f"{name} is not a {kind.__name__}, and there is none: {remedy}")
            add(name, cls=kind)

    def _add_copper(self) -> None:
        """Join hosts without copper to the first switch of copper, and quantum switches apart."""
        links = self.links(withInfo=True)
        ends = [(one, other) for one, other, info in links if not is_made(info, FiberLink)]
        switch, quantum = self._classical_switches()[0], self._named(OpticalSwitch)
        reached = set(self._classical_switches())
        for name in quantum:
            self._reach(reached, ends)
            if name not in reached:
                self.addLink(name, switch)
                reached.add(name)
        joined = {name for both in ends for name in both}
        for name in self.hosts(sort=False):
            if name not in joined:
                self.addLink(name, switch)

    def _reach(self, reached: set[str], ends: Sequence[tuple[str, str]]) -> None:
        """Add the switches that have copper to those already in it; hosts pass nothing on."""
        between = [set(both) for both in ends if all(map(self.isSwitch, both))]
        while beyond := set().union(*(both for both in between if both & reached)) - reached:
            reached |= beyond

    def _add_addresses(self) -> None:
        """Give each host without an address the next one, in the network of those that have one."""
        infos = {name: self.nodeInfo(name) for name in self.hosts(sort=False)}
        taken = [interface_of(name, info["ip"]) for name, info in infos.items() if info.get("ip")]
        network = taken[0].network if taken else NETWORK
        used = {each.ip for each in taken}
        free = (address for address in network.hosts() if address not in used)
        for info in infos.values():
            if "ip" not in info:
                info["ip"] = f"{next(free)}/{network.prefixlen}"
