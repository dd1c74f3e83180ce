"""The bridge's reports of flow entries: monitor's updates, statistics, FLOW_REMOVED."""

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Self

from qswitch_agent.openflow import constants as ofp
from qswitch_agent.openflow import instructions, matches, messages
from qswitch_agent.openflow.flows import FlowEntry, entry
from qswitch_agent.openflow.instructions import Instructions, Mark
from qswitch_agent.openflow.messages import HEADER, NOT_AVAILABLE, strict, with_body
from wire.malformed import MalformedPacket

UPDATE = struct.Struct(ofp.OFP_FLOW_UPDATE_FULL_0_PACK_STR)
STATISTICS = struct.Struct(ofp.OFP_FLOW_STATS_0_PACK_STR)
GONE = struct.Struct(ofp.OFP_FLOW_REMOVED_PACK_STR0)
ADDED, REMOVED, PAUSED, RESUMED = (
    ofp.OFPFME_ADDED,
    ofp.OFPFME_REMOVED,
    ofp.OFPFME_PAUSED,
    ofp.OFPFME_RESUMED,
)


@dataclass(frozen=True)
class FlowUpdate:
    """One event of a flow monitor; no entry comes with PAUSED and RESUMED."""

    event: int
    entry: FlowEntry | None = None


def flow_monitor_request(xid: int) -> bytes:
    """Return a request for table 0 as it is and for each change of it from then on.

    Open vSwitch refuses OFPFMF_NO_ABBREV; only changes made on the same connection
    would be abbreviated, and the agent makes none there.
    """
    flags = (
        ofp.OFPFMF_INITIAL
        | ofp.OFPFMF_ADD
        | ofp.OFPFMF_REMOVED
        | ofp.OFPFMF_MODIFY
        | ofp.OFPFMF_INSTRUCTIONS
    )
    body = struct.pack(
        ofp.OFP_FLOW_MONITOR_REQUEST_0_PACK_STR,
        1,
        ofp.OFPP_ANY,
        ofp.OFPG_ANY,
        flags,
        0,
        ofp.OFPFMC_ADD,
    )
    return messages.request(ofp.OFPMP_FLOW_MONITOR, xid, body + matches.join(b""))


@strict
def flow_updates(message: bytes) -> list[FlowUpdate]:
    """Return the flow monitor's events in a multipart reply, none if it is another reply."""
    if messages.multipart_type(message) != ofp.OFPMP_FLOW_MONITOR:
        return []
    return list(_each_update(message[messages.BODY :]))


def _each_update(data: bytes) -> Iterator[FlowUpdate]:
    offset = 0
    while offset < len(data):
        length, event = struct.unpack_from("!HH", data, offset)
        if not 8 <= length <= len(data) - offset:
            raise MalformedPacket(f"flow update with length {length}")
        update = data[offset : offset + length]
        yield FlowUpdate(event, _flow_entry(update) if event <= ofp.OFPFME_MODIFIED else None)
        offset += length


def _flow_entry(update: bytes) -> FlowEntry:
    fixed = UPDATE.unpack_from(update)
    match, data = matches.split(update[UPDATE.size :])
    return entry(fixed[6], match, instructions.parse(data), fixed[7])


Known = Callable[[int, bytes, int, bool], tuple[Mark, bool] | None]


@strict
def monitor_shown(message: bytes, known: Known) -> bytes:
    """Return a reply of a flow monitor as a controller sees it: without marks.

    `known` tells of an entry, by priority, match, cookie and whether it was removed: its mark,
    if it is a light entry, and whether it was removed because no light passed.
    """
    body, data = b"", message[messages.BODY :]
    while data:
        length, event = struct.unpack_from("!HH", data)
        if not 8 <= length <= len(data):
            raise MalformedPacket(f"flow update with length {length}")
        shown = (
            _update_shown(data[:length], known) if event <= ofp.OFPFME_MODIFIED else data[:length]
        )
        body += shown
        data = data[length:]
    return with_body(message, message[HEADER.size : messages.BODY] + body)


def _update_shown(update: bytes, known: Known) -> bytes:
    fixed = list(UPDATE.unpack_from(update))
    match, data = matches.split(update[UPDATE.size :])
    does = instructions.parse(data)
    removed = fixed[1] == REMOVED
    light = known(fixed[6], match, fixed[7], removed)
    if light is None:
        return update
    mark, idle = light
    rest = matches.join(match) + does.without_mark()
    fixed[0], fixed[4] = UPDATE.size + len(rest), mark.idle_timeout_s
    if idle:
        fixed[3] = ofp.OFPRR_IDLE_TIMEOUT
    return UPDATE.pack(*fixed) + rest


@dataclass(frozen=True)
class FlowStatistics:
    """One entry in a reply to OFPMP_FLOW."""

    fixed: tuple[int, ...]  # as in STATISTICS
    match: bytes
    instructions: Instructions

    @property
    def entry(self) -> FlowEntry:
        return entry(self.fixed[4], self.match, self.instructions, self.fixed[9])

    @property
    def packets(self) -> int:
        return self.fixed[10]

    @property
    def octets(self) -> int:
        """How many bytes it has passed."""
        return self.fixed[11]

    def encode(self) -> bytes:
        rest = matches.join(self.match) + self.instructions.data
        return STATISTICS.pack(STATISTICS.size + len(rest), *self.fixed[1:]) + rest

    def shown(self, mark: Mark, photons: int) -> "FlowStatistics":
        fixed = list(self.fixed)
        fixed[5], fixed[10], fixed[11] = mark.idle_timeout_s, photons, NOT_AVAILABLE
        return FlowStatistics(
            tuple(fixed), self.match, instructions.parse(self.instructions.without_mark())
        )


@strict
def flow_statistics(message: bytes) -> list[FlowStatistics]:
    entries, offset = [], messages.BODY
    while offset < len(message):
        fixed = STATISTICS.unpack_from(message, offset)
        if not STATISTICS.size <= fixed[0] <= len(message) - offset:
            raise MalformedPacket(f"flow statistics with length {fixed[0]}")
        rest = message[offset + STATISTICS.size : offset + fixed[0]]
        match, data = matches.split(rest)
        entries.append(FlowStatistics(fixed, match, instructions.parse(data)))
        offset += fixed[0]
    return entries


@dataclass(frozen=True)
class FlowRemoved:
    fixed: tuple[int, ...]  # as in GONE
    match: bytes

    @classmethod
    @strict
    def decode(cls, message: bytes) -> Self:
        match, _rest = matches.split(message[HEADER.size + GONE.size :])
        return cls(GONE.unpack_from(message, HEADER.size), match)

    @property
    def table(self) -> int:
        return self.fixed[3]

    @property
    def key(self) -> tuple[int, bytes, int]:
        return self.fixed[1], self.match, self.fixed[0]

    @property
    def reason(self) -> int:
        return self.fixed[2]

    def shown(self, message: bytes, mark: Mark, photons: int, reason: int) -> bytes:
        fixed = list(self.fixed)
        fixed[2] = reason
        fixed[6], fixed[8], fixed[9] = mark.idle_timeout_s, photons, NOT_AVAILABLE
        return with_body(message, GONE.pack(*fixed) + matches.join(self.match))
