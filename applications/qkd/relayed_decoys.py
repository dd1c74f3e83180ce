"""Decoy states at both ends of a relay: bounds of the pulses that had one photon at either end.

Alice and bob choose the intensity of each pulse for themselves. Of the counts of bits by both
intensities, S_ab the one of a and b divided by how likely these are and times exp(a + b), the
differences S_mm + S_ww - S_mw - S_wm have no part without a photon of both ends. Two of them, of
signal and of weak pulses against vacuum, bound from below what single photons have brought; those
of errors bound theirs from above (Xu, Curty, Qi, Lo, "Practical aspects of measurement-device-
independent quantum key distribution", New J. Phys. 15, 113007 (2013), section 4, here for ends that
need not be alike). The key is of the basis Z, where weak pulses err least, and what an eavesdropper
knows of it is bounded by the errors of the basis X (Lo, Curty, Qi, Phys. Rev. Lett. 108, 130503).
"""

from dataclasses import dataclass
from math import floor, log, log2
from typing import Any

import numpy as np
from numpy.typing import NDArray

from applications.qkd.bits import Bits, Mask
from applications.qkd.decoy import LEVELS, Bounds, Counts, Decoys, Floats, phase_error

TEST_BASIS = 1  # X
# Of which eps_sec is the sum: 18 counts that are bounded (7 of Z, 7 of X, 4 of errors), a sample,
# and eight as in applications.qkd.decoy.
TERMS = 27
SIGNAL, WEAK, VACUUM = range(LEVELS)

Ends = tuple[Decoys, Decoys]  # alice's, bob's


@dataclass(frozen=True)
class PairSifted:
    """Bits of the key, those of the test, and its errors, by alice's and bob's level; (3, 3)."""

    key: NDArray[Any]
    test: NDArray[Any]
    errors: NDArray[Any]

    @classmethod
    def counted(
        cls, levels: tuple[Bits, Bits], bases: Bits, disclosed: Mask, wrong: Mask
    ) -> "PairSifted":
        """Count sifted bits; `wrong` has one element for each that is disclosed."""
        test = bases == TEST_BASIS
        differ = np.zeros(bases.size, dtype=bool)
        differ[disclosed] = wrong
        chosen = ~disclosed & ~test, test, test & differ
        return cls(*(_by_levels(*(level[mask] for level in levels)) for mask in chosen))


def _by_levels(alice: Bits, bob: Bits) -> Counts:
    both = alice.astype(np.int64) * LEVELS + bob
    return np.bincount(both, minlength=LEVELS * LEVELS).reshape(LEVELS, LEVELS)


def bounds(ends: Ends, sifted: PairSifted, eps_sec: float | None) -> Bounds:
    """Return what counts say; eps_sec None: as if there were endlessly many.

    Bits of pulses without a photon at an end are not counted: nearly none are right.
    """
    single, tested = (_singles(ends, counts, eps_sec) for counts in (sifted.key, sifted.test))
    if single <= 0 or tested <= 0:
        return Bounds(0.0, 0.0, 0.5)
    low, high = _scaled(ends, sifted.errors, eps_sec)
    wrong = max(0.0, _difference(high, low, WEAK)) * _ones(ends) / _gaps(ends, WEAK)
    if eps_sec is None:
        return Bounds(0.0, single, min(0.5, wrong / tested))
    return Bounds(0.0, single, phase_error(single, tested, wrong, eps_sec / TERMS))


def key_length(
    ends: Ends, sifted: PairSifted, leaked_bits: int, eps_sec: float, eps_cor: float
) -> int:
    """Return the length of a key, as applications.qkd.decoy has it of one end's decoys.

    A relay that does what it should makes of both pulses what a pair would be, of which each end
    has measured a half, and the owner of the relay has made the pair: so the argument is the same
    (Curty and others, Nat. Commun. 5, 3732 (2014), for the argument; docs/mdi.md compares both).
    """
    secret = bounds(ends, sifted, eps_sec).secret
    cost = 6 * log2(TERMS / eps_sec) + log2(2 / eps_cor)
    return max(0, floor(secret - leaked_bits - cost))


def expected(counts: NDArray[Any], eps: float) -> tuple[Floats, Floats]:
    """Return between what the expectations of counts are, each but for eps.

    Of sums of independent choices, by the bounds of Chernoff and Bernstein: the mean m is exceeded
    by t with exp(-t^2 / (2 m + 2 t / 3)) and missed by t with exp(-t^2 / 2 m) at most.
    """
    x, far = counts.astype(np.float64), log(1 / eps)
    low = np.maximum(0.0, x + 2 * far / 3 - np.sqrt(4 * far**2 / 9 + 2 * far * x))
    return low, x + far + np.sqrt(far**2 + 2 * far * x)


def _scaled(ends: Ends, counts: NDArray[Any], eps_sec: float | None) -> tuple[Floats, Floats]:
    """Return exp(a + b) / (p p') times the least and the most counts."""
    scale = np.outer(*(np.exp(end.means) / np.array(end.shares) for end in ends))
    low, high = (counts, counts) if eps_sec is None else expected(counts, eps_sec / TERMS)
    return scale * low, scale * high


def _difference(high: Floats, low: Floats, level: int) -> float:
    """Return S_mm + S_ww - S_mw - S_wm: the most, by what is given as high and low."""
    return float(
        high[level, level] + high[VACUUM, VACUUM] - low[level, VACUUM] - low[VACUUM, level]
    )


def _singles(ends: Ends, counts: NDArray[Any], eps_sec: float | None) -> float:
    """Return how many of these bits are of one photon at either end, at least.

    Of n and m photons, (1, 2) and (2, 1) have no share in what is left, and others a negative one.
    """
    low, high = _scaled(ends, counts, eps_sec)
    one, two = ([_ratio(end, power) for end in ends] for power in (1, 2))
    part = 1 / min(one[0] * two[1], two[0] * one[1])  # of the difference of signal pulses
    weak = low[WEAK, WEAK] - high[WEAK, VACUUM] - high[VACUUM, WEAK]
    signal = high[SIGNAL, SIGNAL] - low[SIGNAL, VACUUM] - low[VACUUM, SIGNAL]
    left = weak - part * signal + (1 - part) * low[VACUUM, VACUUM]
    return float(left * _ones(ends) / _gaps(ends, WEAK) / (1 - part * one[0] * one[1]))


def _ratio(end: Decoys, power: int) -> float:
    signal, weak, vacuum = (mean**power for mean in end.means)
    return (signal - vacuum) / (weak - vacuum)


def _ones(ends: Ends) -> float:
    return ends[0].photons(1) * ends[1].photons(1)


def _gaps(ends: Ends, level: int) -> float:
    one, other = (end.means[level] - end.means[VACUUM] for end in ends)
    return one * other
