"""Send a file or standard input through a quantum socket, like netcat.

Prints one line of JSON after every chunk: what the session has used so far.
"""

import argparse
import json
import sys
import time
from hashlib import sha256
from typing import BinaryIO

from hosts.quantum_socket import QuantumSocket, QuantumSocketError
from wire.metadata import FEC_NAMES

CHUNK_BYTES = {"framed": 1 << 16, "per-pair": 16}


def send(arguments: argparse.Namespace, source: BinaryIO) -> None:
    """Send everything that source holds and report on it."""
    digest = sha256()
    with QuantumSocket(arguments.stack) as quantum_socket:
        quantum_socket.connect(
            (arguments.host, arguments.port),
            handshake=arguments.handshake,
            frame_bytes=arguments.frame_bytes,
            block_pairs=arguments.block_pairs,
            rate_hz=arguments.rate_hz,
            fec=arguments.fec,
            interleave=arguments.interleave,
        )
        started = time.monotonic()
        try:
            while chunk := source.read(CHUNK_BYTES[arguments.handshake]):
                quantum_socket.sendall(chunk)
                digest.update(chunk)
                report("sending", quantum_socket, started)
            quantum_socket.shutdown()
        except QuantumSocketError:
            report("sending", quantum_socket, started)  # how far it came
            raise
        report("done", quantum_socket, started, sha256=digest.hexdigest())


def report(event: str, quantum_socket: QuantumSocket, started: float, **fields: str) -> None:
    """Print one line of JSON."""
    elapsed_s = time.monotonic() - started
    line = {"event": event, "elapsed_s": elapsed_s, **quantum_socket.statistics, **fields}
    print(json.dumps(line), flush=True)


def main() -> int:
    """Read the arguments, send, and turn faults into one line and an exit status."""
    parser = argparse.ArgumentParser(prog="python -m hosts.applications.send", description=__doc__)
    parser.add_argument("--stack", help="socket of this host's stack (QMN_STACK)")
    parser.add_argument("--file", type=argparse.FileType("rb"), default=sys.stdin.buffer)
    parser.add_argument("--handshake", choices=sorted(CHUNK_BYTES), default="framed")
    parser.add_argument("--frame-bytes", type=int, default=256)
    parser.add_argument("--block-pairs", type=int, default=65_536)
    parser.add_argument("--rate-hz", type=int, default=50_000_000)
    parser.add_argument("--fec", choices=FEC_NAMES, default="none", help="error-correction code")
    parser.add_argument("--interleave", action="store_true", help="spread its codewords")
    parser.add_argument("host")
    parser.add_argument("port", type=int)
    arguments = parser.parse_args()
    try:
        send(arguments, arguments.file)
    except QuantumSocketError as error:
        print(json.dumps({"event": "failed", "reason": error.reason.name, "text": str(error)}))
        print(f"send: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
