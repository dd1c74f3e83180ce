"""Receive one connection from a quantum socket into a file or standard output.

Prints one line of JSON when it listens and one when all bytes are there.
"""

import argparse
import json
import os
import sys
from hashlib import sha256
from pathlib import Path

from hosts.quantum_socket import QuantumSocket, QuantumSocketError

CHUNK_BYTES = 1 << 16


def receive(arguments: argparse.Namespace) -> None:
    """Accept one connection and write what it brings; a broken transfer leaves no file."""
    digest, partial = sha256(), arguments.output.with_name(arguments.output.name + ".part")
    with QuantumSocket(arguments.stack) as listener:
        listener.listen(arguments.port)
        print(json.dumps({"event": "listening", "port": arguments.port}), flush=True)
        if arguments.background:
            go_to_background()
        connection, peer = listener.accept()
    try:
        with connection, partial.open("wb") as output:
            while chunk := connection.recv(CHUNK_BYTES):
                output.write(chunk)
                digest.update(chunk)
        partial.replace(arguments.output)
    finally:
        partial.unlink(missing_ok=True)
    line = {"event": "done", "peer": peer, "sha256": digest.hexdigest()}
    print(json.dumps({**line, **connection.statistics}), flush=True)


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
    parser.add_argument("--output", type=Path, required=True)
    text = "let the shell go on as soon as this listens"
    parser.add_argument("--background", action="store_true", help=text)
    parser.add_argument("port", type=int)
    arguments = parser.parse_args()
    try:
        receive(arguments)
    except QuantumSocketError as error:
        print(json.dumps({"event": "failed", "reason": error.reason.name, "text": str(error)}))
        print(f"receive: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
