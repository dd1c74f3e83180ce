"""Flow entries as bytes: FLOW_MOD, the flow monitor's updates, statistics, FLOW_REMOVED.

A light entry carries a mark in the bridge's table: Open vSwitch's action `note`, which does
nothing, holds the idle time-out that the controller asked for and the number under which
photons are counted. So both outlive the agent, and the table stays the only truth. The
bridge itself never expires a light entry for idleness: no packets flow through it.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

from os_ken.ofproto import ofproto_v1_4 as ofp

from qswitch_agent.openflow import matches, multipart
from qswitch_agent.openflow.messages import HEADER, each_part, encode, strict, with_body
from wire.metadata import MalformedPacket

MOD = struct.Struct(ofp.OFP_FLOW_MOD_PACK_STR0)
MOD_FIELDS = (
    "cookie",
    "cookie_mask",
    "table",
    "command",
    "idle_timeout_s",
    "hard_timeout_s",
    "priority",
    "buffer_id",
    "out_port",
    "out_group",
    "flags",
    "importance",
)
UPDATE = struct.Struct(ofp.OFP_FLOW_UPDATE_FULL_0_PACK_STR)
STATISTICS = struct.Struct(ofp.OFP_FLOW_STATS_0_PACK_STR)
GONE = struct.Struct(ofp.OFP_FLOW_REMOVED_PACK_STR0)
INSTRUCTION = struct.Struct("!HH4x")  # type, length
OUTPUT = struct.Struct("!HHIH6x")  # type, length, port, bytes for a controller
NOTE = struct.Struct("!HHIHHI")  # experimenter, length, Nicira, note, then the mark
NICIRA, NICIRA_NOTE = 0x00002320, 8
ACTION_LISTS = (ofp.OFPIT_APPLY_ACTIONS, ofp.OFPIT_WRITE_ACTIONS)
ADDED, REMOVED, PAUSED, RESUMED = (
    ofp.OFPFME_ADDED,
    ofp.OFPFME_REMOVED,
    ofp.OFPFME_PAUSED,
    ofp.OFPFME_RESUMED,
)


@dataclass(frozen=True)
class Mark:
    """What the bridge's table holds for the agent in a light entry."""

    idle_timeout_s: int  # that the controller asked for; 0: none
    circuit: int  # photons are counted under this number; 0 is none

    def encode(self) -> bytes:
        """Return the note action."""
        head = ofp.OFPAT_EXPERIMENTER, NOTE.size, NICIRA, NICIRA_NOTE
        return NOTE.pack(*head, self.idle_timeout_s, self.circuit)

    @classmethod
    def decode(cls, action: bytes) -> Self | None:
        """Return the mark that an action is, None if it is another action."""
        if len(action) != NOTE.size:
            return None
        *head, idle_timeout_s, circuit = NOTE.unpack(action)
        if head != [ofp.OFPAT_EXPERIMENTER, NOTE.size, NICIRA, NICIRA_NOTE]:
            return None
        return cls(idle_timeout_s, circuit)


@dataclass(frozen=True)
class Instructions:
    """The instructions of an entry, taken apart."""

    data: bytes

    @cached_property
    def kinds(self) -> list[int]:
        """The types of the instructions."""
        return [kind for kind, _body in self._parts]

    @cached_property
    def actions(self) -> list[tuple[int, bytes]]:
        """Type and bytes of the actions of all instructions."""
        return [
            action
            for kind, body in self._parts
            if kind in ACTION_LISTS
            for action in each_part(body[INSTRUCTION.size :], 8, "action")
        ]

    @cached_property
    def outputs(self) -> list[int]:
        """The ports that actions output to."""
        return output_ports(self.actions)

    @cached_property
    def mark(self) -> Mark | None:
        """The mark among the actions, None if there is none."""
        return next((mark for _, one in self.actions if (mark := Mark.decode(one))), None)

    def require_whole(self) -> None:
        """Raise MalformedPacket unless all that is read of them is there."""
        output_ports(self.actions)

    def without_mark(self) -> bytes:
        """Return the instructions as a controller gave them."""
        return b"".join(self._clean(kind, body) for kind, body in self._parts)

    @cached_property
    def _parts(self) -> list[tuple[int, bytes]]:
        parts = list(each_part(self.data, 4, "instruction"))
        if any(kind in ACTION_LISTS and len(body) < INSTRUCTION.size for kind, body in parts):
            raise MalformedPacket("instruction is cut short")
        return parts

    def _clean(self, kind: int, body: bytes) -> bytes:
        if kind not in ACTION_LISTS:
            return body
        actions = [one for _, one in each_part(body[INSTRUCTION.size :], 8, "action")]
        return _instruction(kind, b"".join(one for one in actions if not Mark.decode(one)))


@strict
def output_ports(actions: list[tuple[int, bytes]]) -> list[int]:
    """Return the ports that actions output to."""
    return [OUTPUT.unpack_from(body)[2] for kind, body in actions if kind == ofp.OFPAT_OUTPUT]


def _instruction(kind: int, actions: bytes) -> bytes:
    return INSTRUCTION.pack(kind, INSTRUCTION.size + len(actions)) + actions


def light_instructions(mark: Mark, out_port: int | None) -> bytes:
    """Return the instructions of a light entry: its mark, and where light goes (None: nowhere)."""
    actions = mark.encode()
    if out_port is not None:
        actions += OUTPUT.pack(ofp.OFPAT_OUTPUT, OUTPUT.size, out_port, 0)
    return _instruction(ofp.OFPIT_APPLY_ACTIONS, actions)


@dataclass(frozen=True)
class FlowMod:
    """A FLOW_MOD."""

    cookie: int
    cookie_mask: int
    table: int
    command: int
    idle_timeout_s: int
    hard_timeout_s: int
    priority: int
    buffer_id: int
    out_port: int
    out_group: int
    flags: int
    importance: int
    match: bytes  # OXM fields
    instructions: Instructions

    @classmethod
    @strict
    def decode(cls, message: bytes) -> "FlowMod":
        """Read a FLOW_MOD, its match and its instructions included."""
        fixed: dict[str, Any] = dict(
            zip(MOD_FIELDS, MOD.unpack_from(message, HEADER.size), strict=True)
        )
        match, instructions = matches.split(message[HEADER.size + MOD.size :])
        mod = FlowMod(**fixed, match=match, instructions=Instructions(instructions))
        matches.parse(mod.match)
        mod.instructions.require_whole()
        return mod

    def encode(self, xid: int) -> bytes:
        """Return the FLOW_MOD as a message."""
        fixed = MOD.pack(*(getattr(self, name) for name in MOD_FIELDS))
        body = fixed + matches.join(self.match) + self.instructions.data
        return encode(ofp.OFPT_FLOW_MOD, xid, body)

    @cached_property
    def fields(self) -> matches.Fields:
        """The match, taken apart."""
        return matches.parse(self.match)

    @property
    def deletes(self) -> bool:
        """Whether it is one of the two commands that delete."""
        return self.command in (ofp.OFPFC_DELETE, ofp.OFPFC_DELETE_STRICT)

    @property
    def strict(self) -> bool:
        """Whether it names one entry by priority and match."""
        return self.command in (ofp.OFPFC_MODIFY_STRICT, ofp.OFPFC_DELETE_STRICT)

    def marked(self, mark: Mark) -> "FlowMod":
        """Return what the bridge is told: the mark instead of the idle time-out.

        The match is written as the bridge reports it, so that both are one entry to the agent.
        """
        outputs, in_port = self.instructions.outputs, matches.in_port(self.fields)
        assert in_port is not None
        return replace(
            self,
            idle_timeout_s=0,
            match=matches.of_port(in_port),
            instructions=Instructions(
                light_instructions(mark, outputs[0] if outputs else None),
            ),
        )


@dataclass(frozen=True)
class FlowEntry:
    """What the agent needs to know of a flow entry; priority and match identify it."""

    priority: int
    match: bytes  # the OXM fields as they were sent
    in_port: int | None  # None: any
    other_fields: bool  # the match asks for more than the port
    out_port: int | None  # None: the entry does anything but output to one port
    cookie: int = 0
    mark: Mark | None = None

    @property
    def key(self) -> tuple[int, bytes]:
        """What tells the entry from all others."""
        return self.priority, self.match

    def __str__(self) -> str:
        more = " and more" if self.other_fields else ""
        action = "other actions" if self.out_port is None else f"output to {self.out_port:#x}"
        return f"priority {self.priority}, in_port {self.in_port}{more} -> {action}"


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
    return multipart.request(ofp.OFPMP_FLOW_MONITOR, xid, body + matches.join(b""))


@strict
def flow_updates(message: bytes) -> list[FlowUpdate]:
    """Return the flow monitor's events in a multipart reply, none if it is another reply."""
    if multipart.multipart_type(message) != ofp.OFPMP_FLOW_MONITOR:
        return []
    return list(_each_update(message[multipart.BODY :]))


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
    match, instructions = matches.split(update[UPDATE.size :])
    return entry(fixed[6], match, Instructions(instructions), fixed[7])


def entry(priority: int, match: bytes, instructions: Instructions, cookie: int) -> FlowEntry:
    """Return the entry that has these properties."""
    fields = matches.parse(match)
    mark = instructions.mark
    only = len(instructions.kinds) == 1 and instructions.kinds[0] in ACTION_LISTS
    outputs = instructions.outputs
    one = only and len(instructions.actions) - (mark is not None) == 1 == len(outputs)
    return FlowEntry(
        priority,
        match,
        matches.in_port(fields),
        bool(fields.keys() - {matches.IN_PORT}),
        outputs[0] if one else None,
        cookie,
        mark,
    )


@strict
def monitor_shown(message: bytes) -> bytes:
    """Return a reply of a flow monitor as a controller sees it: without marks."""
    body, data = b"", message[multipart.BODY :]
    while data:
        length, event = struct.unpack_from("!HH", data)
        if not 8 <= length <= len(data):
            raise MalformedPacket(f"flow update with length {length}")
        body += _unmarked(data[:length]) if event <= ofp.OFPFME_MODIFIED else data[:length]
        data = data[length:]
    return with_body(message, message[HEADER.size : multipart.BODY] + body)


def _unmarked(update: bytes) -> bytes:
    fixed = list(UPDATE.unpack_from(update))
    match, data = matches.split(update[UPDATE.size :])
    instructions = Instructions(data)
    if instructions.mark is None:
        return update
    rest = matches.join(match) + instructions.without_mark()
    fixed[0], fixed[4] = UPDATE.size + len(rest), instructions.mark.idle_timeout_s
    return UPDATE.pack(*fixed) + rest


@dataclass(frozen=True)
class FlowStatistics:
    """One entry in a reply to OFPMP_FLOW."""

    fixed: tuple[int, ...]  # as in STATISTICS
    match: bytes
    instructions: Instructions

    @property
    def entry(self) -> FlowEntry:
        """The entry that is described."""
        return entry(self.fixed[4], self.match, self.instructions, self.fixed[9])

    @property
    def packets(self) -> int:
        """How many packets, or photons, it has passed."""
        return self.fixed[10]

    @property
    def octets(self) -> int:
        """How many bytes it has passed."""
        return self.fixed[11]

    def encode(self) -> bytes:
        """Return the entry's part of a reply."""
        rest = matches.join(self.match) + self.instructions.data
        return STATISTICS.pack(STATISTICS.size + len(rest), *self.fixed[1:]) + rest

    def shown(self, mark: Mark, photons: int) -> "FlowStatistics":
        """Return what a controller sees of a light entry."""
        fixed = list(self.fixed)
        fixed[5], fixed[10], fixed[11] = mark.idle_timeout_s, photons, 0
        return FlowStatistics(
            tuple(fixed), self.match, Instructions(self.instructions.without_mark())
        )


@strict
def flow_statistics(message: bytes) -> list[FlowStatistics]:
    """Return the entries in a reply to OFPMP_FLOW."""
    entries, offset = [], multipart.BODY
    while offset < len(message):
        fixed = STATISTICS.unpack_from(message, offset)
        if not STATISTICS.size <= fixed[0] <= len(message) - offset:
            raise MalformedPacket(f"flow statistics with length {fixed[0]}")
        rest = message[offset + STATISTICS.size : offset + fixed[0]]
        match, instructions = matches.split(rest)
        entries.append(FlowStatistics(fixed, match, Instructions(instructions)))
        offset += fixed[0]
    return entries


@dataclass(frozen=True)
class FlowRemoved:
    """A FLOW_REMOVED."""

    fixed: tuple[int, ...]  # as in GONE
    match: bytes

    @classmethod
    @strict
    def decode(cls, message: bytes) -> Self:
        """Read a FLOW_REMOVED."""
        match, _rest = matches.split(message[HEADER.size + GONE.size :])
        return cls(GONE.unpack_from(message, HEADER.size), match)

    @property
    def table(self) -> int:
        """The table it was in."""
        return self.fixed[3]

    @property
    def key(self) -> tuple[int, bytes, int]:
        """Priority, match and cookie."""
        return self.fixed[1], self.match, self.fixed[0]

    def shown(self, message: bytes, mark: Mark, photons: int, idle: bool) -> bytes:
        """Return the message as a controller sees it, if a light entry was removed."""
        fixed = list(self.fixed)
        if idle:
            fixed[2] = ofp.OFPRR_IDLE_TIMEOUT
        fixed[6], fixed[8], fixed[9] = mark.idle_timeout_s, photons, 0
        return with_body(message, GONE.pack(*fixed) + matches.join(self.match))


def delete_strict(one: FlowEntry, xid: int) -> bytes:
    """Return the FLOW_MOD that deletes this entry of table 0 and no other."""
    fixed = MOD.pack(
        one.cookie,
        0xFFFFFFFFFFFFFFFF,
        0,
        ofp.OFPFC_DELETE_STRICT,
        0,
        0,
        one.priority,
        ofp.OFP_NO_BUFFER,
        ofp.OFPP_ANY,
        ofp.OFPG_ANY,
        0,
        0,
    )
    return encode(ofp.OFPT_FLOW_MOD, xid, fixed + matches.join(one.match))
