"""qmn classical NODE NODE MW: how strong the classical light in the fibres between them is."""

import argparse
from typing import Any

from qmn.needs import Needs
from qmn.running.fiber_order import add_nodes, give


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("classical", description=__doc__)
    add_nodes(parser)
    parser.add_argument("power_mw", type=float, metavar="MW", help="launched into each; 0: none")
    parser.set_defaults(call=call, needs=Needs.RUNNING)


def call(arguments: argparse.Namespace) -> int:
    power_mw = arguments.power_mw
    done = f"classical light of {power_mw:g} mW"
    return give(arguments.a, arguments.b, done, classical_mw=power_mw)
