"""A switch behind its agent's proxy: its light, and messages on either side."""

import openflow_messages as of
from os_ken.ofproto import ofproto_v1_4 as ofp
from proxy_scene import End, Stage

from qswitch_agent.openflow import matches, messages
from qswitch_agent.openflow.flow_reports import ADDED, FlowUpdate
from qswitch_agent.openflow.flows import FlowEntry, FlowMod
from qswitch_agent.openflow.instructions import Mark
from qswitch_agent.openflow.messages import encode
from qswitch_agent.proxy.link import PRIVATE_XID

ECHO = encode(ofp.OFPT_ECHO_REQUEST, 3, b"are you there?")
FLOOD = of.flow_mod({"in_port": 9}, of.outputs(ofp.OFPP_FLOOD), xid=4)
OWN_BARRIER = encode(ofp.OFPT_BARRIER_REQUEST, PRIVATE_XID)
NICIRA = bytes.fromhex("00002320 000000")
OWN_REPLY = encode(ofp.OFPT_BARRIER_REPLY, PRIVATE_XID)


def error(kind: int, code: int, request: bytes) -> bytes:
    return messages.error(kind, code, request)


def path(in_port: int, out_port: int, mark: Mark | None = None, event: int = ADDED) -> FlowUpdate:
    entry = FlowEntry(0x8000, matches.of_port(in_port), in_port, False, out_port, 0, mark)
    return FlowUpdate(event, entry)


async def heard_light(end: End) -> FlowMod:
    """Return the FLOW_MOD of a light entry that comes next, and check that it is marked."""
    mod = FlowMod.decode(await end.next())
    assert mod.instructions.mark
    return mod


async def pass_light(now: Stage, in_port: int, out_port: int, xid: int = 1) -> None:
    """Let a path be added and confirmed by the controller's barrier."""
    now.controller.says(of.light(in_port, out_port, xid), of.barrier_request(xid + 1))
    mod = await heard_light(now.bridge)
    await now.bridge.hears(of.barrier_request(xid + 1))
    now.reports.waiting.append(path(in_port, out_port, mod.instructions.mark))
    now.bridge.says(of.barrier_reply(xid + 1))
    await now.controller.hears(of.barrier_reply(xid + 1))


def undone(request: bytes) -> bytes:
    return error(ofp.OFPET_FLOW_MOD_FAILED, ofp.OFPFMFC_UNKNOWN, request)
