"""Random numbers that depend on what they are for and not on when they are asked for.

Each purpose of each block has a stream of its own, of which photon j takes the j-th number.
So neither the order of arrival nor how a block was divided changes what a photon meets.
"""

from dataclasses import dataclass, replace
from hashlib import blake2b

import numpy as np
from numpy.typing import NDArray

from dispatcher.sabot.backend import Bytes

Key = tuple[int, int, int]  # session, block number, half
Mask = NDArray[np.bool_]

BYTE = 256


class Draws:
    """The random numbers of a run, all from its seed."""

    def __init__(self, seed: int) -> None:
        """Use this seed, any integer."""
        self._seed = seed

    def bits(self, key: Key, purpose: str, count: int) -> Bytes:
        """Return a fair bit for each of the first `count` photons of a block."""
        packed = np.frombuffer(self._generator(key, purpose).bytes((count + 7) // 8), np.uint8)
        return np.unpackbits(packed, count=count, bitorder="little")

    def uniform(self, key: Key, purpose: str, count: int) -> NDArray[np.float64]:
        """Return a number from [0, 1) for each of the first `count` photons of a block."""
        return self._generator(key, purpose).random(count)

    def normal(self, key: Key, purpose: str, count: int) -> NDArray[np.float64]:
        """Return a number of mean 0 and variance 1 for each of `count` photons of a block."""
        return self._generator(key, purpose).standard_normal(count)

    def exponential(self, key: Key, purpose: str, count: int) -> NDArray[np.float64]:
        """Return a number from the exponential distribution of mean 1 for each of `count`."""
        return self._generator(key, purpose).standard_exponential(count)

    def hits(self, key: Key, purpose: str, count: int, probability: float) -> Mask:
        """Return which of the first `count` photons something of this probability happens to.

        A byte for each photon decides it, and a number where the byte is the one that the
        probability falls into: exact, in a quarter of the time. What is sure is not drawn.
        """
        if not 0 < probability < 1:
            return np.full(count, probability >= 1)
        generator = self._generator(key, purpose)
        whole, rest = divmod(probability * BYTE, 1.0)
        drawn = np.frombuffer(generator.bytes(count), np.uint8)
        hit = drawn < whole
        undecided = np.flatnonzero(drawn == whole)
        refining = self._generator(key, f"{purpose}, refined")
        hit[undecided] = refining.random(undecided.size) < rest
        return hit

    def _generator(self, key: Key, purpose: str) -> np.random.Generator:
        """Return a counter-based generator (Philox, Salmon et al. 2011) for the purpose."""
        identity = repr((self._seed, *key, purpose)).encode()
        digest = blake2b(identity, digest_size=16).digest()
        return np.random.Generator(np.random.Philox(key=np.frombuffer(digest, np.uint64)))


@dataclass(frozen=True)
class PhotonDraws:
    """The random numbers of the photons of one block at one place."""

    draws: Draws
    key: Key
    where: str
    count: int  # photons of the block

    def at(self, place: str) -> "PhotonDraws":
        """Return others, for a place within this one."""
        return replace(self, where=self._at(place))

    def bits(self, purpose: str) -> Bytes:
        """Return a fair bit for each photon."""
        return self.draws.bits(self.key, self._at(purpose), self.count)

    def uniform(self, purpose: str) -> NDArray[np.float64]:
        """Return a number from [0, 1) for each photon."""
        return self.draws.uniform(self.key, self._at(purpose), self.count)

    def normal(self, purpose: str) -> NDArray[np.float64]:
        """Return a number of mean 0 and variance 1 for each photon."""
        return self.draws.normal(self.key, self._at(purpose), self.count)

    def hits(self, purpose: str, probability: float) -> Mask:
        """Return which photons something of this probability happens to."""
        return self.draws.hits(self.key, self._at(purpose), self.count, probability)

    def few(self, purpose: str, count: int) -> NDArray[np.float64]:
        """Return a number from [0, 1) for each of the few photons that need one."""
        return self.draws.uniform(self.key, self._at(purpose), count)

    def waits(self, purpose: str, count: int) -> NDArray[np.float64]:
        """Return an exponential number of mean 1 for each of the few photons that need one."""
        return self.draws.exponential(self.key, self._at(purpose), count)

    def _at(self, purpose: str) -> str:
        return f"{self.where} {purpose}"
