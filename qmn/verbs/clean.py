"""qmn clean: remove what killed runs have left; never what is not ours, nor a running network."""

import argparse
import sys
from typing import Any

from topologies.networks import leftovers
from topologies.networks.network import require_root
from topologies.system.processes.programs import NetworkError


def add_parser(verbs: Any) -> None:
    """Describe the verb."""
    text = "remove what killed runs have left"
    parser = verbs.add_parser("clean", help=text, description=__doc__)
    parser.set_defaults(call=call, needs_root=True)


def call(_arguments: argparse.Namespace) -> int:
    """Remove and say what; turn what is wrong into one line and an exit status."""
    try:
        require_root()
        removed = leftovers.remove().lines()
    except NetworkError as error:
        print(f"qmn: {error}", file=sys.stderr)
        return 1
    for line in removed:
        print(f"removed {line}")
    if not removed:
        print("nothing of ours is left")
    return 0
