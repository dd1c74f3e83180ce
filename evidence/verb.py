"""qmn lab KIND …: experiments around a network; without a kind it lists them all."""

import argparse
from typing import Any

from evidence.kinds import listing
from qmn.parser import add_kinds, module_of

KINDS = {
    "demo": ("effects of a whole network, beside theory", "evidence.kinds.demo:describe"),
    "published": (
        "published results as runs of the network",
        "evidence.kinds.published:describe",
    ),
    "curves": ("check the physics against theory", "evidence.kinds.curves:describe"),
    "sweep": ("measure a grid of parameters", "evidence.kinds.sweep:describe"),
    "attack": ("try an attack on an emulated network", "evidence.kinds.attack:describe"),
    "bench": ("measure this machine", "evidence.kinds.bench:describe"),
}


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("lab", description=__doc__)
    parser.set_defaults(call=show)
    add_kinds(parser, "KIND", KINDS)


def show(_arguments: argparse.Namespace) -> int:
    """List the experiments of each kind by name."""
    for kind, (text, function) in KINDS.items():
        print(f"qmn lab {kind}: {text}")
        listing.show(module_of(function).names(), "  ")
    return 0
