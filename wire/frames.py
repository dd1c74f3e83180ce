"""Messages on a byte stream: the length in four bytes, network byte order, then the message."""

import struct
from asyncio import StreamReader

from wire.malformed import MalformedPacket

LENGTH = struct.Struct("!I")
MAX_LENGTH = 1 << 20


def encode(message: bytes) -> bytes:
    return LENGTH.pack(len(message)) + message


async def read(stream: StreamReader) -> bytes:
    """Return the next message.

    Raise EOFError where the stream ends, MalformedPacket for more than MAX_LENGTH bytes.
    """
    (length,) = LENGTH.unpack(await stream.readexactly(LENGTH.size))
    if length > MAX_LENGTH:
        raise MalformedPacket(f"a message of {length} bytes, more than {MAX_LENGTH}")
    return await stream.readexactly(length)
