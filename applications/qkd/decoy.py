"""Decoy states: bounds of single photons from pulses of three intensities.

Lim, Curty, Walenta, Xu, Zbinden, "Concise security bounds for practical decoy-state quantum key
distribution", Phys. Rev. A 89, 022307 (2014), arXiv:1311.7129. The key is of the basis X; errors of
the basis Z bound an eavesdropper's knowledge of it. An attacker who
divides photon numbers cannot know the intensity of a pulse, and so changes how often those of each
are seen (Hwang 2003; Lo, Ma, Chen 2005).

But for their equation 5, of the phase error: its term for random sampling is that of a normal
distribution, which few errors are far from, and is the chance of one number of errors, not of all
below. The tail of the hypergeometric distribution itself takes its place.

Their lower bounds of counts, n - delta, are 0 here where they are negative: there are no fewer
bits than none. Keys are longer for it than by the formulas as they stand where few pulses of an
intensity are seen, by 7 % in one case.
"""

from dataclasses import dataclass
from math import ceil, exp, factorial, floor, lgamma, log, log1p, log2, sqrt

import numpy as np
from numpy.typing import NDArray

from applications.qkd.bits import Bits, Mask
from applications.qkd.key_length import binary_entropy
from applications.qkd.messages import Intensities

LEVELS = 3
TERMS = 21  # of which eps_sec is the sum (their equation B5)
TEST_BASIS = 0  # Z
SHARES = (0.5, 0.35, 0.15)  # of signal, weak and vacuum pulses

Counts = NDArray[np.int64]  # by intensity, shape (3,)
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Decoys:
    """Mean photon numbers, m1 > m2 + m3, m2 > m3 >= 0, and which share of the pulses has each."""

    means: tuple[float, ...]
    shares: tuple[float, ...] = SHARES

    @classmethod
    def of(cls, message: Intensities) -> "Decoys":
        return cls(message.means, message.shares)

    def message(self, count: int, levels: bytes) -> Intensities:
        signal, weak, vacuum = self.means
        shares = self.shares
        return Intensities(signal, weak, vacuum, shares[0], shares[1], shares[2], count, levels)

    def photons(self, count: int) -> float:
        """Return how likely a pulse has this number of photons (tau_n)."""
        pairs = zip(self.shares, self.means, strict=True)
        return sum(share * exp(-mean) * mean**count for share, mean in pairs) / factorial(count)


@dataclass(frozen=True)
class Sifted:
    """How many sifted bits there are of each basis, and errors in Z, by intensity."""

    key: Counts
    test: Counts
    errors: Counts

    @classmethod
    def counted(cls, levels: Bits, bases: Bits, wrong: Mask) -> "Sifted":
        """Count bits; `wrong` has one element for each bit of the test basis."""
        test = bases == TEST_BASIS
        chosen = levels[~test], levels[test], levels[test][wrong]
        return cls(*(np.bincount(each, minlength=LEVELS) for each in chosen))


@dataclass(frozen=True)
class Bounds:
    """Of the key: bits of pulses without a photon and with one at least, and their phase error."""

    vacuum: float
    single: float
    phase_error: float

    @property
    def secret(self) -> float:
        """Return the bits of which an eavesdropper knows nothing."""
        return self.vacuum + self.single * (1 - binary_entropy(self.phase_error))


def bounds(decoys: Decoys, sifted: Sifted, eps_sec: float | None) -> Bounds:
    """Return what counts say; eps_sec None: as if there were endlessly many."""
    vacuum, single = _numbers(decoys, sifted.key, eps_sec)
    _vacuum, tested = _numbers(decoys, sifted.test, eps_sec)
    _m1, m2, m3 = decoys.means
    low, high = _scaled(decoys, sifted.errors, eps_sec)
    wrong = max(0.0, decoys.photons(1) * (high[1] - low[2]) / (m2 - m3))
    if single <= 0 or tested <= 0:
        return Bounds(vacuum, 0.0, 0.5)
    if eps_sec is None:
        return Bounds(vacuum, single, min(0.5, wrong / tested))
    return Bounds(vacuum, single, phase_error(single, tested, wrong, eps_sec / TERMS))


def key_length(
    decoys: Decoys, sifted: Sifted, leaked_bits: int, eps_sec: float, eps_cor: float
) -> int:
    """Return the length of an eps_sec-secret and eps_cor-correct key, their equation 1."""
    secret = bounds(decoys, sifted, eps_sec).secret
    cost = 6 * log2(TERMS / eps_sec) + log2(2 / eps_cor)
    return max(0, floor(secret - leaked_bits - cost))


def _scaled(decoys: Decoys, counts: Counts, eps_sec: float | None) -> tuple[Floats, Floats]:
    """Return e^m / p times the least and the most counts, by intensity (Hoeffding 1963)."""
    spread = 0.0 if eps_sec is None else sqrt(int(counts.sum()) / 2 * log(TERMS / eps_sec))
    scale = np.exp(decoys.means) / np.array(decoys.shares)
    return scale * np.maximum(counts - spread, 0.0), scale * (counts + spread)


def _numbers(decoys: Decoys, counts: Counts, eps_sec: float | None) -> tuple[float, float]:
    """Return how many of these bits are of no photon, and of one, at least."""
    (_low1, low2, low3), (high1, high2, high3) = _scaled(decoys, counts, eps_sec)
    m1, m2, m3 = decoys.means
    none = max(0.0, decoys.photons(0) * (m2 * low3 - m3 * high2) / (m2 - m3))
    several = (m2**2 - m3**2) / m1**2 * (high1 - none / decoys.photons(0))
    one = decoys.photons(1) * m1 * (low2 - high3 - several) / (m1 * (m2 - m3) - m2**2 + m3**2)
    return float(none), max(0.0, float(one))


def phase_error(single: float, tested: float, wrong: float, eps: float) -> float:
    """Return the largest share of phase errors in bits of a key, given errors of a test.

    It is more with probability eps^2, as smooth entropies need (arXiv:1103.4130).
    """
    key, test, errors = floor(single), floor(tested), ceil(wrong)
    if key < 1 or 2 * errors >= test:
        return 0.5
    least, most = 0, key
    while most - least > 1:
        middle = (least + most) // 2
        if _log_chance(key, middle, test, errors) > 2 * log(eps):
            least = middle
        else:
            most = middle
    return min(0.5, most / key)


def _log_chance(key: int, in_key: int, test: int, in_test: int) -> float:
    """Return how likely a test has so few of all errors at most, if chance draws it; a logarithm.

    It is the last term of the hypergeometric distribution's tail over 1 - r, at most: each term
    before is r of the next one, or less.
    """
    ratio = in_test * (key - in_key) / ((in_key + 1) * (test - in_test + 1))
    if ratio >= 1:
        return 0.0
    ways = _ways(key, in_key) + _ways(test, in_test) - _ways(key + test, in_key + in_test)
    return ways - log1p(-ratio)


def _ways(bits: int, errors: int) -> float:
    return lgamma(bits + 1) - lgamma(errors + 1) - lgamma(bits - errors + 1)
