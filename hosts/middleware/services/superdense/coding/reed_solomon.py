"""Reed-Solomon over bytes, RS(255,223) shortened: 32 check bytes for up to 223 of data.

Data is cut into as few codewords as will do, as equal as can be, so that none of them is
weaker than the others. Each corrects e wrong and f erased bytes if 2e + f <= 32.
"""

import numpy as np
import reedsolo

from hosts.middleware.services.superdense.coding.code import Bits, Mask
from wire.metadata.vocabulary import Fec

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
