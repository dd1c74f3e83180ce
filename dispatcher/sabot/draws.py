"""Random numbers that depend on what they are for and not on when they are asked for.

Each purpose of each block has a stream of its own, of which photon j takes the j-th number.
So neither the order of arrival nor how a block was divided changes what a photon meets.
"""

from hashlib import blake2b

import numpy as np
from numpy.typing import NDArray

from dispatcher.sabot.backend import Bytes

Key = tuple[int, int, int]  # session, block number, half


class Draws:
    """The random numbers of a run, all from its seed."""

    def __init__(self, seed: int) -> None:
        """Use this seed, any integer."""
        self._seed = seed

    def bits(self, key: Key, purpose: str, count: int) -> Bytes:
        """Return a fair bit for each of the first `count` photons of a block."""
        packed = np.frombuffer(self.generator(key, purpose).bytes((count + 7) // 8), np.uint8)
        return np.unpackbits(packed, count=count, bitorder="little")

    def uniform(self, key: Key, purpose: str, count: int) -> NDArray[np.float64]:
        """Return a number from [0, 1) for each of the first `count` photons of a block."""
        return self.generator(key, purpose).random(count)

    def generator(self, key: Key, purpose: str) -> np.random.Generator:
        """Return a counter-based generator (Philox, Salmon et al. 2011) for the purpose."""
        identity = repr((self._seed, *key, purpose)).encode()
        digest = blake2b(identity, digest_size=16).digest()
        return np.random.Generator(np.random.Philox(key=np.frombuffer(digest, np.uint64)))
