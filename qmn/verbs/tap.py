"""qmn tap NODE NODE FRACTION: put an eavesdropper on the fibres between two nodes."""

import argparse
from typing import Any

from qmn.needs import Needs
from qmn.running.fiber_order import add_nodes, give


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("tap", description=__doc__)
    add_nodes(parser)
    text = "of the photons that she measures in Z or X and sends on; 0: no eavesdropper"
    parser.add_argument("fraction", type=float, metavar="FRACTION", help=text)
    parser.set_defaults(call=call, needs=Needs.RUNNING)


def call(arguments: argparse.Namespace) -> int:
    fraction = arguments.fraction
    done = f"{fraction:g} of the photons are measured and sent on"
    return give(arguments.a, arguments.b, done, tapped=fraction)
