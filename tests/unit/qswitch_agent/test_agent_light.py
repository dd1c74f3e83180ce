"""Refusals of what light cannot do, each by itself, with the error's type and code."""

from typing import Any

import openflow_messages as of
import pytest
from openflow_messages import CLASSICAL, FIBERS
from os_ken.ofproto import ofproto_v1_4 as ofp
from os_ken.ofproto import ofproto_v1_4_parser as parser

from qswitch_agent.middleware.flow_table import FlowTable
from qswitch_agent.openflow import matches
from qswitch_agent.openflow.flows import FlowMod
from qswitch_agent.openflow.refusals import Refusal
from qswitch_agent.proxy.checks import is_light, require_no_fiber

TABLE = FlowTable(FIBERS)
LOCAL, CONTROLLER = ofp.OFPP_LOCAL, ofp.OFPP_CONTROLLER
BAD_PORT = (ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_OUT_PORT)
BAD_TYPE = (ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_TYPE)
BAD_FIELD = (ofp.OFPET_BAD_MATCH, ofp.OFPBMC_BAD_FIELD)
UNSUPPORTED = (ofp.OFPET_BAD_INSTRUCTION, ofp.OFPBIC_UNSUP_INST)
FROM_1: dict[str, Any] = {"in_port": 1}
LLDP_1: dict[str, Any] = {"in_port": 1, "eth_type": 0x88CC}
REWRITE = parser.OFPActionSetField(eth_dst="02:00:00:00:00:01")
NOTE = parser.OFPActionExperimenterUnknown(0x2320, bytes.fromhex("0008000000000000"))

REFUSED: dict[str, tuple[FlowMod, tuple[int, int]]] = {
    "to two ports": (
        of.mod(FROM_1, of.outputs(2, 3)),
        (ofp.OFPET_BAD_ACTION, ofp.OFPBAC_TOO_MANY),
    ),
    "to one port twice": (
        of.mod(FROM_1, of.outputs(2, 2)),
        (ofp.OFPET_BAD_ACTION, ofp.OFPBAC_TOO_MANY),
    ),
    "to two ports by two instructions": (
        of.mod(
            FROM_1,
            of.outputs(2),
            of.actions(parser.OFPActionOutput(3), kind=ofp.OFPIT_WRITE_ACTIONS),
        ),
        (ofp.OFPET_BAD_ACTION, ofp.OFPBAC_TOO_MANY),
    ),
    "back": (of.mod(FROM_1, of.outputs(1)), BAD_PORT),
    "back by name": (of.mod(FROM_1, of.outputs(ofp.OFPP_IN_PORT)), BAD_PORT),
    "flood": (of.mod(FROM_1, of.outputs(ofp.OFPP_FLOOD)), BAD_PORT),
    "all": (of.mod(FROM_1, of.outputs(ofp.OFPP_ALL)), BAD_PORT),
    "normal": (of.mod(FROM_1, of.outputs(ofp.OFPP_NORMAL)), BAD_PORT),
    "to the controller": (of.mod(FROM_1, of.outputs(CONTROLLER)), BAD_PORT),
    "to a classical port": (of.mod(FROM_1, of.outputs(CLASSICAL)), BAD_PORT),
    "from a classical port": (of.mod({"in_port": CLASSICAL}, of.outputs(2)), BAD_PORT),
    "from any port": (of.mod({}, of.outputs(2)), BAD_PORT),
    "from any port of a kind": (of.mod({"eth_type": 0x800}, of.outputs(2)), BAD_PORT),
    "by modification": (
        of.mod({"in_port": CLASSICAL}, of.outputs(2), command=ofp.OFPFC_MODIFY),
        BAD_PORT,
    ),
    "rewritten": (of.mod(FROM_1, of.actions(REWRITE, parser.OFPActionOutput(2))), BAD_TYPE),
    "noted": (of.mod(FROM_1, of.actions(NOTE, parser.OFPActionOutput(2))), BAD_TYPE),
    "to a group": (
        of.mod(FROM_1, of.actions(parser.OFPActionGroup(1))),
        (ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_OUT_GROUP),
    ),
    "metered": (of.mod(FROM_1, parser.OFPInstructionMeter(1), of.outputs(2)), UNSUPPORTED),
    "to another table": (of.mod(FROM_1, parser.OFPInstructionGotoTable(1)), UNSUPPORTED),
    "with metadata": (of.mod(FROM_1, parser.OFPInstructionWriteMetadata(1, 1)), UNSUPPORTED),
    "cleared": (of.mod(FROM_1, of.actions(kind=ofp.OFPIT_CLEAR_ACTIONS)), UNSUPPORTED),
    "by headers": (of.mod({"in_port": 1, "eth_type": 0x800}, of.outputs(2)), BAD_FIELD),
    "in another table": (
        of.mod(FROM_1, of.outputs(2), table_id=1),
        (ofp.OFPET_FLOW_MOD_FAILED, ofp.OFPFMFC_BAD_TABLE_ID),
    ),
    "in all tables": (
        of.mod(FROM_1, of.outputs(2), table_id=0xFF, command=ofp.OFPFC_MODIFY),
        (ofp.OFPET_FLOW_MOD_FAILED, ofp.OFPFMFC_BAD_TABLE_ID),
    ),
    "by no command": (
        of.mod(FROM_1, of.outputs(2), command=5),
        (ofp.OFPET_FLOW_MOD_FAILED, ofp.OFPFMFC_BAD_COMMAND),
    ),
    "LLDP into a fibre": (of.mod(LLDP_1, of.outputs(2)), BAD_PORT),
    "LLDP to a classical port": (of.mod(LLDP_1, of.outputs(CONTROLLER, CLASSICAL)), BAD_PORT),
    "LLDP rewritten": (
        of.mod(LLDP_1, of.actions(REWRITE, parser.OFPActionOutput(CONTROLLER))),
        BAD_PORT,
    ),
    "LLDP to another table": (of.mod(LLDP_1, parser.OFPInstructionGotoTable(1)), UNSUPPORTED),
}
LIGHT = {
    "path": of.mod(FROM_1, of.outputs(2)),
    "path by write": of.mod(
        FROM_1, of.actions(parser.OFPActionOutput(2), kind=ofp.OFPIT_WRITE_ACTIONS)
    ),
    "path by modification": of.mod(FROM_1, of.outputs(2), command=ofp.OFPFC_MODIFY),
    "drop": of.mod(FROM_1),
    "drop by no action": of.mod(FROM_1, of.actions()),
}
NO_LIGHT = {
    "LLDP to the controller": of.mod(LLDP_1, of.outputs(CONTROLLER)),
    "LLDP of all ports": of.mod({"eth_type": 0x88CC}, of.outputs(CONTROLLER)),
    "LLDP dropped": of.mod(LLDP_1),
    "table-miss entry": of.mod({}, of.outputs(CONTROLLER), priority=0),
    "classical entry": of.mod(
        {"in_port": CLASSICAL}, of.actions(REWRITE, parser.OFPActionOutput(LOCAL))
    ),
    "classical flood": of.mod({"in_port": CLASSICAL}, of.outputs(ofp.OFPP_FLOOD)),
    "classical entry of another table": of.mod({}, of.outputs(LOCAL), table_id=3),
    "deletion": of.mod(FROM_1, of.outputs(2, 3), command=ofp.OFPFC_DELETE),
    "strict deletion": of.mod(FROM_1, command=ofp.OFPFC_DELETE_STRICT),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_light_cannot_do_is_refused(case: str) -> None:
    mod, error = REFUSED[case]
    with pytest.raises(Refusal) as refusal:
        is_light(mod, TABLE)
    assert (refusal.value.kind, refusal.value.code) == error
    assert str(refusal.value)


def test_port_matched_by_some_bits_is_refused() -> None:
    message = of.light(1, 2)
    match = matches.join(bytes.fromhex("80000108 00000001 fffffffe"))
    mod = FlowMod.decode(message[:48] + match + message[64:])
    with pytest.raises(Refusal) as refusal:
        is_light(mod, TABLE)
    assert (refusal.value.kind, refusal.value.code) == (ofp.OFPET_BAD_MATCH, ofp.OFPBMC_BAD_MASK)


def test_port_with_a_mask_of_zero_is_any_port() -> None:
    message = of.light(1, 2)
    match = matches.join(bytes.fromhex("80000108 00000001 00000000"))
    mod = FlowMod.decode(message[:48] + match + message[64:])
    with pytest.raises(Refusal, match="packets cannot go into the fibre at port 2"):
        is_light(mod, TABLE)


@pytest.mark.parametrize("case", LIGHT)
def test_what_light_can_do_is_light(case: str) -> None:
    assert is_light(LIGHT[case], TABLE)


@pytest.mark.parametrize("case", NO_LIGHT)
def test_what_is_no_light_passes(case: str) -> None:
    assert not is_light(NO_LIGHT[case], TABLE)


def test_inner_ports_take_light_and_no_packets() -> None:
    table = FlowTable(FIBERS, [60_001, 60_002, 61_001, 62_001])
    paths = (1, 60_001), (1, 61_001), (61_001, 60_001), (61_001, 1), (62_001, 1), (62_001, 61_001)
    for in_port, output in paths:
        assert is_light(of.mod({"in_port": in_port}, of.outputs(output)), table)
    outcomes = of.actions(REWRITE, parser.OFPActionOutput(CLASSICAL))
    for fields in ({"in_port": 60_001}, {"in_port": 61_001, "eth_type": 0x88B5}):
        assert not is_light(of.mod(fields, outcomes), table)
        with pytest.raises(Refusal, match="packets cannot go into the inner port 60002"):
            is_light(of.mod(fields, of.outputs(60_002)), table)
    for in_port in (1, CLASSICAL):
        with pytest.raises(Refusal, match=r"62001|0xf231"):
            is_light(of.mod({"in_port": in_port}, of.outputs(62_001)), table)
    for fields in ({"in_port": 61_001, "eth_type": 0x88CC}, {"in_port": 61_001, "eth_type": 0x800}):
        with pytest.raises(Refusal, match="light of port 61001 carries no headers"):
            is_light(of.mod(fields, of.outputs(CLASSICAL)), table)


def test_packets_go_into_no_fibre() -> None:
    require_no_fiber([CLASSICAL, LOCAL, ofp.OFPP_FLOOD], FIBERS)
    with pytest.raises(Refusal, match="port 4"):
        require_no_fiber([CLASSICAL, 4], FIBERS)
