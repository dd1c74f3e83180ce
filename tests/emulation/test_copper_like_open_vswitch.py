"""On copper ports a quantum switch answers as plain Open vSwitch does: the same requests to both.

Open vSwitch is the independent program. Ryu's own switch tests are in test_ryus_switch_tests.py.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from agent_scene import (
    BRIDGE,
    DATAPATH,
    Controller,
    actions,
    ask,
    entries,
    flow_mod,
    needs_open_vswitch,
    running_switch,
)
from copper_scene import PLAIN, copper, plain_open_vswitch
from os_ken.ofproto import ofproto_v1_4 as ofp
from os_ken.ofproto import ofproto_v1_4_parser as parser

pytestmark = needs_open_vswitch
IN, OUT = 7, 8  # copper ports of both
IP4, IP6, ARP, MPLS, PBB = (
    {"eth_type": number} for number in (0x0800, 0x86DD, 0x0806, 0x8847, 0x88E7)
)
FIELDS: dict[str, tuple[Any, dict[str, Any]]] = {  # a value, and what must be matched beside it
    "in_phy_port": (1, {}),
    "metadata": (7, {}),
    "eth_dst": ("02:00:00:00:00:01", {}),
    "eth_src": (("02:00:00:00:00:00", "ff:00:00:00:00:00"), {}),
    "eth_type": (0x0800, {}),
    "vlan_vid": (0x1005, {}),
    "vlan_pcp": (3, {"vlan_vid": 0x1005}),
    "ip_dscp": (10, IP4),
    "ip_ecn": (1, IP4),
    "ip_proto": (6, IP4),
    "ipv4_src": (("10.0.0.0", "255.0.0.0"), IP4),
    "ipv4_dst": ("10.0.0.1", IP4),
    "tcp_src": (1, IP4 | {"ip_proto": 6}),
    "tcp_dst": (2, IP4 | {"ip_proto": 6}),
    "udp_src": (1, IP4 | {"ip_proto": 17}),
    "udp_dst": (2, IP6 | {"ip_proto": 17}),
    "sctp_src": (1, IP4 | {"ip_proto": 132}),
    "sctp_dst": (2, IP4 | {"ip_proto": 132}),
    "icmpv4_type": (8, IP4 | {"ip_proto": 1}),
    "icmpv4_code": (0, IP4 | {"ip_proto": 1}),
    "arp_op": (1, ARP),
    "arp_spa": ("10.0.0.1", ARP),
    "arp_tpa": ("10.0.0.2", ARP),
    "arp_sha": ("02:00:00:00:00:01", ARP),
    "arp_tha": ("02:00:00:00:00:02", ARP),
    "ipv6_src": ("fe80::1", IP6),
    "ipv6_dst": (("fe80::", "ffff::"), IP6),
    "ipv6_flabel": (5, IP6),
    "icmpv6_type": (135, IP6 | {"ip_proto": 58}),
    "icmpv6_code": (0, IP6 | {"ip_proto": 58}),
    "ipv6_nd_target": ("fe80::1", IP6 | {"ip_proto": 58, "icmpv6_type": 135}),
    "ipv6_nd_sll": ("02:00:00:00:00:01", IP6 | {"ip_proto": 58, "icmpv6_type": 135}),
    "ipv6_nd_tll": ("02:00:00:00:00:01", IP6 | {"ip_proto": 58, "icmpv6_type": 136}),
    "mpls_label": (9, MPLS),
    "mpls_tc": (1, MPLS),
    "mpls_bos": (1, MPLS),
    "pbb_isid": (1, PBB),
    "tunnel_id": (1, {}),
    "ipv6_exthdr": (1, IP6),
    "pbb_uca": (1, PBB),
}
OUTPUT = parser.OFPActionOutput(OUT)
ACTIONS: dict[str, list[Any]] = {
    "output": [OUTPUT],
    "output to where it came from": [parser.OFPActionOutput(IN)],
    "output to a port that is not there": [parser.OFPActionOutput(99)],
    "two outputs": [OUTPUT, parser.OFPActionOutput(ofp.OFPP_LOCAL)],
    **{
        f"output to {name}": [parser.OFPActionOutput(getattr(ofp, f"OFPP_{name}"))]
        for name in ("IN_PORT", "TABLE", "NORMAL", "FLOOD", "ALL", "CONTROLLER", "LOCAL", "ANY")
    },
    "group": [parser.OFPActionGroup(3)],
    "queue": [parser.OFPActionSetQueue(1), OUTPUT],
    "push vlan": [parser.OFPActionPushVlan(0x8100), OUTPUT],
    "push vlan of a wrong type": [parser.OFPActionPushVlan(0x1234), OUTPUT],
    "pop vlan": [parser.OFPActionPopVlan(), OUTPUT],
    "push mpls": [parser.OFPActionPushMpls(0x8847), OUTPUT],
    "pop mpls": [parser.OFPActionPopMpls(0x0800), OUTPUT],
    "push pbb": [parser.OFPActionPushPbb(0x88E7), OUTPUT],
    "pop pbb": [parser.OFPActionPopPbb(), OUTPUT],
    "ttl of ip": [parser.OFPActionDecNwTtl(), OUTPUT],
    "set ttl of ip": [parser.OFPActionSetNwTtl(9), OUTPUT],
    "ttl of mpls": [parser.OFPActionDecMplsTtl(), OUTPUT],
    "ttl out": [parser.OFPActionCopyTtlOut(), OUTPUT],
    "ttl in": [parser.OFPActionCopyTtlIn(), OUTPUT],
    "nothing": [],
}
APPLY = actions(OUTPUT)
GOTO, METER = parser.OFPInstructionGotoTable, parser.OFPInstructionMeter
INSTRUCTIONS: dict[str, list[Any]] = {
    "goto": [GOTO(5)],
    "goto itself": [GOTO(0)],
    "goto the last": [GOTO(254)],
    "goto behind the last": [GOTO(255)],
    "metadata": [parser.OFPInstructionWriteMetadata(1, 3), GOTO(1)],
    "meter": [METER(1), APPLY],
    "write": [parser.OFPInstructionActions(ofp.OFPIT_WRITE_ACTIONS, [OUTPUT])],
    "clear": [parser.OFPInstructionActions(ofp.OFPIT_CLEAR_ACTIONS, [])],
    "twice": [APPLY, APPLY],
    "none": [],
}
MORE: dict[str, dict[str, Any]] = {
    "another table": {"table_id": 3},
    "every table": {"table_id": ofp.OFPTT_ALL},
    "an unknown command": {"command": 9},
    "an unknown buffer": {"buffer_id": 77},
    "flags": {"flags": ofp.OFPFF_SEND_FLOW_REM | ofp.OFPFF_NO_PKT_COUNTS},
    "unknown flags": {"flags": 0x8000},
    "time-outs": {"idle_timeout": 600, "hard_timeout": 900},
    "modify": {"command": ofp.OFPFC_MODIFY},
    "modify strictly": {"command": ofp.OFPFC_MODIFY_STRICT},
    "delete": {"command": ofp.OFPFC_DELETE},
    "delete strictly": {"command": ofp.OFPFC_DELETE_STRICT},
    "overlap": {"flags": ofp.OFPFF_CHECK_OVERLAP},
}


def requests() -> Iterator[tuple[str, Any]]:
    """Yield requests that concern copper alone, by what is of interest in them."""
    for name, (value, beside) in FIELDS.items():
        yield f"match {name}", mod({**beside, name: value}, APPLY)
        if beside:
            yield f"match {name} alone", mod({name: value}, APPLY)
        if not isinstance(value, tuple):
            setting = actions(parser.OFPActionSetField(**{name: value}), OUTPUT)
            yield f"set {name}", mod({**beside}, setting)
            yield f"set {name} of any packet", mod({}, setting)
    for name, listed in ACTIONS.items():
        for kind, beside in (("any", {}), ("IPv4", IP4), ("MPLS", MPLS)):
            yield f"{name}, {kind}", mod({**beside}, actions(*listed))
    for name, instructions in INSTRUCTIONS.items():
        yield f"instruction {name}", mod({}, *instructions)
    for name, more in MORE.items():
        yield name, mod({}, APPLY, **more)
        yield f"{name}, IPv4", mod({**IP4}, APPLY, **more)


def mod(fields: dict[str, Any], *instructions: Any, **more: Any) -> Any:
    return flow_mod(IN, *instructions, fields=fields, cookie=5, priority=9, **more)


def answered(controller: Controller, request: Any) -> object:
    """Return what a request comes to: the error, or the entries that there are then."""
    for clearing in (
        parser.OFPFlowMod(
            DATAPATH,
            table_id=ofp.OFPTT_ALL,
            command=ofp.OFPFC_DELETE,
            out_port=ofp.OFPP_ANY,
            out_group=ofp.OFPG_ANY,
        ),
        mod({**IP4}, APPLY),  # something to modify, delete, and overlap with
    ):
        assert isinstance(ask(controller, clearing, 100), parser.OFPBarrierReply)
    answer = ask(controller, request, 200)
    if isinstance(answer, parser.OFPErrorMsg):
        return answer.type, answer.code
    return sorted(described(entry) for entry in entries(controller, 300))


def described(entry: Any) -> str:
    """Return an entry but for how old it is."""
    kept = (entry.priority, entry.cookie, entry.flags, entry.idle_timeout, entry.hard_timeout)
    return f"{kept} {entry.match} {entry.instructions}"


def test_copper_is_answered_as_open_vswitch_does(tmp_path: Path) -> None:
    with (
        running_switch(tmp_path) as switch,
        plain_open_vswitch() as plain,
        copper((IN, OUT), BRIDGE, PLAIN),
    ):
        differing, seen = {}, []
        for (name, request), (_name, same) in zip(requests(), requests(), strict=True):
            ours, theirs = answered(switch.controller, request), answered(plain, same)
            seen.append(theirs)
            if ours != theirs:
                differing[name] = ours, theirs
        assert differing == {}
    assert len(seen) > 200
    errors = [each for each in seen if isinstance(each, tuple)]
    assert len(seen) / 4 < len(errors) < 3 * len(seen) / 4  # both kinds of answers are there
