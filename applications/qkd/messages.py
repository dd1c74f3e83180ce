"""Classical messages of quantum key distribution, each with its authentication tag.

    0       2    3    4        8                16         20
    +-------+----+----+--------+----------------+----------+---------------------+----------+
    | magic |ver |kind| length | session        | sequence | fields of the kind  | tag (16) |
    +-------+----+----+--------+----------------+----------+---------------------+----------+

Network byte order. `length` counts the whole message; the tag covers all that stands before
it. `sequence` counts the messages of one direction from 0. Bit strings are packed, first bit
highest, and their padding is 0. For their purpose see docs/key-distillation.md.
"""

import struct
from collections.abc import Mapping
from dataclasses import dataclass, fields
from enum import IntEnum
from types import MappingProxyType
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from wire import gaps
from wire.malformed import MalformedPacket

MAGIC = 0x514B  # "QK"
VERSION = 1
HEADER = struct.Struct("!HBBIQI")
TAG_BYTES = 16
MAX_PHOTONS = 1_000_000  # in one block, detected ones or all
MAX_PULSES = (1 << 32) - 1  # in one block; of these MAX_PHOTONS are detected at most
MAX_KEY_BITS = 1 << 20  # sifted bits in one session
MAX_LENGTH = 1 << 21
MAX_MEAN = 10  # photons in a pulse
MAX_TEXT = 1000  # bytes
START_BYTES, WIDTH_BYTES = 4, 2  # of an interval in AskIntervals

E = TypeVar("E", bound=IntEnum)


class Bound(IntEnum):
    """How the length of the final key is computed."""

    FINITE = 1  # secure for the number of bits there are
    ASYMPTOTIC = 2  # as if there were infinitely many: to compare with theory


class Reconciliation(IntEnum):
    CASCADE = 1
    LDPC = 2


class AbortReason(IntEnum):
    """Why a session ended without a key."""

    MALFORMED = 1  # bytes that are not a message
    FORGED = 2  # the tag is wrong: changed, replayed, or out of its turn
    PROTOCOL = 3  # a message that does not belong here
    PARAMETERS = 4  # the ends are set up differently
    NOISY = 5  # error rate above the threshold
    NOT_CORRECTED = 6  # verification found different keys
    TOO_SHORT = 7  # no secret bit is left
    NO_AUTHENTICATION_KEY = 8
    CANCELLED = 9
    LOCAL = 10  # the CHSH test does not exclude local hidden variables


@dataclass(frozen=True)
class Packed:
    """An array behind the fixed fields: unsigned numbers of `width` bits each, without gaps."""

    name: str
    count: str  # the field that says how many, or the bits before it whose ones are as many
    width: int = 1


@dataclass(frozen=True)
class QkdMessage:
    """Fixed fields, then arrays; a kind with more to check overrides check."""

    KIND: ClassVar[int]
    FIELDS: ClassVar[struct.Struct]
    RANGES: ClassVar[Mapping[str, tuple[int, int]]] = MappingProxyType({})  # least and most
    PACKED: ClassVar[tuple[Packed, ...]] = ()

    def encode(self) -> bytes:
        """Return the fields as they go onto the wire, without header and tag."""
        values = vars(self).copy()
        arrays = [values.pop(packed.name) for packed in self.PACKED]
        return self.FIELDS.pack(*values.values()) + b"".join(arrays)

    @classmethod
    def parse(cls, body: bytes) -> "QkdMessage":
        """Build the message from its body; raise MalformedPacket if it does not fit."""
        values, rest = cls._fixed(body)
        for packed in cls.PACKED:
            count = values[packed.count]
            ones = int.from_bytes(count).bit_count() if isinstance(count, bytes) else count
            size = _bytes_for(bits := packed.width * ones)
            values[packed.name], rest = rest[:size], rest[size:]
            _check_bits(cls, values[packed.name], bits)
        if rest:
            raise MalformedPacket(f"{cls.__name__}: {len(rest)} bytes too many")
        return cls._checked(values)

    @classmethod
    def _fixed(cls, body: bytes) -> tuple[dict[str, Any], bytes]:
        if len(body) < cls.FIELDS.size:
            raise MalformedPacket(f"{cls.__name__}: {len(body)} bytes are too few")
        fixed = cls.FIELDS.unpack_from(body)
        values = dict(zip([item.name for item in fields(cls)], fixed, strict=False))
        for name, (least, most) in cls.RANGES.items():
            _check_count(f"{cls.__name__}: {name}", values[name], most, least)
        return values, body[cls.FIELDS.size :]

    @classmethod
    def _checked(cls, values: dict[str, Any]) -> "QkdMessage":
        message = cls(**values)
        message.check()
        return message

    def check(self) -> None:
        """Raise MalformedPacket for fields that cannot be."""


@dataclass(frozen=True)
class Proposal(QkdMessage):
    """The parameters of the session at alice; bob's must be the same."""

    KIND = 1
    FIELDS = struct.Struct("!ddddBBddd")

    test_fraction: float
    max_qber: float
    eps_sec: float
    eps_cor: float
    bound: int
    reconciliation: int
    multi_photon: float  # how likely a pulse of alice's source has several photons
    chsh_fraction: float  # of bob's photons, for a CHSH test; 0: there is none
    chsh_margin: float  # by which S has to be above 2

    def check(self) -> None:
        for name in ("chsh_fraction", "chsh_margin", "multi_photon"):
            if not 0 <= (value := getattr(self, name)) < 1:
                raise MalformedPacket(f"Proposal: {name} {value} is not 0 to 1")
        fractions = self.test_fraction, self.max_qber, self.eps_sec, self.eps_cor
        if not all(0 < fraction < 1 for fraction in fractions):
            raise MalformedPacket(f"Proposal: {fractions} are not all between 0 and 1")
        _member(Bound, self.bound)
        _member(Reconciliation, self.reconciliation)


@dataclass(frozen=True)
class Detections(QkdMessage):
    """Which photons of a block were detected, and in which bases those were measured."""

    KIND = 2
    FIELDS = struct.Struct("!IIII")
    RANGES = MappingProxyType({"photons": (1, MAX_PULSES), "clicks": (0, MAX_PHOTONS)})
    PACKED = (Packed("gaps", "size", 8), Packed("bases", "clicks"))

    block: int
    photons: int
    clicks: int
    size: int  # bytes of gaps
    gaps: bytes  # which photons were detected (wire/gaps.py)
    bases: bytes  # a bit for each of them

    @property
    def clicked(self) -> NDArray[np.int64]:
        """Which photons were detected; raise MalformedPacket if the gaps tell others than these."""
        try:
            clicked = gaps.decode(self.gaps, self.photons)
        except ValueError as error:
            raise MalformedPacket(f"Detections: {error}") from error
        if clicked.size != self.clicks:
            raise MalformedPacket(f"Detections: gaps of {clicked.size} photons, not {self.clicks}")
        return clicked


@dataclass(frozen=True)
class Sifted(QkdMessage):
    """Which of the photons detected in a block are kept."""

    KIND = 3
    FIELDS = struct.Struct("!II")
    RANGES = MappingProxyType({"clicks": (0, MAX_PHOTONS)})
    PACKED = (Packed("kept", "clicks"),)

    block: int
    clicks: int
    kept: bytes  # a bit for each photon detected


@dataclass(frozen=True)
class Sample(QkdMessage):
    """End sifting: the seed that chooses the test sample, and alice's bits of it."""

    KIND = 4
    FIELDS = struct.Struct("!II32s")
    RANGES = MappingProxyType({"sifted": (1, MAX_KEY_BITS), "size": (1, MAX_KEY_BITS)})
    PACKED = (Packed("bits", "size"),)

    sifted: int  # bits in the whole session
    size: int  # bits disclosed
    seed: bytes
    bits: bytes

    def check(self) -> None:
        if self.size >= self.sifted:
            raise MalformedPacket(f"Sample: {self.size} of {self.sifted} bits")


@dataclass(frozen=True)
class _BitString(QkdMessage):
    FIELDS = struct.Struct("!I")
    RANGES = MappingProxyType({"count": (0, MAX_KEY_BITS)})
    PACKED = (Packed("bits", "count"),)

    count: int
    bits: bytes


class Disclosed(_BitString):
    """Bob's bits of the test sample."""

    KIND = 5


class Parities(_BitString):
    """The parities of alice's key that bob requested, in the order of his request."""

    KIND = 6


@dataclass(frozen=True)
class AskBlocks(QkdMessage):
    """Cascade: ask for the parities of all blocks of passes that begin."""

    KIND = 7
    FIELDS = struct.Struct("!BBI")

    first: int
    passes: int
    size: int  # bits of a block


@dataclass(frozen=True)
class AskIntervals(QkdMessage):
    """Cascade: ask for the parities of parts of blocks of one pass."""

    KIND = 8
    FIELDS = struct.Struct("!BI")
    RANGES = MappingProxyType({"count": (1, MAX_KEY_BITS)})
    PACKED = (
        Packed("starts", "count", 8 * START_BYTES),
        Packed("widths", "count", 8 * WIDTH_BYTES),
    )

    number: int  # of the pass
    count: int
    starts: bytes  # unsigned, START_BYTES each
    widths: bytes  # unsigned, WIDTH_BYTES each: bits of the part


@dataclass(frozen=True)
class AskSyndrome(QkdMessage):
    """LDPC: ask for the syndrome of the key under the code with this number of checks."""

    KIND = 9
    FIELDS = struct.Struct("!I")

    checks: int


@dataclass(frozen=True)
class Verify(QkdMessage):
    """Bob has corrected his key: a hash of it, under a hash key drawn just now."""

    KIND = 10
    FIELDS = struct.Struct("!32s16sII")

    hash_key: bytes
    tag: bytes
    leaked_bits: int
    errors: int  # bits that bob has put right


@dataclass(frozen=True)
class Amplify(QkdMessage):
    """The corrected keys agree: how long the final key is, and which matrix makes it."""

    KIND = 11
    FIELDS = struct.Struct("!II")
    RANGES = MappingProxyType({"length": (1, MAX_KEY_BITS), "count": (1, 2 * MAX_KEY_BITS)})
    PACKED = (Packed("seed", "count"),)

    length: int  # bits of the final key
    count: int
    seed: bytes  # of the Toeplitz matrix, count bits


@dataclass(frozen=True)
class Confirm(QkdMessage):
    """Bob holds the final key."""

    KIND = 12
    FIELDS = struct.Struct("!I")

    length: int


@dataclass(frozen=True)
class Abort(QkdMessage):
    """This session yields no key, with a text a person can act on."""

    KIND = 13
    FIELDS = struct.Struct("!B")

    reason: int
    text: str = ""

    def encode(self) -> bytes:
        """Return the fields as they go onto the wire; a text over MAX_TEXT bytes is cut."""
        text = self.text.encode()[:MAX_TEXT].decode(errors="ignore").encode()
        return self.FIELDS.pack(self.reason) + text

    @classmethod
    def parse(cls, body: bytes) -> "Abort":
        values, text = cls._fixed(body)
        _check_count("bytes of text", len(text), MAX_TEXT, least=0)
        try:
            return cls(_member(AbortReason, values["reason"]), text.decode())
        except UnicodeDecodeError as error:
            raise MalformedPacket(f"Abort: text is not UTF-8: {error}") from error


@dataclass(frozen=True)
class Intensities(QkdMessage):
    """Decoy states, before the sample: how many photons pulses had on average, and who had which.

    The sample is then all bits of the basis Z, and the key those of the basis X. Where both ends
    send pulses to a relay both tell theirs, bob before what he discloses: all bits of the basis X
    and a sample of the others.
    """

    KIND = 14
    FIELDS = struct.Struct("!ddddddI")
    RANGES = MappingProxyType({"count": (1, MAX_KEY_BITS)})
    PACKED = (Packed("levels", "count", 2),)

    signal_mean: float
    weak_mean: float
    vacuum_mean: float
    signal_share: float  # of the pulses
    weak_share: float
    vacuum_share: float
    count: int
    levels: bytes  # of each sifted bit: 0 signal, 1 weak, 2 vacuum

    @property
    def means(self) -> tuple[float, ...]:
        return self.signal_mean, self.weak_mean, self.vacuum_mean

    @property
    def shares(self) -> tuple[float, ...]:
        return self.signal_share, self.weak_share, self.vacuum_share

    def check(self) -> None:
        signal, weak, vacuum = self.means
        if not (0 <= vacuum < weak and weak + vacuum < signal <= MAX_MEAN):
            raise MalformedPacket(f"Intensities: {self.means} are not a signal and decoys")
        if not all(0 < share < 1 for share in self.shares) or abs(sum(self.shares) - 1) > 1e-9:
            raise MalformedPacket(f"Intensities: {self.shares} are not shares of the pulses")
        if any(byte & byte >> 1 & 0x55 for byte in self.levels):
            raise MalformedPacket("Intensities: a level is 3")


@dataclass(frozen=True)
class BellTest(QkdMessage):
    """Bob's part of the CHSH test, before the detections of a block: settings and outcomes."""

    KIND = 15
    FIELDS = struct.Struct("!II")
    RANGES = MappingProxyType({"photons": (1, MAX_PHOTONS)})
    PACKED = (Packed("tested", "photons"), Packed("settings", "tested"), Packed("bits", "tested"))

    block: int
    photons: int
    tested: bytes  # a bit for each photon: whether it was detected for the test
    settings: bytes  # of each of these: 0 Z+X, 1 Z-X
    bits: bytes  # its outcome


@dataclass(frozen=True)
class BellAnswer(QkdMessage):
    """Alice's part: what she has found of the photons that bob has tested."""

    KIND = 16
    FIELDS = struct.Struct("!II")
    RANGES = MappingProxyType({"tests": (0, MAX_PHOTONS)})
    PACKED = (Packed("clicked", "tests"), Packed("bases", "clicked"), Packed("bits", "clicked"))

    block: int
    tests: int
    clicked: bytes  # a bit for each photon tested
    bases: bytes  # of each that was detected here, too: 0 Z, 1 X
    bits: bytes  # its outcome


KINDS: dict[int, type[QkdMessage]] = {
    kind.KIND: kind
    for kind in (
        *(Proposal, Detections, Sifted, Sample, Disclosed, Parities, AskBlocks, AskIntervals),
        *(AskSyndrome, Verify, Amplify, Confirm, Abort, Intensities, BellTest, BellAnswer),
    )
}


@dataclass(frozen=True)
class Sealed:
    """A message as it arrived: check the tag over `covered` before you open it."""

    session: int
    sequence: int
    kind: int
    covered: bytes
    tag: bytes

    def open(self) -> QkdMessage:
        """Decode the message; raise MalformedPacket if its fields do not fit."""
        return KINDS[self.kind].parse(self.covered[HEADER.size :])


def unsealed(message: QkdMessage, session: int, sequence: int) -> bytes:
    """Return header and fields of a message: what its tag covers and is appended to."""
    body = message.encode()
    length = HEADER.size + len(body) + TAG_BYTES
    if length > MAX_LENGTH:
        raise ValueError(f"{type(message).__name__} of {length} bytes, at most {MAX_LENGTH}")
    return HEADER.pack(MAGIC, VERSION, message.KIND, length, session, sequence) + body


def message_length(data: bytes) -> int | None:
    """Return the length of the message that data begins with, None if more bytes are needed.

    Raise MalformedPacket as soon as the header cannot be that of a message.
    """
    if not MAGIC.to_bytes(2, "big").startswith(data[:2]):
        raise MalformedPacket(f"not key distribution: begins with {data[:2].hex()}")
    if len(data) < HEADER.size:
        return None
    _magic, version, kind, length, _session, _sequence = HEADER.unpack_from(data)
    if version != VERSION:
        raise MalformedPacket(f"version {version}, this is version {VERSION}")
    if kind not in KINDS:
        raise MalformedPacket(f"unknown kind {kind}")
    _check_count("bytes in a message", length, MAX_LENGTH, least=HEADER.size + TAG_BYTES)
    return int(length)


def kind_of(data: bytes) -> int:
    return int(HEADER.unpack_from(data)[2])


def unframe(data: bytes) -> Sealed:
    """Take exactly one message apart; raise MalformedPacket for anything else."""
    length = message_length(data)
    if length is None or len(data) != length:
        raise MalformedPacket(f"{len(data)} bytes where the header says {length}")
    _magic, _version, kind, _length, session, sequence = HEADER.unpack_from(data)
    return Sealed(session, sequence, kind, data[:-TAG_BYTES], data[-TAG_BYTES:])


def _bytes_for(bits: int) -> int:
    return (bits + 7) // 8


def _check_count(what: str, count: int, most: int, least: int = 1) -> None:
    if not least <= count <= most:
        raise MalformedPacket(f"{what}: {count}, not {least} to {most}")


def _check_bits(kind: type[QkdMessage], data: bytes, count: int) -> None:
    if len(data) != _bytes_for(count):
        raise MalformedPacket(f"{kind.__name__}: {len(data)} bytes for {count} bits")
    if count % 8 and data[-1] & (0xFF >> count % 8):
        raise MalformedPacket(f"{kind.__name__}: padding is not 0")


def _member(kind: type[E], value: int) -> E:
    try:
        return kind(value)
    except ValueError as error:
        raise MalformedPacket(f"unknown {kind.__name__} {value}") from error
