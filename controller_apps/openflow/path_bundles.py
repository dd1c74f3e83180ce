"""The bundle that changes the light paths through a switch, as bytes.

To put it together from the framework's objects took the controller longer than Open vSwitch takes
to read it, while light is waited for.
"""

import struct
from collections.abc import Iterator
from typing import Any

from controller_apps.light.paths import Hop
from controller_apps.openflow.flow_entries import ALL_BITS, LIGHT_TABLE, PATH_PRIORITY
from controller_apps.openflow.framework import ofproto
from controller_apps.sessions.actions import OpenPaths

FLAGS = ofproto.OFPBF_ATOMIC | ofproto.OFPBF_ORDERED
HEADER = struct.Struct("!BBHI")  # version, type, length, xid
BUNDLE = struct.Struct("!IHH")  # bundle, type (or padding), flags
# Cookie and its mask; table, command; time-outs; priority, buffer; out_port, out_group; flags;
# importance.
FLOW_MOD = struct.Struct("!QQBBHHHIIIHH")
IN_PORT = struct.Struct("!HHIIxxxx")  # a match: type, length; a field: which, port
OUTPUT = struct.Struct("!HHxxxxHHIHxxxxxx")  # an instruction; an action: type, length, port, bytes
MATCH_LENGTH = IN_PORT.size - 4  # without what fills it up
IN_PORT_FIELD = 0x80000004  # OFPXMC_OPENFLOW_BASIC, OFPXMT_OFB_IN_PORT, no mask, 4 bytes
INSTRUCTION = ofproto.OFPIT_APPLY_ACTIONS, OUTPUT.size
ACTION = ofproto.OFPAT_OUTPUT, 16
XIDS = 0xFFFFFFFF


def path_bundle(paths: OpenPaths, tuning: list[Any], xids: Iterator[int]) -> list[bytes]:
    """Return one bundle that changes the hops through a switch, and a barrier behind it.

    `tuning` are PORT_MODs of the framework. No time-outs: light moves no packets, so an entry would
    expire while in use.
    """
    bundle = paths.transaction & XIDS
    messages = [_control(bundle, ofproto.OFPBCT_OPEN_REQUEST, next(xids))]
    for hop in paths.closed:
        xid = next(xids)
        messages.append(_member(bundle, _delete(hop, paths.session, xid), xid))
    for port_mod in tuning:
        xid = next(xids)
        port_mod.set_xid(xid & XIDS)
        port_mod.serialize()
        messages.append(_member(bundle, bytes(port_mod.buf), xid))
    for hop in paths.hops:
        xid = next(xids)
        messages.append(_member(bundle, _add(hop, paths.session, xid), xid))
    messages.append(_control(bundle, ofproto.OFPBCT_COMMIT_REQUEST, next(xids)))
    messages.append(_message(ofproto.OFPT_BARRIER_REQUEST, next(xids)))
    return messages


def xid_of(message: bytes) -> int:
    return int.from_bytes(message[4:8], "big")


def _message(kind: int, xid: int, body: bytes = b"") -> bytes:
    return HEADER.pack(ofproto.OFP_VERSION, kind, HEADER.size + len(body), xid & XIDS) + body


def _control(bundle: int, kind: int, xid: int) -> bytes:
    return _message(ofproto.OFPT_BUNDLE_CONTROL, xid, BUNDLE.pack(bundle, kind, FLAGS))


def _member(bundle: int, message: bytes, xid: int) -> bytes:
    head = BUNDLE.pack(bundle, 0, FLAGS)
    return _message(ofproto.OFPT_BUNDLE_ADD_MESSAGE, xid, head + message)


def _add(hop: Hop, session: int, xid: int) -> bytes:
    fixed = _flow_mod(session, 0, ofproto.OFPFC_ADD, 0, 0)
    output = OUTPUT.pack(*INSTRUCTION, *ACTION, hop.out_port, ofproto.OFPCML_NO_BUFFER)
    return _message(ofproto.OFPT_FLOW_MOD, xid, fixed + _match(hop) + output)


def _delete(hop: Hop, session: int, xid: int) -> bytes:
    """Delete one hop of a session, not what has taken its place."""
    ends = hop.out_port, ofproto.OFPG_ANY
    fixed = _flow_mod(session, ALL_BITS, ofproto.OFPFC_DELETE_STRICT, *ends)
    return _message(ofproto.OFPT_FLOW_MOD, xid, fixed + _match(hop))


def _flow_mod(session: int, mask: int, command: int, out_port: int, out_group: int) -> bytes:
    cookie, no_time_outs, buffer = (session, mask), (0, 0), ofproto.OFP_NO_BUFFER
    entry = *cookie, LIGHT_TABLE, command, *no_time_outs, PATH_PRIORITY, buffer
    return FLOW_MOD.pack(*entry, out_port, out_group, 0, 0)


def _match(hop: Hop) -> bytes:
    return IN_PORT.pack(ofproto.OFPMT_OXM, MATCH_LENGTH, IN_PORT_FIELD, hop.in_port)
