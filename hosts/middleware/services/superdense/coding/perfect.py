"""The perfect binary codes: repetition(3,1), Hamming(7,4) and Golay(23,12).

Systematic, data first. Perfect: every word is within t of exactly one codeword, so a table
of syndromes is maximum-likelihood decoding. Erasures are filled twice, with zeros and with
ones; a candidate with e errors outside f erasures is the nearest codeword if 2e + f < d,
and where neither is, all codewords are compared. Source: MacWilliams and Sloane, "The
Theory of Error-Correcting Codes", chapters 1 and 2.
"""

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from hosts.middleware.services.superdense.coding.code import Bits, Mask
from wire.metadata.vocabulary import Fec

WORDS_AT_A_TIME = 512  # compared with all codewords


class PerfectCode:
    """A perfect (n, k) code of odd distance, given by the parity bits of its unit vectors."""

    unit_bits = 1

    def __init__(self, fec: Fec, name: str, parity: NDArray[np.uint8], distance: int) -> None:
        self.fec = fec
        self.name = name
        self.distance = distance
        self.k = len(parity)
        checks: int = parity.shape[1]
        self.n: int = self.k + checks
        self._data_weights = 1 << np.arange(self.k)[::-1]
        self._check_weights = 1 << np.arange(checks)[::-1]
        data = np.arange(1 << self.k)[:, None] >> np.arange(self.k)[::-1] & 1
        checks_of_data = data @ parity & 1
        self._codebook: Bits = np.hstack([data, checks_of_data]).astype(np.uint8)
        self._syndromes = checks_of_data @ self._check_weights  # of data with no parity bits
        self._word_weights = (1 << np.arange(self.n)[::-1]).astype(np.int32)
        self._codewords = self._codebook @ self._word_weights
        self._errors = self._coset_leaders(np.vstack([parity, np.eye(checks, dtype=np.uint8)]))

    def word_bits(self, data_bits: int) -> int:
        return self.n

    def encoded_bits(self, data_bits: int) -> int:
        """Return n bits for each k, the last ones padded."""
        return -(-data_bits // self.k) * self.n

    def encode(self, bits: Bits) -> Bits:
        padded = np.zeros(-(-bits.size // self.k) * self.k, dtype=np.uint8)
        padded[: bits.size] = bits
        numbers = padded.reshape(-1, self.k) @ self._data_weights
        encoded: Bits = self._codebook[numbers].reshape(-1)
        return encoded

    def decode(self, bits: Bits, erased: Mask, data_bits: int) -> Bits:
        words, holes = bits.reshape(-1, self.n), erased.reshape(-1, self.n)
        data = self._nearest(words)
        some = np.flatnonzero(holes.any(axis=1))
        if some.size:
            data[some] = self._fill(words[some], holes[some])
        return data.reshape(-1)[:data_bits]

    def _coset_leaders(self, syndromes: NDArray[np.uint8]) -> Bits:
        """Return the error of least weight for every syndrome; rows: those of single errors."""
        leaders = np.zeros((1 << self.n - self.k, self.n), dtype=np.uint8)
        for weight in range((self.distance - 1) // 2 + 1):
            places = np.array(list(combinations(range(self.n), weight)), dtype=np.intp)
            syndrome_bits = syndromes[places].sum(axis=1, dtype=np.intp) & 1
            leaders[(syndrome_bits @ self._check_weights)[:, None], places] = 1
        return leaders

    def _nearest(self, words: Bits) -> Bits:
        """Return the data of the nearest codewords; shapes (m, n) and (m, k)."""
        numbers = words[:, : self.k] @ self._data_weights
        syndromes = self._syndromes[numbers] ^ words[:, self.k :] @ self._check_weights
        data: Bits = words[:, : self.k] ^ self._errors[syndromes, : self.k]
        return data

    def _fill(self, words: Bits, holes: Mask) -> Bits:
        """Return the data of the codewords nearest to words outside their holes."""
        tries = [self._nearest(np.where(holes, np.uint8(fill), words)) for fill in (0, 1)]
        wrong = [self._distances(data, words, holes) for data in tries]
        data = np.where((wrong[0] <= wrong[1])[:, None], *tries)
        unsure = np.flatnonzero(2 * np.minimum(*wrong) + holes.sum(axis=1) >= self.distance)
        for start in range(0, unsure.size, WORDS_AT_A_TIME):
            rows = unsure[start : start + WORDS_AT_A_TIME]
            data[rows] = self._compared(words[rows], holes[rows])
        return data

    def _distances(self, data: Bits, words: Bits, holes: Mask) -> NDArray[np.int64]:
        codewords = self._codebook[data @ self._data_weights]
        distances: NDArray[np.int64] = ((codewords != words) & ~holes).sum(axis=1)
        return distances

    def _compared(self, words: Bits, holes: Mask) -> Bits:
        """Return the data of the codewords nearest to words, by comparing with all of them."""
        differing = (words @ self._word_weights)[:, None] ^ self._codewords
        counted = differing & (~holes @ self._word_weights)[:, None]
        data: Bits = self._codebook[np.bitwise_count(counted).argmin(axis=1), : self.k]
        return data


def _cyclic(generator: int, n: int) -> NDArray[np.uint8]:
    """Return the parity bits of the unit vectors of a cyclic code, by polynomial division."""
    checks = generator.bit_length() - 1
    rows = []
    for degree in range(n - 1, checks - 1, -1):
        rest = 1 << degree
        for high in range(degree, checks - 1, -1):
            if rest >> high & 1:
                rest ^= generator << high - checks
        rows.append([rest >> bit & 1 for bit in range(checks - 1, -1, -1)])
    return np.array(rows, dtype=np.uint8)


REPETITION = PerfectCode(Fec.REPETITION, "repetition", np.array([[1, 1]], dtype=np.uint8), 3)
HAMMING = PerfectCode(
    Fec.HAMMING,
    "hamming",
    np.array([[1, 1, 0], [1, 0, 1], [0, 1, 1], [1, 1, 1]], dtype=np.uint8),
    3,
)
GOLAY = PerfectCode(Fec.GOLAY, "golay", _cyclic(0b101011100011, 23), 7)
