"""Bytes from a file, or to one, through a quantum socket, and what is said of them as JSON."""

import json
import time
from hashlib import sha256
from pathlib import Path
from typing import Any, BinaryIO

from hosts.quantum_socket import QuantumSocket, QuantumSocketError

CHUNK_BYTES = {"framed": 1 << 16, "per-pair": 16, "sequential": 16}
READ_BYTES = 1 << 16


def say(event: str, fields: dict[str, Any]) -> None:
    """Print one line of JSON."""
    print(json.dumps({"event": event, **fields}), flush=True)


def send(sending: QuantumSocket, source: BinaryIO, chunk_bytes: int) -> None:
    """Send all that a file holds; say after every chunk what the session has used so far."""
    digest, started = sha256(), time.monotonic()

    def used(event: str, **fields: str) -> None:
        elapsed_s = time.monotonic() - started
        say(event, {"elapsed_s": elapsed_s, **sending.statistics, **fields})

    try:
        while chunk := source.read(chunk_bytes):
            sending.sendall(chunk)
            digest.update(chunk)
            used("result")
        sending.shutdown()
    except QuantumSocketError:
        used("result")  # how far it came
        raise
    used("done", sha256=digest.hexdigest())


def receive(receiving: QuantumSocket, peer: str, output: Path) -> None:
    """Write what comes to a file; a session that breaks leaves none."""
    digest, partial = sha256(), output.with_name(f"{output.name}.part")
    try:
        with partial.open("wb") as opened:
            while chunk := receiving.recv(READ_BYTES):
                opened.write(chunk)
                digest.update(chunk)
        partial.replace(output)
    finally:
        partial.unlink(missing_ok=True)
    say("done", {"peer": peer, "sha256": digest.hexdigest(), **receiving.statistics})
