"""The interface of error-correction codes, and the code that does nothing.

A block interleaver: codewords written as rows are sent by columns.

    word 0   a0 a1 a2 ...
    word 1   b0 b1 b2 ...     sent: a0 b0 c0 a1 b1 c1 a2 ...
    word 2   c0 c1 c2 ...

Bits of one codeword are as many places apart as there are codewords, so with two or more
no two of them share a symbol of two bits, and with eleven or more none of eleven bits. A
code over bytes is interleaved by bytes: it counts a byte with eight wrong bits once.
"""

from functools import lru_cache
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from wire.metadata.vocabulary import Fec

Bits = NDArray[np.uint8]  # 0 or 1 each, one dimension
Mask = NDArray[np.bool_]
Received = TypeVar("Received", Bits, Mask)


class Code(Protocol):
    """A systematic block code; codewords follow one another, the last one padded with zeros."""

    @property
    def fec(self) -> Fec:
        """Its number on the wire."""

    @property
    def name(self) -> str:
        """Its name for users."""

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
        return 1

    def encoded_bits(self, data_bits: int) -> int:
        return data_bits

    def encode(self, bits: Bits) -> Bits:
        return bits

    def decode(self, bits: Bits, erased: Mask, data_bits: int) -> Bits:
        """Return the same bits, zeros where they are erased."""
        return np.where(erased, np.uint8(0), bits)


def interleave(code: Code, bits: Bits, data_bits: int) -> Bits:
    """Return encoded bits in the order in which they travel."""
    return bits[_places(code, bits.size, data_bits)]


def deinterleave(code: Code, received: Received, data_bits: int) -> Received:
    """Return bits (or which are erased) in the order of their codewords."""
    placed = np.empty_like(received)
    placed[_places(code, received.size, data_bits)] = received
    return placed


def _places(code: Code, encoded_bits: int, data_bits: int) -> NDArray[np.int64]:
    return _order(encoded_bits, code.word_bits(data_bits), code.unit_bits)


@lru_cache(maxsize=64)
def _order(encoded_bits: int, word_bits: int, unit_bits: int) -> NDArray[np.int64]:
    """Return which encoded bit travels at each place; shape (encoded_bits,)."""
    columns = word_bits // unit_bits
    units = np.argsort(np.arange(encoded_bits // unit_bits) % columns, kind="stable")
    order: NDArray[np.int64] = (units[:, None] * unit_bits + np.arange(unit_bits)).reshape(-1)
    return order
