"""The sender's side of framing: which symbols the next block of pairs carries."""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from math import ceil
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from hosts.hardware.replies import Symbols
from hosts.middleware.services.superdense.frame_format import (
    NO_SLOTS,
    FrameFormat,
    FramingError,
    SlotMap,
    Slots,
)
from wire.metadata.blocks import MAX_FRAMES, Frame, Report

LEAST_ARRIVALS = (
    4  # of a block of refills alone, on average: few symbols shall not need many blocks
)


@dataclass
class _Outgoing:
    data: bytes
    symbols: Symbols | None = None  # made when they are first wanted for themselves


@dataclass(frozen=True)
class OutgoingBlock:
    """Load of the next block of pairs."""

    number: int
    refills: int
    frames: tuple[Frame, ...]
    symbols: Symbols  # shape (pairs,)


class Outbox:
    """Bytes that the receiver does not hold yet."""

    def __init__(self, frame_bytes: int, block_pairs: int, frame_format: FrameFormat) -> None:
        self._slots = SlotMap(frame_format, frame_bytes)
        self._format = frame_format
        self._frame_bytes = frame_bytes
        self._block_pairs = max(block_pairs, frame_format.pairs(frame_bytes))
        self._waiting: deque[bytes] = deque()
        self._frames: dict[int, _Outgoing] = {}  # under way
        self._open: Slots = NO_SLOTS
        self._frames_made = 0
        self._blocks_made = 0
        self._data_bits = self._code_bits = 0
        self._sent = self._arrived = 0.0  # pairs, of late
        self.attempts: dict[int, int] = {}  # failed checks of frames under way
        self.repeated_frames = 0

    def add(self, data: bytes) -> None:
        """Take bytes to send; they begin a frame of their own."""
        for start in range(0, len(data), self._frame_bytes):
            frame = data[start : start + self._frame_bytes]
            self._waiting.append(frame)
            self._data_bits += 8 * len(frame)
            self._code_bits += self._format.code.encoded_bits(8 * len(frame))

    @property
    def code_rate(self) -> float:
        """Bits of data for each bit of code, in all frames so far; 1 if there was none."""
        return self._data_bits / self._code_bits if self._code_bits else 1.0

    @property
    def empty(self) -> bool:
        return not self._waiting and not self._open.size

    @property
    def goes_ahead(self) -> bool:
        """Whether the next block does not depend on reports of those before it."""
        return bool(self._waiting) and not self._open.size

    def next_block(self) -> OutgoingBlock:
        """Fill the next block; only when not empty."""
        refills = self._refills()
        frames = tuple(self._new_frames(self._block_pairs - refills))
        if self._format.plain and not refills:
            whole = b"".join(self._frames[frame.number].data for frame in frames)
            symbols = self._format.to_symbols(whole)
        else:
            symbols = self._read(self._slots.block(self._open, refills, frames))
        self._blocks_made += 1
        return OutgoingBlock(self._blocks_made, refills, frames, symbols)

    def _refills(self) -> int:
        """Return how many pairs to give to open symbols: each one, or as many as take to arrive.

        As long as most pairs arrive, each round asks for half as many as the one before anyway.
        """
        pairs = missing = int(self._open.size)
        if missing and 2 * self._arrived < self._sent:
            pairs = ceil(max(missing, LEAST_ARRIVALS) * self._sent / max(self._arrived, 1))
        return min(pairs, self._block_pairs)

    def dark(self, block: OutgoingBlock) -> None:
        """No light reached this host: the frames of the block go into a later one."""
        for frame in reversed(block.frames):
            self._waiting.appendleft(self._frames.pop(frame.number).data)
        self._frames_made -= len(block.frames)

    def report(self, block: OutgoingBlock, report: Report) -> None:
        """Note what the receiver says of a block; raise FramingError if it cannot be so."""
        if (report.block, report.pairs) != (block.number, block.symbols.size):
            raise FramingError(f"report of block {report.block}, sent was {block.number}")
        if block.refills or report.failed or report.again:
            self._reopen(block, report)
        else:  # every one of its frames has come
            self._drop(frame.number for frame in block.frames)
        self._sent = self._sent / 2 + report.pairs
        self._arrived = self._arrived / 2 + report.pairs - report.lost

    def _reopen(self, block: OutgoingBlock, report: Report) -> None:
        slots = self._slots.block(self._open, block.refills, block.frames)
        if len(set(report.failed)) != len(report.failed):
            raise FramingError(f"report of block {report.block} names a failed frame twice")
        failed = [self._failed_slots(number) for number in report.failed]
        again = slots[_mask(report.again, slots.size)]
        rest = self._open[block.refills :]
        self._open = np.unique(np.concatenate([rest, again, *failed]))
        touched, still_open = self._slots.numbers(slots), self._slots.numbers(self._open)
        self._drop(np.setdiff1d(touched, still_open).tolist())

    def _new_frames(self, capacity: int) -> list[Frame]:
        frames: list[Frame] = []
        while self._waiting and len(frames) < MAX_FRAMES:
            data = self._waiting[0]
            capacity -= self._format.pairs(len(data))
            if capacity < 0:
                break
            self._waiting.popleft()
            self._frames[self._frames_made] = _Outgoing(data)
            frames.append(Frame(self._frames_made, len(data), crc32(data)))
            self._frames_made += 1
        return frames

    def _read(self, slots: Slots) -> Symbols:
        numbers, starts, indices = self._slots.runs(slots)
        parts = np.split(indices, starts[1:])
        picked = [self._symbols(n)[i] for n, i in zip(numbers, parts, strict=True)]
        return np.concatenate(picked)

    def _symbols(self, number: int) -> Symbols:
        frame = self._frames[number]
        if frame.symbols is None:
            frame.symbols = self._format.to_symbols(frame.data)
        return frame.symbols

    def _failed_slots(self, number: int) -> Slots:
        if number not in self._frames:
            raise FramingError(f"report of frame {number}, which is not under way")
        self.attempts[number] = self.attempts.get(number, 0) + 1
        self.repeated_frames += 1
        return self._slots.frame(number, len(self._frames[number].data))

    def _drop(self, numbers: Iterable[int]) -> None:
        for number in numbers:
            del self._frames[number]
            self.attempts.pop(number, None)


def _mask(bits: bytes, pairs: int) -> NDArray[np.bool_]:
    if not bits:
        return np.zeros(pairs, dtype=np.bool_)
    return np.unpackbits(np.frombuffer(bits, dtype=np.uint8), count=pairs).astype(np.bool_)
