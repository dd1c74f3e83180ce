"""Which topologies `qmn run` knows, and what the command line may say of them."""

import argparse
from collections.abc import Callable
from functools import partial

from mininet.topo import Topo

from topologies.chain import ChainTopo
from topologies.leaf_spine import LeafSpineTopo
from topologies.ring import RingTopo
from topologies.sdc import SdcTopo

TOPOLOGIES: dict[str, tuple[Callable[..., Topo], str]] = {
    "sdc": (SdcTopo, "one quantum switch"),
    "chain": (ChainTopo, "quantum switches in a line"),
    "ring": (RingTopo, "quantum switches in a ring"),
    "leaf-spine": (LeafSpineTopo, "two stages of quantum switches"),
}
SIZES = {
    "sdc": (),
    "chain": ("switches",),
    "ring": ("switches",),
    "leaf-spine": ("leaves", "spines"),
}
FIBER = ("length_km", "loss_db_per_km", "depolarizing")


class BadTopology(Exception):
    """What the user asked of a topology cannot be had; the text names value and remedy."""


def topology(arguments: argparse.Namespace) -> Callable[[], Topo]:
    """Return what builds the topology; raise BadTopology for sizes that do not fit it."""
    name = arguments.topology
    every = {size for sizes in SIZES.values() for size in sizes}
    sizes = {size: getattr(arguments, size) for size in every}
    given = {size: value for size, value in sizes.items() if value is not None}
    for size in sorted(given.keys() - set(SIZES[name])):
        fitting = ", ".join(topo for topo, own in SIZES.items() if size in own)
        raise BadTopology(f"--{size} is of {fitting}, not of {name}: leave it out")
    fiber = {key: getattr(arguments, key) for key in FIBER}
    build = partial(TOPOLOGIES[name][0], **given, **fiber)
    try:
        build()
    except ValueError as error:
        raise BadTopology(str(error)) from error
    return build
