"""Framing, headers, and the messages that are alike for all: HELLO, ERROR, barriers.

SET_ASYNC and GET_ASYNC_REPLY as bytes: which removals of flow entries a controller hears of.

Light entries never expire in the bridge: the agent deletes those that are idle. So the bridge
gets the order to report deletions if the controller wants to hear of idle entries, and the agent
drops reports that it did not request.
"""

import struct
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import wraps
from typing import ParamSpec, TypeVar

from qswitch_agent.openflow import constants as ofp
from wire.malformed import MalformedPacket
from wire.optical import EXPERIMENTER

HEADER = struct.Struct(ofp.OFP_HEADER_PACK_STR)  # version, type, length, xid
ERROR = struct.Struct("!HH")  # type, code
PART = struct.Struct("!HH")  # type, length
ERROR_DATA = 64  # bytes of the message that is answered, at least those it has
MAX_LENGTH = 0xFFFF
NOT_AVAILABLE = (1 << 64) - 1  # a counter that a switch does not have (OpenFlow 1.4, 5.8)
ANY_VERSION = (ofp.OFPT_HELLO, ofp.OFPT_ERROR)  # of a message that may not be of version 1.4
PART_LENGTHS = {  # the error for a part of a list whose length cannot be
    "action": (ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_LEN),
    "instruction": (ofp.OFPET_BAD_INSTRUCTION, ofp.OFPBIC_BAD_LEN),
    "property": (ofp.OFPET_BAD_PROPERTY, ofp.OFPBPC_BAD_LEN),
}
ROLE = struct.Struct(ofp.OFP_ROLE_REQUEST_PACK_STR)

P = ParamSpec("P")
T = TypeVar("T")


class MalformedPart(MalformedPacket):
    """A part of a message that is malformed, for which OpenFlow has an error of its own."""

    def __init__(self, kind: int, code: int, reason: str) -> None:
        super().__init__(reason)
        self.kind = kind
        self.code = code


def strict(parse: Callable[P, T]) -> Callable[P, T]:
    """Let a parser raise MalformedPacket where a structure is cut short."""

    @wraps(parse)
    def guarded(*arguments: P.args, **options: P.kwargs) -> T:
        try:
            return parse(*arguments, **options)
        except (struct.error, IndexError) as error:
            raise MalformedPacket(f"OpenFlow message is cut short: {error}") from error

    return guarded


class Framer:
    """Cuts a byte stream into OpenFlow messages."""

    def __init__(self) -> None:
        self._buffer = b""

    def feed(self, data: bytes) -> list[bytes]:
        """Return the messages that data completes; raise MalformedPacket at a bad header."""
        self._buffer += data
        messages, start = [], 0
        while len(self._buffer) - start >= HEADER.size:
            length = _checked_length(self._buffer, start)
            if len(self._buffer) - start < length:
                break
            messages.append(self._buffer[start : start + length])
            start += length
        self._buffer = self._buffer[start:]
        return messages


def _checked_length(buffer: bytes, start: int) -> int:
    _version, kind, length, _xid = HEADER.unpack_from(buffer, start)
    if length < HEADER.size:
        raise MalformedPacket(f"OpenFlow message of type {kind} with length {length}")
    return int(length)


def require_version(message: bytes) -> bytes:
    """Return a message that is of OpenFlow 1.4, as all but HELLO and ERROR must be."""
    if message[0] != ofp.OFP_VERSION and message[1] not in ANY_VERSION:
        raise MalformedPart(
            ofp.OFPET_BAD_REQUEST,
            ofp.OFPBRC_BAD_VERSION,
            f"OpenFlow version {message[0]:#x}, not 1.4 ({ofp.OFP_VERSION:#x}), "
            f"in a message of type {message[1]}",
        )
    return message


def message_type(message: bytes) -> int:
    return message[1]


def transaction_id(message: bytes) -> int:
    return int.from_bytes(message[4:8], "big")


def encode(kind: int, xid: int, body: bytes = b"") -> bytes:
    return HEADER.pack(ofp.OFP_VERSION, kind, HEADER.size + len(body), xid) + body


def with_body(message: bytes, body: bytes) -> bytes:
    return encode(message_type(message), transaction_id(message), body)


def each_part(data: bytes, header: int, what: str) -> list[tuple[int, bytes]]:
    """Return type and bytes of each part of a list of (u16 type, u16 length, …).

    A length covers its part; raise MalformedPart where it does not, or is under `header`.
    """
    parts, offset = [], 0
    while offset < len(data):
        kind, length = PART.unpack_from(data.ljust(offset + PART.size, b"\0"), offset)
        if not header <= length <= len(data) - offset:
            raise MalformedPart(*PART_LENGTHS[what], f"{what} with length {length}")
        parts.append((kind, data[offset : offset + length]))
        offset += length
    return parts


def hello() -> bytes:
    """Return a HELLO that offers OpenFlow 1.4 alone."""
    bitmap = struct.pack("!HHI", ofp.OFPHET_VERSIONBITMAP, 8, 1 << ofp.OFP_VERSION)
    return encode(ofp.OFPT_HELLO, 0, bitmap)


def error(kind: int, code: int, request: bytes) -> bytes:
    return encode(
        ofp.OFPT_ERROR, transaction_id(request), ERROR.pack(kind, code) + request[:ERROR_DATA]
    )


@strict
def error_code(message: bytes) -> tuple[int, int]:
    kind, code = ERROR.unpack_from(message, HEADER.size)
    return kind, code


@strict
def role(message: bytes) -> int:
    return int(ROLE.unpack_from(message, HEADER.size)[0])


REASONS = struct.Struct(ofp.OFP_ASYNC_CONFIG_PROP_REASONS_PACK_STR)  # type, length, mask
SLAVE, MASTER = ofp.OFPACPT_FLOW_REMOVED_SLAVE, ofp.OFPACPT_FLOW_REMOVED_MASTER
IDLE, DELETED = 1 << ofp.OFPRR_IDLE_TIMEOUT, 1 << ofp.OFPRR_DELETE
ALL_REASONS = (1 << ofp.OFPRR_EVICTION + 1) - 1
DEFAULT = {SLAVE: 0, MASTER: ALL_REASONS}  # of a connection that has set nothing


def removal_masks(message: bytes) -> dict[int, int]:
    masks = (REASONS.unpack(part) for part in _parts(message) if _is_removal(part))
    return {kind: mask for kind, _length, mask in masks}


def with_deletions(message: bytes) -> bytes:
    masks = removal_masks(message)
    wider = {kind: mask | (DELETED if mask & IDLE else 0) for kind, mask in masks.items()}
    return with_removal_masks(message, wider)


def with_removal_masks(message: bytes, masks: Mapping[int, int]) -> bytes:
    return with_body(message, b"".join(_with_mask(part, masks) for part in _parts(message)))


def _parts(message: bytes) -> Iterator[bytes]:
    return (body for _kind, body in each_part(message[HEADER.size :], 4, "property"))


def _is_removal(part: bytes) -> bool:
    return int.from_bytes(part[:2], "big") in (SLAVE, MASTER) and len(part) == REASONS.size


def _with_mask(part: bytes, masks: Mapping[int, int]) -> bytes:
    if not _is_removal(part):
        return part
    kind, length, mask = REASONS.unpack(part)
    return REASONS.pack(kind, length, masks.get(kind, mask))


MULTIPART = struct.Struct("!HH4x")  # type, flags
BODY = HEADER.size + MULTIPART.size
MORE = ofp.OFPMPF_REPLY_MORE
EXPERIMENT = struct.Struct("!II")  # experimenter, exp_type


@strict
def multipart_type(message: bytes) -> int:
    return int(MULTIPART.unpack_from(message, HEADER.size)[0])


@strict
def more_follows(message: bytes) -> bool:
    return bool(MULTIPART.unpack_from(message, HEADER.size)[1] & MORE)


def request(kind: int, xid: int, body: bytes = b"") -> bytes:
    return encode(ofp.OFPT_MULTIPART_REQUEST, xid, MULTIPART.pack(kind, 0) + body)


def reply(kind: int, xid: int, parts: Iterable[bytes], more: bool = False) -> bytes:
    """Return a reply made of these parts, as one message or, if they are many, several."""
    bodies, size = [b""], MAX_LENGTH - BODY
    for part in parts:
        if len(bodies[-1]) + len(part) > size:
            bodies.append(b"")
        bodies[-1] += part
    flags = [MORE] * (len(bodies) - 1) + [MORE if more else 0]
    return b"".join(
        encode(ofp.OFPT_MULTIPART_REPLY, xid, MULTIPART.pack(kind, flag) + body)
        for body, flag in zip(bodies, flags, strict=True)
    )


def rebuilt(message: bytes, parts: Iterable[bytes]) -> bytes:
    kind, xid = multipart_type(message), transaction_id(message)
    return reply(kind, xid, parts, more_follows(message))


@strict
def asked_of_us(message: bytes) -> int | None:
    """Return the type of our experimenter's request, None for any other multipart request."""
    if multipart_type(message) != ofp.OFPMP_EXPERIMENTER:
        return None
    experimenter, kind = EXPERIMENT.unpack_from(message, BODY)
    return int(kind) if experimenter == EXPERIMENTER else None


def reply_of_ours(xid: int, kind: int, body: bytes) -> bytes:
    """Return our experimenter's reply, whose entries have multiples of 16 bytes; in parts if long.

    wire.optical and wire.analyser_frames encode the body.
    """
    entries = [body[at : at + 16] for at in range(0, len(body), 16)]
    head, capacity = EXPERIMENT.pack(EXPERIMENTER, kind), (MAX_LENGTH - BODY - 8) // 16
    chunks = [entries[at : at + capacity] for at in range(0, len(entries), capacity)] or [[]]
    parts = [head + b"".join(chunk) for chunk in chunks]
    return b"".join(
        reply(ofp.OFPMP_EXPERIMENTER, xid, [part], more=number + 1 < len(parts))
        for number, part in enumerate(parts)
    )
