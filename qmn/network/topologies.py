"""The topologies of `qmn run`, and their options on the command line."""

import argparse
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from mininet.topo import Topo

from qmn.network import custom_topology
from qmn.network.custom_topology import BadTopology
from qmn.network.device_options import kind_of_all
from qmn.network.options import MAP, NETWORK, NetworkOptions
from qmn.options import titled
from topologies.chain import ChainTopo
from topologies.leaf_spine import LeafSpineTopo
from topologies.mapped import MapTopo
from topologies.repeaters import RepeatersTopo
from topologies.ring import RingTopo
from topologies.sdc import SdcTopo
from topologies.tapped import TappedTopo
from topologies.tree import TreeTopo
from wire.parameters.checks import remedy

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
KNOWN = (*TOPOLOGIES, "or your own, FILE.py:CLASS")  # as a user reads what may be chosen
SIZES = {
    "sdc": ("both_ways",),
    "chain": ("switches", "fibers", "both_ways"),
    "ring": ("switches", "fibers", "both_ways"),
    "leaf-spine": ("leaves", "spines", "fibers", "both_ways"),
    "repeaters": ("repeaters", "stations"),
    "tree": ("hosts", "switches"),
    "tapped": ("both_ways",),
    MAP: ("map", "fibers", "hosts_at", "sources_at", "repeaters_at"),
}


def is_known(name: str) -> bool:
    return name in TOPOLOGIES or custom_topology.is_custom(name)


def topology_name(text: str) -> str:
    """Return the name of a topology that there may be; raise ArgumentTypeError for no such."""
    if not is_known(text):
        raise argparse.ArgumentTypeError(f"{text!r}: {remedy(text, KNOWN)}")
    return text


def add_topology(parser: argparse.ArgumentParser, default: str = "sdc") -> None:
    """Describe --topology, and which one is meant without it."""
    names = f"{', '.join(TOPOLOGIES)}, or FILE.py:CLASS"
    text = f"over this network ({names}; default: {default})"
    named = titled(parser, NETWORK)
    named.add_argument("--topology", type=topology_name, metavar="NAME", help=text)
    parser.set_defaults(usual_topology=default)


def builder(options: NetworkOptions, fiber: Mapping[str, Any]) -> Callable[[], Topo]:
    """Return what builds the topology that is named, with these parameters of every fibre.

    Raise BadTopology for what does not fit it, or ValueError.
    """
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
    given |= fiber
    more = {"preset": options.preset, "node": kind_of_all(options.node)}
    if own:
        given |= {key: value for key, value in more.items() if value not in ("ideal", "")}
        return custom_topology.load(name, given)
    return partial(TOPOLOGIES[name][0], **given, **more)
