"""A message of coins: how many were thrown so far, and how many fell alike."""

import struct
from dataclasses import dataclass

from qmn.services import MalformedPacket

TOPIC = 200  # of its envelopes; qmn's own are below FREE_TOPIC of wire/metadata/values.py, 128
FIELDS = struct.Struct("!II")


@dataclass(frozen=True)
class Tally:
    thrown: int
    agreed: int

    def encode(self) -> bytes:
        return FIELDS.pack(self.thrown, self.agreed)

    @classmethod
    def decode(cls, content: bytes) -> "Tally":
        """Return the message of an envelope; raise MalformedPacket for another."""
        if len(content) != FIELDS.size:
            raise MalformedPacket(f"tally of {len(content)} bytes, not {FIELDS.size}")
        tally = cls(*FIELDS.unpack(content))
        if tally.agreed > tally.thrown:
            raise MalformedPacket(f"tally: {tally.agreed} of {tally.thrown} agreed")
        return tally
