"""The fidelity of pairs to Phi+, estimated by measuring some of them in equal bases at both ends.

F = (1 + <XX> - <YY> + <ZZ>) / 4: of Phi+ the outcomes agree in X and Z and differ in Y.
"""

from dataclasses import dataclass, field
from math import exp, sqrt

import numpy as np
from numpy.typing import NDArray

from hosts.hardware.replies import Symbols
from hosts.middleware.session.values import Lifetimes

DIFFER = 2  # the basis in which the halves of Phi+ give different outcomes
NORMAL_95 = 1.959964  # 95 % of a normal distribution is within this number of standard deviations


@dataclass
class Estimate:
    measured: NDArray[np.int64] = field(default_factory=lambda: np.zeros(3, np.int64))
    right: NDArray[np.int64] = field(default_factory=lambda: np.zeros(3, np.int64))  # as of Phi+

    def add(self, bases: Symbols, ours: Symbols, theirs: Symbols) -> None:
        """Count pairs: their basis and the outcomes at both ends, above 1 where there was none."""
        clicked = (ours <= 1) & (theirs <= 1)
        right = clicked & ((ours != theirs) == (bases == DIFFER))
        self.measured += np.bincount(bases[clicked], minlength=3)
        self.right += np.bincount(bases[right], minlength=3)

    @property
    def total(self) -> int:
        return int(self.measured.sum())

    @property
    def fidelity(self) -> float | None:
        """Return the estimate, from 0 to 1; None while a basis has no outcome."""
        if not self.measured.all():
            return None
        return _of_share(self._right_share)

    @property
    def interval(self) -> tuple[float, float] | None:
        """Return the 95 % confidence interval; None while a basis has no outcome.

        The Wilson score interval (J. Am. Stat. Assoc. 22, 209, 1927) of the mean share q of right
        outcomes, of which F = (3 q - 1) / 2, as if all were drawn alike. Where bases differ, the
        mean varies less than that: the interval is then on the safe side. It has a width also if
        all outcomes are right.
        """
        if not self.measured.all():
            return None
        share, square = self._right_share, NORMAL_95**2
        count = 9 / float((1 / self.measured).sum())  # all, if every basis has as many
        middle = share + square / (2 * count)
        half = NORMAL_95 * sqrt(share * (1 - share) / count + square / (4 * count**2))
        low, high = ((middle + side) / (1 + square / count) for side in (-half, half))
        return _of_share(low), _of_share(high)

    def after(self, waited_s: float, both: tuple[Lifetimes, Lifetimes]) -> float | None:
        """Return the fidelity after a further wait of both halves; None while none is known.

        Depolarising takes from all alike; coherence decays with T2 at either end; relaxation to |0>
        turns <ZZ> into e e' <ZZ> + (1 - e)(1 - e'), e = exp(-t / T1): so for halves that are 0 as
        often as 1 now.
        """
        if not self.measured.all():
            return None
        z, x, y = (2 * self.right / self.measured - 1).tolist()  # signs as of Phi+
        unrelaxed = [exp(-waited_s / memory.t1_s) for memory in both]
        coherent = exp(-sum(waited_s / memory.t2_s for memory in both))
        relaxed = unrelaxed[0] * unrelaxed[1] * z + (1 - unrelaxed[0]) * (1 - unrelaxed[1])
        clean = exp(-sum(waited_s / memory.depolarizing_s for memory in both))
        fidelity: float = (1 + clean * (coherent * (x + y) + relaxed)) / 4
        return min(max(fidelity, 0.0), 1.0)

    @property
    def _right_share(self) -> float:
        """Return the mean over the bases: each correlation is 2 share - 1."""
        return float((self.right / self.measured).mean())


def _of_share(right: float) -> float:
    return min(max((3 * right - 1) / 2, 0.0), 1.0)
