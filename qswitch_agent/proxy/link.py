"""One connection between the bridge and a controller: what its two directions share."""

import asyncio
import contextlib
import logging
import time
from asyncio import StreamWriter
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

from qswitch_agent.bridge import BridgeFault
from qswitch_agent.middleware.flow_table import FlowTable
from qswitch_agent.openflow import constants as ofp
from qswitch_agent.openflow import messages, packets
from qswitch_agent.openflow.flows import FlowMod
from qswitch_agent.openflow.messages import message_type, transaction_id
from qswitch_agent.proxy.bundles import Bundles
from qswitch_agent.timeouts import BARRIER_DEADLINE_S, SHOW_SOON_S

PRIVATE_XID = 0x514D0000
UNDONE = ofp.OFPET_FLOW_MOD_FAILED, ofp.OFPFMFC_UNKNOWN  # no code says: by the hardware
MAX_OUTGOING = 10_000  # messages that wait for their turn; more wait in the connection
log = logging.getLogger(__name__)


@dataclass
class Barrier:
    """A barrier that the bridge has not answered yet; it answers them in their order."""

    changes: int  # made before it
    passed: asyncio.Future[None] | None  # of the agent's own; None: the controller's


class Change(NamedTuple):
    """A change of the flow table that the flow monitor may not have reported yet."""

    number: int
    mods: tuple[FlowMod, ...]  # to the bridge
    certain: bool  # it deletes, which the bridge does not refuse


class Outgoing(NamedTuple):
    """A message on its way to the controller."""

    message: bytes
    since_ns: int  # time.monotonic_ns: the bridge has sent it by then
    by_agent: bool = False  # else the bridge sent it


class Link:
    """Sends to both ends, and keeps account of what the bridge still owes."""

    def __init__(
        self, bridge: StreamWriter, controller: StreamWriter, batches: bool = True
    ) -> None:
        self._batches = batches
        self.bridge = bridge
        self.controller = controller
        self.outgoing: asyncio.Queue[Outgoing] = asyncio.Queue(MAX_OUTGOING)
        self._requests: list[bytes] = []  # for the bridge, in one write
        self._shown: list[bytes] = []  # for the controller, in one write
        self.is_slave = False
        self.removals = dict(messages.DEFAULT)  # that the controller wants to hear of
        self.bundles = Bundles()
        self.aggregates: dict[int, tuple[int, int, int]] = {}  # packets, bytes, flows by xid
        self._soon: asyncio.TimerHandle | None = None  # the next show, if it is not at once
        self._changes = 0  # of the flow table, sent to the bridge
        self._unreported: deque[Change] = deque()  # of those, as far as it is known what they do
        self._unknown = 0  # the last one of which it is not
        self.confirmed = 0  # that it has certainly made, or refused
        self._reported = 0  # that the flow monitor has certainly reported
        self._barriers: deque[Barrier] = deque()
        self._refused: dict[int, bool] = {}  # by xid: whether an error came for what is watched
        self._discarding: set[int] = set()  # xids of our own
        self._failed: list[bytes] = []  # errors for what was not refused at once

    def to_bridge(self, request: bytes) -> None:
        """Send a request to the bridge, at the next flush."""
        self._requests.append(request)

    def flush(self) -> None:
        if self._requests:
            self.bridge.write(b"".join(self._requests))
            self._requests.clear()

    def to_controller(self, message: bytes) -> None:
        """Send the last message (none, if empty) to the controller at the next show."""
        self._shown.append(message)

    @property
    def owes_barrier(self) -> bool:
        return bool(self._barriers)

    def show_soon(self) -> None:
        """Write what there is for the controller in a moment, with what comes until then."""
        if self._shown and self._soon is None:
            soon_s = SHOW_SOON_S if self._batches else 0.0
            self._soon = asyncio.get_running_loop().call_later(soon_s, self.show)

    def show(self) -> None:
        if self._soon is not None:
            self._soon.cancel()
            self._soon = None
        message = b"".join(self._shown)
        if message:
            self.controller.write(message)
        for _ in self._shown:
            self.outgoing.task_done()
        self._shown.clear()

    async def answer(self, message: bytes) -> None:
        """Send an answer of the agent to the controller, behind the messages of the bridge."""
        await self.outgoing.put(Outgoing(message, time.monotonic_ns(), by_agent=True))

    def wants_removal(self, reason: int) -> bool:
        role = messages.SLAVE if self.is_slave else messages.MASTER
        return bool(self.removals[role] >> reason & 1)

    def fail(self, request: bytes, reason: str) -> None:
        """Answer a request with an error after all, before what is shown next."""
        log.info("refused after all: %s", reason)
        self._failed.append(messages.error(*UNDONE, request))
        with contextlib.suppress(asyncio.QueueFull):  # then something is shown anyway
            self.outgoing.put_nowait(Outgoing(b"", time.monotonic_ns(), by_agent=True))

    def failed(self) -> bytes:
        """Return the errors that are to be shown now."""
        errors, self._failed = b"".join(self._failed), []
        return errors

    def delete(self, mod: FlowMod, request: bytes) -> None:
        """Send a FLOW_MOD that deletes: what it will do is certain."""
        self.change(request, mods=(mod,), certain=True)

    @property
    def deletions(self) -> list[FlowMod]:
        return [mod for change in self._unreported if change.certain for mod in change.mods]

    @property
    def only_deletes(self) -> bool:
        return self._unknown <= self._reported and all(one.certain for one in self._unreported)

    @property
    def all_reported(self) -> bool:
        return self._reported == self._changes

    def seen_in(self, table: FlowTable) -> bool:
        """Tell whether a table shows all changes that the bridge has made; not if there are none.

        A controller without requests waits for the changes of others.
        """
        if self._unknown > self._reported:
            return False
        confirmed = [change.mods for change in self._unreported if change.number <= self.confirmed]
        return bool(confirmed) and all(table.shows(mod) for mods in confirmed for mod in mods)

    def change(
        self, *requests: bytes, mods: tuple[FlowMod, ...] | None = None, certain: bool = False
    ) -> None:
        """Send what changes the flow table; None: it is not known how."""
        self._changes += 1
        if mods is None:
            self._unknown = self._changes
        else:
            self._unreported.append(Change(self._changes, mods, certain))
        for request in requests:
            self.to_bridge(request)

    def barrier(self, request: bytes) -> None:
        self._barriers.append(Barrier(self._changes, None))
        self.to_bridge(request)

    async def confirm(self) -> bool:
        if self.confirmed < self._changes:
            await self._own_barrier()
        return self._reported < self.confirmed

    def reported(self, confirmed: int) -> None:
        self._reported = max(self._reported, confirmed)
        while self._unreported and self._unreported[0].number <= self._reported:
            self._unreported.popleft()

    async def accepted(self, *requests: bytes) -> bool:
        """Send requests of one xid and tell whether the bridge took them without an error."""
        xid = transaction_id(requests[0])
        self._refused[xid] = False
        try:
            for request in requests:
                self.to_bridge(request)
            await self._own_barrier()
            return not self._refused[xid]
        finally:
            del self._refused[xid]

    async def discard(self, bundle: int, xid: int) -> None:
        """Let the bridge forget a bundle; its reply is not for the controller.

        Return when the bridge has answered what was asked before.
        """
        self._discarding.add(xid)
        body = packets.BUNDLE.pack(bundle, ofp.OFPBCT_DISCARD_REQUEST, 0)
        self.to_bridge(messages.encode(ofp.OFPT_BUNDLE_CONTROL, xid, body))
        await self._own_barrier()

    async def settle(self) -> None:
        """Return when all that was asked for up to now is answered."""
        await self._own_barrier()  # the bridge answers barriers in their order
        await self.outgoing.join()

    async def _own_barrier(self) -> None:
        passed = asyncio.get_running_loop().create_future()
        self._barriers.append(Barrier(self._changes, passed))
        self.to_bridge(messages.encode(ofp.OFPT_BARRIER_REQUEST, PRIVATE_XID))
        self.flush()
        try:
            async with asyncio.timeout(BARRIER_DEADLINE_S):
                await passed
        except TimeoutError as error:
            raise BridgeFault(
                f"the bridge did not answer a barrier in {BARRIER_DEADLINE_S} s"
            ) from error

    def is_ours(self, message: bytes) -> bool:
        """Take note of a message of the bridge; tell whether it answers the agent itself."""
        kind = message_type(message)
        if kind == ofp.OFPT_BARRIER_REPLY:
            return self._barrier_passed()
        if kind == ofp.OFPT_ERROR:
            return self._error(message)
        if kind == ofp.OFPT_BUNDLE_CONTROL:
            return self._bundle_reply(message)
        if kind in (ofp.OFPT_ROLE_REPLY, ofp.OFPT_ROLE_STATUS):
            self.is_slave = messages.role(message) == ofp.OFPCR_ROLE_SLAVE
        return False

    def _barrier_passed(self) -> bool:
        if not self._barriers:
            return False
        barrier = self._barriers.popleft()
        self.confirmed = max(self.confirmed, barrier.changes)
        if barrier.passed is None:
            return False
        if not barrier.passed.done():
            barrier.passed.set_result(None)
        return True

    def _error(self, message: bytes) -> bool:
        if message[0] != ofp.OFP_VERSION:
            # So Open vSwitch 3.1 answers a bad request for a flow monitor, and with any xid.
            log.warning("an error of OpenFlow version %#x: dropped", message[0])
            return True
        xid = transaction_id(message)
        if xid in self._refused:
            self._refused[xid] = True
        self.bundles.committing.pop(xid, None)
        self.aggregates.pop(xid, None)
        if xid in self._discarding and messages.error_code(message)[0] == ofp.OFPET_BUNDLE_FAILED:
            self._discarding.discard(xid)
            return True
        return False

    def _bundle_reply(self, message: bytes) -> bool:
        kind, xid = packets.bundle_control(message)[1], transaction_id(message)
        if kind == ofp.OFPBCT_DISCARD_REPLY and xid in self._discarding:
            self._discarding.discard(xid)
            return True
        return False

    def close(self) -> None:
        """Say what is left, and let nobody wait for a bridge that has left."""
        self.show()
        for barrier in self._barriers:
            if barrier.passed is not None and not barrier.passed.done():
                barrier.passed.set_result(None)
        self.confirmed = self._changes
