"""Receive one connection from a quantum socket into a file or standard output.

Prints one line of JSON when it listens and one when all bytes are there: to standard error, if
the bytes go to standard output.
"""

import argparse
import os
import sys
from contextlib import redirect_stdout
from pathlib import Path

from hosts.applications.service import Part, ended_well, wait
from wire.metadata.vocabulary import Service


def go_to_background() -> None:
    """Let the parent of this program go on; discard output from now on."""
    if os.fork():
        os._exit(0)
    os.setsid()
    for stream in (sys.stdin, sys.stdout, sys.stderr):
        with open(os.devnull, "r+b") as nothing:
            os.dup2(nothing.fileno(), stream.fileno())


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m hosts.applications.receive", description=__doc__
    )
    parser.add_argument("--stack", help="socket of this host's stack (QMN_STACK)")
    parser.add_argument("--output", type=Path, help="file for the bytes (standard output)")
    text = "let the shell go on as soon as this listens"
    parser.add_argument("--background", action="store_true", help=text)
    parser.add_argument("port", type=int)
    arguments = parser.parse_args()
    if arguments.background and arguments.output is None:
        parser.error("--background needs --output: nobody reads standard output then")
    output = sys.stdout.buffer if arguments.output is None else arguments.output
    part = Part(Service.SDC.name.lower(), arguments.port, arguments.stack, output=output)
    listening = go_to_background if arguments.background else None
    with redirect_stdout(sys.stderr if arguments.output is None else sys.stdout):
        return ended_well("receive", lambda: wait(part, listening))


if __name__ == "__main__":
    sys.exit(main())
