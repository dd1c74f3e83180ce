"""Bits as symbols of pairs: one symbol for each Bell state that is distinguished.

Four symbols: two bits a pair, high bit first. Three symbols (an analyser of linear optics):
11 bits in 7 pairs, since 3^7 = 2187 covers 2^11 = 2048; a lost symbol erases its 11 bits,
and so does a word of symbols that stands for no 11 bits.
"""

from typing import Protocol

import numpy as np

from hosts.hardware.replies import Symbols
from hosts.middleware.services.superdense.coding import Bits, Mask
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
        """Return seven pairs for each eleven bits."""
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
