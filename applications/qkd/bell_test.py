"""The test of Clauser, Horne, Shimony and Holt (1969), in the settings that suit Phi+ best.

    S = E(Z, Z+X) + E(X, Z+X) + E(Z, Z-X) - E(X, Z-X)

Alice measures Z or X, as for a key; bob measures some photons halfway between (Z+X)/sqrt 2 or
(Z-X)/sqrt 2. Local hidden variables, such as an eavesdropper who measures, reach 2, Phi+ 2 sqrt 2.
"""

from dataclasses import dataclass
from math import nan, sqrt

import numpy as np
from numpy.typing import NDArray

from applications.qkd.bits import Bits, Mask
from hosts.middleware.session.estimation import share_variance

LOCAL = 2.0
SIGMAS = 5  # of S, that it has to be above
SIGNS = np.array([[1, 1], [1, -1]])  # by alice's basis and bob's setting


@dataclass(frozen=True)
class BellOutcomes:
    """Bob's part of the test of a block: photons, settings and outcomes."""

    tested: Mask  # of all photons: those that were detected
    settings: Bits  # of these: 0 Z+X, 1 Z-X
    bits: Bits


class Correlations:
    """How often outcomes were alike and differed, for each pair of settings."""

    def __init__(self) -> None:
        self._counts: NDArray[np.int64] = np.zeros((2, 2, 2), np.int64)

    def add(self, bases: Bits, settings: Bits, differ: Bits) -> None:
        np.add.at(self._counts, (bases, settings, differ), 1)

    def include(self, other: "Correlations") -> None:
        self._counts += other._counts

    @property
    def pairs(self) -> int:
        return int(self._counts.sum())

    @property
    def s(self) -> float:
        """S; NaN as long as some pair of settings did not occur."""
        return float((SIGNS * self._expected).sum())

    @property
    def error(self) -> float:
        """The standard error of S (`share_variance` of each correlation); NaN likewise."""
        counts = self._counts.sum(axis=2)
        if not counts.all():
            return nan
        return sqrt(float(4 * share_variance(self._counts[:, :, 0], counts).sum()))

    def least(self, margin: float) -> float:
        """Return what S has to be above: 2 and the margin, at least five standard errors."""
        return LOCAL + max(margin, SIGMAS * self.error)

    @property
    def _expected(self) -> NDArray[np.float64]:
        alike, differ = self._counts[:, :, 0], self._counts[:, :, 1]
        if not (alike + differ).all():
            return np.full((2, 2), nan)
        return np.asarray((alike - differ) / (alike + differ))
