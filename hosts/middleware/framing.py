"""Frames, checks and repeats, at both ends, without a socket or a clock.

The sender cuts bytes into frames and fills blocks of pairs: first the symbols that the
receiver asked for again (refills), then new frames. The receiver reports every block: the
pairs that were lost are asked for again one by one; a frame that is complete but fails its
check is asked for again as a whole. Both ends keep the same ascending list of open slots,
slot = frame number * symbols of a full frame + index, so the list itself never travels.
"""

from collections import deque
from dataclasses import dataclass, field
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from hosts.hardware.qnic import NO_COINCIDENCE, Symbols
from hosts.middleware.encoding import SYMBOLS_PER_BYTE, to_bytes, to_symbols
from wire.metadata import MAX_FRAMES, Block, Frame, Report

Slots = NDArray[np.int64]
NO_SLOTS: Slots = np.empty(0, dtype=np.int64)


class FramingError(Exception):
    """The two ends do not agree on what was sent: a fault of the other side."""


def frame_slots(number: int, size: int, frame_bytes: int) -> Slots:
    """Return the slots of a whole frame of size bytes."""
    first = number * frame_bytes * SYMBOLS_PER_BYTE
    return np.arange(first, first + size * SYMBOLS_PER_BYTE, dtype=np.int64)


def block_slots(
    open_slots: Slots, refills: int, frames: tuple[Frame, ...], frame_bytes: int
) -> Slots:
    """Return the slot of each pair of a block: the first open ones, then the new frames'."""
    new = [frame_slots(frame.number, frame.size, frame_bytes) for frame in frames]
    return np.concatenate([open_slots[:refills], *new])


@dataclass(frozen=True)
class OutgoingBlock:
    """What the next block of pairs shall carry."""

    number: int
    refills: int
    frames: tuple[Frame, ...]
    symbols: Symbols  # shape (pairs,)


class Outbox:
    """The sender's side."""

    def __init__(self, frame_bytes: int, block_pairs: int) -> None:
        self._frame_bytes = frame_bytes
        self._block_pairs = max(block_pairs, frame_bytes * SYMBOLS_PER_BYTE)
        self._waiting: deque[bytes] = deque()
        self._symbols: dict[int, Symbols] = {}  # of frames under way
        self._open: Slots = NO_SLOTS
        self._frames_made = 0
        self._blocks_made = 0
        self.attempts: dict[int, int] = {}  # failed checks of frames under way
        self.repeated_frames = 0

    def add(self, data: bytes) -> None:
        """Take bytes to send; they begin a frame of their own."""
        for start in range(0, len(data), self._frame_bytes):
            self._waiting.append(data[start : start + self._frame_bytes])

    @property
    def empty(self) -> bool:
        """Whether the receiver holds everything."""
        return not self._waiting and not self._open.size

    def next_block(self) -> OutgoingBlock:
        """Fill the next block; only when not empty."""
        refills = min(self._open.size, self._block_pairs)
        frames = tuple(self._new_frames(self._block_pairs - refills))
        slots = block_slots(self._open, refills, frames, self._frame_bytes)
        self._blocks_made += 1
        return OutgoingBlock(self._blocks_made, refills, frames, self._read(slots))

    def dark(self, block: OutgoingBlock) -> None:
        """No light reached this host: the frames of the block go into a later one."""
        for frame in reversed(block.frames):
            self._waiting.appendleft(to_bytes(self._symbols.pop(frame.number)))
        self._frames_made -= len(block.frames)

    def report(self, block: OutgoingBlock, report: Report) -> None:
        """Note what the receiver says of a block; raise FramingError if it cannot be so."""
        slots = block_slots(self._open, block.refills, block.frames, self._frame_bytes)
        if (report.block, report.pairs) != (block.number, slots.size):
            raise FramingError(f"report of block {report.block}, sent was {block.number}")
        failed = [self._failed_slots(number) for number in report.failed]
        lost = slots[_lost_mask(report.lost, slots.size)]
        rest = self._open[block.refills :]
        self._open = np.unique(np.concatenate([rest, lost, *failed]))
        self._drop_delivered(slots)

    def _new_frames(self, room: int) -> list[Frame]:
        frames: list[Frame] = []
        while (
            self._waiting
            and len(frames) < MAX_FRAMES
            and len(self._waiting[0]) * SYMBOLS_PER_BYTE <= room
        ):
            data = self._waiting.popleft()
            self._symbols[self._frames_made] = to_symbols(data)
            frames.append(Frame(self._frames_made, len(data), crc32(data)))
            self._frames_made += 1
            room -= len(data) * SYMBOLS_PER_BYTE
        return frames

    def _read(self, slots: Slots) -> Symbols:
        numbers, starts, indices = _by_frame(slots, self._frame_bytes)
        parts = np.split(indices, starts[1:])
        picked = [self._symbols[int(n)][i] for n, i in zip(numbers, parts, strict=True)]
        return np.concatenate(picked)

    def _failed_slots(self, number: int) -> Slots:
        if number not in self._symbols:
            raise FramingError(f"report of frame {number}, which is not under way")
        self.attempts[number] = self.attempts.get(number, 0) + 1
        self.repeated_frames += 1
        size = self._symbols[number].size // SYMBOLS_PER_BYTE
        return frame_slots(number, size, self._frame_bytes)

    def _drop_delivered(self, slots: Slots) -> None:
        touched = np.unique(slots // (self._frame_bytes * SYMBOLS_PER_BYTE))
        still_open = np.unique(self._open // (self._frame_bytes * SYMBOLS_PER_BYTE))
        for number in np.setdiff1d(touched, still_open).tolist():
            del self._symbols[number]
            self.attempts.pop(number, None)


@dataclass
class _Incoming:
    """A frame under way at the receiver."""

    frame: Frame
    symbols: Symbols
    missing: int
    rejected: list[Symbols] = field(default_factory=list)  # earlier, wrong versions


class Inbox:
    """The receiver's side."""

    MAX_REMEMBERED_VERSIONS = 16

    def __init__(self, frame_bytes: int) -> None:
        self._frame_bytes = frame_bytes
        self._frames: dict[int, _Incoming] = {}
        self._open: Slots = NO_SLOTS
        self._announced = 0
        self._complete: dict[int, bytes] = {}
        self._delivered = 0
        self.symbol_errors = 0
        self.symbols_seen = 0
        self.symbols_lost = 0
        self.repeated_frames = 0

    def block(self, block: Block, symbols: Symbols) -> Report:
        """Take the symbols of a block (255: lost); return what the sender must know."""
        self._announce(block)
        slots = block_slots(self._open, block.refills, block.frames, self._frame_bytes)
        touched = self._fill(slots, symbols)
        failed = [number for number in touched if not self._accept(number)]
        lost = symbols == NO_COINCIDENCE
        self._open = np.unique(
            np.concatenate([self._open[block.refills :], slots[lost], *map(self._reset, failed)])
        )
        self.symbols_seen += int(symbols.size - lost.sum())
        self.symbols_lost += int(lost.sum())
        bits = np.packbits(lost).tobytes() if lost.any() else b""
        return Report(
            block.session, block.block, block.pairs, self.symbol_errors, tuple(failed), bits
        )

    def take(self) -> bytes:
        """Return the bytes that are complete, in order, once."""
        parts = []
        while self._delivered in self._complete:
            parts.append(self._complete.pop(self._delivered))
            self._delivered += 1
        return b"".join(parts)

    def _announce(self, block: Block) -> None:
        numbers = [frame.number for frame in block.frames]
        if numbers != list(range(self._announced, self._announced + len(numbers))):
            raise FramingError(f"block {block.block} announces frames {numbers} out of order")
        if block.refills > self._open.size:
            raise FramingError(f"block {block.block} refills more than is open")
        if block.frames and block.refills != self._open.size:
            raise FramingError(f"block {block.block} begins new frames before the open ones")
        for frame in block.frames:
            if not 0 < frame.size <= self._frame_bytes:
                raise FramingError(f"frame {frame.number} has {frame.size} bytes")
        for frame in block.frames:
            count = frame.size * SYMBOLS_PER_BYTE
            empty = np.full(count, NO_COINCIDENCE, dtype=np.uint8)
            self._frames[frame.number] = _Incoming(frame, empty, count)
        self._announced += len(numbers)

    def _fill(self, slots: Slots, symbols: Symbols) -> list[int]:
        if not slots.size:
            return []
        numbers, starts, indices = _by_frame(slots, self._frame_bytes)
        parts = zip(
            numbers, np.split(indices, starts[1:]), np.split(symbols, starts[1:]), strict=True
        )
        for number, index, symbol in parts:
            incoming = self._frames[number]
            incoming.symbols[index] = symbol
            incoming.missing = int((incoming.symbols == NO_COINCIDENCE).sum())
        return [number for number in numbers if not self._frames[number].missing]

    def _accept(self, number: int) -> bool:
        incoming = self._frames[number]
        data = to_bytes(incoming.symbols)
        if crc32(data) != incoming.frame.crc32:
            return False
        for version in incoming.rejected:
            self.symbol_errors += int((version != incoming.symbols).sum())
        del self._frames[number]
        self._complete[number] = data
        return True

    def _reset(self, number: int) -> Slots:
        incoming = self._frames[number]
        self.repeated_frames += 1
        if len(incoming.rejected) < self.MAX_REMEMBERED_VERSIONS:
            incoming.rejected.append(incoming.symbols)
        incoming.missing = incoming.symbols.size
        incoming.symbols = np.full(incoming.missing, NO_COINCIDENCE, dtype=np.uint8)
        return frame_slots(number, incoming.frame.size, self._frame_bytes)


def _by_frame(slots: Slots, frame_bytes: int) -> tuple[list[int], Slots, Slots]:
    """Return the frame numbers of slots, where each begins, and the indices inside frames.

    Slots of a block are runs of one frame each: refills ascend, new frames follow.
    """
    frames, indices = np.divmod(slots, frame_bytes * SYMBOLS_PER_BYTE)
    starts = np.flatnonzero(np.diff(frames, prepend=-1))
    return frames[starts].tolist(), starts, indices


def _lost_mask(lost: bytes, pairs: int) -> NDArray[np.bool_]:
    if not lost:
        return np.zeros(pairs, dtype=np.bool_)
    return np.unpackbits(np.frombuffer(lost, dtype=np.uint8), count=pairs).astype(np.bool_)
