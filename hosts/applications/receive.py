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
    """Let whoever has started this program go on; what it says from now on goes nowhere."""
    if os.fork():
        os._exit(0)
    os.setsid()
    for stream in (sys.stdin, sys.stdout, sys.stderr):
        with open(os.devnull, "r+b") as nothing:
            os.dup2(nothing.fileno(), stream.fileno())


def main() -> int:
    """Read the arguments, receive, and turn faults into one line and an exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m hosts.applications.receive", description=__doc__
    )
    parser.add_argument("--stack", help="socket of this host's stack (QMN_STACK)")
    parser.add_argument("--output", type=Path, help="file for the bytes (standard output)")
    text = "let the shell go on as soon as this listens"
    parser.add_argument("--background", action="store_true", help=text)
    parser.add_argument("port", type=int)
    said = parser.parse_args()
    if said.background and said.output is None:
        parser.error("--background needs --output: nobody reads standard output then")
    output = sys.stdout.buffer if said.output is None else said.output
    part = Part(Service.SDC.name.lower(), said.port, said.stack, output=output)
    listening = go_to_background if said.background else None
    with redirect_stdout(sys.stderr if said.output is None else sys.stdout):
        return ended_well("receive", lambda: wait(part, listening))


if __name__ == "__main__":
    sys.exit(main())
