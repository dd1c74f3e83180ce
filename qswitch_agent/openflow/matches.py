"""OpenFlow matches: OXM fields as bytes, and which match covers which."""

import struct
from collections.abc import Mapping
from functools import lru_cache

from qswitch_agent.openflow import constants as ofp
from qswitch_agent.openflow.messages import MalformedPart, strict

OXM = struct.Struct("!HBB")  # class, field << 1 | has_mask, length of the value
MATCH = struct.Struct("!HH")  # type, length without the padding
NXM_IN_PORT = (0x0000, 0, 2)  # Open vSwitch takes its older name, too
EXPERIMENTER = struct.Struct("!I")  # before the value of a field of class OFPXMC_EXPERIMENTER
IN_PORT = (ofp.OFPXMC_OPENFLOW_BASIC, ofp.OFPXMT_OFB_IN_PORT, 4)
ETH_TYPE = (ofp.OFPXMC_OPENFLOW_BASIC, ofp.OFPXMT_OFB_ETH_TYPE, 2)
MAX_REMEMBERED = 256  # bytes of a match; longer ones would fill the memory
LLDP = bytes.fromhex("88cc")

Field = tuple[int, int, int]  # class (and experimenter), number, length of the value
Fields = Mapping[Field, tuple[bytes, bytes]]  # value and mask


@strict
def split(data: bytes) -> tuple[bytes, bytes]:
    kind, length = MATCH.unpack_from(data)
    if kind != ofp.OFPMT_OXM:
        raise _bad(ofp.OFPBMC_BAD_TYPE, f"match of type {kind}")
    if not MATCH.size <= length <= len(data):
        raise _bad(ofp.OFPBMC_BAD_LEN, f"match with length {length}")
    return data[MATCH.size : length], data[length + -length % 8 :]


def join(fields: bytes) -> bytes:
    length = MATCH.size + len(fields)
    return MATCH.pack(ofp.OFPMT_OXM, length) + fields + b"\0" * (-length % 8)


def parse(data: bytes) -> Fields:
    """Return the fields with their values and masks, but those that ask for nothing.

    Like the bridge, take a field whose mask is zero for one that is not there.
    """
    return _remembered(data) if len(data) <= MAX_REMEMBERED else _fields(data)


def _fields(data: bytes) -> Fields:
    fields: dict[Field, tuple[bytes, bytes]] = {}
    offset = 0
    while offset < len(data):
        oxm_class, number, length = OXM.unpack_from(data.ljust(offset + OXM.size, b"\0"), offset)
        body = data[offset + OXM.size : offset + OXM.size + length]
        if offset + OXM.size + length > len(data):
            raise _bad(ofp.OFPBMC_BAD_LEN, f"match field {oxm_class:#x}/{number >> 1} is cut short")
        key, value, mask = _field(oxm_class, number >> 1, bool(number & 1), body)
        if key in fields:
            reason = f"match field {oxm_class:#x}/{number >> 1} occurs twice"
            raise _bad(ofp.OFPBMC_DUP_FIELD, reason)
        if any(mask) or not mask:
            fields[key] = value, mask
        offset += OXM.size + length
    return fields


_remembered = lru_cache(maxsize=4096)(_fields)


def _field(oxm_class: int, number: int, masked: bool, body: bytes) -> tuple[Field, bytes, bytes]:
    if oxm_class == ofp.OFPXMC_EXPERIMENTER:
        if len(body) < EXPERIMENTER.size:
            raise _bad(ofp.OFPBMC_BAD_LEN, f"match field of no experimenter, {len(body)} bytes")
        oxm_class = oxm_class << 32 | EXPERIMENTER.unpack_from(body)[0]
        body = body[EXPERIMENTER.size :]
    if masked and len(body) % 2:
        raise _bad(ofp.OFPBMC_BAD_LEN, f"match field {oxm_class:#x}/{number} has half a mask")
    width = len(body) // 2 if masked else len(body)
    value, mask = body[:width], body[width:] if masked else b"\xff" * width
    if (oxm_class, number) == IN_PORT[:2] and width != IN_PORT[2]:
        raise _bad(ofp.OFPBMC_BAD_LEN, f"in_port of {width} bytes")
    key = oxm_class, number, width
    if key == NXM_IN_PORT:
        return IN_PORT, bytes(2) + value, mask[:1] * 2 + mask
    return key, value, mask


def _bad(code: int, reason: str) -> MalformedPart:
    return MalformedPart(ofp.OFPET_BAD_MATCH, code, reason)


def of_port(number: int) -> bytes:
    oxm_class, field, width = IN_PORT
    return OXM.pack(oxm_class, field << 1, width) + number.to_bytes(width, "big")


def in_port(fields: Fields) -> int | None:
    return int.from_bytes(fields[IN_PORT][0], "big") if IN_PORT in fields else None


def in_port_is_masked(fields: Fields) -> bool:
    """Tell whether a match asks for some bits of the port alone, which no bridge does."""
    return IN_PORT in fields and fields[IN_PORT][1] != b"\xff" * 4


def is_of_type(fields: Fields, ether_type: bytes) -> bool:
    return fields.get(ETH_TYPE) == (ether_type, b"\xff\xff")


def covers(wide: Fields, narrow: Fields) -> bool:
    """Tell whether everything that `narrow` matches is also matched by `wide`."""
    return all(key in narrow and _within(narrow[key], wide[key]) for key in wide)


def _within(narrow: tuple[bytes, bytes], wide: tuple[bytes, bytes]) -> bool:
    return all(
        (mask & wide_mask) == wide_mask and (value ^ wide_value) & wide_mask == 0
        for value, mask, wide_value, wide_mask in zip(*narrow, *wide, strict=True)
    )
