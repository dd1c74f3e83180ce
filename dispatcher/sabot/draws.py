"""Random numbers that depend on what they are for and not on when they are asked for.

Each purpose of each block has a stream of its own, of which photon j takes the j-th number.
So neither the order of arrival nor how a block was divided changes what a photon meets.
"""

from collections.abc import Callable
from hashlib import blake2b
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import DTypeLike, NDArray

from dispatcher.sabot.backend import Bytes

Key = tuple[int, int, int]  # session, block number, half
Uniform = NDArray[np.float64]


class DrawsName(NamedTuple):
    """The key of random numbers, by which another process can draw the same."""

    seed: int
    key: Key
    purpose: str


class PhotonDraws:
    """The random numbers of k photons for one purpose, drawn when they are first asked for."""

    name: DrawsName | None = None  # of those of a whole block

    def __init__(self, bits: Callable[[], Bytes], fractions: Callable[[], Uniform]) -> None:
        """Draw by calling these; each returns an array of shape (k,)."""
        # Thousands of these are made for single photons: functools.cache takes longer to make.
        self._draw_bits, self._draw_fractions = bits, fractions
        self._bits: Bytes | None = None
        self._fractions: Uniform | None = None

    @classmethod
    def by(cls, random: np.random.Generator, count: int) -> Self:
        """Draw for `count` photons from a generator: for circuits that have no blocks.

        Only bits advance it, so that Clifford circuits have the same outcomes on any backend.
        """
        (child,) = random.spawn(1)
        return cls(
            lambda: random.integers(0, 2, count, dtype=np.uint8), lambda: child.random(count)
        )

    @classmethod
    def given(cls, bits: Bytes) -> Self:
        """Take these bits; uniform() gives a quarter or three."""
        return cls(bits.copy, lambda: np.full(len(bits), 0.5))

    def bits(self) -> Bytes:
        """Return a fair bit for each photon, the same whenever they are asked for."""
        if self._bits is None:
            self._bits = self._draw_bits()
        return self._bits

    def fractions(self) -> Uniform:
        """Return a number from [0, 1) for each photon that does not depend on its bit."""
        if self._fractions is None:
            self._fractions = self._draw_fractions()
        return self._fractions

    def uniform(self) -> Uniform:
        return (self.bits() + self.fractions()) / 2

    def at(self, positions: NDArray[np.unsignedinteger] | slice) -> "PhotonDraws":
        if isinstance(positions, slice) and positions == slice(None):
            return self
        return PhotonDraws(lambda: self.bits()[positions], lambda: self.fractions()[positions])


class Draws:
    def __init__(self, seed: int) -> None:
        self._seed = seed

    def photons(self, key: Key, purpose: str, count: int) -> PhotonDraws:
        """Return what the first `count` photons of a block draw for a measurement."""
        draws = PhotonDraws(
            lambda: self.bits(key, purpose, count),
            lambda: self.uniform(key, f"{purpose} fraction", count),
        )
        draws.name = DrawsName(self._seed, key, purpose)
        return draws

    def bits(self, key: Key, purpose: str, count: int) -> Bytes:
        """Return a fair bit for each of the first `count` photons of a block."""
        packed = random_bytes(self.generator(key, purpose), (count + 7) // 8)
        return np.unpackbits(packed, count=count, bitorder="little")

    def uniform(self, key: Key, purpose: str, count: int) -> Uniform:
        """Return a number from [0, 1) for each of the first `count` photons of a block."""
        return self.generator(key, purpose).random(count)

    def generator(self, key: Key, purpose: str) -> np.random.Generator:
        """Return a counter-based generator (Philox, Salmon et al. 2011) for the purpose."""
        digest = _Key(self.digest(key, purpose))
        return np.random.Generator(np.random.Philox(digest))  # type: ignore[arg-type]

    def digest(self, key: Key, purpose: str) -> bytes:
        """Return the key of a purpose's random numbers, 16 bytes."""
        return blake2b(repr((self._seed, *key, purpose)).encode(), digest_size=16).digest()


def random_bytes(generator: np.random.Generator, count: int) -> Bytes:
    """Return the bytes of `Generator.bytes`, which takes several times as long, shape (k,)."""
    words = generator.bit_generator.random_raw(-(-count // 8))
    return words.astype("<u8", copy=False).view(np.uint8)[:count]


class _Key(np.random.bit_generator.ISeedSequence):
    """Gives Philox a key as it is; with `key` numpy would first ask the system for entropy."""

    def __init__(self, digest: bytes) -> None:
        """Hold a key of 16 bytes."""
        self._digest = digest

    def generate_state(
        self, n_words: int, dtype: DTypeLike = np.uint64
    ) -> NDArray[np.uint32 | np.uint64]:
        assert (n_words, dtype) == (2, np.uint64)  # what Philox asks for
        return np.frombuffer(self._digest, np.uint64)
