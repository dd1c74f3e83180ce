"""A network as a user describes it, resolved once; this is passed on.

A topology of ours, one of FILE.py:CLASS and one that a script makes become the same; what
`mn --custom` is given is the same Topo.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from mininet.topo import Topo

from dispatcher.fiber import fiber_noise
from qmn.network.custom_topology import BadTopology, is_custom
from qmn.network.options import MAP, NetworkOptions
from qmn.network.pace import against_steps, pace_of
from qmn.network.part_options import PartOptions, set_device
from qmn.network.time_scale import Pace
from qmn.network.topologies import builder
from topologies.catalogue.map_parts import spelling
from topologies.catalogue.presets import preset
from topologies.description.content import content_of
from topologies.description.description import Description, describe
from topologies.fabric import fiber_of
from topologies.links.copper_lengths import assign_copper_lengths
from topologies.links.fiber import resolved
from topologies.nodes import OpticalSwitch, QuantumHost
from wire.parameters.fiber import FiberOptics, optics
from wire.parameters.physics import Device

# Options of every fibre.
FIBER = ("length_km", "loss_db_per_km", "depolarizing", "kind", "channels")


@dataclass(frozen=True)
class NetworkDescription:
    """Nodes and fibres of a network, the settings of its programs, and how its time passes."""

    options: NetworkOptions  # with the settings and the policy
    topo: Topo  # every node and link, as Mininet takes them
    parts: Description  # hosts with light, quantum switches, fibres
    pace: Pace
    every_fiber: FiberOptics | None  # what all fibres are like; None: the topology says it itself
    stated_devices: Mapping[str, Device]  # of hosts that are named, and of "every" other one
    unused_settings: tuple[str, ...] = ()  # HOST.PART.NAME of presets and topology, by a job

    @property
    def hosts(self) -> list[str]:
        return list(self.parts.hosts)

    @property
    def dark_hosts(self) -> list[str]:
        return [name for name in self.topo.hosts() if name not in self.parts.hosts]

    def node(self, name: str) -> str:
        """Return the node of a name, or of the place of a map that has it; or the name itself."""
        places: Mapping[str, str] = getattr(self.topo, "places", {})
        return name if name in self.topo.nodes() else places.get(spelling(name), name)

    def with_policy(self, policy: Path) -> "NetworkDescription":
        return replace(self, options=replace(self.options, policy=str(policy)))

    def with_analyser(self, host: str, kind: str) -> "NetworkDescription":
        """Return the network with another Bell analyser of a host, as by --device."""
        device = self.parts.hosts[host]
        device = replace(device, analyser=replace(device.analyser, kind=kind))
        device.check(host)
        set_device(self.topo.nodeInfo(host), device)
        settings = *self.options.device, f"{host}.analyser.kind={kind}"
        return replace(
            self,
            options=replace(self.options, device=settings),
            parts=replace(self.parts, hosts={**self.parts.hosts, host: device}),
            stated_devices={**self.stated_devices, host: device},
        )

    def paced_for(self, *reasons: str) -> "NetworkDescription":
        """Return the network with paced time for these reasons; raise BadInput if it is to step."""
        if self.pace.stepped and reasons:
            return replace(self, pace=pace_of(self.options, reasons))
        return self

    def build(self) -> Topo:
        return self.topo


def no_parts(_switches: Sequence[str]) -> Sequence[str]:
    return ()


def describe_network(
    options: NetworkOptions, switch_parts: Callable[[Sequence[str]], Sequence[str]] = no_parts
) -> NetworkDescription:
    """Return the network that options name; raise BadTopology for what cannot be.

    `switch_parts` returns words of --switch for quantum switches of these names; those that the
    options name come after them.
    """
    settings = part_options(options)
    try:
        named = {name: getattr(options, name) for name in FIBER}
        optics_given = {name: value for name, value in named.items() if value is not None}
        optics_given |= settings.of_every_fiber()
        every = optics("every fibre", **fiber_of(options.preset, optics_given))
        # So that what cannot be is refused here, and not in the midst of a start.
        fiber_noise.models(resolved(every))
        return _described(builder(options, optics_given), options, switch_parts, every)
    except ValueError as error:
        raise BadTopology(str(error)) from error


def describe_own(build: Callable[[], Topo], options: NetworkOptions) -> NetworkDescription:
    """Return the network that a script's own topology makes; raise BadTopology."""
    try:
        return _described(build, options, no_parts, None)
    except ValueError as error:
        raise BadTopology(str(error)) from error


def _described(
    build: Callable[[], Topo],
    options: NetworkOptions,
    switch_parts: Callable[[Sequence[str]], Sequence[str]],
    every: FiberOptics | None,
) -> NetworkDescription:
    topo = build()
    content = content_of(topo)
    of_switches = switch_parts([switch.name for switch in content.of(OpticalSwitch)])
    options = replace(options, switch=(*of_switches, *options.switch))
    settings = part_options(options).of_hosts([host.name for host in content.of(QuantumHost)])
    settings.set_parts(content)
    assign_copper_lengths(topo)
    parts = describe(content)
    is_own = every is None or is_custom(options.topology)
    named = {host: parts.hosts[host] for host in settings.named_hosts}
    return NetworkDescription(
        options.by_policy(),
        topo,
        parts,
        pace_of(options, against_steps(options, content)),
        None if is_own or options.topology == MAP else every,
        parts.hosts if is_own else {"every": settings.base_device, **named},
    )


def part_options(options: NetworkOptions) -> PartOptions:
    return PartOptions(
        options.fiber,
        options.switch,
        options.node,
        options.device,
        preset(options.preset).device,
    )
