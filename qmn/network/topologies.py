"""The topologies of `qmn run`, and their options on the command line."""

import argparse
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from typing import Any

from mininet.topo import Topo

from dispatcher.fiber import fiber_noise
from qmn.network import custom_topology
from qmn.network.custom_topology import BadTopology
from qmn.network.device_options import base_device, kind_of_all
from qmn.network.options import MAP, NetworkOptions
from qmn.network.part_options import PartOptions
from topologies.chain import ChainTopo
from topologies.fabric import fiber_of
from topologies.fiber import resolved
from topologies.leaf_spine import LeafSpineTopo
from topologies.mapped import MapTopo
from topologies.nodes import QuantumHost, device_of
from topologies.presets import preset
from topologies.repeaters import RepeatersTopo
from topologies.ring import RingTopo
from topologies.sdc import SdcTopo
from topologies.tapped import TappedTopo
from topologies.tree import TreeTopo
from wire.parameters.fiber import FiberOptics, optics
from wire.parameters.physics import Device

TOPOLOGIES: dict[str, tuple[Callable[..., Topo], str]] = {
    "sdc": (SdcTopo, "one quantum switch"),
    "chain": (ChainTopo, "quantum switches in a line"),
    "ring": (RingTopo, "quantum switches in a ring"),
    "leaf-spine": (LeafSpineTopo, "two stages of quantum switches"),
    "repeaters": (RepeatersTopo, "repeaters in a line, a quantum switch between neighbours"),
    "tree": (TreeTopo, "quantum switches in a tree, with up to 1,024 hosts"),
    "tapped": (TappedTopo, "one quantum switch, with eve, who can be put on a fibre"),
    MAP: (MapTopo, "a quantum switch and a host at each place of a map"),
}
SIZES = {
    "sdc": ("both_ways",),
    "chain": ("switches", "fibers", "both_ways"),
    "ring": ("switches", "fibers", "both_ways"),
    "leaf-spine": ("leaves", "spines", "fibers", "both_ways"),
    "repeaters": ("repeaters",),
    "tree": ("hosts", "switches"),
    "tapped": ("both_ways",),
    MAP: ("map", "fibers", "hosts_at", "sources_at", "repeaters_at"),
}
FIBER = ("length_km", "loss_db_per_km", "depolarizing", "kind")


def is_known(name: str) -> bool:
    """Return whether there may be a topology of this name."""
    return name in TOPOLOGIES or custom_topology.is_custom(name)


def topology_name(text: str) -> str:
    """Return the name of a topology that there may be; raise ArgumentTypeError for no such."""
    if not is_known(text):
        known = ", ".join(TOPOLOGIES)
        raise argparse.ArgumentTypeError(f"{text!r}: choose {known}, or your own, FILE.py:CLASS")
    return text


def topology(options: NetworkOptions) -> Callable[[], Topo]:
    """Return what builds the topology; raise BadTopology for what does not fit it."""
    name = options.topology
    every = {size for sizes in SIZES.values() for size in sizes}
    sizes = {size: getattr(options, size) for size in every}
    given = {
        size: value for size, value in sizes.items() if value is not None and value is not False
    }
    own = custom_topology.is_custom(name)
    for size in sorted(given.keys() - (given.keys() if own else set(SIZES[name]))):
        fitting = ", ".join(topo for topo, own in SIZES.items() if size in own)
        option = f"--{size.replace('_', '-')}"
        raise BadTopology(f"{option} is of {fitting}, not of {name}: leave it out")
    try:
        given |= fiber_parameters(options)
        more = {"preset": options.preset, "node": kind_of_all(options.node)}
        if own:
            given |= {key: value for key, value in more.items() if value not in ("ideal", "")}
            build = custom_topology.load(name, given)
        else:
            build = partial(TOPOLOGIES[name][0], **given, **more)
        # So that what cannot be is refused here, and not in the midst of a start.
        fiber_noise.models(resolved(every_fiber(options)))
    except ValueError as error:
        raise BadTopology(str(error)) from error
    return with_parts(build, options)


def with_parts(build: Callable[[], Topo], options: NetworkOptions) -> Callable[[], Topo]:
    """Return what builds a topology with its single parts as the command line says.

    Raise BadTopology for what cannot be.
    """
    try:
        complete = partial(part_options(options).built, build)
        complete()
    except ValueError as error:
        raise BadTopology(str(error)) from error
    return complete


def part_options(options: NetworkOptions) -> PartOptions:
    """Return what the command line says of single parts."""
    return PartOptions(
        options.fiber,
        options.switch,
        options.node,
        options.device,
        preset(options.preset).device,
    )


def quantum_hosts(topo: Topo) -> list[str]:
    """Return the hosts of a topology that have light."""
    classes = {host: topo.nodeInfo(host).get("cls") for host in topo.hosts()}
    return [host for host, each in classes.items() if each and issubclass(each, QuantumHost)]


def stated_devices(options: NetworkOptions) -> dict[str, Device]:
    """Return the devices of hosts that are named, and of "every" other one if all are alike."""
    topo = topology(options)()
    if custom_topology.is_custom(options.topology):
        return devices_of(topo)
    every = base_device(options.node, preset(options.preset).device)
    return {"every": every, **part_options(options).devices(topo)}


def devices_of(topo: Topo) -> dict[str, Device]:
    """Return the devices of all hosts of a topology that have light."""
    return {host: device_of(host, topo.nodeInfo(host)) for host in quantum_hosts(topo)}


def stated_optics(options: NetworkOptions) -> dict[str, Any]:
    """Return the optics that every fibre has; none of a topology that says them itself."""
    own = custom_topology.is_custom(options.topology) or options.topology == MAP
    return {} if own else asdict(every_fiber(options))


def every_fiber(options: NetworkOptions) -> FiberOptics:
    """Return the optics that all fibres have."""
    return optics("every fibre", **fiber_of(options.preset, fiber_parameters(options)))


def fiber_parameters(options: NetworkOptions) -> dict[str, Any]:
    """Return what the command line says of every fibre; raise BadTopology for no such name."""
    given = {key: getattr(options, key) for key in FIBER if getattr(options, key) is not None}
    return {**given, **part_options(options).of_every_fiber()}
