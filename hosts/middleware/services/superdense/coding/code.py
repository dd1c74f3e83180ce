"""The interface of error-correction codes, and the code that does nothing."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from wire.metadata import Fec

Bits = NDArray[np.uint8]  # 0 or 1 each, one dimension
Mask = NDArray[np.bool_]


class Code(Protocol):
    """A systematic block code; codewords follow one another, the last one padded with zeros."""

    @property
    def fec(self) -> Fec:
        """Its number on the wire."""

    @property
    def name(self) -> str:
        """What users call it."""

    @property
    def unit_bits(self) -> int:
        """Bits that count as one symbol of the code: 1, or 8 for a code over bytes."""

    def word_bits(self, data_bits: int) -> int:
        """Return the length of the codewords (the last may be shorter) for this many bits."""

    def encoded_bits(self, data_bits: int) -> int:
        """Return how many bits the code makes of this many."""

    def encode(self, bits: Bits) -> Bits:
        """Return the codewords of data; shape (encoded_bits(bits.size),)."""

    def decode(self, bits: Bits, erased: Mask, data_bits: int) -> Bits:
        """Return the data of received codewords; shape (data_bits,).

        `bits` and `erased` have shape (encoded_bits(data_bits),); the value of an erased bit
        does not matter. More errors than the code can put right give wrong data, never an
        exception: what carries the data has a check of its own.
        """


class Uncoded:
    """No code: bits travel as they are."""

    fec = Fec.NONE
    name = "none"
    unit_bits = 1

    def word_bits(self, data_bits: int) -> int:
        """Return 1: every bit stands for itself."""
        return 1

    def encoded_bits(self, data_bits: int) -> int:
        """Return the same number."""
        return data_bits

    def encode(self, bits: Bits) -> Bits:
        """Return the same bits."""
        return bits

    def decode(self, bits: Bits, erased: Mask, data_bits: int) -> Bits:
        """Return the same bits, zeros where they are erased."""
        return np.where(erased, np.uint8(0), bits)
