"""qmn paths: the light paths that stand in the running network, and the fibres."""

import argparse
from typing import Any

from qmn.needs import Needs
from qmn.running.controller_console import answered
from qmn.running.light_paths import ask_and_show


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("paths", description=__doc__)
    parser.add_argument("--json", action="store_true", help="print everything, for programs")
    parser.set_defaults(call=call, needs=Needs.RUNNING)


def call(arguments: argparse.Namespace) -> int:
    return answered(lambda: ask_and_show(arguments.json))
