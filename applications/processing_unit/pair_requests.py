"""The messages of processing units before they ask for light: who wants which pairs.

creator's unit                       receiver's unit, TCP port PAIRS_PORT
PairRequest                      ->
                                 <-  PairAnswer, once the application there wants some of them
PairsMade, when these are there  ->

The pairs that the answer counts come with a session of the service `distribute`, to its port. The
creator requests the others again.
"""

import struct
from dataclasses import astuple, dataclass
from enum import IntEnum
from typing import NamedTuple

from wire.malformed import MalformedPacket

PAIRS_PORT = 9014
MAGIC = b"QE"
VERSION = 2
REQUEST = struct.Struct("!2sB32siiIBB3BB")
ANSWER = struct.Struct("!2sBBHI")
MADE = struct.Struct("!2sBI")
MAX_PAIRS = 4096  # in a request
MAX_LIGHT_US = (1 << 31) - 1  # as NetQASM's registers hold it


class Use(IntEnum):
    """The use of pairs: NetQASM's types of requests."""

    KEEP = 0
    MEASURE = 1  # at both ends, at once
    PREPARE = 2  # measured by the creator, kept by the receiver: remote state preparation


class Verdict(IntEnum):
    READY = 0
    NOBODY = 1  # no application there has asked to receive, for as long as a request waits
    OTHER_USE = 2


class RandomBasis(IntEnum):
    """Which bases a measurement is drawn from, each as often as the others."""

    NONE = 0  # as the rotations say
    XZ = 1
    XYZ = 2
    CHSH = 3


@dataclass(frozen=True)
class Measuring:
    bases: RandomBasis = RandomBasis.NONE
    rotations: tuple[int, int, int] = (0, 0, 0)  # in units of pi/16
    axes: int = 0  # of the three rotations: XYX, YZY, ZXZ


@dataclass(frozen=True)
class PairRequest:
    """Pairs between a socket here and a socket there, at most as many as counted."""

    creator: str  # its node
    creator_socket: int
    receiver_socket: int
    pairs: int
    use: Use
    receiver: Measuring

    def encode(self) -> bytes:
        bases, rotations, axes = astuple(self.receiver)
        name, here, there = self.creator.encode(), self.creator_socket, self.receiver_socket
        return REQUEST.pack(
            MAGIC, VERSION, name, here, there, self.pairs, self.use, bases, *rotations, axes
        )


def decode_request(data: bytes) -> PairRequest:
    """Return a request; raise MalformedPacket for anything else."""
    if len(data) != REQUEST.size:
        raise MalformedPacket(f"a request for pairs in {len(data)} bytes, not {REQUEST.size}")
    magic, version, name, ours, theirs, pairs, use, bases, *how = REQUEST.unpack(data)
    first, second, third, axes = how
    if (magic, version) != (MAGIC, VERSION) or not 0 < pairs <= MAX_PAIRS or axes > 2:
        raise MalformedPacket(f"no request for pairs: {data[:8].hex()}, {pairs} pairs")
    try:
        creator = name.rstrip(b"\0").decode("ascii")
        measuring = Measuring(RandomBasis(bases), (first, second, third), axes)
        return PairRequest(creator, ours, theirs, pairs, Use(use), measuring)
    except ValueError as error:
        raise MalformedPacket(f"a request for pairs: {error}") from error


class PairAnswer(NamedTuple):
    """The port to which a number of the requested pairs may come."""

    verdict: Verdict
    port: int = 0
    pairs: int = 0

    def encode(self) -> bytes:
        return ANSWER.pack(MAGIC, VERSION, *self)


def decode_answer(data: bytes) -> PairAnswer:
    """Return an answer; raise MalformedPacket for anything else."""
    if len(data) != ANSWER.size:
        raise MalformedPacket(f"an answer of {len(data)} bytes, not {ANSWER.size}")
    magic, version, verdict, port, pairs = ANSWER.unpack(data)
    if (magic, version) != (MAGIC, VERSION) or verdict not in Verdict.__members__.values():
        raise MalformedPacket(f"no answer to a request for pairs: {data.hex()}")
    if pairs > MAX_PAIRS or (verdict == Verdict.READY) != (pairs > 0):
        raise MalformedPacket(f"{pairs} pairs in an answer to a request: {data.hex()}")
    return PairAnswer(Verdict(verdict), port, pairs)


class PairsMade(NamedTuple):
    """The pairs are at both ends; their light has lasted so long."""

    light_us: int

    def encode(self) -> bytes:
        return MADE.pack(MAGIC, VERSION, *self)


def decode_made(data: bytes) -> PairsMade:
    """Return the message; raise MalformedPacket for anything else."""
    if len(data) != MADE.size:
        raise MalformedPacket(f"{len(data)} bytes about pairs that are made, not {MADE.size}")
    magic, version, light_us = MADE.unpack(data)
    if (magic, version) != (MAGIC, VERSION) or light_us > MAX_LIGHT_US:
        raise MalformedPacket(f"no message about pairs that are made: {data.hex()}")
    return PairsMade(light_us)
