"""The receiver's side of framing: what has come, what must come again."""

from dataclasses import dataclass
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from hosts.hardware.replies import Symbols
from hosts.middleware.services.superdense.frame_format import (
    BLOCKS_UNDER_WAY,
    NO_SLOTS,
    FrameFormat,
    FramingError,
    SlotMap,
    Slots,
)
from wire import dibits
from wire.metadata.blocks import Block, Frame, Report
from wire.outcomes import NO_COINCIDENCE

SYMBOLS = 4
DIAGONAL = np.diag_indices(SYMBOLS)


@dataclass
class _Incoming:
    frame: Frame
    symbols: Symbols
    # Further arrivals for each place, wrong or repeated symbols: (pairs, 4) counts.
    besides: NDArray[np.uint32] | None = None

    @property
    def complete(self) -> bool:
        return not (self.symbols == NO_COINCIDENCE).any()

    def take_first(self, index: Slots, symbols: Symbols) -> None:
        """Fill places by what comes first; the rest is kept to be counted when frames are right."""
        arrived = symbols != NO_COINCIDENCE
        index, symbols = index[arrived], symbols[arrived]
        first = np.zeros(index.size, dtype=np.bool_)
        first[np.unique(index, return_index=True)[1]] = True
        first &= self.symbols[index] == NO_COINCIDENCE
        self.symbols[index[first]] = symbols[first]
        self._remember(index[~first], symbols[~first])

    def begin_again(self) -> None:
        """Wait for every place again; arrivals are kept, to be counted when the frame is right."""
        self._remember(np.arange(self.symbols.size), self.symbols)
        self.symbols = np.full(self.symbols.size, NO_COINCIDENCE, dtype=np.uint8)

    def _remember(self, index: Slots, symbols: Symbols) -> None:
        arrived = symbols != NO_COINCIDENCE
        if arrived.any():
            if self.besides is None:
                self.besides = np.zeros((self.symbols.size, SYMBOLS), dtype=np.uint32)
            cells = SYMBOLS * index[arrived] + symbols[arrived]
            np.add.at(self.besides.reshape(-1), cells, 1)


class Inbox:
    """Frames that are not whole yet, and bytes that are."""

    def __init__(self, frame_bytes: int, frame_format: FrameFormat) -> None:
        self._slots = SlotMap(frame_format, frame_bytes)
        self._format = frame_format
        self._frame_bytes = frame_bytes
        self._frames: dict[int, _Incoming] = {}
        self._open: Slots = NO_SLOTS
        self._announced = 0
        self._ahead = 0  # blocks in a row whose sender may not have known what is open
        self._complete: dict[int, bytes] = {}
        self._delivered = 0
        self.symbol_errors = 0
        self.corrected_symbols = 0
        self.filled_symbols = 0
        self.symbols_seen = 0
        self.symbols_lost = 0
        self.repeated_frames = 0
        # Symbols sent x received, where known.
        self.confusion = np.zeros((SYMBOLS, SYMBOLS), dtype=np.int64)
        self._as_sent: list[Symbols] = []  # of frames that came without an error, to be counted

    def block(self, block: Block, symbols: Symbols) -> Report:
        """Take the symbols of a block (255: lost); return what the sender must know."""
        self._announce(block)
        if self._format.plain and not block.refills and not (symbols == NO_COINCIDENCE).any():
            return self._report(block, self._take_whole(block.frames, symbols))
        for frame in block.frames:
            pairs = self._format.pairs(frame.size)
            self._frames[frame.number] = _Incoming(
                frame, np.full(pairs, NO_COINCIDENCE, dtype=np.uint8)
            )
        slots = self._slots.block(self._open, block.refills, block.frames)
        rest = self._open[block.refills :]
        touched = self._fill(slots, symbols, copies=block.refills > self._open.size)
        accepted, failed = self._judge(touched, on_their_way=self._slots.numbers(rest))
        self._tally_as_sent()
        lost = symbols == NO_COINCIDENCE
        needed = ~np.isin(slots // self._slots.frame_pairs, accepted)
        again = lost & needed & ~np.isin(slots, slots[~lost])
        self._open = np.unique(np.concatenate([rest, slots[again], *map(self._reset, failed)]))
        bits = np.packbits(again).tobytes() if again.any() else b""
        return self._report(block, failed, int(lost.sum()), bits)

    def take(self) -> bytes:
        """Return the bytes that are complete, in order, once."""
        parts = []
        while self._delivered in self._complete:
            parts.append(self._complete.pop(self._delivered))
            self._delivered += 1
        return b"".join(parts)

    def _report(self, block: Block, failed: list[int], lost: int = 0, again: bytes = b"") -> Report:
        self.symbols_seen += block.pairs - lost
        self.symbols_lost += lost
        return Report(
            block.session,
            block.block,
            block.pairs,
            lost,
            self.symbol_errors,
            self.corrected_symbols,
            self.filled_symbols,
            tuple(failed),
            again,
        )

    def _take_whole(self, frames: tuple[Frame, ...], symbols: Symbols) -> list[int]:
        """Take new frames of which no symbol is lost, all at once; return those that are wrong.

        Frame by frame, as lost symbols need it, takes ten times as long.
        """
        data = self._format.to_bytes(symbols, symbols.size // dibits.PER_BYTE)
        start, right, wrong = 0, [], []
        for frame in frames:
            end = start + frame.size
            part = data[start:end]
            if crc32(part) == frame.crc32:
                self._complete[frame.number] = part
                right.append(part)
            else:
                copied = symbols[dibits.PER_BYTE * start : dibits.PER_BYTE * end]
                self._frames[frame.number] = _Incoming(frame, copied.copy())
                wrong.append(frame.number)
            start = end
        self.confusion[DIAGONAL] += dibits.counts(b"".join(right))
        if wrong:
            self._open = np.unique(np.concatenate([self._open, *map(self._reset, wrong)]))
        return wrong

    def _announce(self, block: Block) -> None:
        numbers = [frame.number for frame in block.frames]
        if numbers != list(range(self._announced, self._announced + len(numbers))):
            raise FramingError(f"block {block.block} announces frames {numbers} out of order")
        if block.refills and not self._open.size:
            raise FramingError(f"block {block.block} refills more than is open")
        ahead = self._ahead + 1 if block.frames and block.refills < self._open.size else 0
        if ahead and (block.refills or ahead >= BLOCKS_UNDER_WAY):
            raise FramingError(f"block {block.block} begins new frames before the open ones")
        for frame in block.frames:
            if not 0 < frame.size <= self._frame_bytes:
                raise FramingError(f"frame {frame.number} has {frame.size} bytes")
        counts = [self._format.pairs(frame.size) for frame in block.frames]
        if block.pairs != block.refills + sum(counts):
            raise FramingError(
                f"block {block.block}: {block.pairs} pairs do not carry {block.refills} refills "
                f"and frames of {sum(counts)} pairs"
            )
        self._announced += len(numbers)
        self._ahead = ahead

    def _fill(self, slots: Slots, symbols: Symbols, copies: bool) -> list[int]:
        """Put symbols where they belong; return the numbers of the frames they belong to.

        Copies: a slot may be there several times.
        """
        if not slots.size:
            return []
        if copies:  # those of a frame beside each other
            order = np.argsort(slots, kind="stable")
            slots, symbols = slots[order], symbols[order]
        numbers, starts, indices = self._slots.runs(slots)
        parts = zip(
            numbers, np.split(indices, starts[1:]), np.split(symbols, starts[1:]), strict=True
        )
        for number, index, symbol in parts:
            if copies:
                self._frames[number].take_first(index, symbol)
            else:
                self._frames[number].symbols[index] = symbol
        return numbers

    def _judge(self, touched: list[int], on_their_way: Slots) -> tuple[list[int], list[int]]:
        accepted: list[int] = []
        failed: list[int] = []
        for number in set(touched).difference(on_their_way.tolist()):
            complete = self._frames[number].complete
            if (complete or self._format.fills_losses) and self._accept(number):
                accepted.append(number)
            elif complete:
                failed.append(number)
        return accepted, sorted(failed)

    def _accept(self, number: int) -> bool:
        incoming = self._frames[number]
        data = self._format.to_bytes(incoming.symbols, incoming.frame.size)
        if crc32(data) != incoming.frame.crc32:
            return False
        if incoming.besides is not None or self._format.fills_losses:
            self._count(incoming, self._format.to_symbols(data))
        else:  # nothing was put right: what came is what was sent
            self._as_sent.append(incoming.symbols)
        del self._frames[number]
        self._complete[number] = data
        return True

    def _count(self, incoming: _Incoming, sent: Symbols) -> None:
        lost = incoming.symbols == NO_COINCIDENCE
        corrected = int(((incoming.symbols != sent) & ~lost).sum())
        self.corrected_symbols += corrected
        self.filled_symbols += int(lost.sum())
        self.symbol_errors += corrected
        self._tally(sent, incoming.symbols)
        if incoming.besides is not None:
            besides = np.array(
                [incoming.besides[sent == symbol].sum(axis=0) for symbol in range(SYMBOLS)]
            )
            self.symbol_errors += int(besides.sum() - besides.trace())
            self.confusion += besides.astype(np.int64)

    def _tally_as_sent(self) -> None:
        """Count the symbols of right frames, those of a block at once: one by one takes longer."""
        if self._as_sent:
            symbols = np.concatenate(self._as_sent)
            counts = [np.count_nonzero(symbols == symbol) for symbol in range(SYMBOLS)]
            self.confusion[DIAGONAL] += counts
            self._as_sent.clear()

    def _tally(self, sent: Symbols, received: Symbols) -> None:
        arrived = received != NO_COINCIDENCE
        cells = SYMBOLS * sent[arrived] + received[arrived]
        counts = np.bincount(cells, minlength=SYMBOLS * SYMBOLS)
        self.confusion += counts.reshape(SYMBOLS, SYMBOLS)

    def _reset(self, number: int) -> Slots:
        incoming = self._frames[number]
        self.repeated_frames += 1
        incoming.begin_again()
        return self._slots.frame(number, incoming.frame.size)
