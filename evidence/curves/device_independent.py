"""Keys of devices that nobody trusts: what S of the CHSH test and the error rate leave of them.

One key basis: Acin et al., Phys. Rev. Lett. 98, 230501 (2007). Two, of which each bit has one at
random: Schwonnek et al., Nat. Commun. 12, 2880 (2021). Keys of a finite number of rounds:
Nadlinger et al., Nature 607, 682 (2022), supplement, equations 23 to 25 and 61 to 73.
"""

from dataclasses import dataclass
from functools import cache
from math import e, exp, log, log2, sqrt

import numpy as np
from numpy.typing import NDArray

from applications.qkd.key_length import binary_entropy

Floats = NDArray[np.float64]

LOCAL, MOST = 2.0, 2 * sqrt(2)  # S of what needs no entanglement, and of quantum mechanics
LOST, WON = (1 - 1 / sqrt(2)) / 2, (1 + 1 / sqrt(2)) / 2  # of CHSH games, at least and at most
POINTS = 101  # in either direction, where a least value is looked for
COLLISIONS = 2.0**-61  # of hashes
STARTS = (0.4, -7.4, -5.6, -6.6, 1.8, 4.5)  # near the best of Nadlinger et al.
ROUNDS = 20  # of the search, each from where the one before ended


def entropy(s: float) -> float:
    """Return how much of a bit nobody else knows of alice's outcome in one basis."""
    if s <= LOCAL:
        return 0.0
    return 1 - binary_entropy((1 - sqrt(min(s * s / 4 - 1, 1.0))) / 2)


def random_basis_entropy(s: float) -> float:
    """Return the same on average over her two bases of the CHSH test, announced afterwards.

    The least of what Bell-diagonal pairs and settings in a plane leave, or of a mixture of those
    with S = 2, of which all may be known.
    """
    s = min(s, MOST)
    slope, tangent = _mixed()
    return slope * max(s - LOCAL, 0.0) if s <= tangent else _unmixed(s)


def one_basis_rate(s: float, qber: float) -> float:
    """Return the key bits of a round for the key, of endlessly many; below 0 there are none."""
    return entropy(s) - binary_entropy(max(qber, 0.0))


def random_basis_rate(s: float, qber: float) -> float:
    return random_basis_entropy(s) - binary_entropy(max(qber, 0.0))


@cache
def _mixed() -> tuple[float, float]:
    """Return the least entropy by how much S is above 2, and S where that is."""
    return min((_unmixed(s) / (s - LOCAL), s) for s in np.linspace(2.75, 2.8, 26).tolist())


def _unmixed(s: float) -> float:
    """Return the least entropy of pairs that are all alike.

    Pairs keep t1 and t2 of correlations along two axes, and their maker knows as much as
    that tells: of all such pairs the entropy is largest, h((1 + t1)/2) + h((1 + t2)/2). Alice's
    settings are as far on either side of the first axis, so that S = 2 (t1 cos a + t2 sin a).
    """
    correlations = np.linspace(sqrt(s * s / 4 - 1), 1, POINTS)
    t1, t2 = np.meshgrid(correlations, correlations)
    radius = np.hypot(t1, t2)
    beside = np.arccos(np.minimum(s / 2 / radius, 1))
    least = np.inf
    for sign in (1, -1):
        angle = np.arctan2(t2, t1) + sign * beside
        length = np.hypot(t1 * np.cos(angle), t2 * np.sin(angle))
        left = 1 + _h((1 + length) / 2) - _h((1 + t1) / 2) - _h((1 + t2) / 2)
        least = min(least, float(left[radius >= s / 2 - 1e-12].min()))
    return least


def _h(p: Floats) -> Floats:
    inside = np.clip(p, 1e-300, 1 - 1e-16)
    entropies: Floats = -inside * np.log2(inside) - (1 - inside) * np.log2(1 - inside)
    return entropies


def wins(s: float) -> float:
    return (4 + s) / 8


@dataclass(frozen=True)
class Rounds:
    """A protocol of rounds, of which a part is tested, for pairs with S and error rate."""

    count: int
    tested: float
    s: float
    qber: float
    soundness: float = 1e-10

    @property
    def threshold(self) -> float:
        """Return the wins below which there is no key: three standard deviations below S."""
        losses = self.tested * (1 - wins(self.s))
        allowed = losses + 3 * sqrt(losses * (1 - losses) / self.count)
        return 1 - allowed / self.tested

    @property
    def syndrome(self) -> float:
        """Return how many bits are disclosed to correct errors."""
        wrong = (1 - self.tested) * binary_entropy(self.qber)
        wrong += self.tested * binary_entropy(1 - wins(self.s))
        return self.count * wrong + 50 * sqrt(self.count)

    def key_of(self, s: float, qber: float) -> int:
        """Return the bits of key of pairs that have been measured; 0 if they do not pass."""
        return self.key_bits() if wins(s) >= self.threshold and qber <= self.qber else 0

    def key_bits(self) -> int:
        """Return the longest key; 0 where there is none. Free parameters are searched for."""
        from scipy.optimize import minimize  # takes a second, which few need

        best = np.array(STARTS)
        for _ in range(ROUNDS):
            best = minimize(lambda x: -self._left(x), best, method="Nelder-Mead").x
        left = self._left(best)
        return int(left - 4 * log2(left)) if left > 1 else 0

    def _left(self, x: Floats) -> float:
        """Return what the extractor gets (equation 73) by free parameters: t, Renyi's, epsilons."""
        part = 1 / (1 + np.exp(-x))
        tangent, first, second = 0.75 + (WON - 0.75) * part[0], exp(x[1]), exp(x[2])
        if first >= 1 or second >= 1 / log2(5):
            return -np.inf
        whole = self.soundness - 4 * COLLISIONS
        amplified = whole * part[3]
        smooth = (whole - amplified) / 2
        one, two = smooth * part[4], smooth * (1 - part[4]) / 2 * part[5]
        slope, height = _slope(tangent), entropy(8 * tangent - 4)
        most, least = (height + (won - tangent) * slope for won in (1.0, LOST))
        tangent_at = height + (self.threshold - tangent) * slope  # g_t at the threshold
        lost = most - slope / self.tested  # f_t of a game that is lost
        games, left_of_games = _games()
        losses = self.tested * (1 - games)
        spread = losses * (1 - losses) * (most - lost) ** 2
        beyond = left_of_games - losses * lost - (1 - losses) * most
        beyond -= first * log(2) / 2 * (log2(33) + np.sqrt(2 + spread)) ** 2
        range_ = 2 + most - least
        third = 2 ** (first * range_) * log(2**range_ + e**2) ** 3 / (6 * (1 - first) ** 3 * log(2))
        rounds = tangent_at + beyond.min() - first**2 * third - self.tested - second * log2(5) ** 2
        chance = log2(1 / whole)
        left = self.count * rounds - 3 * _theta(smooth - one - 2 * two)
        left -= (_theta(one) + (1 + first) * chance) / first
        left -= (_theta(two) + (1 + second) * chance) / second
        return float(left - 5 * log2(1 / amplified) - self.syndrome - 264)


@cache
def _games() -> tuple[Floats, Floats]:
    chances = np.linspace(LOST, WON, 20 * POINTS)
    return chances, np.array([entropy(8 * won - 4) for won in chances])


def _slope(won: float) -> float:
    step = 1e-6
    return (entropy(8 * (won + step) - 4) - entropy(8 * (won - step) - 4)) / (2 * step)


def _theta(epsilon: float) -> float:
    """Return log2 of 1 / (1 - sqrt(1 - epsilon^2)), of small ones by its bound."""
    return log2(2 / epsilon**2)
