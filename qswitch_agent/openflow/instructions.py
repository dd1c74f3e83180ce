"""Instructions and actions as bytes, and the mark that a light entry carries among them.

The mark is Open vSwitch's action `note`, which does nothing: it holds the idle time-out that
the controller asked for and the number under which photons are counted. So both outlive the
agent, and the bridge's table stays the only truth. The bridge itself never expires a light
entry for idleness: no packets flow through it.
"""

import struct
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

from qswitch_agent.openflow import constants as ofp
from qswitch_agent.openflow.messages import MalformedPart, each_part

INSTRUCTION = struct.Struct("!HH4x")  # type, length
OUTPUT = struct.Struct("!HHIH6x")  # type, length, port, bytes for a controller
NOTE = struct.Struct("!HHIH")  # experimenter, length, Nicira, note
MARK = struct.Struct("!HI")  # idle time-out, circuit
NICIRA, NICIRA_NOTE = 0x00002320, 8
NOTE_SIZE = NOTE.size + MARK.size
NOTE_HEAD = NOTE.pack(ofp.OFPAT_EXPERIMENTER, NOTE_SIZE, NICIRA, NICIRA_NOTE)
MAX_REMEMBERED = 256  # bytes of instructions; longer ones would fill the memory
MOST_REMEMBERED = 4096
APPLY = ofp.OFPIT_APPLY_ACTIONS
ACTION_LISTS = (APPLY, ofp.OFPIT_WRITE_ACTIONS)


LENGTHS = {
    ofp.OFPIT_GOTO_TABLE: 8,
    ofp.OFPIT_WRITE_METADATA: 24,
    ofp.OFPIT_CLEAR_ACTIONS: 8,
    ofp.OFPIT_METER: 8,
}
KNOWN = {*LENGTHS, *ACTION_LISTS}
ADDED = 1 << 31  # of a circuit in a mark: the instruction around it is the agent's, too


@dataclass(frozen=True)
class Mark:
    """The agent's mark in a light entry of the bridge's table."""

    idle_timeout_s: int  # that the controller asked for; 0: none
    circuit: int  # photons are counted under this number; 0 is none
    added: bool = False  # the controller gave no APPLY_ACTIONS that the mark could be in

    def encode(self) -> bytes:
        return NOTE_HEAD + MARK.pack(self.idle_timeout_s, self.circuit | ADDED * self.added)

    @classmethod
    def decode(cls, action: bytes) -> Self | None:
        if len(action) != NOTE_SIZE or not action.startswith(NOTE_HEAD):
            return None
        idle_timeout_s, circuit = MARK.unpack_from(action, NOTE.size)
        return cls(idle_timeout_s, circuit & ~ADDED, bool(circuit & ADDED))


class Instructions(NamedTuple):
    """The instructions of an entry, taken apart by `parse`."""

    data: bytes
    kinds: tuple[int, ...]  # types of the instructions
    actions: tuple[tuple[int, bytes], ...]  # types and bytes of the actions of all of them
    outputs: tuple[int, ...]  # ports that actions output to
    mark: Mark | None  # among the actions

    def with_mark(self, mark: Mark) -> "Instructions":
        if self.kinds != (APPLY,):
            return parse(self._with_mark_among(mark))
        # As light entries are: nothing has to be decoded again.
        note = mark.encode()
        data = _instruction(APPLY, note + self.data[INSTRUCTION.size :])
        actions = ((ofp.OFPAT_EXPERIMENTER, note), *self.actions)
        return _remember(self._replace(data=data, actions=actions, mark=mark))

    def _with_mark_among(self, mark: Mark) -> bytes:
        parts = each_part(self.data, 4, "instruction")
        applied = [body[INSTRUCTION.size :] for kind, body in parts if kind == APPLY]
        mark = replace(mark, added=not applied)
        others = b"".join(body for kind, body in parts if kind != APPLY)
        return _instruction(APPLY, mark.encode() + b"".join(applied)) + others

    def without_mark(self) -> bytes:
        parts = each_part(self.data, 4, "instruction")
        if self.mark is not None and self.mark.added:
            return b"".join(body for kind, body in parts if kind != APPLY)
        return b"".join(_clean(kind, body) for kind, body in parts)


def _parts(data: bytes) -> Instructions:
    parts = each_part(data, 4, "instruction")
    actions: list[tuple[int, bytes]] = []
    kinds = [kind for kind, _body in parts]
    for kind, body in parts:
        if kind in ACTION_LISTS:
            if len(body) < INSTRUCTION.size:
                raise _bad(ofp.OFPBIC_BAD_LEN, "instruction is cut short")
            actions += each_action(body[INSTRUCTION.size :])
        elif len(body) != LENGTHS.get(kind, len(body)):
            raise _bad(ofp.OFPBIC_BAD_LEN, f"instruction {kind} of {len(body)} bytes")
        if kind != ofp.OFPIT_EXPERIMENTER and kinds.count(kind) > 1:
            raise _bad(ofp.OFPBIC_DUP_INST, f"instruction {kind} occurs twice")
    marks = [mark for _, one in actions if (mark := Mark.decode(one))]
    return Instructions(
        data,
        tuple(kinds),
        tuple(actions),
        tuple(output_ports(actions)),
        marks[0] if marks else None,
    )


_remembered: dict[bytes, Instructions] = {}


def parse(data: bytes) -> Instructions:
    """Return decoded instructions, each decoded once: the bridge reports the same bytes."""
    return _remembered.get(data) or _remember(_parts(data))


def _remember(one: Instructions) -> Instructions:
    if len(one.data) <= MAX_REMEMBERED:
        if len(_remembered) >= MOST_REMEMBERED:
            _remembered.clear()
        _remembered[one.data] = one
    return one


def each_action(data: bytes) -> list[tuple[int, bytes]]:
    """Return type and bytes of each action of a list; lengths are multiples of 8."""
    actions = each_part(data, 8, "action")
    for kind, body in actions:
        if len(body) % 8 or (kind == ofp.OFPAT_OUTPUT and len(body) != OUTPUT.size):
            raise MalformedPart(
                ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_LEN, f"action {kind} of {len(body)} bytes"
            )
    return actions


def _clean(kind: int, body: bytes) -> bytes:
    if kind not in ACTION_LISTS:
        return body
    actions = [one for _, one in each_part(body[INSTRUCTION.size :], 8, "action")]
    return _instruction(kind, b"".join(one for one in actions if not Mark.decode(one)))


def output_ports(actions: Iterable[tuple[int, bytes]]) -> list[int]:
    return [OUTPUT.unpack_from(body)[2] for kind, body in actions if kind == ofp.OFPAT_OUTPUT]


def _instruction(kind: int, actions: bytes) -> bytes:
    return INSTRUCTION.pack(kind, INSTRUCTION.size + len(actions)) + actions


def _bad(code: int, reason: str) -> MalformedPart:
    return MalformedPart(ofp.OFPET_BAD_INSTRUCTION, code, reason)
