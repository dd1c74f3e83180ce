"""Receive one connection from a quantum socket into a file or standard output.

Prints one line of JSON when it listens and one when all bytes are there.
"""

import argparse
import sys
from pathlib import Path

from hosts.applications.service import ended_well, wait
from wire.metadata import Service


def main() -> int:
    """Read the arguments, receive, and turn faults into one line and an exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m hosts.applications.receive", description=__doc__
    )
    parser.add_argument("--stack", help="socket of this host's stack (QMN_STACK)")
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("port", type=int)
    parser.set_defaults(service=Service.SDC.name.lower())
    arguments = parser.parse_args()
    return ended_well("receive", lambda: wait(arguments))


if __name__ == "__main__":
    sys.exit(main())
