"""OpenFlow messages for the tests: requests encoded by os_ken, replies packed as bridges do."""

import struct
from dataclasses import replace
from typing import Any

from os_ken.ofproto import ofproto_v1_4 as ofp
from os_ken.ofproto import ofproto_v1_4_parser as parser
from os_ken.ofproto.ofproto_parser import msg as parse
from os_ken.ofproto.ofproto_protocol import ProtocolDesc

from qswitch_agent.openflow import flow_reports, matches, messages, packets, ports
from qswitch_agent.openflow.flows import FlowMod
from qswitch_agent.openflow.instructions import Mark
from qswitch_agent.openflow.messages import HEADER, encode
from wire import optical

DATAPATH = ProtocolDesc(version=ofp.OFP_VERSION)
FIBERS = frozenset({1, 2, 3, 4})
CLASSICAL = 9
ADDRESS = bytes.fromhex("020000000001")
ATOMIC = ofp.OFPBF_ATOMIC | ofp.OFPBF_ORDERED
LLDP = bytes.fromhex("0180c200000e0a00000000aa88cc") + bytes(46)
PING = bytes.fromhex("ffffffffffff0a00000000aa0800") + bytes(46)


def encoded(message: Any, xid: int = 1) -> bytes:
    """Return a message of os_ken as bytes."""
    message.set_xid(xid)
    message.serialize()
    return bytes(message.buf)


def decoded(message: bytes) -> Any:
    """Return a message as os_ken understands it."""
    version, kind, length, xid = HEADER.unpack_from(message)
    assert length == len(message)
    return parse(DATAPATH, version, kind, length, xid, message)


def actions(*list_of_actions: Any, kind: int = ofp.OFPIT_APPLY_ACTIONS) -> Any:
    return parser.OFPInstructionActions(kind, list(list_of_actions))


def outputs(*numbers: int) -> Any:
    return actions(*(parser.OFPActionOutput(number) for number in numbers))


def flow_mod(fields: dict[str, Any], *instructions: Any, xid: int = 1, **more: Any) -> bytes:
    """Return a FLOW_MOD."""
    if more.get("command") in (ofp.OFPFC_DELETE, ofp.OFPFC_DELETE_STRICT):
        more = {"out_port": ofp.OFPP_ANY, "out_group": ofp.OFPG_ANY} | more
    match = parser.OFPMatch(**fields)
    mod = parser.OFPFlowMod(DATAPATH, match=match, instructions=list(instructions), **more)
    return encoded(mod, xid)


def mod(fields: dict[str, Any], *instructions: Any, **more: Any) -> FlowMod:
    """Return a FLOW_MOD as the agent reads it."""
    return FlowMod.decode(flow_mod(fields, *instructions, **more))


def light(in_port: int, out_port: int, xid: int = 1, **more: Any) -> bytes:
    """Return the FLOW_MOD that adds a light entry."""
    return flow_mod({"in_port": in_port}, outputs(out_port), xid=xid, **more)


def port_mod(number: int, *properties: Any, config: int = 0, mask: int = 0, xid: int = 1) -> bytes:
    """Return a PORT_MOD."""
    address = ADDRESS.hex(":")
    message = parser.OFPPortMod(DATAPATH, number, address, config, mask, list(properties))
    return encoded(message, xid)


def tuning(frequency_mhz: int, power: int = 0, configure: int = optical.TUNABLE) -> Any:
    """Return the property that tunes a port; power in dBm * 10."""
    return parser.OFPPortModPropOptical(
        type_=ofp.OFPPMPT_OPTICAL,
        configure=configure,
        freq_lmda=frequency_mhz,
        fl_offset=0,
        grid_span=50_000,
        tx_pwr=power & 0xFFFFFFFF,
    )


def group_mod(*numbers: int, xid: int = 1) -> bytes:
    """Return a GROUP_MOD whose buckets output to these ports."""
    buckets = [parser.OFPBucket(actions=[parser.OFPActionOutput(number)]) for number in numbers]
    return encoded(parser.OFPGroupMod(DATAPATH, ofp.OFPGC_ADD, ofp.OFPGT_ALL, 1, buckets), xid)


def packet_out(frame: bytes, *numbers: int, xid: int = 1) -> bytes:
    """Return a PACKET_OUT to these ports."""
    out = [parser.OFPActionOutput(number) for number in numbers]
    message = parser.OFPPacketOut(DATAPATH, ofp.OFP_NO_BUFFER, ofp.OFPP_CONTROLLER, out, frame)
    return encoded(message, xid)


def bundle_control(number: int, kind: int, xid: int) -> bytes:
    """Return a BUNDLE_CONTROL, which may also be a reply."""
    return encode(ofp.OFPT_BUNDLE_CONTROL, xid, packets.BUNDLE.pack(number, kind, ATOMIC))


def bundle_add(number: int, member: bytes, xid: int | None = None) -> bytes:
    """Return the BUNDLE_ADD_MESSAGE with this member; its xid is the member's."""
    xid = int.from_bytes(member[4:8], "big") if xid is None else xid
    return encode(ofp.OFPT_BUNDLE_ADD_MESSAGE, xid, packets.BUNDLE.pack(number, 0, ATOMIC) + member)


def bundle(number: int, *members: bytes, xid: int = 50) -> list[bytes]:
    """Return the messages that make and commit a bundle."""
    return [
        bundle_control(number, ofp.OFPBCT_OPEN_REQUEST, xid),
        *(bundle_add(number, member) for member in members),
        bundle_control(number, ofp.OFPBCT_COMMIT_REQUEST, xid),
    ]


def barrier_request(xid: int) -> bytes:
    return encode(ofp.OFPT_BARRIER_REQUEST, xid)


def barrier_reply(xid: int) -> bytes:
    return encode(ofp.OFPT_BARRIER_REPLY, xid)


def flow_request(xid: int, aggregate: bool = False) -> bytes:
    """Return a request for all flow statistics, or their sum."""
    kind = parser.OFPAggregateStatsRequest if aggregate else parser.OFPFlowStatsRequest
    anything = (0, ofp.OFPTT_ALL, ofp.OFPP_ANY, ofp.OFPG_ANY, 0, 0, parser.OFPMatch())
    return encoded(kind(DATAPATH, *anything), xid)


def entry_bytes(message: bytes, mark: Mark | None = None) -> tuple[bytes, bytes]:
    """Return match and instructions of a FLOW_MOD, as the bridge holds them."""
    report = FlowMod.decode(message)
    report = report.marked(mark) if mark else report
    return matches.join(report.match), report.instructions.data


def flow_update(event: int, message: bytes, mark: Mark | None = None) -> bytes:
    """Return one update of a flow monitor about the entry that a FLOW_MOD adds."""
    report = FlowMod.decode(message)
    match, instructions = entry_bytes(message, mark)
    length = flow_reports.UPDATE.size + len(match) + len(instructions)
    fixed = (length, event, 0, 0, 0, report.hard_timeout_s, report.priority, report.cookie)
    return flow_reports.UPDATE.pack(*fixed) + match + instructions


def monitor_reply(*updates: bytes, more: bool = False) -> bytes:
    """Return a flow monitor's reply."""
    return messages.reply(ofp.OFPMP_FLOW_MONITOR, 0, [b"".join(updates)], more)


def flow_entry(message: bytes, mark: Mark | None = None, packet_count: int = 0) -> bytes:
    """Return the part of a FLOW reply about the entry that a FLOW_MOD adds."""
    report = FlowMod.decode(message)
    match, instructions = entry_bytes(message, mark)
    length = flow_reports.STATISTICS.size + len(match) + len(instructions)
    fixed = (length, report.table, 5, 0, report.priority, 0, report.hard_timeout_s, report.flags, 0)
    counted = (report.cookie, packet_count, packet_count * 60)
    return flow_reports.STATISTICS.pack(*fixed, *counted) + match + instructions


def flow_removed(message: bytes, reason: int = ofp.OFPRR_DELETE) -> bytes:
    """Return the FLOW_REMOVED of the entry that a FLOW_MOD adds."""
    report = FlowMod.decode(message)
    fixed = (report.cookie, report.priority, reason, 0, 5, 0, 0, report.hard_timeout_s, 0, 0)
    return encode(
        ofp.OFPT_FLOW_REMOVED, 0, flow_reports.GONE.pack(*fixed) + matches.join(report.match)
    )


def port(number: int, config: int = 0, state: int = 0, properties: bytes = b"") -> ports.Port:
    """Return the description of a port; no interface has its name."""
    return ports.Port(number, ADDRESS, f"no-such-eth{number}", config, state, properties)


def port_status(described: ports.Port, reason: int = ofp.OFPPR_MODIFY) -> bytes:
    return encode(ofp.OFPT_PORT_STATUS, 0, bytes([reason]) + bytes(7) + described.encode())


def port_statistics(number: int, properties: bytes = b"") -> bytes:
    """Return the part of a PORT_STATS reply about a port that has counted 11 to 18."""
    length = ports.STATISTICS.size + len(properties)
    return ports.STATISTICS.pack(length, number, 60, 0, *range(11, 19)) + properties


def packet_in(in_port: int, frame: bytes) -> bytes:
    fixed = packets.PACKET_IN.pack(ofp.OFP_NO_BUFFER, len(frame), ofp.OFPR_APPLY_ACTION, 0, 0)
    match = matches.join(matches.of_port(in_port))
    return encode(ofp.OFPT_PACKET_IN, 0, fixed + match + bytes(2) + frame)


def light_instructions(mark: Mark, out_port: int | None) -> bytes:
    """Return the bridge's form of a light entry: APPLY_ACTIONS with a note and the output.

    An entry without actions has an instruction of the agent's own, which the mark says.
    """
    actions = replace(mark, added=out_port is None).encode()
    if out_port is not None:
        actions += struct.pack("!HHIH6x", ofp.OFPAT_OUTPUT, 16, out_port, ofp.OFPCML_MAX)
    head = struct.pack("!HH4x", ofp.OFPIT_APPLY_ACTIONS, 8 + len(actions))
    return head + actions


def unknown(*_entry: object) -> None:
    """Know no entry of a flow monitor's report."""
