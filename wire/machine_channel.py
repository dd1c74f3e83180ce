"""The channel between a runner and its agent on another machine: messages over mutual TLS.

!II   lengths of header and body
      header: an object in JSON
      body: bytes, as of a file or of what a program prints
"""

import asyncio
import json
import struct
from typing import Any

from wire.malformed import MalformedPacket

LENGTHS = struct.Struct("!II")
MOST_HEADER_BYTES = 1 << 20
MOST_BODY_BYTES = 1 << 20

Header = dict[str, Any]


def encode(header: Header, body: bytes = b"") -> bytes:
    """Return a message; raise ValueError for one that nobody would take."""
    text = json.dumps(header).encode()
    if len(text) > MOST_HEADER_BYTES or len(body) > MOST_BODY_BYTES:
        raise ValueError(f"a message of {len(text):,} and {len(body):,} bytes is too long")
    return LENGTHS.pack(len(text), len(body)) + text + body


def lengths(data: bytes) -> tuple[int, int]:
    """Return how long header and body are; raise MalformedPacket for more than there may be."""
    header, body = LENGTHS.unpack(data)
    if header > MOST_HEADER_BYTES or body > MOST_BODY_BYTES:
        raise MalformedPacket(f"a message of {header:,} and {body:,} bytes")
    return header, body


def decode_header(data: bytes) -> Header:
    """Return a header; raise MalformedPacket for anything else."""
    try:
        header = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise MalformedPacket(f"a header that is not JSON: {error}") from error
    if not isinstance(header, dict):
        raise MalformedPacket(f"a header that is not an object: {str(header)[:40]}")
    return header


async def receive(reader: asyncio.StreamReader) -> tuple[Header, bytes] | None:
    """Return the next message, None at the end; raise MalformedPacket, or OSError."""
    try:
        header, body = lengths(await reader.readexactly(LENGTHS.size))
        return decode_header(await reader.readexactly(header)), await reader.readexactly(body)
    except asyncio.IncompleteReadError:
        return None
