"""Analysers and memories of switches as bytes: their counts, and the frames they send.

A frame is Ethernet with the type of local experiments, as IP would need an address of the switch:

    address of receiver (6), of the inner port (6), type (2)
    "QMNA", end (1), method of a round (1), outcomes in this frame (2)
    inner port (4), number (4), pulses of the block (4), the first of them in this frame (4)
    how long halves waited in memories until they were measured, in us, on average; of a station
    the attempts (4)
    two outcomes a byte, the first in its high bits: a Bell state, or 15 without a coincidence

A round of purification has the method 2 BBPSSW or 4 DEJMPS, and 1 more at the right end of its
pairs. Each of its outcomes is a Pauli operator, and 4 for each third of a turn of a twirl.

All numbers are in network byte order. The frames of one block have the same number, by which the
analyser counts blocks from 1.
"""

import struct
from collections.abc import Hashable, Iterator
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Literal, Self

from wire.malformed import MalformedPacket
from wire.optical import EXPERIMENTER
from wire.outcomes import NO_COINCIDENCE

ETHER_TYPE = b"\x88\xb5"  # IEEE 802, local experimental EtherType 1
HERALDS = b"\x88\xb6"  # local experimental EtherType 2: of what a memory holds now
BROADCAST = b"\xff" * 6
MAGIC, EMIT = b"QMNA", b"QMNE"
HEAD = struct.Struct("!4sBBHIIIII")
ETHERNET_BYTES, LEAST_PAYLOAD, MOST_PAYLOAD = 14, 46, 1500
MOST_OUTCOMES = 2 * (MOST_PAYLOAD - HEAD.size)
MOST_PULSES = 1 << 24
MOST = (1 << 32) - 1
PLACES = b"\x02\0\0\0\0"  # of a chain: what the address of an analyser's frame begins with
# Four bits of each outcome are a hexadecimal digit.
SYMBOLS = bytes([*range(12), NO_COINCIDENCE])
DIGITS = bytes.maketrans(SYMBOLS, b"0123456789abf")
OUTCOMES = bytes.maketrans(b"0123456789abf", SYMBOLS)
THIRD = 4  # of an outcome, beside its Pauli operator
METHODS = range(2, 6)  # of rounds of purification: protocol and end
MAX_UNDER_WAY = 4  # blocks of one chain, at once
LocalGate = Literal["H", "S", "S_DAG"]
PHOTONS = 2  # that go into one of purification
# Rotations that leave Phi+ as it is and exchange the other Bell states, at the left end; the other
# has the complex conjugate of each gate. By a third of the pairs each, and Pauli operators, twirl.
CYCLES: tuple[tuple[tuple[LocalGate, ...], ...], ...] = (
    ((), ("S", "H"), ("H", "S_DAG")),
    ((), ("S_DAG", "H"), ("H", "S")),
)
# A quarter turn about X at the left end, and back at the right one.
QUARTER_TURNS: tuple[tuple[LocalGate, ...], ...] = (("H", "S", "H"), ("H", "S_DAG", "H"))
CUT_OFF = struct.Struct("!HHIIQ")  # of a PORT_MOD: type, length, experimenter, its type; ns
CUT_OFF_HEAD = CUT_OFF.pack(0xFFFF, CUT_OFF.size, EXPERIMENTER, 2, 0)[:12]


class End(IntEnum):
    """How light has ended at an analyser (wire/dispatcher.proto, BellOutcomes)."""

    MEASURED = 0
    NO_PARTNER = 1
    CLOSED = 2
    UNFIT = 3
    CUT_OFF = 4  # in a memory
    STORED = 5  # no end: a memory holds it now
    FAILED = 6
    HERALDED = 7  # no end: a station has made pairs, in these Bell states
    WAITS = 8  # no end: qubits attempt by one input of it, and none by the other yet
    PURIFY = 9  # to a memory, or to the host of a chain, which without a method has its last pairs
    PURIFIED = 10  # its answer: what it has measured of each pair that is left


MEASURING = End.MEASURED, End.HERALDED  # of these a block may have no pulse
ROUNDS = End.PURIFY, End.PURIFIED
WITH_OUTCOMES = *MEASURING, End.STORED, *ROUNDS
TO_CONTROLLERS = End.STORED, End.WAITS, *ROUNDS  # by a type of their own
COUNTED = End.NO_PARTNER, End.CLOSED, End.UNFIT, End.FAILED  # of an analyser


class Receivers(IntEnum):
    """Hosts of a session that hear a frame of an inner port."""

    BOTH = 0
    OPENER = 1
    ACCEPTOR = 2
    CONTROLLER = 3  # of one of them


def group_of(session: int, to: Receivers = Receivers.BOTH) -> bytes:
    """Return the address of hosts of a session: of a group, administered locally."""
    return bytes([3 | to << 2]) + (session & (1 << 40) - 1).to_bytes(5)


def address_of_place(place: int) -> bytes:
    """Return the address of the frames of a chain's analyser, by its place from the opener on."""
    return PLACES + bytes([place])


@dataclass(frozen=True)
class AnalyserFrame:
    """The outcomes of a block, or of a part of it."""

    port: int
    number: int
    end: End
    pulses: int
    first: int = 0
    outcomes: bytes = b""  # one byte for each pulse: a Bell state, NO_COINCIDENCE without one
    waited_us: int = 0  # by each half until it was measured, on average; HERALDED: attempts
    method: int = 0  # of a round of purification

    def encode(self, receiver: bytes, sender: bytes) -> bytes:
        """Return the frame, padded as Ethernet wants it."""
        count = len(self.outcomes)
        packed = bytes.fromhex((self.outcomes.translate(DIGITS) + b"0" * (count % 2)).decode())
        waited_us = min(self.waited_us, MOST)
        port, number, pulses, first = self.port, self.number, self.pulses, self.first
        head = HEAD.pack(
            MAGIC, self.end, self.method, count, port, number, pulses, first, waited_us
        )
        kind = HERALDS if self.end in TO_CONTROLLERS else ETHER_TYPE
        return receiver + sender + kind + (head + packed).ljust(LEAST_PAYLOAD, b"\0")

    @classmethod
    def decode(cls, frame: bytes) -> Self:
        """Read a frame; raise MalformedPacket for any other."""
        payload = frame[ETHERNET_BYTES:]
        kind = frame[12:ETHERNET_BYTES]
        if kind not in (ETHER_TYPE, HERALDS) or len(payload) < LEAST_PAYLOAD:
            raise MalformedPacket(f"no frame of an analyser in {len(frame)} bytes")
        magic, end, method, count, port, number, pulses, first, us = HEAD.unpack_from(payload)
        size = HEAD.size + (count + 1) // 2
        wrong = end > max(End) or (end in TO_CONTROLLERS) != (kind == HERALDS)
        wrong |= bool(method) and (end != End.PURIFY or method not in METHODS)
        if magic != MAGIC or wrong or count > MOST_OUTCOMES:
            raise MalformedPacket(f"frame of an analyser that begins {payload[:8].hex()}")
        least = end not in MEASURING  # of two blocks that meet one may have no pulse left
        if not least <= pulses <= MOST_PULSES or first + count > pulses or not port or not number:
            raise MalformedPacket(f"outcomes {first} to {first + count} of {pulses} pulses")
        if (end in WITH_OUTCOMES and pulses > 0) != (count > 0):
            raise MalformedPacket(f"{count} outcomes of light that has ended as {End(end).name}")
        if len(payload) != max(size, LEAST_PAYLOAD) or any(payload[size:]):
            raise MalformedPacket(f"{len(payload)} bytes for {count} outcomes")
        allowed = b"0123456789abf" if method else b"0123f"
        outcomes = _outcomes(payload[HEAD.size : size], count, allowed)
        return cls(port, number, End(end), pulses, first, outcomes, us, method)


def _outcomes(packed: bytes, count: int, allowed: bytes) -> bytes:
    digits = packed.hex().encode()
    if digits[:count].translate(None, allowed) or digits[count:].strip(b"0"):
        raise MalformedPacket("an outcome other than a Bell state")
    return digits[:count].translate(OUTCOMES)


def frames_of(report: AnalyserFrame) -> Iterator[AnalyserFrame]:
    for first in range(0, max(len(report.outcomes), 1), MOST_OUTCOMES):
        outcomes = report.outcomes[first : first + MOST_OUTCOMES]
        yield replace(report, first=first, outcomes=outcomes)


class Parts:
    """Frames of blocks, put together by the places that they come from."""

    def __init__(self) -> None:
        self._begun: dict[Hashable, AnalyserFrame] = {}

    def whole(self, place: Hashable, frame: AnalyserFrame) -> AnalyserFrame | None:
        """Return all of a block with its last frame, None before; MalformedPacket: one is lost."""
        begun = self._begun.pop(place, None) if frame.first else None
        before = begun.outcomes if begun and begun.number == frame.number else b""
        if frame.first != len(before):
            text = f"outcome {frame.first} of number {frame.number} comes behind {len(before)}"
            raise MalformedPacket(text)
        whole = replace(frame, first=0, outcomes=before + frame.outcomes)
        if len(whole.outcomes) >= whole.pulses:
            return whole
        self._begun[place] = whole
        return None


@dataclass(frozen=True)
class Emission:
    """A controller's frame to the port of a source, or of a memory that emits: make pairs."""

    FIELDS = struct.Struct("!4sQIIII")

    session: int  # with the number the name of the block
    number: int
    pairs: int
    rate_hz: int
    frequency_mhz: int

    def encode(self) -> bytes:
        payload = self.FIELDS.pack(EMIT, *vars(self).values())
        return BROADCAST + bytes(6) + ETHER_TYPE + payload.ljust(LEAST_PAYLOAD, b"\0")

    @classmethod
    def decode(cls, frame: bytes) -> Self:
        """Read a frame; raise MalformedPacket for any other."""
        body = frame[ETHERNET_BYTES:]
        if len(body) != LEAST_PAYLOAD or frame[12:ETHERNET_BYTES] != ETHER_TYPE:
            raise MalformedPacket(f"nothing that a source emits by in {len(frame)} bytes")
        magic, *fields = cls.FIELDS.unpack_from(body)
        emission = cls(*fields)
        if magic != EMIT or not emission.pairs or any(body[cls.FIELDS.size :]):
            raise MalformedPacket(f"frame to a source that begins {body[:24].hex()}")
        return emission


@dataclass
class AnalyserCounts:
    """Counts of an analyser, or station, since the network began."""

    FIELDS = struct.Struct("!I4x11Q")

    port: int  # of its first input
    pulses: int = 0  # that met, or pairs that were heralded
    phi_plus: int = 0
    psi_plus: int = 0
    phi_minus: int = 0
    psi_minus: int = 0
    none: int = 0  # pulses without an outcome
    no_partner: int = 0  # blocks
    closed: int = 0
    unfit: int = 0
    failed: int = 0  # blocks that came to it, or were there, when it had failed
    attempts: int = 0  # of all blocks of pairs that were heralded

    def add(self, end: End, outcomes: bytes = b"", attempts: int = 0) -> None:
        """Count a block that has ended so, with one byte for each pulse."""
        self.pulses += len(outcomes)
        for name, outcome in (("phi_plus", 0), ("psi_plus", 1), ("phi_minus", 2), ("psi_minus", 3)):
            setattr(self, name, getattr(self, name) + outcomes.count(outcome))
        self.none += outcomes.count(NO_COINCIDENCE)
        self.attempts += attempts
        if end in COUNTED:
            name = end.name.lower()
            setattr(self, name, getattr(self, name) + 1)

    def encode(self) -> bytes:
        return self.FIELDS.pack(*vars(self).values())


@dataclass(frozen=True)
class MemoryCounts:
    """A memory now, and its photons since the network began."""

    FIELDS = struct.Struct("!IIQ4Q16x")

    port: int
    held: int
    oldest_ns: int  # age of the first of them; 0: there is none
    stored: int
    released: int
    cut_off: int  # nothing released them in time
    refused: int  # there was no room

    def encode(self) -> bytes:
        return self.FIELDS.pack(*vars(self).values())
