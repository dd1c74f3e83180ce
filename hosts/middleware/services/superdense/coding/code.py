"""The interface of error-correction codes, and the code that does nothing.

A block interleaver: codewords written as rows are sent by columns.

    word 0   a0 a1 a2 ...
    word 1   b0 b1 b2 ...     sent: a0 b0 c0 a1 b1 c1 a2 ...
    word 2   c0 c1 c2 ...

Bits of one codeword are as many places apart as there are codewords, so with two or more
no two of them share a symbol of two bits, and with eleven or more none of eleven bits. A
code over bytes is interleaved by bytes: it counts a byte with eight wrong bits once.

Reed-Solomon over bytes, RS(255,223) shortened: 32 check bytes for up to 223 of data.

Data is cut into as few codewords as will do, as equal as can be, so that none of them is
weaker than the others. Each corrects e wrong and f erased bytes if 2e + f <= 32.
"""

from functools import lru_cache
from typing import Protocol, TypeVar

import numpy as np
import reedsolo
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


CHECK_BYTES = 32
DATA_BYTES = 255 - CHECK_BYTES


class ReedSolomon:
    """The library reedsolo, on bits."""

    fec = Fec.REED_SOLOMON
    name = "reed-solomon"
    unit_bits = 8

    def __init__(self) -> None:
        self._codec = reedsolo.RSCodec(CHECK_BYTES)

    def word_bits(self, data_bits: int) -> int:
        """Return the length of every codeword but the last, which may be shorter."""
        return 8 * (_data_bytes(data_bits) + CHECK_BYTES)

    def encoded_bits(self, data_bits: int) -> int:
        """Return 8 bits for each byte of data and for 32 check bytes for each codeword."""
        size = -(-data_bits // 8)
        return 8 * (size + _words(size) * CHECK_BYTES)

    def encode(self, bits: Bits) -> Bits:
        """Return the codewords of data, one after the other."""
        data, step = np.packbits(bits).tobytes(), _data_bytes(bits.size)
        words = (data[start : start + step] for start in range(0, len(data), step))
        encoded = b"".join(bytes(self._codec.encode(word)) for word in words)
        return np.unpackbits(np.frombuffer(encoded, dtype=np.uint8))

    def decode(self, bits: Bits, erased: Mask, data_bits: int) -> Bits:
        """Return the data; that of a codeword with too many errors as it came."""
        octets, step = np.packbits(bits), self.word_bits(data_bits) // 8
        holes: Mask = erased.reshape(-1, 8).max(axis=1)
        data = b"".join(
            self._word(octets[start : start + step], holes[start : start + step])
            for start in range(0, octets.size, step)
        )
        return np.unpackbits(np.frombuffer(data, dtype=np.uint8), count=data_bits)

    def _word(self, word: Bits, holes: Mask) -> bytes:
        places = np.flatnonzero(holes).tolist()
        try:
            return bytes(self._codec.decode(word.tobytes(), erase_pos=places)[0])
        except reedsolo.ReedSolomonError:
            return word[:-CHECK_BYTES].tobytes()


def _words(size: int) -> int:
    return -(-size // DATA_BYTES)


def _data_bytes(data_bits: int) -> int:
    """Return the data bytes of every codeword but the last."""
    size = max(1, -(-data_bits // 8))
    return -(-size // _words(size))
