"""Bundles as controllers ask for them: judged as a whole at COMMIT, passed on or refused whole."""

from collections.abc import Awaitable, Callable

from qswitch_agent.middleware.flow_table import FlowTable
from qswitch_agent.openflow import constants as ofp
from qswitch_agent.openflow import messages, packets, refusals
from qswitch_agent.openflow.flows import FlowMod
from qswitch_agent.openflow.messages import HEADER, transaction_id
from qswitch_agent.openflow.ports import PortMod
from qswitch_agent.openflow.refusals import Refusal
from qswitch_agent.proxy.bundles import Bundle, Member, require_supported
from qswitch_agent.proxy.checks import (
    checked_port_mod,
    concerns_light,
    marked,
    may_modify_light,
    require_no_light,
    require_not_slave,
)
from qswitch_agent.proxy.link import Link
from qswitch_agent.switch import Switch, circuits, impossible_path
from wire.malformed import MalformedPacket


class BundleRequests:
    """One controller's bundles."""

    def __init__(
        self, switch: Switch, link: Link, refuse: Callable[[bytes, Refusal], Awaitable[None]]
    ) -> None:
        """`refuse` answers a message with an error."""
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
        """Return what the bridge is told in place of a message in a bundle."""
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
        """Open, commit or discard a bundle."""
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
                self._link.change(message, told=self._switch.seen_when_done(changes))

    async def _told(
        self, number: int, commit: bytes, bundle: Bundle, trial: FlowTable
    ) -> list[FlowMod] | None:
        """Return what the bridge is told by a bundle; refuse it if it cannot be committed."""
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
                raise impossible_path(reason)
        except Refusal as refusal:
            await self._fail(number, commit, member, refusal)
            return None
        for member, mod in changes:
            self._switch.promise(mod, self._link, member.message)
        return [mod for _, mod in changes]

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
        await self._refuse(commit, refusals.bundle_failed(f"bundle {number} is refused"))
