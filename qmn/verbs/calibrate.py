"""qmn calibrate NODE NODE: compensate how the fibres between two nodes have drifted."""

import argparse
from typing import Any

from qmn.needs import Needs
from qmn.running.fiber_order import add_nodes, give


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("calibrate", description=__doc__)
    add_nodes(parser)
    parser.set_defaults(call=call, needs=Needs.RUNNING)


def call(arguments: argparse.Namespace) -> int:
    return give(arguments.a, arguments.b, "calibrated", calibrate=True)
