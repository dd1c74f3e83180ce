"""Logical features: what a node can do, whatever it is made of (paper, section "Middleware").

A host announces them by LLDP, in an organizationally specific TLV of ours (wire.lldp):

    +---------+----------+---------------+
    | subtype | features | memory_qubits |   u8, u8 (Feature), u32; network byte order
    +---------+----------+---------------+
"""

import struct
from dataclasses import dataclass
from enum import Flag

from wire.malformed import MalformedPacket

_FIELDS = struct.Struct("!BI")


class Feature(Flag):
    """The capabilities of a node for qubits."""

    EMIT = 1  # make photons, entangled with each other or with what it keeps
    STORE = 2  # keep qubits in a memory
    GATE = 4  # do gates on qubits that it holds, also between two; Pauli operators need no feature
    MEASURE = 8  # measure qubits that it holds, and light that arrives; also in the Bell basis
    HERALD = 16  # keep qubits that emit photons entangled with them, which a station may herald
    INTERFERE = 32  # let light from two hosts interfere, and tell what clicked
    ABSORB = 64  # take light that comes from elsewhere into the memory


EMIT, STORE, GATE, MEASURE, HERALD, INTERFERE, ABSORB = Feature
NOTHING = Feature(0)
EVERYTHING = EMIT | STORE | GATE | MEASURE | HERALD | INTERFERE | ABSORB


@dataclass(frozen=True)
class NodeFeatures:
    """The features of a node, and how many qubits its memory takes (0 without STORE)."""

    features: Feature
    memory_qubits: int

    def encode(self) -> bytes:
        """Return them as a host announces them, without OUI and subtype."""
        return _FIELDS.pack(self.features.value, self.memory_qubits)

    @classmethod
    def decode(cls, data: bytes) -> "NodeFeatures":
        """Read a host's announcement; raise MalformedPacket for impossible features."""
        if len(data) != _FIELDS.size:
            raise MalformedPacket(f"features in {len(data)} bytes, not {_FIELDS.size}")
        return cls.checked(*_FIELDS.unpack(data))

    @classmethod
    def checked(cls, bits: int, memory_qubits: int) -> "NodeFeatures":
        """Return what another node says of itself; raise MalformedPacket for what none can be."""
        if bits > EVERYTHING.value:
            raise MalformedPacket(f"features {bits:#04x}, of which {EVERYTHING.value:#04x} exist")
        features = Feature(bits)
        if bool(memory_qubits) != (STORE in features):
            raise MalformedPacket(f"{names(features)} with a memory of {memory_qubits} qubits")
        return cls(features, memory_qubits)

    def both(self, other: "NodeFeatures") -> "NodeFeatures":
        fewer = min(self.memory_qubits, other.memory_qubits)
        return NodeFeatures(self.features & other.features, fewer)


def names(features: Feature) -> str:
    """Return what people call these features: "emit, store"."""
    return ", ".join(str(feature.name).lower() for feature in features) or "nothing"
