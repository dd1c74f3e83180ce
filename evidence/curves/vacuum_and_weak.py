"""How far vacuum and weak decoys bring keys of BB84, by the bounds that a key session takes.

Channel and detectors are those of Gobby, Yuan and Shields, Appl. Phys. Lett. 84, 3762 (2004), as
Ma, Qi, Zhao and Lo take them, Phys. Rev. A 72, 012326 (2005), quant-ph/0503005: .21 dB/km, 4.5 % of
the light that comes is seen, 1.7e-6 dark counts, errors of 3.3 %, error correction at 1.22 times
the limit. Keys are endless.
"""

from math import exp

import numpy as np

from applications.qkd.decoy import Decoys, Sifted, bounds
from applications.qkd.key_length import binary_entropy
from evidence.curves import theory

LOSS_DB_PER_KM, SEEN, DARK, WRONG, CORRECTION = 0.21, 0.045, 1.7e-6, 0.033, 1.22
SIGNAL = 0.48  # photons a pulse, best for these numbers
PULSES = 1e15  # of any intensity: rounding does not matter
NEAR_KM, FAR_KM = 50.0, 200.0  # there is a key, and there is none

Single = tuple[float, float]  # of pulses of one photon: how many are seen, and errors of those


def seen(length_km: float, mean: float) -> tuple[float, float]:
    """Return how likely a pulse is seen, and seen wrongly (their equations 10 and 11)."""
    light = 1 - exp(-mean * SEEN * theory.transmission(LOSS_DB_PER_KM * length_km))
    return DARK + light, DARK / 2 + WRONG * light


def with_decoys(length_km: float, weak: float) -> Single:
    """Return what pulses of three intensities tell: the yield at least, the errors at most."""
    decoys = Decoys((SIGNAL, weak, 0.0))
    rates = np.array([seen(length_km, mean) for mean in decoys.means]).T
    counts, wrong = rates * np.array(decoys.shares) * PULSES
    single = bounds(decoys, Sifted(counts, counts, wrong), None)
    return single.single / decoys.photons(1) / PULSES, single.phase_error


def endless(length_km: float) -> Single:
    """Return what endlessly many intensities tell: the channel itself."""
    light = SEEN * theory.transmission(LOSS_DB_PER_KM * length_km)
    gain = DARK + light - DARK * light
    return gain, (DARK / 2 + WRONG * light) / gain


def key(length_km: float, single: Single) -> float:
    """Return secret bits of a pulse that both sift, below 0 where there is no key (equation 1)."""
    gain, wrong = seen(length_km, SIGNAL)
    leak = CORRECTION * gain * binary_entropy(wrong / gain)
    return single[0] * SIGNAL * exp(-SIGNAL) * (1 - binary_entropy(single[1])) - leak


def reach(weak: float | None) -> float:
    """Return how many kilometres leave a key; weak None: with endlessly many intensities."""

    from scipy.optimize import brentq  # takes a second, which few need

    def left(length_km: float) -> float:
        return key(length_km, endless(length_km) if weak is None else with_decoys(length_km, weak))

    return float(brentq(left, NEAR_KM, FAR_KM))
