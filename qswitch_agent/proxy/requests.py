"""Controllers' requests: passed on to the bridge, changed, answered, or refused.

Light is judged here, before the bridge hears of it: a FLOW_MOD as it comes, the members of
a bundle together at COMMIT. What a controller is refused changes nothing.
"""

import logging
from collections.abc import Awaitable, Callable

from qswitch_agent.hardware.optics import HardwareRefusal
from qswitch_agent.openflow import async_config, identity, messages, multipart, packets, refusals
from qswitch_agent.openflow import constants as ofp
from qswitch_agent.openflow.flows import FlowMod
from qswitch_agent.openflow.instructions import NICIRA
from qswitch_agent.openflow.messages import HEADER, transaction_id
from qswitch_agent.openflow.packets import PacketOut
from qswitch_agent.openflow.refusals import Refusal
from qswitch_agent.proxy.bundle_requests import BundleRequests
from qswitch_agent.proxy.bundles import Tunings
from qswitch_agent.proxy.checks import (
    checked_port_mod,
    concerns_light,
    marked,
    may_modify_light,
    require_meters,
    require_no_light,
    require_not_slave,
)
from qswitch_agent.proxy.link import Link
from qswitch_agent.switch import Switch
from wire.malformed import MalformedPacket
from wire.optical import encode_path_optics

# Of Nicira: they would pass by unseen.
UNJUDGED = {13: "NXT_FLOW_MOD", 28: "NXT_RESUME", 31: "NXT_GROUP_MOD"}
log = logging.getLogger(__name__)


class Requests:
    """One controller's requests, in their order."""

    def __init__(self, switch: Switch, link: Link) -> None:
        self._switch = switch
        self._link = link
        self._bundles = BundleRequests(switch, link, self._refuse)
        self._handlers: dict[int, Callable[[bytes], Awaitable[None]]] = {
            ofp.OFPT_FLOW_MOD: self._flow_mod,
            ofp.OFPT_PORT_MOD: self._port_mod,
            ofp.OFPT_GROUP_MOD: self._group_mod,
            ofp.OFPT_METER_MOD: self._meter_mod,
            ofp.OFPT_PACKET_OUT: self._packet_out,
            ofp.OFPT_BUNDLE_CONTROL: self._bundles.control,
            ofp.OFPT_BUNDLE_ADD_MESSAGE: self._bundles.add,
            ofp.OFPT_MULTIPART_REQUEST: self._multipart,
            ofp.OFPT_BARRIER_REQUEST: self._barrier,
            ofp.OFPT_ROLE_REQUEST: self._role,
            ofp.OFPT_SET_ASYNC: self._set_async,
            ofp.OFPT_EXPERIMENTER: self._experimenter,
        }

    async def take(self, message: bytes) -> None:
        """Handle one message of the controller."""
        handler = self._handlers.get(messages.message_type(message), self._pass)
        try:
            await handler(messages.require_version(message))
        except Refusal as refusal:
            await self._refuse(message, refusal)
        except MalformedPacket as error:
            await self._refuse(message, refusals.of_malformed(error))

    async def _pass(self, message: bytes) -> None:
        self._link.to_bridge(message)

    async def _refuse(self, message: bytes, refusal: Refusal) -> None:
        """Answer a request with an error; a slave's requests are refused as such."""
        log.info("refused: %s", refusal)
        kind, code = refusal.kind, refusal.code
        if self._link.is_slave and message[1] != ofp.OFPT_MULTIPART_REQUEST:
            kind, code = ofp.OFPET_BAD_REQUEST, ofp.OFPBRC_IS_SLAVE
        await self._link.answer(messages.error(kind, code, message))

    async def _flow_mod(self, message: bytes) -> None:
        mod, xid = FlowMod.decode(message), transaction_id(message)
        light = concerns_light(mod, self._switch)
        if mod.deletes:
            self._link.delete(mod, message)
            return
        if light and mod.command == ofp.OFPFC_ADD:
            mod = marked(mod, self._switch, self._link)
        elif not light and not may_modify_light(mod):
            self._link.change(message)
            return
        async with self._switch.trial(self._link) as trial:
            mods = trial.change(mod)
            self._switch.require_possible(trial, mods)
            for one in mods:
                self._switch.promise(one, self._link, message)
            self._link.change(
                *(one.encode(xid) for one in mods), told=self._switch.seen_when_done(mods)
            )

    async def _port_mod(self, message: bytes) -> None:
        mod, tunings = checked_port_mod(message, self._switch)
        if not tunings:
            self._link.to_bridge(message)
        elif not await self._link.accepted(mod.encode(transaction_id(message))):
            return  # the bridge has said why
        await self._tune(tunings)

    async def _tune(self, tunings: Tunings) -> None:
        for port, tuned in tunings:
            try:
                await self._switch.hardware.tune(port, *tuned)
            except HardwareRefusal as refusal:
                raise refusals.bad_config(str(refusal)) from refusal

    async def _meter_mod(self, message: bytes) -> None:
        require_meters(message, self._switch)
        self._link.to_bridge(message)

    async def _group_mod(self, message: bytes) -> None:
        require_no_light(message, self._switch)
        self._link.to_bridge(message)

    async def _packet_out(self, message: bytes) -> None:
        packet = PacketOut.decode(message)
        fibers = self._switch.fibers.intersection(packet.outputs)
        if not fibers:
            self._link.to_bridge(message)
            return
        if len(packet.actions) > 1 or not packets.is_lldp(packet.frame):
            raise refusals.bad_out_port(
                f"into the fibre at port {min(fibers)} goes LLDP alone, by one output action",
            )
        require_not_slave(self._link, "PACKET_OUT")
        self._switch.send_lldp(packet.outputs[0], packet.frame)

    async def _multipart(self, message: bytes) -> None:
        kind, xid = multipart.multipart_type(message), transaction_id(message)
        if multipart.asks_for_path_optics(message):
            body = encode_path_optics(self._switch.path_optics())
            await self._link.answer(multipart.path_optics_reply(xid, body))
        elif kind == ofp.OFPMP_TABLE_FEATURES and len(message) == multipart.BODY:
            await self._link.answer(identity.table_features(xid))
        elif kind == ofp.OFPMP_AGGREGATE:
            # The bodies are alike; the sum over entries is made of what light has counted.
            self._link.aggregates[xid] = (0, 0, 0)
            body = message[multipart.BODY :]
            self._link.to_bridge(multipart.request(ofp.OFPMP_FLOW, xid, body))
        else:
            self._link.to_bridge(message)

    async def _barrier(self, message: bytes) -> None:
        if len(message) != HEADER.size:  # the bridge would answer it by an error, not in turn
            raise MalformedPacket(f"BARRIER_REQUEST of {len(message)} bytes")
        self._link.barrier(message)

    async def _role(self, message: bytes) -> None:
        # What comes behind is judged by the role that the bridge grants: it may be stale.
        await self._link.accepted(message)

    async def _set_async(self, message: bytes) -> None:
        masks = async_config.removal_masks(message)
        if await self._link.accepted(async_config.with_deletions(message)):
            self._link.removals.update(masks)

    async def _experimenter(self, message: bytes) -> None:
        experimenter, kind = _experiment(message)
        if experimenter == NICIRA and kind in UNJUDGED:
            raise refusals.bad_experiment(
                f"{UNJUDGED[kind]} is not offered: use OpenFlow's own messages",
            )
        self._link.to_bridge(message)


@messages.strict
def _experiment(message: bytes) -> tuple[int, int]:
    experimenter, kind = multipart.EXPERIMENT.unpack_from(message, HEADER.size)
    return experimenter, kind
