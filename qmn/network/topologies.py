"""The topologies of `qmn run`, and their options on the command line."""

import argparse
import json
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from typing import Any

from mininet.topo import Topo

from dispatcher.fiber import fiber_noise
from qmn.network import custom_topology
from qmn.network.custom_topology import BadTopology
from qmn.network.device_options import base_device, devices, kind_of_all, nodes
from qmn.network.options import NetworkOptions
from topologies.chain import ChainTopo
from topologies.fabric import fiber_of
from topologies.fiber import resolved
from topologies.leaf_spine import LeafSpineTopo
from topologies.nodes import QuantumHost, device_of
from topologies.presets import preset
from topologies.repeaters import RepeatersTopo
from topologies.ring import RingTopo
from topologies.sdc import SdcTopo
from topologies.tapped import TappedTopo
from wire.parameters.fiber import FiberOptics, optics
from wire.parameters.physics import Device

TOPOLOGIES: dict[str, tuple[Callable[..., Topo], str]] = {
    "sdc": (SdcTopo, "one quantum switch"),
    "chain": (ChainTopo, "quantum switches in a line"),
    "ring": (RingTopo, "quantum switches in a ring"),
    "leaf-spine": (LeafSpineTopo, "two stages of quantum switches"),
    "repeaters": (RepeatersTopo, "repeaters in a line, a quantum switch between neighbours"),
    "tapped": (TappedTopo, "one quantum switch, with eve, who can be put on a fibre"),
}
SIZES = {
    "sdc": (),
    "chain": ("switches",),
    "ring": ("switches",),
    "leaf-spine": ("leaves", "spines"),
    "repeaters": ("repeaters",),
    "tapped": (),
}
FIBER = ("length_km", "loss_db_per_km", "depolarizing", "kind")
PARAMETERS = asdict(FiberOptics())  # of a fibre, with their defaults


def topology_name(text: str) -> str:
    """Return the name of a topology that there may be; raise ArgumentTypeError for no such."""
    if text not in TOPOLOGIES and not custom_topology.is_custom(text):
        known = ", ".join(TOPOLOGIES)
        raise argparse.ArgumentTypeError(f"{text!r}: choose {known}, or your own, FILE.py:CLASS")
    return text


def topology(options: NetworkOptions) -> Callable[[], Topo]:
    """Return what builds the topology; raise BadTopology for what does not fit it."""
    name = options.topology
    every = {size for sizes in SIZES.values() for size in sizes}
    sizes = {size: getattr(options, size) for size in every}
    given = {size: value for size, value in sizes.items() if value is not None}
    own = custom_topology.is_custom(name)
    for size in sorted(given.keys() - (given.keys() if own else set(SIZES[name]))):
        fitting = ", ".join(topo for topo, own in SIZES.items() if size in own)
        raise BadTopology(f"--{size} is of {fitting}, not of {name}: leave it out")
    try:
        given |= fiber_parameters(options)
        described = every_device(options)
        more = {
            "preset": options.preset,
            "node": kind_of_all(options.node),
            "devices": described,
        }
        if own:
            ideal = {"preset": "ideal", "node": "", "devices": {}}
            given |= {key: value for key, value in more.items() if value != ideal[key]}
            build = custom_topology.load(name, given)
        else:
            build = partial(TOPOLOGIES[name][0], **given, **more)
        topo = build()
        hosts = quantum_hosts(topo)
        for host in described.keys() - set(hosts):
            raise BadTopology(f"--node or --device {host}: choose one of {', '.join(hosts)}")
        # So that a noise model of the user's own is refused here, and not by the dispatcher.
        fiber_noise.models(resolved(every_fiber(options)))
    except ValueError as error:
        raise BadTopology(str(error)) from error
    return build


def quantum_hosts(topo: Topo) -> list[str]:
    """Return the hosts of a topology that have light."""
    classes = {host: topo.nodeInfo(host).get("cls") for host in topo.hosts()}
    return [host for host, each in classes.items() if each and issubclass(each, QuantumHost)]


def every_device(options: NetworkOptions) -> dict[str, Device]:
    """Return the devices of the hosts that the command line names."""
    given = preset(options.preset).device
    named = nodes(options.node, given)
    return devices(options.device, base_device(options.node, given), named)


def other_device(options: NetworkOptions) -> Device:
    """Return the device of the hosts that the command line does not name."""
    return base_device(options.node, preset(options.preset).device)


def devices_of(topo: Topo) -> dict[str, Device]:
    """Return the devices of all hosts of a topology that have light."""
    return {host: device_of(host, topo.nodeInfo(host)) for host in quantum_hosts(topo)}


def stated_optics(options: NetworkOptions) -> dict[str, Any]:
    """Return the optics that every fibre has; none of a topology that says them itself."""
    own = custom_topology.is_custom(options.topology)
    return {} if own else asdict(every_fiber(options))


def every_fiber(options: NetworkOptions) -> FiberOptics:
    """Return the optics that all fibres have."""
    return optics("every fibre", **fiber_of(options.preset, fiber_parameters(options)))


def fiber_parameters(options: NetworkOptions) -> dict[str, Any]:
    """Return what the command line says of every fibre; raise BadTopology for no such words."""
    given = {key: getattr(options, key) for key in FIBER if getattr(options, key) is not None}
    for word in options.fiber:
        name, equals, text = word.partition("=")
        if not equals or name not in PARAMETERS:
            known = ", ".join(PARAMETERS)
            raise BadTopology(f"--fiber {word}: write NAME=VALUE, where NAME is of {known}")
        given[name] = _value(name, text)
    return given


def _value(name: str, text: str) -> Any:
    """Return a parameter's value as the kind of its default."""
    kind = type(PARAMETERS[name])
    try:
        return json.loads(text) if kind is dict else kind(text)
    except ValueError as error:
        raise BadTopology(f"--fiber {name}={text}: {error}") from error
