"""Multipart messages: their header, and bodies that may take more than one message."""

import struct
from collections.abc import Iterable

from qswitch_agent.openflow import constants as ofp
from qswitch_agent.openflow.messages import HEADER, MAX_LENGTH, encode, strict, transaction_id
from wire.optical import EXPERIMENTER, PATH_OPTICS

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
    """Return a reply like this one, but with these parts."""
    kind, xid = multipart_type(message), transaction_id(message)
    return reply(kind, xid, parts, more_follows(message))


@strict
def asks_for_path_optics(message: bytes) -> bool:
    if multipart_type(message) != ofp.OFPMP_EXPERIMENTER:
        return False
    return EXPERIMENT.unpack_from(message, BODY) == (EXPERIMENTER, PATH_OPTICS)


def path_optics_reply(xid: int, body: bytes) -> bytes:
    """Return our experimenter's reply, whose body wire.optical encodes; in parts if long."""
    entries = [body[at : at + 16] for at in range(0, len(body), 16)]
    head, capacity = EXPERIMENT.pack(EXPERIMENTER, PATH_OPTICS), (MAX_LENGTH - BODY - 8) // 16
    chunks = [entries[at : at + capacity] for at in range(0, len(entries), capacity)] or [[]]
    parts = [head + b"".join(chunk) for chunk in chunks]
    return b"".join(
        reply(ofp.OFPMP_EXPERIMENTER, xid, [part], more=number + 1 < len(parts))
        for number, part in enumerate(parts)
    )
