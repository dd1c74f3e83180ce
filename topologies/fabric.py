"""The base of topologies of several quantum switches.

Everything has copper to the classical switch s1; fibres join the quantum switches. Superdense
coding takes one fibre to the sender, two to the receiver, two to the pair source, and three
paths at once between them, two of which may go the same way: hence two fibres a neighbour.
"""

from collections.abc import Mapping
from inspect import Parameter, signature
from ipaddress import IPv4Network
from types import MappingProxyType
from typing import Any

from topologies.catalogue import presets
from topologies.catalogue.node_kinds import node_device
from topologies.links.fiber import OPTICS, resolved
from topologies.networks.stock_mininet import StockMininet
from topologies.nodes import (
    ClassicalSwitch,
    DispatcherHost,
    OpticalSwitch,
    QuantumController,
    QuantumHost,
)
from topologies.quantum_topo import CLASSICAL_SWITCH, DISPATCHER, QuantumTopo
from wire.config import CONTROLLER
from wire.parameters.checks import check_names
from wire.parameters.fiber import KINDS, optics
from wire.parameters.physics import BadParameter, Device

MOST_SWITCHES = 256
SMALL = 250  # hosts, for which 256 addresses are enough


class FabricTopo(QuantumTopo):
    """alice, bob, charlie with his pairs, ed with the qubits; subclasses lay the fibres."""

    # Where nodes are on a map, on any scale, from left to right and upwards; none: on no map.
    positions: Mapping[str, tuple[float, float]] = MappingProxyType({})

    def add_classical_network(self, source: str = "charlie", **settings: Any) -> None:
        """Add s1 and the hosts, and note what every fibre will be like: see `set_up`.

        The source is charlie, or alice where there is none.
        """
        self.set_up(**settings)
        self.add_host("alice", "10.0.0.1", **({"source": True} if source == "alice" else {}))
        self.add_host("bob", "10.0.0.2")
        if source == "charlie":
            self.add_host("charlie", "10.0.0.3", source=True)
        self.add_dispatcher("10.0.0.4")

    def set_up(
        self,
        preset: str = "ideal",
        devices: Mapping[str, Device] | None = None,
        node: str = "",
        light: str = CONTROLLER,
        addresses: int = SMALL,
        both_ways: bool = False,
        **fiber: Any,
    ) -> None:
        """Add s1, and note what every fibre and host will be like.

        Fibres are as the preset says (catalogue/presets.py), but for what is given by keyword
        (wire.parameters.fiber.FiberOptics); raise BadParameter for what cannot be. Hosts have the
        preset's device, that of a kind of `node` (catalogue/node_kinds.py), or their own of
        `devices`. `light` says who grants it to them (wire.config.LIGHT). `addresses` is the number
        of hosts with an address. `both_ways` gives alice a second fibre, so that she can receive,
        too.
        """
        check_names(type(self).__name__, fiber, [*self._keywords(), *sorted(OPTICS)], BadParameter)
        self._alice_fibers = 2 if both_ways else 1
        self._light = light
        self._fiber = fiber_of(preset, fiber)
        self._device = presets.preset(preset).device
        if node:
            self._device = node_device(node, self._device)
        self._devices = devices or {}
        self._network = IPv4Network("10.0.0.0/24" if addresses <= SMALL else "10.0.0.0/16")
        self._addresses = self._network.hosts()
        self.addSwitch(CLASSICAL_SWITCH, cls=ClassicalSwitch)

    def _keywords(self) -> list[str]:
        named = [
            *signature(self.build).parameters.values(),
            *signature(self.set_up).parameters.values(),
        ]
        return [one.name for one in named if one.kind == Parameter.POSITIONAL_OR_KEYWORD]

    def add_dispatcher(self, address: str) -> None:
        """Add ed, with copper to s1."""
        self.addHost(DISPATCHER, cls=DispatcherHost, ip=f"{address}/{self._network.prefixlen}")
        self.addLink(DISPATCHER, CLASSICAL_SWITCH)

    def next_address(self) -> str:
        return str(next(self._addresses))

    def device_of(self, name: str) -> Device:
        return self._devices.get(name, self._device)

    def add_host(self, name: str, address: str, **params: object) -> None:
        ip, device = f"{address}/{self._network.prefixlen}", self.device_of(name)
        self.addHost(
            name, cls=QuantumHost, ip=ip, **{"device": device, "light": self._light, **params}
        )
        self.addLink(name, CLASSICAL_SWITCH)

    def add_quantum_switches(self, count: int, least: int = 1) -> list[str]:
        """Add q1, q2, …, each with copper to s1; raise ValueError for a count out of range."""
        if not least <= count <= MOST_SWITCHES:
            raise ValueError(f"{count} quantum switches: choose {least} to {MOST_SWITCHES}")
        names = [f"q{number}" for number in range(1, count + 1)]
        for name in names:
            self.addSwitch(name, cls=OpticalSwitch)
            self.addLink(CLASSICAL_SWITCH, name)
        return names

    def place(self, alice_at: str, bob_at: str, charlie_at: str) -> None:
        """Lay the fibres of sender, receiver and pair source to their switches."""
        self.join("alice", alice_at, self._alice_fibers)
        self.join("bob", bob_at, 2)
        self.join("charlie", charlie_at, 2)

    def join(self, one: str, other: str, fibers: int, **settings: object) -> None:
        self.addFibers(one, other, fibers, **{**self._fiber, **settings})


def fiber_of(preset: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters of every fibre: what is given, else what its kind and preset say.

    A kind that is given goes before the preset's other parameters, as its own values differ.
    """
    base = presets.preset(preset).fiber
    kind = KINDS.get(str(options["kind"]), {}) if "kind" in options else {}
    chosen = {**base, **kind, **options}
    resolved(optics("every fibre", **chosen))
    return chosen


def findController() -> type[QuantumController]:  # noqa: N802
    """Tell `mn` which controller is the default: it takes its own names from the file."""
    return QuantumController


controllers = {"quantum": QuantumController}
Mininet = StockMininet  # so does `mn` with this: its own would wait for ever here and there
