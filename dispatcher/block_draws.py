"""The random numbers of the photons of one block for one device or place."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from dispatcher.sabot.backend import Bytes
from dispatcher.sabot.draws import Draws, Key, PhotonDraws
from dispatcher.sabot.registers import Mask

Numbers = NDArray[np.float64]


@dataclass(frozen=True)
class BlockDraws:
    """Draws for each of `count` photons, or one by one for the few photons that need one."""

    draws: Draws
    key: Key
    count: int  # photons of the block
    where: str

    def at(self, place: str) -> Self:
        """Return others, for a place within this one."""
        return replace(self, where=self._at(place))

    def bits(self, purpose: str) -> Bytes:
        """Return a fair bit for each photon."""
        return self.draws.bits(self.key, self._at(purpose), self.count)

    def uniform(self, purpose: str) -> Numbers:
        """Return a number from [0, 1) for each photon."""
        return self.draws.uniform(self.key, self._at(purpose), self.count)

    def normal(self, purpose: str) -> Numbers:
        """Return a number of mean 0 and variance 1 for each photon."""
        return self.draws.normal(self.key, self._at(purpose), self.count)

    def hits(self, purpose: str, probability: float) -> Mask:
        """Return which photons something of this probability happens to."""
        return self.draws.hits(self.key, self._at(purpose), self.count, probability)

    def photons(self, purpose: str) -> PhotonDraws:
        """Return what the photons draw for a measurement."""
        return self.draws.photons(self.key, self._at(purpose), self.count)

    def few(self, purpose: str, count: int) -> Numbers:
        """Return `count` numbers from [0, 1)."""
        return self.draws.uniform(self.key, self._at(purpose), count)

    def waits(self, purpose: str, count: int) -> Numbers:
        """Return `count` exponential numbers of mean 1."""
        return self.draws.exponential(self.key, self._at(purpose), count)

    def _at(self, purpose: str) -> str:
        return f"{self.where} {purpose}"
