"""The topologies of `qmn run`, and their options on the command line."""

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial
from types import MappingProxyType
from typing import Any

from mininet.topo import Topo

from qmn.network import custom_topology
from qmn.network.custom_topology import BadTopology
from qmn.network.options import GONE, MAP, NETWORK, NetworkOptions, ShapeOptions
from qmn.network.part_options import kind_of_all
from qmn.options import titled
from qmn.parser import listed
from topologies.chain import ChainTopo
from topologies.leaf_spine import LeafSpineTopo
from topologies.mapped import MapTopo
from topologies.repeaters import RepeatersTopo
from topologies.ring import RingTopo
from topologies.sdc import SdcTopo
from topologies.tapped import TappedTopo
from topologies.tree import TreeTopo
from wire.parameters.checks import remedy
from wire.parameters.option import declared
from wire.registered import TOPOLOGIES as REGISTERED
from wire.registered import registered


@dataclass(frozen=True)
class Topology:
    build: Callable[..., Topo]
    text: str
    parameters: tuple[str, ...]  # in the order in which values without names are taken


TOPOLOGIES: Mapping[str, Topology] = MappingProxyType(
    {
        "sdc": Topology(SdcTopo, "one quantum switch", ("both_ways",)),
        "chain": Topology(
            ChainTopo, "quantum switches in a line", ("switches", "fibers", "both_ways")
        ),
        "ring": Topology(
            RingTopo, "quantum switches in a ring", ("switches", "fibers", "both_ways")
        ),
        "leaf-spine": Topology(
            LeafSpineTopo,
            "two stages of quantum switches",
            ("leaves", "spines", "fibers", "both_ways"),
        ),
        "repeaters": Topology(
            RepeatersTopo,
            "hosts in a line, a quantum switch between neighbours",
            ("repeaters",),
        ),
        "tree": Topology(
            TreeTopo, "quantum switches in a tree, with up to 1,024 hosts", ("hosts", "switches")
        ),
        "tapped": Topology(
            TappedTopo, "one quantum switch, and eve, who can tap a fibre", ("both_ways",)
        ),
        MAP: Topology(
            MapTopo,
            "a quantum switch and a host at each place of a map",
            ("map", "fibers", "hosts_at", "sources_at"),
        ),
    }
)
OWN = "FILE.py:CLASS"
PACKAGES = registered(REGISTERED, TOPOLOGIES)
KNOWN = (*TOPOLOGIES, *PACKAGES, f"or your own, {OWN}")  # as a user reads what may be chosen
PARAMETERS = {field.name: field for field in fields(ShapeOptions)}
LISTS = ("hosts_at", "sources_at")  # parameters whose values have commas


def is_known(name: str) -> bool:
    return name in TOPOLOGIES or custom_topology.is_custom(name)


def topology(text: str) -> dict[str, str | int | bool]:
    """Read NAME[,VALUE…][,PARAMETER=VALUE…]; raise ArgumentTypeError for what there is not.

    As in Mininet's --topo, values without names come first. Return fields of NetworkOptions.
    """
    name, *parameters = text.split(",")
    if not is_known(name):
        raise argparse.ArgumentTypeError(f"{name!r}: {remedy(name, KNOWN)}")
    names = TOPOLOGIES[name].parameters if name in TOPOLOGIES else tuple(PARAMETERS)
    values: dict[str, str] = {}
    unnamed, last = iter(names), ""
    for word in parameters:
        key, named, value = word.partition("=")
        if not named and last in LISTS:
            values[last] += f",{word}"
            continue
        if not named:
            key, value = (word, "true") if word in PARAMETERS else (next(unnamed, ""), word)
        if word in GONE or key not in names:
            wrong = word if word in GONE else key or word
            raise argparse.ArgumentTypeError(_no_parameter(name, wrong, names))
        if key in values:
            raise argparse.ArgumentTypeError(
                f"{name}: {key} is {values[key]} and {value}: name it once"
            )
        last, values[key] = key, value
    return {"topology": name, **{key: _parameter(key, value) for key, value in values.items()}}


def _no_parameter(topology: str, word: str, names: Sequence[str]) -> str:
    if word in GONE:
        return (
            f"{word} is gone: quantum switches swap, not hosts; name their parts, as --switch "
            "q2.analysers=1 --switch q2.memories=2 --switch q2.sources=1 (docs/switch-swaps.md)"
        )
    others = [other for other, each in TOPOLOGIES.items() if word in each.parameters]
    if others:
        return not_of(word, topology)
    return f"{topology} has no parameter {word!r}: {remedy(word, names)}"


def not_of(parameter: str, topology: str) -> str:
    fitting = [name for name, each in TOPOLOGIES.items() if parameter in each.parameters]
    return f"{parameter} is of {', '.join(fitting)}, not of {topology}: leave it out"


def _parameter(name: str, text: str) -> str | int | bool:
    default = PARAMETERS[name].default
    if isinstance(default, bool):
        if text not in ("true", "false"):
            raise argparse.ArgumentTypeError(f"{name} {text!r}: choose true or false")
        return text == "true"
    if name == MAP or name in LISTS:
        return text
    try:
        return int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{name} {text!r}: choose a whole number") from None


class TakeTopology(argparse.Action):
    """Store the name of a topology and its parameters, each in a place of its own."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        for name, value in values.items():
            setattr(namespace, name, value)


def add_topology(parser: argparse.ArgumentParser, default: str = "sdc") -> None:
    """Describe --topology, and which one is meant without it."""
    names = f"{', '.join([*TOPOLOGIES, *PACKAGES])}, or {OWN}"
    text = (
        f"network ({names}; default: {default}), as chain,5 or chain,switches=5; "
        "`qmn run --help` lists the parameters"
    )
    titled(parser, NETWORK).add_argument(
        "--topology",
        dest="named",  # a default of its own would be read as text
        default=argparse.SUPPRESS,
        action=TakeTopology,
        type=topology,
        metavar="NAME[,…]",
        help=text,
    )
    parser.set_defaults(topology=default)


def described_topologies() -> str:
    """Return what `--help` lists: topologies with their parameters."""
    shown = {
        name: f"{each.text}: {', '.join(each.parameters)}" for name, each in TOPOLOGIES.items()
    } | {name: f"of a package: {entry.value}" for name, entry in PACKAGES.items()}
    meanings = {name: declared(each)["help"] for name, each in PARAMETERS.items()}
    return "\n".join(
        [
            listed("topologies, as in --topology chain,5 or chain,switches=5,fibers=1", shown),
            listed("parameters of topologies", meanings),
        ]
    )


def builder(options: NetworkOptions, fiber: Mapping[str, Any]) -> Callable[[], Topo]:
    """Return what builds the topology that is named, with these parameters of every fibre.

    Raise BadTopology for what does not fit it, or ValueError.
    """
    name = options.topology
    sizes = {size: getattr(options, size) for size in PARAMETERS}
    arguments = {
        size: value for size, value in sizes.items() if value is not None and value is not False
    }
    is_own = custom_topology.is_custom(name)
    for size in sorted(
        arguments.keys() - (arguments.keys() if is_own else set(TOPOLOGIES[name].parameters))
    ):
        raise BadTopology(not_of(size, name))
    arguments |= fiber
    more = {"preset": options.preset, "node": kind_of_all(options.node)}
    if is_own:
        arguments |= {key: value for key, value in more.items() if value not in ("ideal", "")}
        return custom_topology.load(name, arguments)
    return partial(TOPOLOGIES[name].build, **arguments, **more)
