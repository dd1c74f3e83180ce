"""Receive one connection from a quantum socket into a file or standard output.

Prints one line of JSON when it listens and one when all bytes are there.
"""

import argparse
import json
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


def main() -> int:
    """Read the arguments, receive, and turn faults into one line and an exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m hosts.applications.receive", description=__doc__
    )
    parser.add_argument("--stack", help="socket of this host's stack (QMN_STACK)")
    parser.add_argument("--output", type=Path, required=True)
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
