"""OpenFlow matches: OXM fields as bytes, and which match covers which."""

import struct
from collections.abc import Mapping
from functools import lru_cache

from os_ken.ofproto import ofproto_v1_4 as ofp

from qswitch_agent.openflow.messages import strict
from wire.metadata import MalformedPacket

OXM = struct.Struct("!HBB")  # class, field << 1 | has_mask, length of the value
MATCH = struct.Struct("!HH")  # type, length without the padding
NXM_IN_PORT = (0x0000, 0, 2)  # Open vSwitch takes its older name, too
IN_PORT = (ofp.OFPXMC_OPENFLOW_BASIC, ofp.OFPXMT_OFB_IN_PORT, 4)
ETH_TYPE = (ofp.OFPXMC_OPENFLOW_BASIC, ofp.OFPXMT_OFB_ETH_TYPE, 2)
LLDP = bytes.fromhex("88cc")

Field = tuple[int, int, int]  # class, number, length of the value without a mask
Fields = Mapping[Field, tuple[bytes, bytes]]  # value and mask


@strict
def split(data: bytes) -> tuple[bytes, bytes]:
    """Return the OXM fields that data begins with, and what is behind the match's padding."""
    kind, length = MATCH.unpack_from(data)
    if kind != ofp.OFPMT_OXM or not MATCH.size <= length <= len(data):
        raise MalformedPacket(f"match of type {kind} with length {length}")
    return data[MATCH.size : length], data[length + -length % 8 :]


def join(fields: bytes) -> bytes:
    """Return a match made of OXM fields, with its padding."""
    length = MATCH.size + len(fields)
    return MATCH.pack(ofp.OFPMT_OXM, length) + fields + b"\0" * (-length % 8)


@lru_cache(maxsize=4096)
@strict
def parse(data: bytes) -> Fields:
    """Return the fields with their values and masks."""
    fields: dict[Field, tuple[bytes, bytes]] = {}
    offset = 0
    while offset < len(data):
        oxm_class, number, length = OXM.unpack_from(data, offset)
        offset += OXM.size
        body = data[offset : offset + length]
        if len(body) < length:
            raise MalformedPacket(f"match field {oxm_class:#x}/{number >> 1} is cut short")
        width = length // 2 if number & 1 else length
        mask = body[width:] if number & 1 else b"\xff" * width
        key = oxm_class, number >> 1, width
        if key == NXM_IN_PORT:
            key, body, width, mask = IN_PORT, bytes(2) + body, 4, b"\xff" * 4
        if key in fields:
            raise MalformedPacket(f"match field {oxm_class:#x}/{number >> 1} is there twice")
        fields[key] = body[:width], mask
        offset += length
    return fields


def in_port(fields: Fields) -> int | None:
    """Return the port that a match asks for, None if any will do."""
    return int.from_bytes(fields[IN_PORT][0], "big") if IN_PORT in fields else None


def is_lldp(fields: Fields) -> bool:
    """Tell whether a match asks for LLDP alone."""
    return ETH_TYPE in fields and fields[ETH_TYPE] == (LLDP, b"\xff\xff")


def covers(wide: Fields, narrow: Fields) -> bool:
    """Tell whether everything that `narrow` matches is also matched by `wide`."""
    return all(key in narrow and _within(narrow[key], wide[key]) for key in wide)


def _within(narrow: tuple[bytes, bytes], wide: tuple[bytes, bytes]) -> bool:
    return all(
        (mask & wide_mask) == wide_mask and (value ^ wide_value) & wide_mask == 0
        for value, mask, wide_value, wide_mask in zip(*narrow, *wide, strict=True)
    )
