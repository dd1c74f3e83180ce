"""Packets and groups as bytes: PACKET_OUT, PACKET_IN, GROUP_MOD, bundles."""

import struct
from dataclasses import dataclass
from typing import Self

from qswitch_agent.openflow import constants as ofp
from qswitch_agent.openflow import matches
from qswitch_agent.openflow.instructions import each_action, output_ports
from qswitch_agent.openflow.messages import HEADER, MalformedPart, encode, strict, with_body
from wire.malformed import MalformedPacket
from wire.metadata.decoding import decode
from wire.metadata.header import TO_SWITCHES
from wire.metadata.setup import SETUP_LENGTH, Setup

PACKET_OUT = struct.Struct(ofp.OFP_PACKET_OUT_PACK_STR)  # buffer, in_port, length of actions
OUTPUT = struct.Struct("!HHIH6x")  # type, length, port, bytes for the controller
PACKET_IN = struct.Struct(ofp.OFP_PACKET_IN_PACK_STR)
COMMAND = struct.Struct("!H")  # which GROUP_MOD and METER_MOD begin with
GROUP_MOD = struct.Struct(ofp.OFP_GROUP_MOD_PACK_STR)  # command, type, group
BUCKET = struct.Struct(ofp.OFP_BUCKET_PACK_STR)  # length, weight, port, group
BUNDLE = struct.Struct(ofp.OFP_BUNDLE_CTRL_MSG_PACK_STR)  # bundle, type (or padding), flags
ETHERTYPE, IP = slice(12, 14), 14


@dataclass(frozen=True)
class PacketOut:
    in_port: int
    actions: list[tuple[int, bytes]]
    frame: bytes

    @classmethod
    @strict
    def decode(cls, message: bytes) -> Self:
        _buffer, in_port, length = PACKET_OUT.unpack_from(message, HEADER.size)
        rest = message[HEADER.size + PACKET_OUT.size :]
        if length > len(rest):
            raise MalformedPacket(f"PACKET_OUT with {length} bytes of actions in {len(rest)}")
        return cls(in_port, each_action(rest[:length]), rest[length:])

    @property
    def outputs(self) -> list[int]:
        return output_ports(self.actions)


def by_the_table(in_port: int, frame: bytes, xid: int) -> bytes:
    """Return the PACKET_OUT of a frame that flow entries match as one that comes from a port."""
    action = OUTPUT.pack(ofp.OFPAT_OUTPUT, OUTPUT.size, ofp.OFPP_TABLE, 0)
    fixed = PACKET_OUT.pack(ofp.OFP_NO_BUFFER, in_port, len(action))
    return encode(ofp.OFPT_PACKET_OUT, xid, fixed + action + frame)


def is_lldp(frame: bytes) -> bool:
    return frame[ETHERTYPE] == matches.LLDP


@strict
def packet_in(message: bytes) -> tuple[int | None, bytes]:
    match, rest = matches.split(message[HEADER.size + PACKET_IN.size :])
    return matches.in_port(matches.parse(match)), rest[2:]


@strict
def copied_setup(message: bytes) -> Setup | None:
    """Return the set-up message of which a PACKET_IN is a copy, if one has come on copper.

    A frame of a PACKET_OUT is sent up with another reason.
    """
    reason, frame = PACKET_IN.unpack_from(message, HEADER.size)[2], packet_in(message)[1]
    if reason != ofp.OFPR_APPLY_ACTION or frame[:6] != TO_SWITCHES:
        return None
    tcp = IP + 4 * (int.from_bytes(frame[IP : IP + 1]) & 0xF)
    payload = frame[tcp + 4 * (int.from_bytes(frame[tcp + 12 : tcp + 13]) >> 4) :]
    try:
        setup = decode(payload[:SETUP_LENGTH])
    except MalformedPacket:
        return None  # data behind it
    return setup if isinstance(setup, Setup) else None


@strict
def group_outputs(message: bytes) -> list[int]:
    data, ports = message[HEADER.size + GROUP_MOD.size :], []
    while data:
        length, _weight, _port, _group = BUCKET.unpack_from(data)
        if not BUCKET.size <= length <= len(data):
            raise MalformedPacket(f"bucket with length {length}")
        ports += output_ports(each_action(data[BUCKET.size : length]))
        data = data[length:]
    return ports


@strict
def command(message: bytes) -> int:
    (number,) = COMMAND.unpack_from(message, HEADER.size)
    return int(number)


@strict
def bundle_control(message: bytes) -> tuple[int, int, int]:
    bundle, kind, flags = BUNDLE.unpack_from(message, HEADER.size)
    return bundle, kind, flags


@strict
def bundle_member(message: bytes) -> tuple[int, bytes]:
    bundle, _pad, _flags = BUNDLE.unpack_from(message, HEADER.size)
    data = message[HEADER.size + BUNDLE.size :]
    length = int(HEADER.unpack_from(data)[2])
    if data[0] != ofp.OFP_VERSION:
        raise MalformedPart(
            ofp.OFPET_BAD_REQUEST,
            ofp.OFPBRC_BAD_VERSION,
            f"bundle member of version {data[0]:#x}",
        )
    if not HEADER.size <= length <= len(data):
        raise MalformedPart(
            ofp.OFPET_BUNDLE_FAILED,
            ofp.OFPBFC_MSG_BAD_LEN,
            f"bundle member with length {length}",
        )
    return bundle, data[:length]


def with_member(message: bytes, member: bytes) -> bytes:
    head = message[HEADER.size : HEADER.size + BUNDLE.size]
    return with_body(message, head + member)
