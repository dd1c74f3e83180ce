"""Instructions and actions as bytes, and the mark that a light entry carries among them.

The mark is Open vSwitch's action `note`, which does nothing: it holds the idle time-out that
the controller asked for and the number under which photons are counted. So both outlive the
agent, and the bridge's table stays the only truth. The bridge itself never expires a light
entry for idleness: no packets flow through it.
"""

import struct
from dataclasses import dataclass
from functools import cached_property
from typing import Self

from os_ken.ofproto import ofproto_v1_4 as ofp

from qswitch_agent.openflow.messages import each_part, strict
from wire.metadata import MalformedPacket

INSTRUCTION = struct.Struct("!HH4x")  # type, length
OUTPUT = struct.Struct("!HHIH6x")  # type, length, port, bytes for a controller
NOTE = struct.Struct("!HHIHHI")  # experimenter, length, Nicira, note, then the mark
NICIRA, NICIRA_NOTE = 0x00002320, 8
ACTION_LISTS = (ofp.OFPIT_APPLY_ACTIONS, ofp.OFPIT_WRITE_ACTIONS)


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
