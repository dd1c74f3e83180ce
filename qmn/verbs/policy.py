"""qmn policy reload: let the controller read its policy file again."""

import argparse
from typing import Any

from qmn.needs import Needs
from qmn.running.controller_console import answered, ask


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("policy", description=__doc__)
    parser.add_argument(
        "what", metavar="reload", choices=["reload"], help="overrides become those of the file"
    )
    parser.set_defaults(call=call, needs=Needs.RUNNING)


def call(_arguments: argparse.Namespace) -> int:
    return answered(lambda: print(f"in force: {ask('reload-policy')['policy']}"))
