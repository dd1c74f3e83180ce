"""The switch's own words of itself: description, features, its one table, its fibres' medium.

Open vSwitch would speak of itself: 254 tables that match and rewrite headers, groups, meters.
Light has one table, which matches ports. On a switch with copper ports further tables
for packets stay Open vSwitch's; the agent reports no features of them.
"""

import struct
from typing import NamedTuple

from qswitch_agent.openflow import constants as ofp
from qswitch_agent.openflow import messages
from qswitch_agent.openflow.messages import HEADER, each_part, strict, with_body

DESCRIPTION = struct.Struct(ofp.OFP_DESC_PACK_STR)  # maker, hardware, software, serial, datapath
FEATURES = struct.Struct(ofp.OFP_SWITCH_FEATURES_PACK_STR)
TABLE = struct.Struct(ofp.OFP_TABLE_FEATURES_PACK_STR)
ETHERNET = struct.Struct("!HH4x6I")  # type, length; media: now, advertised, supported, peer's
MAX_ENTRIES = 1_000_000  # of a table of Open vSwitch
IN_PORT, ETH_TYPE = 0x80000004, 0x80000A02  # headers of OXM fields: all ports, LLDP
PACKETS_ALONE = ofp.OFPC_GROUP_STATS | ofp.OFPC_QUEUE_STATS | ofp.OFPC_IP_REASM


class Identity(NamedTuple):
    name: str = ""
    fibers: int = 0


@strict
def described(message: bytes, identity: Identity) -> bytes:
    _maker, _hardware, software, serial, _name = DESCRIPTION.unpack_from(message, messages.BODY)
    bridge = software.partition(b"\0")[0].decode("ascii", "replace")
    description = DESCRIPTION.pack(
        b"qmn",
        f"optical cross-connect, {identity.fibers} fibre ports".encode(),
        f"qmn agent on Open vSwitch {bridge}".encode(),
        serial,
        identity.name.encode(),
    )
    return messages.rebuilt(message, [description])


@strict
def features(message: bytes, optical_alone: bool) -> bytes:
    """Return a FEATURES_REPLY: light has one table, and no groups nor queues."""
    datapath, buffers, tables, auxiliary, capabilities, reserved = FEATURES.unpack_from(
        message, HEADER.size
    )
    if optical_alone:
        tables, capabilities = 1, capabilities & ~PACKETS_ALONE
    body = FEATURES.pack(datapath, buffers, tables, auxiliary, capabilities, reserved)
    return with_body(message, body)


def table_features(xid: int) -> bytes:
    """Return the reply to OFPMP_TABLE_FEATURES: table 0, where light is sent from port to port."""
    instructions = struct.pack("!4H", ofp.OFPIT_WRITE_ACTIONS, 4, ofp.OFPIT_APPLY_ACTIONS, 4)
    output = struct.pack("!HH", ofp.OFPAT_OUTPUT, 4)
    fields = struct.pack("!II", IN_PORT, ETH_TYPE)
    properties = b"".join(
        _property(kind, data)
        for kind, data in (
            (ofp.OFPTFPT_INSTRUCTIONS, instructions),
            (ofp.OFPTFPT_NEXT_TABLES, b""),
            (ofp.OFPTFPT_WRITE_ACTIONS, output),
            (ofp.OFPTFPT_APPLY_ACTIONS, output),
            (ofp.OFPTFPT_MATCH, fields),
            (ofp.OFPTFPT_WILDCARDS, fields),
            (ofp.OFPTFPT_WRITE_SETFIELD, b""),
            (ofp.OFPTFPT_APPLY_SETFIELD, b""),
        )
    )
    head = TABLE.pack(TABLE.size + len(properties), 0, b"light", 0, 0, 0, MAX_ENTRIES)
    return messages.reply(ofp.OFPMP_TABLE_FEATURES, xid, [head + properties])


def _property(kind: int, data: bytes) -> bytes:
    length = 4 + len(data)
    return struct.pack("!HH", kind, length) + data + bytes(-length % 8)


def nothing_of(message: bytes) -> bytes:
    """Return a reply like this one that says 0 everywhere: no groups, or no meters."""
    return messages.rebuilt(message, [bytes(len(message) - messages.BODY)])


def on_fiber(properties: bytes) -> bytes:
    """Return the properties of a port's description; their medium is fibre, without a bit rate."""
    return b"".join(
        ETHERNET.pack(kind, ETHERNET.size, *[ofp.OFPPF_FIBER] * 4, 0, 0)
        if kind == ofp.OFPPDPT_ETHERNET and len(body) == ETHERNET.size
        else body
        for kind, body in each_part(properties, 4, "property")
    )
