"""The errors that a perfect code leaves, computed over all error patterns of a codeword.

Every word is one error pattern away from the nearest codeword: the leader of its coset. So the
decoder turns an error pattern into the pattern plus its leader, and the residual bit error is the
mean weight of that sum in the data bits. Two laws give a pattern its probability:

- interleaved: each bit comes from another dibit, so bits are wrong independently with p/2;
- not interleaved: two bits a dibit, each of its three errors with p/4. The lengths of codewords
  are odd, so every second one begins in the middle of a dibit.
"""

from functools import cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from evidence.curves import theory
from hosts.middleware.services.superdense.coding import CODES, NAMES

Counts = NDArray[np.float64]


def residual_error(name: str, interleaved: bool, p: float) -> float | None:
    """Return the residual bit error over data bits, None for a code that is not perfect."""
    if name == "none":
        return theory.bit_error(p)
    length, data_bits = _size(name)
    if length > 32:
        return None
    if interleaved:
        return float(_weights(name) @ _independent(length, p / 2)) / data_bits
    likely = np.outer(_dibits(length // 2, p), [1 - p / 2, p / 2])
    wrong = [float((_classes(name, phase) * likely).sum()) for phase in (0, 1)]
    return sum(wrong) / 2 / data_bits


def _independent(length: int, wrong: float) -> Counts:
    """Return the probability of one pattern of each weight."""
    weights = np.arange(length + 1)
    return wrong**weights * (1 - wrong) ** (length - weights)


def _dibits(dibits: int, p: float) -> Counts:
    """Return the probability of one pattern with a number of wrong dibits."""
    wrong = np.arange(dibits + 1)
    return (p / 4) ** wrong * (1 - 3 * p / 4) ** (dibits - wrong)


@cache
def _weights(name: str) -> Counts:
    """Return the sum of residual errors over all patterns of each weight, shape (n + 1,)."""
    length, _data_bits = _size(name)
    patterns, residual = _decoded(name)
    return np.bincount(np.bitwise_count(patterns), residual, length + 1).astype(float)


@cache
def _classes(name: str, phase: int) -> Counts:
    """Return the same by wrong dibits and by the bit that is alone, shape (n//2 + 1, 2).

    Phase 0: the codeword begins with a dibit, phase 1: with half of one.
    """
    length, _data_bits = _size(name)
    patterns, residual = _decoded(name)
    one = np.uint32(1)
    alone = (patterns if phase == 0 else patterns >> np.uint32(length - 1)) & one
    dibits = patterns >> one if phase == 0 else patterns & np.uint32((1 << length - 1) - 1)
    either = (dibits | dibits >> one) & np.uint32(0x55555555)
    classes = np.bitwise_count(either) * np.uint8(2) + alone
    counts = np.bincount(classes, residual, 2 * (length // 2 + 1))
    return counts.reshape(-1, 2).astype(float)


def _decoded(name: str) -> tuple[NDArray[np.uint32], NDArray[np.uint8]]:
    """Return every error pattern, first bit highest, and how many data bits stay wrong."""
    length, data_bits = _size(name)
    checks = length - data_bits
    code = CODES[NAMES[name]]
    unit_vectors = np.eye(data_bits, dtype=np.uint8)
    parity = [_number(code.encode(vector)[data_bits:]) for vector in unit_vectors]
    columns = [*parity, *(1 << check for check in reversed(range(checks)))]
    syndromes = np.zeros(1, dtype=np.uint32)
    for column in reversed(columns):
        syndromes = np.concatenate([syndromes, syndromes ^ np.uint32(column)])
    leaders = _leaders(syndromes, length, 1 << checks)
    patterns = np.arange(1 << length, dtype=np.uint32)
    return patterns, np.bitwise_count((patterns ^ leaders[syndromes]) >> np.uint32(checks))


def _leaders(syndromes: NDArray[np.uint32], length: int, cosets: int) -> NDArray[np.uint32]:
    """Return the lightest pattern of each coset; a perfect code has one in each."""
    leaders: dict[int, int] = {}
    for weight in range(length + 1):
        for places in combinations(range(length), weight):
            pattern = sum(1 << place for place in places)
            leaders.setdefault(int(syndromes[pattern]), pattern)
        if len(leaders) == cosets:
            break
    return np.array([leaders[syndrome] for syndrome in range(cosets)], dtype=np.uint32)


def _size(name: str) -> tuple[int, int]:
    """Return the length of a codeword and its data bits."""
    code = CODES[NAMES[name]]
    data_bits = 1
    while code.encoded_bits(data_bits + 1) == code.encoded_bits(1):
        data_bits += 1
    return code.encoded_bits(1), data_bits


def _number(bits: NDArray[np.uint8]) -> int:
    return int("".join(map(str, bits.tolist())), 2)
