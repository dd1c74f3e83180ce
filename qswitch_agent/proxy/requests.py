"""What controllers ask for: passed on to the bridge, changed, answered, or refused.

Light is judged here, before the bridge hears of it: a FLOW_MOD as it comes, the members of
a bundle together at COMMIT. What a controller is refused changes nothing.
"""

import logging
from collections.abc import Awaitable, Callable

from os_ken.ofproto import ofproto_v1_4 as ofp

from qswitch_agent.hardware.optics import HardwareRefusal
from qswitch_agent.middleware.flow_table import FlowTable, concerns
from qswitch_agent.middleware.light import MODIFYING, is_light, require_no_fiber
from qswitch_agent.openflow import messages, multipart, packets
from qswitch_agent.openflow.flows import FlowMod
from qswitch_agent.openflow.instructions import NICIRA, Mark
from qswitch_agent.openflow.messages import HEADER, Refusal, transaction_id
from qswitch_agent.openflow.packets import PacketOut
from qswitch_agent.openflow.ports import PortMod
from qswitch_agent.proxy.bundles import Bundle, Member, Tunings, require_supported
from qswitch_agent.proxy.link import Link
from qswitch_agent.switch import Switch
from wire.metadata import MalformedPacket
from wire.optical import encode_path_optics

CHANGEABLE = ofp.OFPPC_PORT_DOWN | ofp.OFPPC_NO_PACKET_IN
# Of Nicira: they would pass by unseen.
UNJUDGED = {13: "NXT_FLOW_MOD", 28: "NXT_RESUME", 31: "NXT_GROUP_MOD"}
log = logging.getLogger(__name__)


class Requests:
    """One controller's requests, in their order."""

    def __init__(self, switch: Switch, link: Link) -> None:
        self._switch = switch
        self._link = link
        self._handlers: dict[int, Callable[[bytes], Awaitable[None]]] = {
            ofp.OFPT_FLOW_MOD: self._flow_mod,
            ofp.OFPT_PORT_MOD: self._port_mod,
            ofp.OFPT_GROUP_MOD: self._group_mod,
            ofp.OFPT_PACKET_OUT: self._packet_out,
            ofp.OFPT_BUNDLE_CONTROL: self._bundle_control,
            ofp.OFPT_BUNDLE_ADD_MESSAGE: self._bundle_add,
            ofp.OFPT_MULTIPART_REQUEST: self._multipart,
            ofp.OFPT_BARRIER_REQUEST: self._barrier,
            ofp.OFPT_ROLE_REQUEST: self._role,
            ofp.OFPT_EXPERIMENTER: self._experimenter,
        }

    async def take(self, message: bytes) -> None:
        """Handle one message of the controller."""
        handler = self._handlers.get(messages.message_type(message))
        if handler is None:
            self._link.to_bridge(message)
            return
        try:
            await handler(message)
        except Refusal as refusal:
            await self._refuse(message, refusal)
        except MalformedPacket as error:
            bad_length = Refusal(ofp.OFPET_BAD_REQUEST, ofp.OFPBRC_BAD_LEN, str(error))
            await self._refuse(message, bad_length)

    async def _refuse(self, message: bytes, refusal: Refusal) -> None:
        """Answer a request with an error; a slave's requests are refused as such."""
        log.info("refused: %s", refusal)
        kind, code = refusal.kind, refusal.code
        if self._link.is_slave and message[1] != ofp.OFPT_MULTIPART_REQUEST:
            kind, code = ofp.OFPET_BAD_REQUEST, ofp.OFPBRC_IS_SLAVE
        await self._link.answer(messages.error(kind, code, message))

    async def _flow_mod(self, message: bytes) -> None:
        mod, xid = FlowMod.decode(message), transaction_id(message)
        light = is_light(mod, self._switch.fibers)
        if mod.deletes:
            self._link.delete(mod, message)
            return
        if light and mod.command == ofp.OFPFC_ADD:
            mod = self._marked(mod)
        elif not light and not _may_modify_light(mod):
            self._link.change(message)
            return
        async with self._switch.trial(self._link) as trial:
            told = trial.change(mod)
            self._switch.require_free_outputs(trial)
            self._link.change(*(one.encode(xid) for one in told))

    def _marked(self, mod: FlowMod) -> FlowMod:
        """Return an ADD with a mark; an entry that takes another's place counts on from there."""
        before = self._switch.paths.table.find(mod.priority, mod.match)
        if mod.flags & ofp.OFPFF_RESET_COUNTS or any(
            before and concerns(deletion, before) for deletion in self._link.deletions
        ):
            before = None
        known = before.mark.circuit if before and before.mark else 0
        return mod.marked(Mark(mod.idle_timeout_s, known or self._switch.new_circuit()))

    async def _port_mod(self, message: bytes) -> None:
        mod, tunings = self._checked_port_mod(message)
        if not tunings:
            self._link.to_bridge(message)
        elif not await self._link.accepted(mod.encode(transaction_id(message))):
            return  # the bridge has said why
        await self._tune(tunings, message)

    def _checked_port_mod(self, message: bytes) -> tuple[PortMod, Tunings]:
        """Return a PORT_MOD and how ports are to be tuned by it."""
        mod = PortMod.decode(message)
        if mod.number not in self._switch.fibers:
            if mod.tuning:
                reason = f"port {mod.number} has no optics"
                raise Refusal(ofp.OFPET_BAD_PROPERTY, ofp.OFPBPC_BAD_TYPE, reason)
            return mod, []
        if mod.mask & ~CHANGEABLE:
            raise Refusal(
                ofp.OFPET_PORT_MOD_FAILED,
                ofp.OFPPMFC_BAD_CONFIG,
                f"configuration bits {mod.mask:#x} of a fibre: it can be down or send no packet-in",
            )
        return mod, [(mod.number, *self._switch.tuning(mod.tuning))] if mod.tuning else []

    async def _tune(self, tunings: Tunings, message: bytes) -> None:
        for tuning in tunings:
            try:
                await self._switch.hardware.tune(*tuning)
            except HardwareRefusal as refusal:
                raise Refusal(
                    ofp.OFPET_PORT_MOD_FAILED, ofp.OFPPMFC_BAD_CONFIG, str(refusal)
                ) from refusal

    async def _group_mod(self, message: bytes) -> None:
        require_no_fiber(packets.group_outputs(message), self._switch.fibers)
        self._link.to_bridge(message)

    async def _packet_out(self, message: bytes) -> None:
        packet = PacketOut.decode(message)
        fibers = self._switch.fibers.intersection(packet.outputs)
        if not fibers:
            self._link.to_bridge(message)
            return
        if len(packet.actions) > 1 or not packets.is_lldp(packet.frame):
            raise Refusal(
                ofp.OFPET_BAD_ACTION,
                ofp.OFPBAC_BAD_OUT_PORT,
                f"into the fibre at port {min(fibers)} goes LLDP alone, by one output action",
            )
        self._require_not_slave("PACKET_OUT")
        self._switch.send_lldp(packet.outputs[0], packet.frame)

    def _require_not_slave(self, request: str) -> None:
        """Raise Refusal for what the bridge would refuse as well, before it is taken in here."""
        if self._link.is_slave:
            raise Refusal(ofp.OFPET_BAD_REQUEST, ofp.OFPBRC_IS_SLAVE, f"{request} of a slave")

    async def _bundle_add(self, message: bytes) -> None:
        self._require_not_slave("BUNDLE_ADD_MESSAGE")
        bundle, inner = self._link.bundles.of(message)
        if transaction_id(inner) != transaction_id(message):  # the bridge would leave it out
            raise Refusal(
                ofp.OFPET_BUNDLE_FAILED,
                ofp.OFPBFC_MSG_BAD_XID,
                "the xids of a bundle message and of the message in it differ",
            )
        member = Member(inner, message)
        try:
            told = self._judge_member(bundle, member)
        except Refusal as refusal:  # told at COMMIT, as for members that the bridge refuses
            member.refusal = refusal
        except MalformedPacket as error:
            bad_length = Refusal(ofp.OFPET_BAD_REQUEST, ofp.OFPBRC_BAD_LEN, str(error))
            member.refusal = bad_length
        self._link.bundles.add(bundle, member)
        if member.refusal is None and member.sent and told:
            self._link.to_bridge(packets.with_member(message, told))

    def _judge_member(self, bundle: Bundle, member: Member) -> bytes:
        """Return what the bridge is told in place of a message in a bundle."""
        member.sent = not bundle.late
        kind = require_supported(member.message)
        if kind == ofp.OFPT_PORT_MOD:
            port, tunings = self._checked_port_mod(member.message)
            bundle.tunings += tunings
            return self._without_tuning(port, transaction_id(member.message))
        if kind == ofp.OFPT_GROUP_MOD:
            require_no_fiber(packets.group_outputs(member.message), self._switch.fibers)
            return member.message
        mod = FlowMod.decode(member.message)
        member.mod, member.light = mod, is_light(mod, self._switch.fibers)
        if member.light and mod.command == ofp.OFPFC_ADD:
            member.mod = self._marked(mod)
            return member.mod.encode(transaction_id(member.message))
        if _may_modify_light(mod):
            member.sent = False
        return member.message

    def _without_tuning(self, port: PortMod, xid: int) -> bytes:
        """Return what is left for the bridge of a PORT_MOD in a bundle.

        Open vSwitch takes none in an atomic bundle: it hears of one only if it has to.
        """
        if port.mask or port.properties or not port.tuning:
            return port.encode(xid)
        self._switch.require_address(port.number, port.address)
        return b""

    async def _bundle_control(self, message: bytes) -> None:
        self._require_not_slave("BUNDLE_CONTROL")
        number, kind, _flags = packets.bundle_control(message)
        # Nothing behind may make the bridge refuse what the agent has taken in.
        message = messages.with_body(message, message[HEADER.size :][: packets.BUNDLE.size])
        if kind == ofp.OFPBCT_OPEN_REQUEST:
            self._link.bundles.begin(number)
        elif kind == ofp.OFPBCT_DISCARD_REQUEST:
            self._link.bundles.end(number)
        elif kind == ofp.OFPBCT_COMMIT_REQUEST:
            await self._commit(number, message)
            return
        self._link.to_bridge(message)

    async def _commit(self, number: int, message: bytes) -> None:
        bundle = self._link.bundles.end(number)
        refused = bundle.first_refused
        if refused is not None:
            assert refused.refusal is not None
            await self._fail(number, message, refused, refused.refusal)
            return
        if not bundle.concerns_light:
            self._link.bundles.committing[transaction_id(message)] = bundle.tunings
            self._link.change(message)
            return
        async with self._switch.trial(self._link) as trial:
            if await self._fits(number, message, bundle, trial):
                self._link.bundles.committing[transaction_id(message)] = bundle.tunings
                self._link.change(message)

    async def _fits(self, number: int, commit: bytes, bundle: Bundle, trial: FlowTable) -> bool:
        """Tell whether a bundle can be committed; refuse it if not."""
        member = None
        try:
            for member in bundle.members:
                told = trial.change(member.mod) if member.mod else []
                if not member.sent and not await self._send_late(member, told):
                    await self._fail(number, commit)
                    return False
            member = bundle.last_light
            self._switch.require_free_outputs(trial)
        except Refusal as refusal:
            await self._fail(number, commit, member, refusal)
            return False
        return True

    async def _send_late(self, member: Member, told: list[FlowMod]) -> bool:
        """Put a member into the bridge's bundle after all; tell whether the bridge takes it."""
        xid = transaction_id(member.message)
        inner = [mod.encode(xid) for mod in told] if member.mod else [member.message]
        if member.message[1] == ofp.OFPT_PORT_MOD:
            inner = [self._without_tuning(PortMod.decode(member.message), xid)]
        envelopes = [packets.with_member(member.envelope, one) for one in inner if one]
        return not envelopes or await self._link.accepted(*envelopes)

    async def _fail(
        self,
        number: int,
        commit: bytes,
        member: Member | None = None,
        refusal: Refusal | None = None,
    ) -> None:
        """Refuse a bundle as a whole, and let the bridge forget it."""
        await self._link.discard(number, transaction_id(commit))
        if member is not None and refusal is not None:
            await self._refuse(member.message, refusal)
        failed = ofp.OFPET_BUNDLE_FAILED, ofp.OFPBFC_MSG_FAILED
        await self._refuse(commit, Refusal(*failed, f"bundle {number} is refused"))

    async def _multipart(self, message: bytes) -> None:
        kind, xid = multipart.multipart_type(message), transaction_id(message)
        if multipart.asks_for_path_optics(message):
            body = encode_path_optics(self._switch.path_optics())
            await self._link.answer(multipart.path_optics_reply(xid, body))
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
        # Until the bridge has answered, what comes behind is judged as if it were granted.
        if messages.role(message) != ofp.OFPCR_ROLE_SLAVE:
            self._link.is_slave = False
        self._link.to_bridge(message)

    async def _experimenter(self, message: bytes) -> None:
        experimenter, kind = _experiment(message)
        if experimenter == NICIRA and kind in UNJUDGED:
            raise Refusal(
                ofp.OFPET_BAD_REQUEST,
                ofp.OFPBRC_BAD_EXP_TYPE,
                f"{UNJUDGED[kind]} is not offered: use OpenFlow's own messages",
            )
        self._link.to_bridge(message)


@messages.strict
def _experiment(message: bytes) -> tuple[int, int]:
    experimenter, kind = multipart.EXPERIMENT.unpack_from(message, HEADER.size)
    return experimenter, kind


def _may_modify_light(mod: FlowMod) -> bool:
    """Tell whether MODIFY could be about light entries, which match in_port alone."""
    return mod.command in MODIFYING and len(mod.fields) <= 1
