"""Blocks of pairs: those asked of a source, and how superdense coding tells of each."""

import struct
from dataclasses import dataclass
from typing import ClassVar

from wire.malformed import MalformedPacket
from wire.metadata.header import Message, parted

MAX_FRAMES = 4096  # in one block


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
        return self.FIELDS.pack(self.number, self.size, self.crc32)


@dataclass(frozen=True)
class Block(Message):
    """Tell the receiver what a block of pairs carries: first refills, then new frames.

    Refills are the symbols that earlier reports asked for again, in ascending order;
    new frames follow, each in as many pairs as code and alphabet of the session make of its
    bytes. No pairs at all: the light of this block did not reach the sender; the receiver
    discards its halves.
    """

    KIND = 4
    FIELDS = struct.Struct("!IIIQH")

    block: int
    pairs: int
    refills: int
    emitted_ns: int
    frames: tuple[Frame, ...] = ()

    def encode(self) -> bytes:
        fixed = self.FIELDS.pack(
            self.block, self.pairs, self.refills, self.emitted_ns, len(self.frames)
        )
        return self._frame(fixed + b"".join(frame.encode() for frame in self.frames))

    @classmethod
    def parse(cls, session: int, body: bytes) -> "Block":
        (block, pairs, refills, emitted_ns, count), rest = parted(cls, body)
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
        lost, errors, corrected, filled = self.lost, self.errors, self.corrected, self.filled
        failed = struct.pack(f"!{len(self.failed)}I", *self.failed)
        fixed = self.FIELDS.pack(
            self.block, self.pairs, lost, errors, corrected, filled, len(self.failed)
        )
        return self._frame(fixed + failed + self.again)

    @classmethod
    def parse(cls, session: int, body: bytes) -> "Report":
        (block, pairs, lost, errors, corrected, filled, count), rest = parted(cls, body)
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
