"""qmn: the Mininet for programmable quantum networks."""

import argparse
import sys

from qmn import bench, run

VERBS = (run, bench)


def main() -> int:
    """Find the verb, run it, and return its exit status."""
    parser = argparse.ArgumentParser(prog="qmn", description=__doc__)
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    for verb in VERBS:
        verb.add_parser(verbs)
    arguments = parser.parse_args()
    status: int = arguments.call(arguments)
    return status


if __name__ == "__main__":
    sys.exit(main())
