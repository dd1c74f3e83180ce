"""Instructions and actions as bytes, and the mark that a light entry carries among them.

The mark is Open vSwitch's action `note`, which does nothing: it holds the idle time-out that
the controller asked for and the number under which photons are counted. So both outlive the
agent, and the bridge's table stays the only truth. The bridge itself never expires a light
entry for idleness: no packets flow through it.
"""

import struct
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple, Self

from os_ken.ofproto import ofproto_v1_4 as ofp

from qswitch_agent.openflow.messages import each_part, strict
from wire.metadata import MalformedPacket

INSTRUCTION = struct.Struct("!HH4x")  # type, length
OUTPUT = struct.Struct("!HHIH6x")  # type, length, port, bytes for a controller
NOTE = struct.Struct("!HHIH")  # experimenter, length, Nicira, note
MARK = struct.Struct("!HI")  # idle time-out, circuit
NICIRA, NICIRA_NOTE = 0x00002320, 8
NOTE_SIZE = NOTE.size + MARK.size
NOTE_HEAD = NOTE.pack(ofp.OFPAT_EXPERIMENTER, NOTE_SIZE, NICIRA, NICIRA_NOTE)
MAX_REMEMBERED = 256  # bytes of instructions; longer ones would fill the memory
ACTION_LISTS = (ofp.OFPIT_APPLY_ACTIONS, ofp.OFPIT_WRITE_ACTIONS)


@dataclass(frozen=True)
class Mark:
    """What the bridge's table holds for the agent in a light entry."""

    idle_timeout_s: int  # that the controller asked for; 0: none
    circuit: int  # photons are counted under this number; 0 is none

    def encode(self) -> bytes:
        """Return the note action."""
        return NOTE_HEAD + MARK.pack(self.idle_timeout_s, self.circuit)

    @classmethod
    def decode(cls, action: bytes) -> Self | None:
        """Return the mark that an action is, None if it is another action."""
        if len(action) != NOTE_SIZE or not action.startswith(NOTE_HEAD):
            return None
        return cls(*MARK.unpack_from(action, NOTE.size))


class Instructions(NamedTuple):
    """The instructions of an entry, taken apart by `parse`."""

    data: bytes
    kinds: tuple[int, ...]  # types of the instructions
    actions: tuple[tuple[int, bytes], ...]  # types and bytes of the actions of all of them
    outputs: tuple[int, ...]  # ports that actions output to
    mark: Mark | None  # among the actions

    def without_mark(self) -> bytes:
        """Return the instructions as a controller gave them."""
        parts = each_part(self.data, 4, "instruction")
        return b"".join(_clean(kind, body) for kind, body in parts)


def _parts(data: bytes) -> Instructions:
    parts = each_part(data, 4, "instruction")
    actions: list[tuple[int, bytes]] = []
    for kind, body in parts:
        if kind in ACTION_LISTS:
            if len(body) < INSTRUCTION.size:
                raise MalformedPacket("instruction is cut short")
            actions += each_part(body[INSTRUCTION.size :], 8, "action")
    marks = [mark for _, one in actions if (mark := Mark.decode(one))]
    return Instructions(
        data,
        tuple(kind for kind, _body in parts),
        tuple(actions),
        tuple(output_ports(actions)),
        marks[0] if marks else None,
    )


_remembered = lru_cache(maxsize=4096)(_parts)


def parse(data: bytes) -> Instructions:
    """Return instructions taken apart, each once: the bridge reports what it was told."""
    return _remembered(data) if len(data) <= MAX_REMEMBERED else _parts(data)


def _clean(kind: int, body: bytes) -> bytes:
    if kind not in ACTION_LISTS:
        return body
    actions = [one for _, one in each_part(body[INSTRUCTION.size :], 8, "action")]
    return _instruction(kind, b"".join(one for one in actions if not Mark.decode(one)))


@strict
def output_ports(actions: Iterable[tuple[int, bytes]]) -> list[int]:
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
