"""Parities of a key in the shuffled orders of Cascade, and the end that answers with them.

Pass p of Cascade reorders the bits and cuts them into blocks. Both ends derive the orders
from one public seed, so that a block is named by numbers: the pass, where it starts, where
it stops.

A regular low-density parity-check code of any size, drawn from a public seed.

Every bit of the key is in three checks, every check has about as many bits as any other
(Gallager 1962). A code is the array of the three checks of each bit.
"""

from dataclasses import dataclass

import numpy as np

from applications.qkd.bits import Bits, Indices
from applications.qkd.messages import AskBlocks, AskIntervals, AskSyndrome, QkdMessage
from applications.qkd.public_randomness import mixed, permutation

ROWS_OF_A_BIT = 3
LEAST_CHECKS = 8  # with fewer, three different rows may not be found


def rows(seed: bytes, bits: int, checks: int) -> Indices:
    """Return the checks that each bit is in, shape (bits, 3), three different ones each."""
    if checks < LEAST_CHECKS:
        raise ValueError(f"{checks} checks, at least {LEAST_CHECKS}")
    code = permutation(seed, f"ldpc {checks}", bits * ROWS_OF_A_BIT).reshape(bits, -1) % checks
    while True:
        twice = (code == np.roll(code, 1, axis=1)).any(axis=1)
        if not twice.any():
            return code
        code[twice] = (code[twice] + np.arange(ROWS_OF_A_BIT)) % checks


def syndrome(key: Bits, code: Indices, checks: int) -> Bits:
    ones = np.bincount(code[key == 1].ravel(), minlength=checks)
    return (ones & 1).astype(np.uint8)


MAX_PASSES = 64
ZERO = np.zeros(1, dtype=np.uint8)


class ReconciliationError(Exception):
    """The other end asks what its protocol does not ask, or answers what was not asked."""


@dataclass(frozen=True)
class Blocks:
    """All blocks of a size in each pass from first on; of later passes all but the last one.

    The last block of a later pass is not asked for: pass 0 has the parity of the whole.
    """

    first: int
    passes: int
    size: int


@dataclass(frozen=True)
class Intervals:
    """Parts of blocks of one pass: bits starts[i] to stops[i] (exclusive) of its order."""

    number: int
    starts: Indices
    stops: Indices


@dataclass(frozen=True)
class Syndrome:
    """The parities of the whole key under the LDPC code with `checks` checks."""

    checks: int


Query = Blocks | Intervals | Syndrome


def shuffled(seed: bytes, number: int, bits: int) -> Indices:
    """Return the order of a pass: element i is the place in the key of its i-th bit."""
    return mixed(seed, f"cascade {number}", bits)


def prefix_parities(bits: Bits) -> Bits:
    """Return the parity of the first i bits for every i from 0 to the number of bits.

    Of eight bits at a time: first from the beginning of each byte, then also of those before it.
    """
    packed = np.packbits(bits)
    for step in (1, 2, 4):
        packed ^= packed >> np.uint8(step)
    odd = np.bitwise_xor.accumulate(packed & np.uint8(1))
    packed[1:] ^= odd[:-1] * np.uint8(0xFF)
    return np.concatenate([ZERO, np.unpackbits(packed, count=bits.size)])


def block_starts(bits: int, size: int) -> Indices:
    return np.arange(0, bits, size, dtype=np.int64)


def asked_blocks(number: int, bits: int, size: int) -> int:
    """Return of how many blocks of a pass the parity is asked for."""
    blocks = -(-bits // size)
    return blocks if number == 0 else blocks - 1


class ReferenceKey:
    """The key that counts as right: answers questions about it and counts what they tell."""

    def __init__(self, key: Bits, seed: bytes) -> None:
        self._key = key
        self._seed = seed
        self._prefixes: dict[int, Bits] = {}
        self.leaked_bits = 0

    def answer(self, query: Query) -> Bits:
        """Return the parities asked for; raise ReconciliationError if there can be none."""
        match query:
            case Blocks():
                return self._blocks(query)
            case Intervals():
                return self._intervals(query)
            case Syndrome():
                return self._syndrome(query)

    def _tell(self, count: int) -> None:
        """Count bits that an answer tells, before any work is done for it."""
        self.leaked_bits += count
        if self.leaked_bits > self._key.size:
            raise ReconciliationError(f"more parities asked for than the {self._key.size} bits")

    def _blocks(self, query: Blocks) -> Bits:
        if not 1 <= query.size <= self._key.size or query.passes < 1:
            raise ReconciliationError(
                f"{query.passes} passes with blocks of {query.size} of {self._key.size} bits"
            )
        numbers = range(query.first, query.first + query.passes)
        self._tell(sum(asked_blocks(number, self._key.size, query.size) for number in numbers))
        starts = block_starts(self._key.size, query.size)
        stops = np.minimum(starts + query.size, self._key.size)
        answers = []
        for number in numbers:
            count = asked_blocks(number, self._key.size, query.size)
            prefix = self._prefix(number)
            answers.append(prefix[starts[:count]] ^ prefix[stops[:count]])
        return np.concatenate(answers)

    def _intervals(self, query: Intervals) -> Bits:
        starts, stops = query.starts, query.stops
        right = (starts >= 0) & (starts < stops) & (stops <= self._key.size)
        if starts.shape != stops.shape or not right.all():
            raise ReconciliationError(f"intervals outside the {self._key.size} bits of the key")
        self._tell(starts.size)
        prefix = self._prefix(query.number)
        return prefix[starts] ^ prefix[stops]

    def _syndrome(self, query: Syndrome) -> Bits:
        if not LEAST_CHECKS <= query.checks < self._key.size:
            raise ReconciliationError(f"{query.checks} checks of {self._key.size} bits")
        self._tell(query.checks)
        return syndrome(self._key, rows(self._seed, self._key.size, query.checks), query.checks)

    def _prefix(self, number: int) -> Bits:
        if not 0 <= number < MAX_PASSES:
            raise ReconciliationError(f"pass {number}: there are at most {MAX_PASSES}")
        if number not in self._prefixes:
            order = shuffled(self._seed, number, self._key.size)
            self._prefixes[number] = prefix_parities(self._key[order])
        return self._prefixes[number]


def to_message(query: Query) -> QkdMessage:
    if isinstance(query, Blocks):
        return AskBlocks(query.first, query.passes, query.size)
    if isinstance(query, Syndrome):
        return AskSyndrome(query.checks)
    starts = query.starts.astype(">u4").tobytes()
    widths = (query.stops - query.starts).astype(">u2").tobytes()
    return AskIntervals(query.number, query.starts.size, starts, widths)


def to_query(message: AskBlocks | AskIntervals | AskSyndrome) -> Query:
    if isinstance(message, AskBlocks):
        return Blocks(message.first, message.passes, message.size)
    if isinstance(message, AskSyndrome):
        return Syndrome(message.checks)
    starts = np.frombuffer(message.starts, dtype=">u4").astype(np.int64)
    widths = np.frombuffer(message.widths, dtype=">u2").astype(np.int64)
    return Intervals(message.number, starts, starts + widths)
