"""Well-formed OpenFlow messages of every kind that the agent reads, and how to spoil them."""

import struct
from random import Random

import openflow_messages as of
from os_ken.ofproto import ofproto_v1_4 as ofp
from os_ken.ofproto import ofproto_v1_4_parser as parser

from qswitch_agent.openflow import flow_reports, messages
from qswitch_agent.openflow.instructions import Mark
from qswitch_agent.openflow.messages import HEADER, encode
from wire import optical

SIZES = (0, 1, 3, 4, 7, 8, 9, 15, 16, 0x7FFF, 0x8000, 0xFFFF)
PORTS = (0, 1, 2, 3, 4, 9, *range(ofp.OFPP_MAX, ofp.OFPP_ANY + 1, 0xF8), ofp.OFPP_ANY)
MARK = Mark(30, 4711)


def spoiled(message: bytes, random: Random, framed: float = 0.98) -> bytes:
    """Return the message with one to three faults; `framed`: how often its header is right."""
    data = bytearray(message)
    for _fault in range(random.choice((1, 1, 1, 2, 3))):
        random.choice((_flip, _flip, _resize, _cut, _extend, _number, _repeat))(data, random)
    data += bytes(max(0, HEADER.size - len(data)))
    del data[messages.MAX_LENGTH :]
    if random.random() < framed:
        data[0] = ofp.OFP_VERSION
        struct.pack_into("!H", data, 2, len(data))
    return bytes(data)


def _flip(data: bytearray, random: Random) -> None:
    for _byte in range(random.choice((1, 1, 2, 8))):
        if data:
            data[random.randrange(len(data))] ^= 1 << random.randrange(8)


def _resize(data: bytearray, random: Random) -> None:
    """Spoil what may be a length inside: nothing, huge, or off by a little."""
    if len(data) > HEADER.size + 2:
        at = random.randrange(HEADER.size, len(data) - 1) & ~1
        (size,) = struct.unpack_from("!H", data, at)
        near = ((size + step) & 0xFFFF for step in (-8, -1, 1, 8))
        struct.pack_into("!H", data, at, random.choice((*SIZES, *near)))


def _number(data: bytearray, random: Random) -> None:
    """Put a port's number somewhere."""
    if len(data) > HEADER.size + 4:
        at = random.randrange(HEADER.size, len(data) - 3) & ~3
        struct.pack_into("!I", data, at, random.choice(PORTS))


def _cut(data: bytearray, random: Random) -> None:
    del data[random.randrange(len(data) + 1) :]


def _extend(data: bytearray, random: Random) -> None:
    data += random.randbytes(random.choice((1, 2, 3, 4, 8, 16, 200)))


def _repeat(data: bytearray, random: Random) -> None:
    """Write a piece twice."""
    start = random.randrange(len(data) + 1)
    piece = data[start : start + random.choice((4, 8, 16, 24))]
    data[start:start] = piece


def requests() -> list[list[bytes]]:
    """Return what a controller may say; messages that belong together are one list."""
    output, group = parser.OFPActionOutput, parser.OFPActionGroup
    rewrite = parser.OFPActionSetField(eth_dst="02:00:00:00:00:01")
    modify, strict = {"command": ofp.OFPFC_MODIFY}, {"command": ofp.OFPFC_MODIFY_STRICT}
    delete = of.flow_mod({"in_port": 1}, command=ofp.OFPFC_DELETE)
    changes = [
        of.light(1, 2, priority=7, idle_timeout=30, cookie=5),
        of.light(2, 1, hard_timeout=9, flags=ofp.OFPFF_SEND_FLOW_REM),
        of.light(3, 4, **modify),
        of.light(1, 3, priority=7, **strict),
        of.flow_mod({"in_port": 3}, of.actions(output(1), kind=ofp.OFPIT_WRITE_ACTIONS)),
        of.flow_mod({"in_port": 4}),
        of.flow_mod({"in_port": 1, "eth_type": 0x88CC}, of.outputs(ofp.OFPP_CONTROLLER)),
        of.flow_mod(
            {"in_port": 9, "eth_dst": ("02:00:00:00:00:00", "ff:00:00:00:00:00")},
            of.actions(rewrite, output(ofp.OFPP_LOCAL), group(1)),
            parser.OFPInstructionGotoTable(1),
        ),
        of.flow_mod({"in_port": (1, 0)}, of.outputs(ofp.OFPP_LOCAL), **modify),
        of.flow_mod({}, of.outputs(ofp.OFPP_CONTROLLER), priority=0),
        of.flow_mod({}, of.outputs(ofp.OFPP_LOCAL), **modify),
        of.flow_mod({"ip_proto": 6, "eth_type": 0x800, "tcp_dst": 7}, of.outputs(ofp.OFPP_FLOOD)),
        delete,
        of.flow_mod({}, command=ofp.OFPFC_DELETE, cookie=5, cookie_mask=5, out_port=2),
        of.flow_mod({"in_port": 1}, command=ofp.OFPFC_DELETE_STRICT, priority=7),
    ]
    tune = of.port_mod(1, of.tuning(193_400_000, -50))
    others = [
        tune,
        of.port_mod(2, of.tuning(191_350_000), config=1, mask=1),
        of.port_mod(9, config=1, mask=1),
        of.group_mod(9, ofp.OFPP_LOCAL),
        of.packet_out(of.LLDP, 1),
        of.packet_out(of.PING, 9, ofp.OFPP_LOCAL),
        encode(ofp.OFPT_EXPERIMENTER, 1, struct.pack("!II", 0x2320, 13) + bytes(24)),
        encode(ofp.OFPT_ECHO_REQUEST, 1, b"are you there?"),
        encode(ofp.OFPT_ROLE_REQUEST, 1, messages.ROLE.pack(ofp.OFPCR_ROLE_MASTER, 1)),
        encode(ofp.OFPT_ROLE_REQUEST, 1, messages.ROLE.pack(ofp.OFPCR_ROLE_SLAVE, 2)),
        messages.hello(),
        of.barrier_request(8),
        of.flow_request(9),
        of.flow_request(10, aggregate=True),
        messages.request(ofp.OFPMP_PORT_DESC, 11),
        flow_reports.flow_monitor_request(12),
        messages.request(
            ofp.OFPMP_EXPERIMENTER,
            13,
            messages.EXPERIMENT.pack(optical.EXPERIMENTER, optical.PATH_OPTICS),
        ),
    ]
    bundles = [
        of.bundle(1, of.light(3, 4), of.light(4, 3)),
        of.bundle(2, delete, of.light(3, 2, **modify), of.light(1, 2), tune, of.group_mod(9)),
        of.bundle(3, tune, of.flow_mod({}, of.outputs(ofp.OFPP_LOCAL), **modify)),
    ]
    bundles[2][-1] = of.bundle_control(3, ofp.OFPBCT_DISCARD_REQUEST, 50)
    return [[one] for one in changes + others] + bundles


def replies() -> list[bytes]:
    """Return what a bridge may say."""
    path = of.light(1, 2, cookie=5, priority=7)
    classical = of.flow_mod({"in_port": 9}, of.outputs(ofp.OFPP_LOCAL))
    updates = [
        of.flow_update(event, path, MARK) for event in (flow_reports.ADDED, ofp.OFPFME_MODIFIED)
    ]
    updates += [of.flow_update(flow_reports.REMOVED, classical), bytes.fromhex("0008000500000000")]
    entries = [of.flow_entry(path, MARK), of.flow_entry(classical, packet_count=4)]
    described = [of.port(number).encode() for number in (1, 2, 9)]
    counted = [of.port_statistics(1), of.port_statistics(9)]
    return [
        messages.reply(ofp.OFPMP_PORT_DESC, 11, described),
        messages.reply(ofp.OFPMP_PORT_STATS, 12, counted),
        messages.reply(ofp.OFPMP_FLOW, 9, entries),
        messages.reply(ofp.OFPMP_FLOW, 10, entries),
        messages.reply(ofp.OFPMP_AGGREGATE, 14, [bytes(24)]),
        of.monitor_reply(*updates),
        of.port_status(of.port(1)),
        of.port_status(of.port(2, state=ofp.OFPPS_LINK_DOWN), ofp.OFPPR_DELETE),
        of.flow_removed(path, ofp.OFPRR_HARD_TIMEOUT),
        of.flow_removed(classical),
        of.packet_in(1, of.LLDP),
        of.packet_in(9, of.PING),
        encode(ofp.OFPT_ROLE_REPLY, 1, messages.ROLE.pack(ofp.OFPCR_ROLE_SLAVE, 1)),
        of.bundle_control(1, ofp.OFPBCT_COMMIT_REPLY, 50),
        messages.error(ofp.OFPET_BUNDLE_FAILED, ofp.OFPBFC_BAD_ID, path),
        of.barrier_reply(8),
        encode(ofp.OFPT_ECHO_REPLY, 1, b"I am"),
        messages.hello(),
    ]
