"""A block interleaver: codewords written as rows are sent by columns.

    word 0   a0 a1 a2 ...
    word 1   b0 b1 b2 ...     sent: a0 b0 c0 a1 b1 c1 a2 ...
    word 2   c0 c1 c2 ...

Bits of one codeword are as many places apart as there are codewords, so with two or more
no two of them share a symbol of two bits, and with eleven or more none of eleven bits. A
code over bytes is interleaved by bytes: it counts a byte with eight wrong bits once.
"""

from functools import lru_cache
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from hosts.middleware.services.superdense.coding.code import Bits, Code, Mask

Received = TypeVar("Received", Bits, Mask)


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
