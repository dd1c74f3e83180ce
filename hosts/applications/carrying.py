"""Bytes from a file, or to one, through a quantum socket, with reports as JSON."""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from typing import Any, BinaryIO

from hosts.quantum_socket import QuantumSocket, QuantumSocketError
from wire.network_time import REAL_TIME, NetworkTime
from wire.results.figures import SentFigures

CHUNK_BYTES = {"framed": 1 << 16, "per-pair": 16, "sequential": 16}
# Size of a chunk once the arrival of light is known; both ends wait for all of each chunk.
PAIRS_AT_A_TIME = 1 << 20
LIGHT_S = 5.0  # of light at a time at most
BLOCKS_AT_A_TIME = 256  # where they are small: readers of the session see it go on
PAIRS_PER_BYTE = 4
READ_BYTES = 1 << 16


def say(event: str, fields: dict[str, Any]) -> None:
    """Print one line of JSON."""
    print(json.dumps({"event": event, **fields}), flush=True)


def send(
    sending: QuantumSocket, source: BinaryIO, chunk_bytes: int, clock: NetworkTime = REAL_TIME
) -> None:
    """Send all that a file holds; say after every chunk what the session has used so far.

    The first chunk has `chunk_bytes`; those behind it are larger if the light is good. Times are
    in seconds of the network, by `clock`.
    """
    digest, started, size = sha256(), clock.now_s(), chunk_bytes

    def used(event: str, **fields: str) -> None:
        figures = sent_figures(sending.statistics, clock.now_s() - started)
        say(event, {**vars(figures), **fields})

    try:
        while chunk := source.read(size):
            sending.sendall(chunk)
            digest.update(chunk)
            used("result")
            size = next_chunk(chunk_bytes, sending.statistics)
        sending.shutdown()
    except QuantumSocketError:
        used("result")  # how far it came
        raise
    used("done", sha256=digest.hexdigest())


def sent_figures(used: Mapping[str, Any], elapsed_s: float) -> SentFigures:
    received = used["received_symbols"]
    return SentFigures(
        elapsed_s=elapsed_s,
        pairs_per_s=used["bell_pairs"] / elapsed_s if elapsed_s else 0.0,
        symbol_error_rate=used["symbol_errors"] / received if received else None,
        **used,
    )


def first_chunk(options: Mapping[str, Any]) -> int:
    """Return how many bytes to send first, by the options of a session; a block has a frame."""
    most: int = CHUNK_BYTES[options.get("handshake", "framed")]
    block_bytes: int = options.get("block_pairs", PAIRS_PER_BYTE * most) // PAIRS_PER_BYTE
    frame_bytes: int = options.get("frame_bytes", 1)
    return min(most, BLOCKS_AT_A_TIME * max(block_bytes, frame_bytes))


def next_chunk(first: int, used: Mapping[str, Any]) -> int:
    """Return how many bytes to send next, by what a session has used: a multiple of the first ones.

    It depends on nothing but the light, so that a run with the same seed has the same blocks.
    """
    if first < CHUNK_BYTES["framed"] or not used["bell_pairs"]:
        return first
    pairs = min(PAIRS_AT_A_TIME, used["rate_hz"] * LIGHT_S)
    arriving = pairs * used["received_symbols"] / used["bell_pairs"]
    return max(1, int(arriving * used["code_rate"] / PAIRS_PER_BYTE) // first) * first


@contextmanager
def written_whole(output: Path | BinaryIO) -> Iterator[BinaryIO]:
    """Open a file that exists only if all goes well; a device stays a device."""
    if not isinstance(output, Path):
        yield output
        return
    if output.exists() and not output.is_file():
        with output.open("wb") as opened:
            yield opened
        return
    partial = output.with_name(f"{output.name}.part")
    try:
        with partial.open("wb") as opened:
            yield opened
        partial.replace(output)
    finally:
        partial.unlink(missing_ok=True)


def receive(receiving: QuantumSocket, peer: str, output: Path | BinaryIO) -> None:
    """Write received bytes to a file, or into an existing device, pipe or stream."""
    digest = sha256()
    with written_whole(output) as opened:
        while chunk := receiving.recv(READ_BYTES):
            opened.write(chunk)
            opened.flush()
            digest.update(chunk)
    say("done", {"peer": peer, "sha256": digest.hexdigest(), **receiving.statistics})
