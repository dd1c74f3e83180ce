"""The format of a frame: bytes to code bits to symbols, and back.

    bytes -> bits -> codewords -> interleaved -> symbols

The one place that knows how many pairs carry a frame.

Bits as symbols of pairs: one symbol for each Bell state that is distinguished.

Four symbols: two bits a pair, high bit first. Three symbols (an analyser of linear optics):
11 bits in 7 pairs, since 3^7 = 2187 covers 2^11 = 2048; a lost symbol erases its 11 bits,
and so does a word of symbols that stands for no 11 bits.

Frames, checks and repeats, at both ends: see outbox.py and inbox.py; here is what both share.

The sender cuts bytes into frames and fills blocks of pairs: first the symbols that the
receiver asked for again (refills), then new frames. Where most light is lost, a block has more
refills than there are open symbols, and carries these in turn, again and again; the first copy that
comes counts. The receiver tries a frame as soon as none of its symbols is on its way any more, with
its losses as erasures. If the check fails, lost pairs are asked for again one by one: they are few,
and each one filled leaves the code more room for errors. A frame that has nothing lost and still
fails is repeated as a whole.
Blocks of new frames alone may be sent before a report of those before them has come; refills wait
for all reports. Both ends keep the same ascending list of open slots, slot = frame number * pairs
of a full frame + index, so the list itself never travels.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hosts.hardware.replies import Symbols
from hosts.middleware.services.superdense.coding import (
    CODES,
    NAMES,
    Bits,
    Code,
    Mask,
    deinterleave,
    interleave,
)
from hosts.middleware.session.errors import unsupported
from hosts.middleware.session.options import MAX_BLOCK_PAIRS, MAX_FRAME_BYTES
from wire import dibits
from wire.metadata.blocks import Frame
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Fec
from wire.outcomes import NO_COINCIDENCE

GROUP_BITS, GROUP_PAIRS = 11, 7
_BIT_WEIGHTS = 1 << np.arange(GROUP_BITS)[::-1]
_TRIT_WEIGHTS = 3 ** np.arange(GROUP_PAIRS)[::-1]
_TRITS = (np.arange(1 << GROUP_BITS)[:, None] // _TRIT_WEIGHTS % 3).astype(np.uint8)


class Alphabet(Protocol):
    """A number of symbols, and how bits travel in them."""

    @property
    def symbols(self) -> int:
        """How many there are."""

    def pairs(self, bits: int) -> int:
        """Return how many pairs carry `bits` bits."""

    def to_symbols(self, bits: Bits) -> Symbols:
        """Return the symbols of bits; shape (pairs(bits.size),)."""

    def to_bits(self, symbols: Symbols, count: int) -> tuple[Bits, Mask]:
        """Return count bits and which of them are erased, from symbols of which 255 is lost."""


class Dibits:
    """Four symbols, 0 to 3."""

    symbols = 4

    def pairs(self, bits: int) -> int:
        return -(-bits // 2)

    def to_symbols(self, bits: Bits) -> Symbols:
        """Return two bits as one symbol; a last single bit is followed by 0."""
        symbols = bits[0::2] << np.uint8(1)
        symbols[: bits.size // 2] |= bits[1::2]
        return symbols

    def to_bits(self, symbols: Symbols, count: int) -> tuple[Bits, Mask]:
        """Return the bits; both of a lost symbol are erased."""
        bits = (symbols[:, None] >> np.array([1, 0], dtype=np.uint8) & np.uint8(1)).reshape(-1)
        return bits[:count], np.repeat(symbols == NO_COINCIDENCE, 2)[:count]


class Trits:
    """Three symbols, 0 to 2."""

    symbols = 3

    def pairs(self, bits: int) -> int:
        return -(-bits // GROUP_BITS) * GROUP_PAIRS

    def to_symbols(self, bits: Bits) -> Symbols:
        """Return the symbols of groups of eleven bits, the last one padded with zeros."""
        padded = np.zeros(-(-bits.size // GROUP_BITS) * GROUP_BITS, dtype=np.uint8)
        padded[: bits.size] = bits
        symbols: Symbols = _TRITS[padded.reshape(-1, GROUP_BITS) @ _BIT_WEIGHTS].reshape(-1)
        return symbols

    def to_bits(self, symbols: Symbols, count: int) -> tuple[Bits, Mask]:
        """Return the bits; those of a group that is incomplete or impossible are erased."""
        groups = symbols.reshape(-1, GROUP_PAIRS)
        numbers = groups @ _TRIT_WEIGHTS
        erased = (groups >= self.symbols).any(axis=1) | (numbers >= 1 << GROUP_BITS)
        numbers[erased] = 0
        bits = (numbers[:, None] >> np.arange(GROUP_BITS)[::-1] & 1).astype(np.uint8)
        return bits.reshape(-1)[:count], np.repeat(erased, GROUP_BITS)[:count]


ALPHABETS: dict[int, Alphabet] = {alphabet.symbols: alphabet for alphabet in (Dibits(), Trits())}


@dataclass(frozen=True)
class FrameFormat:
    """Code, order of its bits and alphabet of a session."""

    code: Code = CODES[Fec.NONE]
    interleaved: bool = False
    alphabet: Alphabet = ALPHABETS[4]

    @property
    def fills_losses(self) -> bool:
        return self.code.fec != Fec.NONE

    @property
    def plain(self) -> bool:
        """Whether symbols are the bytes themselves, two bits each.

        Then those of frames in a row are those of their bytes in a row, and can be made at once.
        """
        return not self.fills_losses and not self.interleaved and self.alphabet is ALPHABETS[4]

    def pairs(self, size: int) -> int:
        """Return how many pairs carry a frame of size bytes."""
        return self.alphabet.pairs(self.code.encoded_bits(8 * size))

    def to_symbols(self, data: bytes) -> Symbols:
        """Return the symbols of a frame; shape (pairs(len(data)),)."""
        if self.plain:
            return dibits.unpack(data, dibits.PER_BYTE * len(data))
        bits = np.unpackbits(np.frombuffer(data, dtype=np.uint8))
        encoded = self.code.encode(bits)
        if self.interleaved:
            encoded = interleave(self.code, encoded, bits.size)
        return self.alphabet.to_symbols(encoded)

    def to_bytes(self, symbols: Symbols, size: int) -> bytes:
        """Return the most likely bytes of a frame; only its check tells if they are right."""
        if self.plain:
            return dibits.pack(symbols & dibits.LARGEST)
        count = self.code.encoded_bits(8 * size)
        bits, erased = self.alphabet.to_bits(symbols, count)
        if self.interleaved:
            bits = deinterleave(self.code, bits, 8 * size)
            erased = deinterleave(self.code, erased, 8 * size)
        return np.packbits(self.code.decode(bits, erased, 8 * size)).tobytes()


def agreed_format(setup: Setup, symbols: int) -> FrameFormat:
    """Return what a set-up asks for; raise SessionError for an unknown code or long frames."""
    if setup.fec not in CODES:
        raise unsupported(
            f"error-correction code {setup.fec} is not known; offered are "
            + ", ".join(f"{number:d} ({name})" for name, number in NAMES.items()),
        )
    used = FrameFormat(CODES[Fec(setup.fec)], bool(setup.interleave), ALPHABETS[symbols])
    if used.pairs(min(setup.frame_bytes, MAX_FRAME_BYTES)) > MAX_BLOCK_PAIRS:
        raise unsupported(
            f"a frame of {setup.frame_bytes} bytes with the code {used.code.name} and {symbols} "
            f"symbols needs {used.pairs(setup.frame_bytes)} pairs, at most {MAX_BLOCK_PAIRS}; "
            "choose fewer bytes (--frame-bytes)",
        )
    return used


Slots = NDArray[np.int64]
BLOCKS_UNDER_WAY = 4  # at most: sent, and not reported of
NO_SLOTS: Slots = np.empty(0, dtype=np.int64)


class FramingError(Exception):
    """The two ends do not agree on what was sent: a fault of the other side."""


@dataclass(frozen=True)
class SlotMap:
    """Where frames lie in the ascending numbers of their symbols; the same at both ends."""

    format: FrameFormat
    frame_bytes: int

    @property
    def frame_pairs(self) -> int:
        return self.format.pairs(self.frame_bytes)

    def frame(self, number: int, size: int) -> Slots:
        first = number * self.frame_pairs
        return np.arange(first, first + self.format.pairs(size), dtype=np.int64)

    def block(self, open_slots: Slots, refills: int, frames: tuple[Frame, ...]) -> Slots:
        """Return the slot of each pair of a block: open ones in turn, then those of new frames."""
        new = [self.frame(frame.number, frame.size) for frame in frames]
        return np.concatenate([np.resize(open_slots, refills), *new])

    def numbers(self, slots: Slots) -> Slots:
        return np.unique(slots // self.frame_pairs)

    def runs(self, slots: Slots) -> tuple[list[int], Slots, Slots]:
        """Return the frame numbers of slots, where each begins, and the indices inside frames.

        Slots of a block are runs of one frame each: refills ascend, perhaps several times, new
        frames follow.
        """
        frames, indices = np.divmod(slots, self.frame_pairs)
        starts = np.flatnonzero(np.diff(frames, prepend=-1))
        return frames[starts].tolist(), starts, indices
