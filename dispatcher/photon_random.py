"""The random numbers of one block at one point of its way.

They depend on seed, session, block, photon, place and purpose, and on nothing else: neither on
when they are asked for nor on how the block was divided. Rare events cost only as much as there
are of them.
"""

from math import erfc, sqrt
from typing import Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dispatcher.sabot.draws import random_bytes
from wire import keyed

Bytes = NDArray[np.uint8]

RARE = 1 / 32  # below, gaps between events are drawn instead of a byte for each photon
STEPS = 256  # of a byte
HALF = np.uint64(32)  # bits of a word
TAIL = 1.0  # standard deviations, from which on a tail is drawn by itself


class Source(Protocol):
    """Where generators come from: dispatcher.sabot.draws.Draws."""

    def generator(self, key: tuple[int, int, int], purpose: str) -> np.random.Generator:
        """Return the generator of a block for a purpose."""

    def digest(self, key: tuple[int, int, int], purpose: str) -> bytes:
        """Return the key of that generator."""


class PhotonRandom:
    """Draws for k photons, each for a purpose that a noise model names."""

    def __init__(
        self, draws: Source, block: tuple[int, int, int], place: str, photons: int
    ) -> None:
        self._draws, self._block, self._place = draws, block, place
        self.photons = photons

    def at(self, place: str) -> "PhotonRandom":
        return PhotonRandom(self._draws, self._block, f"{self._place} {place}", self.photons)

    def beside(self, photons: int) -> "PhotonRandom":
        return PhotonRandom(self._draws, self._block, f"{self._place} beside", photons)

    def generator(self, purpose: str) -> np.random.Generator:
        return self._draws.generator(self._block, f"{self._place} {purpose}")

    def uniform(self, purpose: str) -> NDArray[np.float64]:
        """Return a number from [0, 1) for each photon, shape (k,)."""
        return self.generator(purpose).random(self.photons)

    def normal(self, purpose: str) -> NDArray[np.float64]:
        """Return a number of mean 0 and variance 1 for each photon, shape (k,)."""
        return self.generator(purpose).standard_normal(self.photons)

    def outliers(self, purpose: str, least: float) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return of which photons a number as in `normal` is at least so far from 0, and it.

        Those of others are not drawn. Marsaglia, Technometrics 6, 101 (1964), for the tail.
        """
        if least < TAIL:
            numbers = self.normal(purpose)
            indices = np.flatnonzero(np.abs(numbers) >= least)
            return indices, numbers[indices]
        indices = self.events(f"{purpose}, far", erfc(least / sqrt(2)))
        generator, far = self.generator(purpose), np.zeros(0)
        while far.size < indices.size:
            tried = np.sqrt(least**2 + 2 * generator.standard_exponential(indices.size + 8))
            far = np.append(far, tried[generator.random(tried.size) * tried < least])
        signs = generator.integers(0, 2, indices.size) * 2 - 1
        return indices, far[: indices.size] * signs

    def events(self, purpose: str, probability: float) -> NDArray[np.int64]:
        """Return to which photons something of this probability happens, ascending."""
        if probability <= 0:
            return np.empty(0, dtype=np.int64)
        if probability >= RARE:
            return np.flatnonzero(self.happens(purpose, probability))
        generator = self.generator(purpose)
        expected = self.photons * probability
        size = int(expected + 6 * expected**0.5) + 8
        indices = self._gaps(generator, probability, size).cumsum() - 1
        while indices[-1] < self.photons:
            more = self._gaps(generator, probability, size).cumsum() + indices[-1]
            indices = np.concatenate([indices, more])
        return indices[: indices.searchsorted(self.photons)]

    def happens(self, purpose: str, probability: float | NDArray[np.float64]) -> NDArray[np.bool_]:
        """Say for each photon whether something happens, shape (k,); exact for any probability."""
        if isinstance(probability, np.ndarray):
            return self.uniform(purpose) < probability
        rare = probability < RARE
        if rare or probability > 1 - RARE:
            mask = np.full(self.photons, not rare)
            mask[self.events(purpose, probability if rare else 1 - probability)] = rare
            return mask
        generator = self.generator(purpose)
        drawn = random_bytes(generator, self.photons)
        whole, rest = divmod(probability * STEPS, 1)
        mask = drawn < np.uint8(whole)
        undecided = np.flatnonzero(drawn == np.uint8(whole))
        mask[undecided] = generator.random(len(undecided)) < rest
        return mask

    def happens_by_stretch(
        self, purpose: str, probabilities: NDArray[np.float64], stretch: int
    ) -> NDArray[np.bool_]:
        """Do as `happens` with a probability for each stretch of photons; shape (k,)."""
        generator = self.generator(purpose)
        drawn = np.zeros((probabilities.size, stretch), np.uint8)
        drawn.reshape(-1)[: self.photons] = random_bytes(generator, self.photons)
        whole = np.minimum(probabilities * STEPS, STEPS - 1).astype(np.uint8)
        mask = (drawn < whole[:, None]).reshape(-1)[: self.photons]
        undecided = np.flatnonzero((drawn == whole[:, None]).reshape(-1)[: self.photons])
        rest = (probabilities * STEPS - whole)[undecided // stretch]
        mask[undecided] = generator.random(undecided.size) < rest
        return mask

    def coins(self, purpose: str, count: int) -> NDArray[np.uint8]:
        """Return `count` fair bits, for those photons that need one."""
        return self.generator(purpose).integers(0, 2, count, dtype=np.uint8)

    def which(self, purpose: str, count: int, weights: ArrayLike) -> NDArray[np.uint8]:
        """Choose one of several cases, `count` times; return their numbers, from 0."""
        bounds = np.cumsum(weights)
        drawn = self.generator(purpose).random(count) * bounds[-1]
        indices: NDArray[np.uint8] = bounds[:-1].searchsorted(drawn, side="right").astype(np.uint8)
        return indices

    def which_of(self, purpose: str, photons: NDArray[np.int64], weights: ArrayLike) -> Bytes:
        """Choose one of several cases for each of these photons."""
        return self.which(purpose, photons.size, weights)

    def paulis_of(self, purpose: str, photons: NDArray[np.int64]) -> Bytes:
        """Choose X, Z or XZ, any alike, for each of these photons."""
        return self.generator(purpose).integers(1, 4, photons.size, dtype=np.uint8)

    def _gaps(
        self, generator: np.random.Generator, probability: float, size: int
    ) -> NDArray[np.int64]:
        """Draw how far each event is from the last; beyond the block one is like another."""
        return np.minimum(generator.geometric(probability, size), self.photons + 1)


class PhotonsByKey(PhotonRandom):
    """Draws for some photons, whichever they are: each by a key of its own."""

    _keys: keyed.Words

    @classmethod
    def of(cls, random: PhotonRandom, keys: NDArray[np.int64] | keyed.Words) -> Self:
        """Draw for these photons, shape (m,), at the place of others."""
        by_key = cls(random._draws, random._block, random._place, keys.size)
        by_key._keys = keys.astype(np.uint64)
        return by_key

    def uniform(self, purpose: str) -> NDArray[np.float64]:
        return keyed.uniform(self._digest(purpose), self._keys)

    def normal(self, purpose: str) -> NDArray[np.float64]:
        """As Box and Muller, Ann. Math. Statist. 29, 610 (1958)."""
        radius, angle = self.halves(purpose)
        angle *= 2 * np.pi
        # The cosine of 32 bits takes a twentieth of the time, and the angle has no more.
        return np.asarray(np.sqrt(-2 * np.log1p(-radius)) * np.cos(angle.astype(np.float32)))

    def halves(self, purpose: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return two numbers from [0, 1) for each photon, of 32 bits each."""
        drawn = keyed.words(self._digest(purpose), self._keys)
        high, low = (half.astype(np.float64) for half in (drawn >> HALF, drawn.astype(np.uint32)))
        return high * 2.0**-32, low * 2.0**-32

    def coins(self, purpose: str, count: int) -> Bytes:
        assert count == self.photons  # each has its own
        return (self.uniform(purpose) < 0.5).astype(np.uint8)

    def events(self, purpose: str, probability: float) -> NDArray[np.int64]:
        return np.flatnonzero(self.happens(purpose, probability))

    def happens(self, purpose: str, probability: float | NDArray[np.float64]) -> NDArray[np.bool_]:
        return self.uniform(purpose) < probability

    def which_of(self, purpose: str, photons: NDArray[np.int64], weights: ArrayLike) -> Bytes:
        bounds = np.cumsum(weights)
        drawn = keyed.uniform(self._digest(purpose), self._keys[photons]) * bounds[-1]
        return np.asarray(bounds[:-1].searchsorted(drawn, side="right"), np.uint8)

    def paulis_of(self, purpose: str, photons: NDArray[np.int64]) -> Bytes:
        return np.uint8(1) + self.which_of(purpose, photons, np.ones(3))

    def _digest(self, purpose: str) -> bytes:
        return self._draws.digest(self._block, f"{self._place} {purpose}")
