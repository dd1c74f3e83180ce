"""Bytes become messages of quantum metadata."""

from wire.malformed import MalformedPacket
from wire.metadata.blocks import Block, Emission, Emit, Emitted, Finish, Report
from wire.metadata.header import HEADER, MAGIC, MAX_LENGTH, VERSION, Message
from wire.metadata.setup import Answer, Setup
from wire.metadata.values import Envelope, Values

KINDS: dict[int, type[Message]] = {
    kind.KIND: kind
    for kind in (
        *(Setup, Answer, Emit, Block, Report, Finish, Values, Envelope),
        *(Emission, Emitted),
    )
}


def message_length(data: bytes) -> int | None:
    """Return the length of the message that data begins with, None if more bytes are needed.

    Raise MalformedPacket as soon as the header cannot be that of a message.
    """
    if not MAGIC.to_bytes(2, "big").startswith(data[:2]):
        raise MalformedPacket(f"not quantum metadata: begins with {data[:2].hex()}")
    if len(data) < HEADER.size:
        return None
    _magic, version, kind, length, _session = HEADER.unpack_from(data)
    if version != VERSION:
        raise MalformedPacket(f"version {version}, this is version {VERSION}")
    if kind not in KINDS:
        raise MalformedPacket(f"unknown kind {kind}")
    if not HEADER.size <= length <= MAX_LENGTH:
        raise MalformedPacket(f"length {length} is outside {HEADER.size}..{MAX_LENGTH}")
    return int(length)


def decode(data: bytes) -> Message:
    """Decode exactly one message; raise MalformedPacket for anything else."""
    length = message_length(data)
    if length is None or len(data) != length:
        raise MalformedPacket(f"{len(data)} bytes where the header says {length}")
    _magic, _version, kind, _length, session = HEADER.unpack_from(data)
    return KINDS[kind].parse(session, data[HEADER.size :])
