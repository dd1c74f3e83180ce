"""Light is refused what it cannot do, with the fitting OpenFlow error, alone and in a bundle."""

from typing import Any

from agent_scene import (
    DATAPATH,
    Switch,
    accepted,
    actions,
    bundle,
    flow_mod,
    flows,
    light,
    needs_open_vswitch,
    outputs,
    refused,
)
from os_ken.ofproto import ofproto_v1_4 as ofp
from os_ken.ofproto import ofproto_v1_4_parser as parser

pytestmark = needs_open_vswitch
NOTHING = "OFPST_FLOW reply (OF1.4) (xid=0x2):\n", "OFPST_GROUP_DESC reply (OF1.4) (xid=0x2):\n"


def group(*ports: int) -> Any:
    buckets = [parser.OFPBucket(actions=[parser.OFPActionOutput(port)]) for port in ports]
    return parser.OFPGroupMod(DATAPATH, ofp.OFPGC_ADD, ofp.OFPGT_ALL, 1, buckets)


BAD_PORT = ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_OUT_PORT
WHAT_LIGHT_CANNOT_DO = {
    "two outputs": (
        flow_mod(1, outputs(2, 3)),
        (ofp.OFPET_BAD_ACTION, ofp.OFPBAC_TOO_MANY),
    ),
    "flood": (light(1, ofp.OFPP_FLOOD), BAD_PORT),
    "all": (light(1, ofp.OFPP_ALL), BAD_PORT),
    "back": (light(1, ofp.OFPP_IN_PORT), BAD_PORT),
    "to its own input": (light(1, 1), BAD_PORT),
    "to the controller": (light(1, ofp.OFPP_CONTROLLER), BAD_PORT),
    "to a classical port": (light(1, ofp.OFPP_LOCAL), BAD_PORT),
    "to a port that is not there": (light(1, 9), BAD_PORT),
    "from a classical port": (light(ofp.OFPP_LOCAL, 2), BAD_PORT),
    "from anywhere": (flow_mod(None, outputs(2)), BAD_PORT),
    "header rewriting": (
        flow_mod(
            1,
            actions(
                parser.OFPActionSetField(eth_dst="02:00:00:00:00:01"), parser.OFPActionOutput(2)
            ),
        ),
        (ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_TYPE),
    ),
    "to a group": (
        flow_mod(1, actions(parser.OFPActionGroup(1))),
        (ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_OUT_GROUP),
    ),
    "a group": (group(ofp.OFPP_LOCAL), (ofp.OFPET_GROUP_MOD_FAILED, ofp.OFPGMFC_OUT_OF_GROUPS)),
    "a meter": (
        flow_mod(1, parser.OFPInstructionMeter(1), outputs(2)),
        (ofp.OFPET_BAD_INSTRUCTION, ofp.OFPBIC_UNSUP_INST),
    ),
    "goto": (
        flow_mod(1, parser.OFPInstructionGotoTable(1)),
        (ofp.OFPET_BAD_INSTRUCTION, ofp.OFPBIC_UNSUP_INST),
    ),
    "headers in the match": (
        light(1, 2, fields={"eth_type": 0x0800}),
        (ofp.OFPET_BAD_MATCH, ofp.OFPBMC_BAD_FIELD),
    ),
    "another table": (
        light(1, 2, table_id=3),
        (ofp.OFPET_FLOW_MOD_FAILED, ofp.OFPFMFC_BAD_TABLE_ID),
    ),
    "LLDP into a fibre": (light(1, 2, fields={"eth_type": 0x88CC}), BAD_PORT),
}


def test_what_light_cannot_do_is_refused(switch: Switch) -> None:
    for name, (message, error) in WHAT_LIGHT_CANNOT_DO.items():
        message.xid = None
        assert refused(switch.controller, message) == error, name
    assert (flows("dump-flows"), flows("dump-groups")) == NOTHING
    assert switch.dispatcher.sets == [[]]


def test_what_light_cannot_do_is_not_in_a_bundle(switch: Switch) -> None:
    for name, (message, error) in WHAT_LIGHT_CANNOT_DO.items():
        message.xid = None
        bundle(switch.controller, 50, light(3, 4), message, light(4, 3))
        wrong = switch.controller.answer(52)
        assert (wrong.type, wrong.code) == error, name
        assert switch.controller.answer(50).type == ofp.OFPBCT_COMMIT_REPLY, name
        accepted(switch.controller, flow_mod(None, command=ofp.OFPFC_DELETE), 90)
        assert switch.dispatcher.sets[-2:] == [[(3, 4), (4, 3)], []], name
    assert (flows("dump-flows"), flows("dump-groups")) == NOTHING
