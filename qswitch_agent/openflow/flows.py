"""Flow entries as bytes: FLOW_MOD, and what the agent needs to know of an entry."""

import struct
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

from qswitch_agent.openflow import constants as ofp
from qswitch_agent.openflow import instructions, matches
from qswitch_agent.openflow.instructions import (
    ACTION_LISTS,
    Instructions,
    Mark,
)
from qswitch_agent.openflow.messages import HEADER, encode, strict

MOD = struct.Struct(ofp.OFP_FLOW_MOD_PACK_STR0)


class FlowMod(NamedTuple):
    """A FLOW_MOD; its first fields are in the order of MOD."""

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
        fixed: tuple[int, ...] = MOD.unpack_from(message, HEADER.size)
        match, data = matches.split(message[HEADER.size + MOD.size :])
        matches.parse(match)
        return cls._make((*fixed, match, instructions.parse(data)))

    def encode(self, xid: int) -> bytes:
        body = MOD.pack(*self[:-2]) + matches.join(self.match) + self.instructions.data
        return encode(ofp.OFPT_FLOW_MOD, xid, body)

    @property
    def fields(self) -> matches.Fields:
        return matches.parse(self.match)

    @property
    def deletes(self) -> bool:
        return self.command in (ofp.OFPFC_DELETE, ofp.OFPFC_DELETE_STRICT)

    @property
    def strict(self) -> bool:
        return self.command in (ofp.OFPFC_MODIFY_STRICT, ofp.OFPFC_DELETE_STRICT)

    def marked(self, mark: Mark) -> "FlowMod":
        """Return the message to the bridge: the mark instead of the idle time-out.

        The match is written as the bridge reports it, so that both are one entry to the agent.
        """
        in_port = matches.in_port(self.fields)
        assert in_port is not None
        return self._replace(
            idle_timeout_s=0,
            match=matches.of_port(in_port),
            instructions=self.instructions.with_mark(mark),
        )


@dataclass(frozen=True)
class FlowEntry:
    """A flow entry, as the agent needs it; priority and match identify it."""

    priority: int
    match: bytes  # the OXM fields as they were sent
    in_port: int | None  # None: any
    other_fields: bool  # the match asks for more than the port
    out_port: int | None  # None: the entry does anything but output to one port
    cookie: int = 0
    mark: Mark | None = None

    @property
    def key(self) -> tuple[int, bytes]:
        return self.priority, self.match

    def __str__(self) -> str:
        more = " and more" if self.other_fields else ""
        action = "other actions" if self.out_port is None else f"output to {self.out_port:#x}"
        return f"priority {self.priority}, in_port {self.in_port}{more} -> {action}"


def entry(priority: int, match: bytes, does: Instructions, cookie: int) -> FlowEntry:
    short = max(len(match), len(does.data)) <= matches.MAX_REMEMBERED
    return (_remembered if short else _entry)(priority, match, does.data, cookie)


def _entry(priority: int, match: bytes, data: bytes, cookie: int) -> FlowEntry:
    fields, does = matches.parse(match), instructions.parse(data)
    mark = does.mark
    only = all(kind in ACTION_LISTS for kind in does.kinds)
    outputs = does.outputs
    one = only and len(does.actions) - (mark is not None) == 1 == len(outputs)
    return FlowEntry(
        priority,
        match,
        matches.in_port(fields),
        bool(fields.keys() - {matches.IN_PORT}),
        outputs[0] if one else None,
        cookie,
        mark,
    )


_remembered = lru_cache(maxsize=4096)(_entry)


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
