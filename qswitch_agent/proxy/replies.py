"""The bridge's messages, as the controller of an optical switch is to see them."""

import logging
import struct

from programs.network_timers import timeout
from qswitch_agent.bridge import NO_PACKETS, BridgeFault
from qswitch_agent.hardware.optics import HardwareFault, HardwareRefusal, Readings
from qswitch_agent.openflow import constants as ofp
from qswitch_agent.openflow import flow_reports, identity, messages, packets, ports
from qswitch_agent.openflow.flow_reports import FlowRemoved
from qswitch_agent.openflow.flows import FlowEntry
from qswitch_agent.openflow.instructions import Mark
from qswitch_agent.openflow.messages import message_type, transaction_id
from qswitch_agent.proxy.link import Link
from qswitch_agent.switch import Switch

AGGREGATE = struct.Struct(ofp.OFP_AGGREGATE_STATS_REPLY_PACK_STR)
CHANGED = (
    ofp.OFPT_BARRIER_REPLY,
    ofp.OFPT_MULTIPART_REPLY,
    ofp.OFPT_PORT_STATUS,
    ofp.OFPT_FLOW_REMOVED,
    ofp.OFPT_PACKET_IN,
    ofp.OFPT_BUNDLE_CONTROL,
    ofp.OFPT_GET_ASYNC_REPLY,
    ofp.OFPT_FEATURES_REPLY,
)
NOT_OF_LIGHT = ofp.OFPMP_GROUP_FEATURES, ofp.OFPMP_METER_FEATURES
WAITING = ofp.OFPT_BARRIER_REPLY, ofp.OFPT_MULTIPART_REPLY, ofp.OFPT_FLOW_REMOVED
log = logging.getLogger(__name__)


class Replies:
    """One controller's view of what the bridge says."""

    def __init__(self, switch: Switch, link: Link, hold_deadline_s: float) -> None:
        self._switch = switch
        self._link = link
        self._hold_deadline_s = hold_deadline_s

    def may_wait(self, message: bytes) -> bool:
        """Tell whether it may take time until a message is to be shown."""
        kind = message_type(message)
        if kind == ofp.OFPT_BUNDLE_CONTROL:  # ports are tuned
            return bool(self._link.bundles.committing.get(transaction_id(message)))
        return kind in WAITING

    async def shown(self, message: bytes, since_ns: int) -> bytes:
        """Return what the controller gets for a message of the bridge; it may be nothing.

        The bridge has sent it at `since_ns` (time.monotonic_ns) or before.
        """
        kind = message_type(message)
        if kind not in CHANGED:
            return message
        if kind == ofp.OFPT_BARRIER_REPLY:
            return await self._barrier(message)
        if kind == ofp.OFPT_MULTIPART_REPLY:
            return await self._multipart(message, since_ns)
        if kind == ofp.OFPT_PORT_STATUS:
            return b"" if self._is_announced(message) else self._ports(message)
        if kind == ofp.OFPT_FEATURES_REPLY:
            return identity.features(message, self._switch.optical_alone)
        if kind == ofp.OFPT_GET_ASYNC_REPLY:
            return messages.with_removal_masks(message, self._link.removals)
        if kind == ofp.OFPT_FLOW_REMOVED:
            return await self._flow_removed(message, since_ns)
        if kind == ofp.OFPT_PACKET_IN:
            return self._packet_in(message)
        return await self._bundle(message)

    async def _barrier(self, message: bytes) -> bytes:
        """Hold the reply until light passes as was asked for before the barrier.

        Requests that are not executed until the deadline are answered by errors.
        """
        try:
            confirmed = self._link.confirmed
            async with timeout(self._switch.paths.time, self._hold_deadline_s):
                await self._switch.ready(self._link)
            self._link.reported(confirmed)
        except (BridgeFault, HardwareFault, TimeoutError) as error:
            reason = str(error) or f"light paths were not ready in {self._hold_deadline_s} s"
            log.error("before a barrier: %s", reason)
            self._switch.paths.promises.give_up(self._link, reason)
        return message

    def _is_announced(self, message: bytes) -> bool:
        if ports.status_reason(message) != ofp.OFPPR_MODIFY:
            return False
        described = ports.described_ports(message)
        light = self._switch.light_ports
        return any(port.number in light and not port.config & NO_PACKETS for port in described)

    def _known(
        self, priority: int, match: bytes, cookie: int, gone: bool
    ) -> tuple[Mark, bool] | None:
        paths = self._switch.paths
        if gone:
            removed = paths.removed(priority, match, cookie)
            return (removed.mark, removed.idle) if removed else None
        entry = paths.table.find(priority, match)
        mark = entry and self._mark(entry)
        return (mark, False) if mark else None

    async def _multipart(self, message: bytes, since_ns: int) -> bytes:
        kind = messages.multipart_type(message)
        if kind == ofp.OFPMP_PORT_DESC:
            return self._ports(message)
        if kind == ofp.OFPMP_DESC:
            return identity.described(message, self._switch.identity)
        if kind in NOT_OF_LIGHT and self._switch.optical_alone:
            return identity.nothing_of(message)
        if kind == ofp.OFPMP_PORT_STATS:
            return await self._port_statistics(message)
        if kind == ofp.OFPMP_FLOW:
            return await self._flow_statistics(message)
        if kind == ofp.OFPMP_FLOW_MONITOR:
            await self._switch.synchronise(since_ns)
            return flow_reports.monitor_shown(message, self._known)
        return message

    def _ports(self, message: bytes) -> bytes:
        described = ports.described_ports(message)
        light = self._switch.light_ports
        if not any(port.number in light for port in described):
            return message
        shown = [self._switch.shown(port) if port.number in light else port for port in described]
        return ports.with_ports(message, shown)

    async def _port_statistics(self, message: bytes) -> bytes:
        statistics = ports.port_statistics(message)
        if not any(port.number in self._switch.light_ports for port in statistics):
            return message
        readings = await self._switch.read()
        parts = [self._photons(port, readings).encode() for port in statistics]
        return messages.rebuilt(message, parts)

    def _photons(self, port: ports.PortStatistics, readings: Readings) -> ports.PortStatistics:
        if port.number not in self._switch.light_ports:
            return port
        reading = readings.ports.get(port.number)
        if reading is None or not readings.counts_photons:
            photons = (messages.NOT_AVAILABLE,) * 3
        else:
            photons = reading.photons_in, reading.photons_out, reading.photons_lost
        inner = port.number in self._switch.inner  # no optics of its own
        light = b"" if inner else self._switch.light(port.number, readings).encode()
        return port.shown(photons, light)

    async def _flow_statistics(self, message: bytes) -> bytes:
        statistics = flow_reports.flow_statistics(message)
        marks = [self._mark(one.entry) for one in statistics]
        if any(marks):
            readings = await self._switch.read()
            for number, mark in enumerate(marks):
                if mark:
                    photons = _photons(readings, mark)
                    statistics[number] = statistics[number].shown(mark, photons)
        xid = transaction_id(message)
        if xid not in self._link.aggregates:
            return messages.rebuilt(message, [entry.encode() for entry in statistics])
        counted, octets, count = self._link.aggregates[xid]
        counted = _total([counted, *(entry.packets for entry in statistics)])
        octets = _total([octets, *(entry.octets for entry in statistics)])
        count += len(statistics)
        self._link.aggregates[xid] = counted, octets, count
        if messages.more_follows(message):
            return b""
        del self._link.aggregates[xid]
        body = AGGREGATE.pack(counted, octets, count)
        return messages.reply(ofp.OFPMP_AGGREGATE, xid, [body])

    def _mark(self, entry: FlowEntry) -> Mark | None:
        """Return the mark of a light entry; what a controller noted elsewhere is its own."""
        return entry.mark if entry.in_port in self._switch.inputs else None

    async def _flow_removed(self, message: bytes, since_ns: int) -> bytes:
        gone = FlowRemoved.decode(message)
        removed = None
        if gone.table == 0:
            await self._switch.synchronise(since_ns)
            removed = self._switch.paths.removed(*gone.key)
        reason = ofp.OFPRR_IDLE_TIMEOUT if removed and removed.idle else gone.reason
        if not self._link.wants_removal(reason):
            return b""
        if removed is None:
            return message
        photons = _photons(await self._switch.read(since_ns), removed.mark)
        return gone.shown(message, removed.mark, photons, reason)

    def _packet_in(self, message: bytes) -> bytes:
        in_port, frame = packets.packet_in(message)
        if in_port in self._switch.fibers and not packets.is_lldp(frame):
            log.info("a packet from the fibre at port %d that is not LLDP: dropped", in_port)
            return b""
        if self._switch.needs_copies and (setup := packets.copied_setup(message)):
            self._switch.setup_came(setup.session)
        return message

    async def _bundle(self, message: bytes) -> bytes:
        xid = transaction_id(message)
        if packets.bundle_control(message)[1] != ofp.OFPBCT_COMMIT_REPLY:
            return message
        for port, tuned in self._link.bundles.committing.pop(xid, []):
            try:
                await self._switch.tune(port, tuned)
            except HardwareRefusal as refusal:
                log.error("port %d is not tuned: %s", port, refusal)
                return messages.error(ofp.OFPET_BUNDLE_FAILED, ofp.OFPBFC_MSG_FAILED, message)
        return message


def _photons(readings: Readings, mark: Mark) -> int:
    if not readings.counts_photons:
        return messages.NOT_AVAILABLE
    reading = readings.circuits.get(mark.circuit)
    return reading.photons if reading else 0


def _total(counters: list[int]) -> int:
    """Return the sum of counters; it is not available if one of them is not."""
    return messages.NOT_AVAILABLE if messages.NOT_AVAILABLE in counters else sum(counters)
