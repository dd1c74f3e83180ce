"""Values that the ends of a service tell each other, and envelopes for messages of its own."""

import struct
from dataclasses import dataclass
from enum import IntEnum

from wire.malformed import MalformedPacket
from wire.metadata.header import Message, parted

WIDTHS = (1, 2, 8, 32)  # bits of a value
FREE_TOPIC = 128  # up to 255: of services outside this tree


class Topic(IntEnum):
    """The topic of an array of values; services of packages use FREE_TOPIC and up."""

    COMING = 1  # how many photons the block has that comes next; answered when it may come
    STATES = 2  # that were prepared: wire.dispatcher.proto, CreateRequest.states
    BASES = 3  # that were measured in: 0 Z, 1 X, 2 Y
    OUTCOMES = 4  # of measurements
    CORRECTIONS = 5  # Pauli operators that the receiver of the message applies
    ARRIVED = 6  # 1 for what was detected, or kept, 0 for what was not
    SAMPLE = 7  # 1 for what is sacrificed for an estimate
    COUNTS = 8  # the outcome of a block, as its service defines
    KEYS = 9  # messages of key distribution, cut into envelopes anywhere
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
    # Of a conference key: its terms; parities of the leader's bits, and a hash of
    # them behind its key; the seed of privacy amplification; the proof of all messages, 16
    # bytes for each host behind.
    PROPOSAL = 22
    RECEIPT = 24  # likewise 16 bytes, which prove that a block is in the memory of each
    HASH = 23
    SYNDROME = 19
    AMPLIFY = 20
    TAGS = 21
    # Of a graph state: how many hosts, and both ends of each edge, as places in the line.
    EDGES = 25
    KEPT = 14  # the opener holds the key of this number (block) in its store; no values
    PURIFY = 32  # protocol (1 BBPSSW, 2 DEJMPS) and seed of the twirl, of a round of a block
    DELIVER = 33  # a number of pairs, which are numbered from then on; answered
    SWAPPED = 36  # by which analysers, and their numbers of the block


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
        fixed = self.FIELDS.pack(self.topic, self.width, self.block, self.count)
        return self._frame(fixed + self.data)

    @classmethod
    def parse(cls, session: int, body: bytes) -> "Values":
        (topic, width, block, count), data = parted(cls, body)
        if width not in WIDTHS:
            raise MalformedPacket(f"Values: {width} bits a value, not one of {WIDTHS}")
        size, used = divmod(count * width, 8)
        if len(data) != size + bool(used):
            raise MalformedPacket(f"Values: {count} of {width} bits are not {len(data)} bytes")
        if used and data[-1] & (0xFF >> used):
            raise MalformedPacket("Values: bits behind the last value are not 0")
        return cls(session, topic, width, block, count, data)


@dataclass(frozen=True)
class Envelope(Message):
    """Carries a message of a service that has a format of its own, as key distribution."""

    KIND = 8
    FIELDS = struct.Struct("!B")

    topic: int
    content: bytes = b""

    def encode(self) -> bytes:
        return self._frame(self.FIELDS.pack(self.topic) + self.content)

    @classmethod
    def parse(cls, session: int, body: bytes) -> "Envelope":
        (topic,), content = parted(cls, body)
        return cls(session, topic, content)
