"""qmn share RUN COPY: a copy of a run's folder that can be given away.

A run's folder can be read by its owner alone. Captures and event logs show what every qubit was: of
a run that may have made keys, the keys come of that, and the copy holds none of it. Everything else
is copied, readable by all. Keys that a run keeps are never in its folder.
"""

import argparse
import sys
from pathlib import Path
from typing import Any

from qmn.run_archive.named_run import add_run
from qmn.run_archive.shared_copy import CannotShare, share


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("share", description=__doc__)
    add_run(parser)
    parser.add_argument("copy", type=Path, metavar="COPY", help="a folder that does not exist yet")
    parser.set_defaults(call=call)


def call(arguments: argparse.Namespace) -> int:
    try:
        left_out = share(arguments.run, arguments.copy)
    except (CannotShare, OSError) as error:
        print(f"qmn: {error}", file=sys.stderr)
        return 2
    for file in left_out:
        print(f"left out: {file}")
    print(f"copied to {arguments.copy}")
    return 0
