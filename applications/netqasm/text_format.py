"""Texts between the programs of an application, over TCP: NetQASM's classical sockets.

the program whose name comes later          the other one, TCP port TEXTS_PORT
Greeting                               ->
text                                  <->   text, as often as wanted

A text is its length in four bytes, network byte order, and as many bytes of UTF-8.
"""

import struct
from typing import NamedTuple

from wire.malformed import MalformedPacket

TEXTS_PORT = 9016
GREETING = struct.Struct("!2sBi32s32s")
MAGIC = b"QT"
VERSION = 1
NAME_BYTES = 32
LENGTH = struct.Struct("!I")
MAX_BYTES = 1 << 20


class Greeting(NamedTuple):
    """Which of its sockets a program wants to join with which of another's."""

    sender: str
    receiver: str
    socket: int


def encode_greeting(greeting: Greeting) -> bytes:
    sender, receiver = greeting.sender.encode(), greeting.receiver.encode()
    return GREETING.pack(MAGIC, VERSION, greeting.socket, sender, receiver)


def decode_greeting(data: bytes) -> Greeting:
    """Return a greeting; raise MalformedPacket for anything else."""
    if len(data) != GREETING.size:
        raise MalformedPacket(f"a greeting of {len(data)} bytes, not {GREETING.size}")
    magic, version, socket, sender, receiver = GREETING.unpack(data)
    if (magic, version) != (MAGIC, VERSION):
        raise MalformedPacket(f"no greeting of NetQASM programs: {data[:8].hex()}")
    try:
        names = [name.rstrip(b"\0").decode() for name in (sender, receiver)]
    except UnicodeDecodeError as error:
        raise MalformedPacket(f"a name in a greeting: {error}") from error
    return Greeting(names[0], names[1], socket)


def encode_text(text: str) -> bytes:
    data = text.encode()
    if len(data) > MAX_BYTES:
        raise ValueError(f"a text of {len(data)} bytes: at most {MAX_BYTES}, send several")
    return LENGTH.pack(len(data)) + data


def take_text(data: bytearray) -> str | None:
    """Return the first text of what has come, and remove it there; None if it is not whole.

    Raise MalformedPacket for what cannot be one.
    """
    if len(data) < LENGTH.size:
        return None
    (length,) = LENGTH.unpack_from(data)
    if length > MAX_BYTES:
        raise MalformedPacket(f"a text of {length} bytes, more than {MAX_BYTES}")
    end = LENGTH.size + length
    if len(data) < end:
        return None
    body = bytes(data[LENGTH.size : end])
    try:
        text = body.decode()
    except UnicodeDecodeError as error:
        raise MalformedPacket(f"a text that is not UTF-8: {error}") from error
    del data[:end]
    return text
