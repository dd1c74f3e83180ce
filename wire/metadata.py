"""Quantum metadata: the classical messages that say how light will be used.

    0       2    3    4        8                16
    +-------+----+----+--------+----------------+----------------
    | magic |ver |kind| length | session        | fields of the kind
    +-------+----+----+--------+----------------+----------------

Network byte order. `length` counts the whole message. The set-up message has a fixed
size, so that the controller can write its verdict into it without moving a byte.
Field vocabulary: paper, sections "Switches" and "Links".
"""

import struct
from dataclasses import dataclass, replace
from enum import IntEnum
from ipaddress import IPv4Address
from typing import ClassVar, TypeVar

METADATA_PORT = 9010
MAGIC = 0x514D  # "QM"
VERSION = 5
MAX_LENGTH = 1 << 17
MAX_FRAMES = 4096  # in one block
SEAL_BYTES = 16
OBSTACLE_BYTES = 96
HEADER = struct.Struct("!HBBIQ")

E = TypeVar("E", bound=IntEnum)


class MalformedPacket(ValueError):
    """The other side sent bytes that are not what they claim to be."""


class UnknownService(MalformedPacket):
    """A set-up message asks for a service that this version does not know."""


class Service(IntEnum):
    """What the light is wanted for; wire.services says which paths each needs."""

    SDC = 1  # superdense coding
    PAIR_SOURCE = 2  # of an open session: its pairs
    DISTRIBUTE = 3  # entanglement distribution
    TELEPORT = 4
    BBM92 = 5  # quantum key distribution by entangled pairs
    BB84 = 6  # by single photons that the opener prepares
    SWAP = 7  # entanglement swapping, by way of repeaters
    LINK = 8  # between neighbours of such a chain: the opener makes pairs and keeps half of each
    SDC_RETURN = 9  # superdense coding back to the opener of a session of it, with its light
    SEAL = 10  # pairs that watch a fibre
    GHZ = 11  # states of several hosts: this is between two neighbours of their line
    E91 = 12  # quantum key distribution by entangled pairs, with a CHSH test
    CONFERENCE = (
        15  # a key of several hosts, by GHZ states: this is between two neighbours likewise
    )
    SENSE = 14  # phases at hosts, by GHZ states: this is between two neighbours of their line
    GRAPH = 16  # graph states of several hosts: this is between two neighbours of their line
    MDI = 13  # by photons that both ends prepare and a relay measures in pairs


class MemoryState(IntEnum):
    """What the memories of both ends do, as a set-up wants it."""

    ANY = 0  # keep what comes
    HERALDED = 1  # their qubits emit, and the source is a station that heralds pairs of them
    # Said to the source alone: it makes no pairs, but measures the light that both ends send.
    RELAYED = 2


class Topic(IntEnum):
    """What an array of values is about; a service may use numbers that are not listed here."""

    COMING = 1  # how many photons the block has that comes next; answered when it may come
    STATES = 2  # that were prepared: wire.dispatcher.proto, CreateRequest.states
    BASES = 3  # that were measured in: 0 Z, 1 X, 2 Y
    OUTCOMES = 4  # of measurements
    CORRECTIONS = 5  # Pauli operators that the receiver of the message applies
    ARRIVED = 6  # 1 for what was detected, or kept, 0 for what was not
    SAMPLE = 7  # 1 for what is sacrificed for an estimate
    COUNTS = 8  # what came of a block, as its service defines
    KEYS = 9  # messages of wire.qkd, cut into envelopes anywhere
    OPENER = 10  # name of the host that has opened the session, UTF-8
    OVER = 11  # the light of the block is over; no values
    DIRECTIONS = 12  # of states on the Bloch sphere: every theta, then every phi, in turns / 2^32
    # Of the acceptor, before all else: pairs in a block at most, its features (wire.features), and
    # how many qubits its memory takes.
    NODE_FEATURES = 13
    HOSTS = 15  # names of those behind the acceptor, in a line, UTF-8 with commas between
    LAUNCH = 16  # both ends send a block now; the number of intensities that the sender's has
    # Of sensing: by which angles the hosts behind measure between X and Y, in turns / 2^32; with
    # PROBES, before them, how many qubits each makes by itself.
    ANGLES = 17
    PROBES = 18
    # Of a conference key: its terms (wire.conference); parities of the leader's bits, and a hash of
    # them behind its key; the seed of privacy amplification; what proves all that was said, 16
    # bytes for each host behind.
    PROPOSAL = 22
    RECEIPT = 24  # likewise 16 bytes, which prove that a block is in the memory of each
    HASH = 23
    SYNDROME = 19
    AMPLIFY = 20
    TAGS = 21
    EDGES = (
        25  # of a graph state: how many hosts, and both ends of each edge, as places in the line
    )
    KEPT = 14  # the opener holds the key of this number (block) in its store; no values
    PURIFY = 32  # protocol (1 BBPSSW, 2 DEJMPS) and seed of the twirl, of a round of a block
    # Of a station, or passed on by the opener: the Bell state of each heralded pair, as 0 Phi+,
    # 1 Psi+, 2 Phi-, 3 Psi-.
    HERALDED = 34
    DELIVER = 33  # so many pairs, which have numbers from then on; answered
    # A repeater has swapped: its place, and for how many us both halves of a pair have waited;
    # to the left also the place that waits for this notice, to the right ARRIVED and CORRECTIONS.
    SWAPPED = 36


class Handshake(IntEnum):
    """How often light paths are arranged."""

    FRAMED = 1  # once for a session
    PER_PAIR = 2  # a session whose every Bell state has a handshake of its own
    ONE_PAIR = 3  # that handshake (paper, figure "handshaking")


class Verdict(IntEnum):
    """What the controller has written into a set-up message."""

    PENDING = 0
    GRANTED = 1
    REFUSED = 2


class Reason(IntEnum):
    """Why a request was refused; OK if it was not."""

    OK = 0
    NOT_ARBITRATED = 1
    NO_LISTENER = 2
    UNKNOWN_HOST = 3
    NO_PATH = 4
    BUSY = 5
    UNKNOWN_SESSION = 6
    UNSUPPORTED = 7
    SWITCH_FAILED = 8
    SWITCH_TIMEOUT = 9
    NO_LIGHT = 10
    TOO_NOISY = 11
    WRONG_DIGEST = 12
    HARDWARE = 13
    PROTOCOL = 14
    NOT_ALLOWED = 15
    LOSS_TOO_HIGH = 16
    NO_WAVELENGTH = 17
    NODE_SILENT = 18  # written by the controller, with the address of that node as source
    # Written by the controller, with the address of the node that lacks the feature as source.
    CANNOT_EMIT = 19
    CANNOT_STORE = 20
    CANNOT_GATE = 21
    CANNOT_MEASURE = 22
    NO_CHAIN = 23
    FIBER_CUT = 24  # written by the controller, with the address of the host whose fibre it is
    # Written by the controller, with the address of the node that lacks the feature as source.
    CANNOT_HERALD = 26
    CANNOT_INTERFERE = 27
    PATH_BROKEN = 25  # within the optical network
    TOO_LATE = 28  # no light by the deadline that the set-up message names
    NO_ANSWER = 29  # the other end was silent for too long
    PEER_GONE = 30  # it has closed the connection, or lost it
    CANNOT_ABSORB = 31  # written by the controller, with the address of the node as source


class Pauli(IntEnum):
    """Pauli operators as two bits: bit 0 flips (X), bit 1 changes the phase (Z)."""

    I = 0  # noqa: E741
    X = 1
    Z = 2
    XZ = 3


class Fec(IntEnum):
    """Error-correction codes of a session (hosts/middleware/services/superdense/coding)."""

    NONE = 0
    REPETITION = 1  # (3,1)
    HAMMING = 2  # (7,4)
    GOLAY = 3  # (23,12)
    REED_SOLOMON = 4  # (255,223) over bytes, shortened


FEC_NAMES = {fec.name.lower().replace("_", "-"): fec for fec in Fec}  # what users call them
SYMBOLS = (3, 4)  # how many Bell states an analyser can tell apart


PAPER_ENCODING = 0b11_10_01_00  # symbol s is sent as Pauli (encoding >> 2s) & 3: table 1


@dataclass(frozen=True)
class Message:
    """Header and fixed fields; a kind with a variable part overrides encode and parse."""

    KIND: ClassVar[int]
    FIELDS: ClassVar[struct.Struct]

    session: int

    def encode(self) -> bytes:
        """Return the message as it goes onto the wire."""
        _session, *fields = vars(self).values()
        return self._frame(self.FIELDS.pack(*fields))

    def _frame(self, body: bytes) -> bytes:
        length = HEADER.size + len(body)
        return HEADER.pack(MAGIC, VERSION, self.KIND, length, self.session) + body

    @classmethod
    def parse(cls, session: int, body: bytes) -> "Message":
        """Build the message from its body; raise MalformedPacket if it does not fit."""
        if len(body) != cls.FIELDS.size:
            raise MalformedPacket(f"{cls.__name__}: {len(body)} bytes, not {cls.FIELDS.size}")
        return cls(session, *cls.FIELDS.unpack(body))


@dataclass(frozen=True)
class Setup(Message):
    """Ask for light paths. First on its connection, one write, nothing after until answered."""

    KIND = 1
    FIELDS = struct.Struct(f"!BB4sIIIHIBBBBBIiIIBI{OBSTACLE_BYTES}sBBH{SEAL_BYTES}s")

    service: int
    handshake: int
    # IPv4 address of the pair source, of the opener if it keeps half of each pair itself; of
    # another node if the reason says so.
    source: str
    pairs: int  # pairs in a block at most
    frame_bytes: int
    rate_hz: int
    port: int = 0  # the application's port, as in TCP
    block: int = 0  # ONE_PAIR: number of the pair
    encoding: int = PAPER_ENCODING  # proposed; the answer says which one is used
    fec: int = Fec.NONE  # error-correction code; a receiver refuses one that it does not know
    interleave: int = 0  # 1: the bits of its codewords travel far from each other
    polarization: int = 0  # 0 is the horizontal/vertical basis
    memory: int = MemoryState.ANY
    # wire.optical.ANY_WAVELENGTH: what the controller writes here with its verdict.
    wavelength_pm: int = 1_550_120
    phase_mrad: int = 0
    sync_window_ps: int = 1_000_000
    fidelity_ppm: int = 0  # pair fidelity wanted at least; 0 is any
    priority: int = 0  # among those that wait for light, if the policy heeds it: the higher first
    deadline_ms: int = 0  # of the network, until light is wanted at the latest; 0: no deadline
    # Which element is in the way, in the controller's words, with a refusal; ASCII, filled with 0.
    obstacle: str = ""
    verdict: int = Verdict.PENDING
    rotation: int = Pauli.I  # known rotation of the paths, for the receiver to undo
    reason: int = Reason.OK
    seal: bytes = bytes(SEAL_BYTES)  # of the controller, with its verdict (wire.verdict)

    def encode(self) -> bytes:
        """Return the message as it goes onto the wire."""
        packed = {"source": IPv4Address(self.source).packed, "obstacle": self.obstacle.encode()}
        _session, *fields = {**vars(self), **packed}.values()
        return self._frame(self.FIELDS.pack(*fields))

    @classmethod
    def parse(cls, session: int, body: bytes) -> "Setup":
        """Build the message from its body; raise MalformedPacket if it does not fit."""
        raw = super().parse(session, body)
        assert isinstance(raw, Setup)
        for name in ("pairs", "frame_bytes", "rate_hz"):
            if getattr(raw, name) == 0:
                raise MalformedPacket(f"{name} is 0")
        _check_encoding(raw.encoding)
        if raw.interleave > 1:
            raise MalformedPacket(f"interleave is {raw.interleave}, not 0 or 1")
        return replace(
            raw,
            service=_service(raw.service),
            handshake=_member(Handshake, raw.handshake),
            source=str(IPv4Address(raw.source)),
            obstacle=_words(raw.obstacle),
            verdict=_member(Verdict, raw.verdict),
            rotation=_member(Pauli, raw.rotation),
            reason=_member(Reason, raw.reason),
        )


def _words(padded: object) -> str:
    """Return the words of a field of fixed size."""
    assert isinstance(padded, bytes)
    words = padded.rstrip(b"\0")
    if not words.isascii() or not words.decode("ascii").isprintable():
        raise MalformedPacket(f"obstacle {words!r} is not printable ASCII")
    return words.decode("ascii")


SETUP_LENGTH = HEADER.size + Setup.FIELDS.size


NUMBERS_APART = 128  # of a host's sessions: those between are of links and lines that belong to one
_PLACE = struct.Struct("!4sI")


def session_number(opener: str, count: int) -> int:
    """Return the number of the count-th session that a host opens, by its IPv4 address.

    It is nobody else's: the controller refuses a host the numbers of others (`is_number_of`).
    """
    place = _PLACE.pack(IPv4Address(opener).packed, count * NUMBERS_APART % (1 << 32))
    return int.from_bytes(place, "big")


def is_number_of(session: int, opener: str) -> bool:
    """Tell whether a host opens sessions of this number, by its IPv4 address."""
    return session >> 32 == int(IPv4Address(opener))


def session_of(message: bytes) -> int:
    """Return the session that a message names, whatever else it says."""
    return int(HEADER.unpack_from(message)[-1])


def refused(setup: bytes, reason: Reason) -> bytes:
    """Return a set-up message, whatever it asks for, with a refusal written into it."""
    *asked, _verdict, _rotation, _reason, seal = Setup.FIELDS.unpack(setup[HEADER.size :])
    answer = Setup.FIELDS.pack(*asked, Verdict.REFUSED, Pauli.I, reason, seal)
    return setup[: HEADER.size] + answer


@dataclass(frozen=True)
class Answer(Message):
    """Accept (reason OK) or refuse what was asked last, with a text a person can act on.

    A receiver that accepts a set-up says how many Bell states its analyser tells apart, and
    by which operators the sender shall send that many symbols: with 3, those that stay
    distinguishable behind the known rotation of the light path. Whoever accepts a set-up says at
    which wavelength its light was granted.
    """

    KIND = 2
    FIELDS = struct.Struct("!HBBI")

    reason: int
    text: str = ""
    symbols: int = 0  # 3 or 4; 0 in any other answer
    encoding: int = 0
    wavelength_pm: int = 0  # 0 in any other answer

    def encode(self) -> bytes:
        """Return the message as it goes onto the wire; a text over 1,000 bytes is cut."""
        text = self.text.encode()[:1000].decode(errors="ignore").encode()
        fixed = self.reason, self.symbols, self.encoding, self.wavelength_pm
        return self._frame(self.FIELDS.pack(*fixed) + text)

    @classmethod
    def parse(cls, session: int, body: bytes) -> "Answer":
        """Build the message from its body; raise MalformedPacket if it does not fit."""
        (reason, symbols, encoding, wavelength_pm), text = _split(cls, body)
        if symbols or encoding:
            _check_encoding(encoding)
            if symbols not in SYMBOLS:
                raise MalformedPacket(f"Answer: {symbols} symbols")
        try:
            told = text.decode(), symbols, encoding, wavelength_pm
            return cls(session, _member(Reason, reason), *told)
        except UnicodeDecodeError as error:
            raise MalformedPacket(f"Answer: text is not UTF-8: {error}") from error


@dataclass(frozen=True)
class Emit(Message):
    """Ask a pair source for one block of pairs; answered when its light has left."""

    KIND = 3
    FIELDS = struct.Struct("!III")

    block: int
    pairs: int
    rate_hz: int


@dataclass(frozen=True)
class Emission(Emit):
    """Ask for a block as Emit does, behind those asked for before; only a refusal is answered."""

    KIND = 9


@dataclass(frozen=True)
class Emitted(Message):
    """Ask a pair source whether the light of all blocks has left; answered when it has."""

    KIND = 10
    FIELDS = struct.Struct("!I")

    block: int  # the last one


@dataclass(frozen=True)
class Frame:
    """One frame of a block: its number, its size and the check of its content."""

    number: int
    size: int  # bytes
    crc32: int

    FIELDS: ClassVar[struct.Struct] = struct.Struct("!III")

    def encode(self) -> bytes:
        """Return the description as it goes onto the wire."""
        return self.FIELDS.pack(self.number, self.size, self.crc32)


@dataclass(frozen=True)
class Block(Message):
    """Tell the receiver what a block of pairs carries: first refills, then new frames.

    Refills are the symbols that earlier reports asked for again, in ascending order;
    new frames follow, each in as many pairs as code and alphabet of the session make of its
    bytes. No pairs at all: the light of this block did not reach the sender; the receiver
    lets go of its halves.
    """

    KIND = 4
    FIELDS = struct.Struct("!IIIQH")

    block: int
    pairs: int
    refills: int
    emitted_ns: int
    frames: tuple[Frame, ...] = ()

    def encode(self) -> bytes:
        """Return the message as it goes onto the wire."""
        fixed = self.FIELDS.pack(
            self.block, self.pairs, self.refills, self.emitted_ns, len(self.frames)
        )
        return self._frame(fixed + b"".join(frame.encode() for frame in self.frames))

    @classmethod
    def parse(cls, session: int, body: bytes) -> "Block":
        """Build the message from its body; raise MalformedPacket if it does not fit."""
        (block, pairs, refills, emitted_ns, count), rest = _split(cls, body)
        if count > MAX_FRAMES:
            raise MalformedPacket(f"Block: {count} frames, at most {MAX_FRAMES}")
        if len(rest) != count * Frame.FIELDS.size:
            raise MalformedPacket(f"Block: {count} frames announced in {len(rest)} bytes")
        frames = tuple(Frame(*fields) for fields in Frame.FIELDS.iter_unpack(rest))
        if pairs < refills + len(frames):
            raise MalformedPacket(f"Block {block}: {pairs} pairs do not carry what it lists")
        return cls(session, block, pairs, refills, emitted_ns, frames)


@dataclass(frozen=True)
class Report(Message):
    """Tell the sender how a block arrived: what was lost and put right, what to send again."""

    KIND = 5
    FIELDS = struct.Struct("!IIIIIIH")

    block: int
    pairs: int
    lost: int = 0  # of these pairs
    errors: int = 0  # wrong symbols found so far in the session
    corrected: int = 0  # those of them that the code has put right
    filled: int = 0  # lost symbols, so far in the session, that the code has filled in
    failed: tuple[int, ...] = ()  # numbers of the frames to send again as a whole
    again: bytes = b""  # a bit for each lost pair to send again, high bit first; empty: none

    def encode(self) -> bytes:
        """Return the message as it goes onto the wire."""
        numbers = self.block, self.pairs, self.lost, self.errors, self.corrected, self.filled
        fixed = self.FIELDS.pack(*numbers, len(self.failed))
        return self._frame(fixed + struct.pack(f"!{len(self.failed)}I", *self.failed) + self.again)

    @classmethod
    def parse(cls, session: int, body: bytes) -> "Report":
        """Build the message from its body; raise MalformedPacket if it does not fit."""
        (block, pairs, lost, errors, corrected, filled, count), rest = _split(cls, body)
        failed, again = rest[: 4 * count], rest[4 * count :]
        if len(failed) != 4 * count or len(again) not in (0, (pairs + 7) // 8):
            raise MalformedPacket(f"Report of block {block}: {len(rest)} bytes do not fit")
        if not int.from_bytes(again, "big").bit_count() <= lost <= pairs:
            raise MalformedPacket(f"Report of block {block}: {lost} of {pairs} pairs lost")
        numbers = struct.unpack(f"!{count}I", failed)
        return cls(session, block, pairs, lost, errors, corrected, filled, numbers, again)


@dataclass(frozen=True)
class Finish(Message):
    """End the session: how many bytes there were and their SHA-256."""

    KIND = 6
    FIELDS = struct.Struct("!Q32s")

    size: int
    sha256: bytes


@dataclass(frozen=True)
class Values(Message):
    """An array of small numbers that one end of a service tells the other.

    Packed without gaps, high bit first; bits behind the last value are 0.
    """

    KIND = 7
    FIELDS = struct.Struct("!BBII")

    topic: int  # what they are: Topic, or as the service defines
    width: int  # bits of each: one of WIDTHS
    block: int  # of photons that they belong to
    count: int
    data: bytes = b""

    def encode(self) -> bytes:
        """Return the message as it goes onto the wire."""
        fixed = self.FIELDS.pack(self.topic, self.width, self.block, self.count)
        return self._frame(fixed + self.data)

    @classmethod
    def parse(cls, session: int, body: bytes) -> "Values":
        """Build the message from its body; raise MalformedPacket if it does not fit."""
        (topic, width, block, count), data = _split(cls, body)
        if width not in WIDTHS:
            raise MalformedPacket(f"Values: {width} bits a value, not one of {WIDTHS}")
        size, used = divmod(count * width, 8)
        if len(data) != size + bool(used):
            raise MalformedPacket(f"Values: {count} of {width} bits are not {len(data)} bytes")
        if used and data[-1] & (0xFF >> used):
            raise MalformedPacket("Values: bits behind the last value are not 0")
        return cls(session, topic, width, block, count, data)


WIDTHS = (1, 2, 8, 32)


@dataclass(frozen=True)
class Envelope(Message):
    """Carries a message of a service that has a format of its own, such as wire.qkd."""

    KIND = 8
    FIELDS = struct.Struct("!B")

    topic: int
    content: bytes = b""

    def encode(self) -> bytes:
        """Return the message as it goes onto the wire."""
        return self._frame(self.FIELDS.pack(self.topic) + self.content)

    @classmethod
    def parse(cls, session: int, body: bytes) -> "Envelope":
        """Build the message from its body; raise MalformedPacket if it does not fit."""
        (topic,), content = _split(cls, body)
        return cls(session, topic, content)


KINDS: dict[int, type[Message]] = {
    kind.KIND: kind
    for kind in (
        *(Setup, Answer, Emit, Block, Report, Finish, Values, Envelope),
        *(Emission, Emitted),
    )
}


def message_length(data: bytes) -> int | None:
    """Return the length of the message that data begins with, None if more bytes are needed.

    Raise MalformedPacket as soon as the header cannot be that of a message.
    """
    if not MAGIC.to_bytes(2, "big").startswith(data[:2]):
        raise MalformedPacket(f"not quantum metadata: begins with {data[:2].hex()}")
    if len(data) < HEADER.size:
        return None
    _magic, version, kind, length, _session = HEADER.unpack_from(data)
    if version != VERSION:
        raise MalformedPacket(f"version {version}, this is version {VERSION}")
    if kind not in KINDS:
        raise MalformedPacket(f"unknown kind {kind}")
    if not HEADER.size <= length <= MAX_LENGTH:
        raise MalformedPacket(f"length {length} is outside {HEADER.size}..{MAX_LENGTH}")
    return int(length)


def decode(data: bytes) -> Message:
    """Decode exactly one message; raise MalformedPacket for anything else."""
    length = message_length(data)
    if length is None or len(data) != length:
        raise MalformedPacket(f"{len(data)} bytes where the header says {length}")
    _magic, _version, kind, _length, session = HEADER.unpack_from(data)
    return KINDS[kind].parse(session, data[HEADER.size :])


def _split(kind: type[Message], body: bytes) -> tuple[tuple[int, ...], bytes]:
    if len(body) < kind.FIELDS.size:
        raise MalformedPacket(f"{kind.__name__}: {len(body)} bytes are too few")
    return kind.FIELDS.unpack_from(body), body[kind.FIELDS.size :]


def _check_encoding(encoding: int) -> None:
    if {encoding >> shift & 3 for shift in (0, 2, 4, 6)} != {0, 1, 2, 3}:
        raise MalformedPacket(f"encoding {encoding:#x} does not use each operator once")


def _service(number: int) -> Service:
    try:
        return Service(number)
    except ValueError as error:
        known = ", ".join(f"{service.value} ({service.name})" for service in Service)
        raise UnknownService(f"unknown service {number}: choose one of {known}") from error


def _member(kind: type[E], value: int) -> E:
    try:
        return kind(value)
    except ValueError as error:
        raise MalformedPacket(f"unknown {kind.__name__.lower()} {value}") from error
