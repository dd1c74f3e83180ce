"""Controllers' requests: passed on to the bridge, changed, answered, or refused.

Light is judged here, before the bridge hears of it: a FLOW_MOD as it comes, the members of
a bundle together at COMMIT. A refused request changes nothing.
"""

import logging
from collections.abc import Awaitable, Callable
from dataclasses import replace

from qswitch_agent.hardware.optics import HardwareRefusal
from qswitch_agent.middleware.flow_table import FlowTable
from qswitch_agent.openflow import constants as ofp
from qswitch_agent.openflow import identity, messages, packets, refusals
from qswitch_agent.openflow.flows import FlowMod
from qswitch_agent.openflow.instructions import NICIRA
from qswitch_agent.openflow.messages import HEADER, transaction_id
from qswitch_agent.openflow.packets import PacketOut
from qswitch_agent.openflow.ports import PortMod
from qswitch_agent.openflow.refusals import Refusal
from qswitch_agent.proxy.bundles import Bundle, Member, Tunings, require_supported
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
from qswitch_agent.switch import Switch, circuits
from wire.analyser_frames import HERALDS, AnalyserFrame, Emission, End, Parts
from wire.malformed import MalformedPacket
from wire.optical import (
    ANALYSER_COUNTS,
    EMISSION,
    EXPERIMENTER,
    MEMORY_COUNTS,
    PATH_OPTICS,
    encode_path_optics,
)
from wire.parameters.switch import Kind, inner_port


class BundleRequests:
    def __init__(
        self, switch: Switch, link: Link, refuse: Callable[[bytes, Refusal], Awaitable[None]]
    ) -> None:
        self._switch = switch
        self._link = link
        self._refuse = refuse

    async def add(self, message: bytes) -> None:
        """Take a message into a bundle; what is refused is not in it (OpenFlow 1.4, 7.3.9.7)."""
        require_not_slave(self._link, "BUNDLE_ADD_MESSAGE")
        bundle, inner = self._link.bundles.of(message)
        if transaction_id(inner) != transaction_id(message):  # the bridge would leave it out
            raise refusals.bad_xid(
                "the xids of a bundle message and of the message in it differ",
            )
        member = Member(inner, message)
        try:
            answers = self._judge_member(bundle, member)
        except Refusal as refusal:
            await self._refuse(inner, refusal)
            return
        except MalformedPacket as error:
            await self._refuse(inner, refusals.of_malformed(error))
            return
        self._link.bundles.add(bundle, member)
        if member.sent and answers:
            self._link.to_bridge(packets.with_member(message, answers))

    def _judge_member(self, bundle: Bundle, member: Member) -> bytes:
        """Return the messages to the bridge in place of a message in a bundle."""
        member.sent = not bundle.late
        kind = require_supported(member.message)
        if kind == ofp.OFPT_PORT_MOD:
            port, tunings = checked_port_mod(member.message, self._switch)
            message = self._without_tuning(port, transaction_id(member.message))
            bundle.tunings += tunings
            return message
        if kind == ofp.OFPT_GROUP_MOD:
            require_no_light(member.message, self._switch)
            return member.message
        mod = FlowMod.decode(member.message)
        member.mod, member.light = mod, concerns_light(mod, self._switch)
        if member.light and mod.command == ofp.OFPFC_ADD:
            member.mod = marked(mod, self._switch, self._link)
            return member.mod.encode(transaction_id(member.message))
        if may_modify_light(mod):
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

    async def control(self, message: bytes) -> None:
        require_not_slave(self._link, "BUNDLE_CONTROL")
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
        if not bundle.concerns_light:
            self._link.bundles.committing[transaction_id(message)] = bundle.tunings
            self._link.change(message)
            return
        async with self._switch.trial(self._link) as trial:
            changes = await self._told(number, message, bundle, trial)
            if changes is not None:
                self._link.bundles.committing[transaction_id(message)] = bundle.tunings
                self._link.change(message, mods=self._switch.seen_when_done(changes))

    async def _told(
        self, number: int, commit: bytes, bundle: Bundle, trial: FlowTable
    ) -> list[FlowMod] | None:
        """Return the messages to the bridge for a bundle; refuse it if it cannot be committed."""
        member, changes = None, list[tuple[Member, FlowMod]]()
        try:
            for member in bundle.members:
                mods = trial.change(member.mod) if member.mod else []
                changes += [(member, mod) for mod in mods]
                if not member.sent and not await self._send_late(member, mods):
                    await self._fail(number, commit)
                    return None
            for path, reason in self._switch.impossible(trial, [mod for _, mod in changes]).items():
                blamed = [one for one, mod in changes if path.circuit in circuits([mod])]
                member = blamed[-1] if blamed else bundle.last_light
                raise refusals.bad_out_port(reason)
        except Refusal as refusal:
            await self._fail(number, commit, member, refusal)
            return None
        for member, mod in changes:
            self._switch.promise(mod, self._link, member.message)
        return [mod for _, mod in changes]

    async def _send_late(self, member: Member, mods: list[FlowMod]) -> bool:
        """Put a member into the bridge's bundle after all; tell whether the bridge takes it."""
        xid = transaction_id(member.message)
        inner = [mod.encode(xid) for mod in mods] if member.mod else [member.message]
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
        await self._refuse(commit, refusals.bundle_failed(f"bundle {number} is refused"))


# Of Nicira: they would pass by unseen.
UNJUDGED = {13: "NXT_FLOW_MOD", 28: "NXT_RESUME", 31: "NXT_GROUP_MOD"}
log = logging.getLogger(__name__)


class Requests:
    def __init__(self, switch: Switch, link: Link) -> None:
        self._switch = switch
        self._link = link
        self._bundles = BundleRequests(switch, link, self._refuse)
        self._parts = Parts()  # of what is named of a memory's block
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
                *(one.encode(xid) for one in mods), mods=self._switch.seen_when_done(mods)
            )

    async def _port_mod(self, message: bytes) -> None:
        mod, tunings = checked_port_mod(message, self._switch)
        if not tunings:
            self._link.to_bridge(message)
        elif not await self._link.accepted(mod.encode(transaction_id(message))):
            return  # the bridge has reported why
        await self._tune(tunings)

    async def _tune(self, tunings: Tunings) -> None:
        for port, tuned in tunings:
            try:
                await self._switch.tune(port, tuned)
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
        if sources := self._switch.paths.table.sources.intersection(packet.outputs):
            if len(packet.actions) > 1:
                raise refusals.bad_out_port("into a source's port goes one frame, and no further")
            await self._emit(min(sources), packet.frame)
            return
        if inner := self._switch.inner.intersection(packet.outputs):
            await self._choose(packet, min(inner))
            return
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

    async def _emit(self, port: int, frame: bytes) -> None:
        """Have a source make the pairs that a frame into its port asks for."""
        require_not_slave(self._link, "an emission")
        emission = Emission.decode(frame)
        try:
            await self._switch.hardware.emit(port, emission)
        except HardwareRefusal as refusal:
            raise refusals.bad_out_port(str(refusal)) from refusal

    async def _choose(self, packet: PacketOut, port: int) -> None:
        """Have a memory discard the pulses that frames, sent into its port, do not list.

        The others leave, or are purified, when the last frame of their block has come.
        """
        require_not_slave(self._link, "PACKET_OUT")
        memory = inner_port(port).kind == Kind.MEMORY
        if not memory or len(packet.actions) > 1 or packet.frame[12:14] != HERALDS:
            raise refusals.bad_out_port(f"no packet goes into the inner port {port}")
        frame = AnalyserFrame.decode(packet.frame)
        if frame.end != (End.PURIFY if frame.method else End.STORED):
            raise refusals.bad_out_port(f"a frame of {frame.end.name} to port {port}")
        if (chosen := self._parts.whole(port, frame)) is None:
            return
        try:
            await self._switch.hardware.keep(replace(chosen, port=port))
        except HardwareRefusal as refusal:
            raise refusals.bad_out_port(str(refusal)) from refusal

    async def _multipart(self, message: bytes) -> None:
        kind, xid = messages.multipart_type(message), transaction_id(message)
        ours = messages.asked_of_us(message)
        if ours == PATH_OPTICS:
            body = encode_path_optics(self._switch.path_optics())
            await self._link.answer(messages.reply_of_ours(xid, ours, body))
        elif ours in (ANALYSER_COUNTS, MEMORY_COUNTS):
            readings = await self._switch.read()
            parts = readings.analysers if ours == ANALYSER_COUNTS else readings.memories
            body = b"".join(counts.encode() for counts in parts)
            await self._link.answer(messages.reply_of_ours(xid, ours, body))
        elif kind == ofp.OFPMP_TABLE_FEATURES and len(message) == messages.BODY:
            await self._link.answer(identity.table_features(xid))
        elif kind == ofp.OFPMP_AGGREGATE:
            # The bodies are alike; the sum over entries is made of what light has counted.
            self._link.aggregates[xid] = (0, 0, 0)
            body = message[messages.BODY :]
            self._link.to_bridge(messages.request(ofp.OFPMP_FLOW, xid, body))
        else:
            self._link.to_bridge(message)

    async def _barrier(self, message: bytes) -> None:
        if len(message) != HEADER.size:  # the bridge would answer it by an error, not in turn
            raise MalformedPacket(f"BARRIER_REQUEST of {len(message)} bytes")
        self._link.barrier(message)

    async def _role(self, message: bytes) -> None:
        # Later requests are judged by the role that the bridge grants: it may be stale.
        await self._link.accepted(message)

    async def _set_async(self, message: bytes) -> None:
        masks = messages.removal_masks(message)
        if await self._link.accepted(messages.with_deletions(message)):
            self._link.removals.update(masks)

    async def _experimenter(self, message: bytes) -> None:
        experimenter, kind, body = _experiment(message)
        if experimenter == NICIRA and kind in UNJUDGED:
            raise refusals.bad_experiment(
                f"{UNJUDGED[kind]} is not offered: use OpenFlow's own messages",
            )
        if (experimenter, kind) == (EXPERIMENTER, EMISSION):
            port, frame = int.from_bytes(body[:4]), body[4:]
            if port not in self._switch.paths.table.sources:
                raise refusals.bad_out_port(
                    f"port {port} is of no source, and no memory emits there"
                )
            await self._emit(port, frame)
            return
        self._link.to_bridge(message)


@messages.strict
def _experiment(message: bytes) -> tuple[int, int, bytes]:
    experimenter, kind = messages.EXPERIMENT.unpack_from(message, HEADER.size)
    return experimenter, kind, message[HEADER.size + messages.EXPERIMENT.size :]
