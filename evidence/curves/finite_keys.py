"""The best finite keys of decoy-state BB84 over distance (arXiv:1311.7129, section IV).

Intensities, their shares and that of the key's basis are the best ones for each length of fibre
and each number of bits in that basis, by the bounds that a key session takes. Errors of the optics
are taken of the light that is detected: "eta_ch" in the paper would make them 5 %.
"""

from collections.abc import Iterator
from math import log2

import numpy as np
from numpy.typing import NDArray

from applications.qkd.decoy import TERMS, Decoys, Sifted, bounds
from applications.qkd.key_length import binary_entropy
from evidence.curves import theory
from evidence.curves.bb84 import CORRECTION, DARK_COUNT, EFFICIENCY, ERROR, LOSS_DB_PER_KM

Floats = NDArray[np.float64]

AFTERPULSES = 0.04
VACUUM = 2e-4  # photons a pulse
SECRET = 1e-15  # eps_sec for each bit of the key, and eps_cor
ROUNDS = 4  # until the key is as long as its eps_sec says
# Where the best shares of X, signal and weak pulses and the best means are looked for.
FAR = (0.25, 0.04, 0.52, 0.49, 0.1)  # near the best behind much loss
LEAST, MOST, STARTS = (0.3, 0.05, 0.2, 0.4, 0.1), (0.95, 0.5, 0.5, 0.8, 0.3), 3
FARTHEST_KM = 300.0  # by far beyond what dark counts allow
NONE = -1e3  # what cannot be
SOME = 100.0  # above whatever is not a key


def best_rate(block: float, length_km: float) -> float:
    """Return the secret bits of a pulse by bits sifted in basis X; 0: no key."""
    best = max(_best_merits(block, length_km))
    return 2 ** (best - SOME) if best > 0 else 0.0


def reach(block: float) -> float:
    """Return how far (km) keys of a number of bits go, to a tenth of a kilometre; from 0 km on."""
    near, far = 0.0, FARTHEST_KM
    while far - near > 0.1:
        middle = (near + far) / 2
        has_key = any(merit > 0 for merit in _best_merits(block, middle))
        near, far = (middle, far) if has_key else (near, middle)
    return near


def _best_merits(block: float, length_km: float) -> Iterator[float]:
    from scipy.optimize import minimize  # takes a second, which few need

    def less(x: Floats) -> float:
        return -_merit(block, length_km, x)

    others = np.random.default_rng(1).uniform(LEAST, MOST, (STARTS, len(FAR)))
    for start in (np.array(FAR), *others):
        yield -float(minimize(less, start, method="Nelder-Mead").fun)


def _merit(block: float, length_km: float, x: Floats) -> float:
    """Return what the best is the highest of: below 0 without a key, else growing with it."""
    share_x, p1, p2, m1, m2 = x
    shares = (p1, p2, 1 - p1 - p2)
    if not (0.1 < share_x < 1 and min(shares) > 1e-3 and VACUUM < m2 < m1 - VACUUM and m1 < 1.5):
        return NONE
    decoys = Decoys((m1, m2, VACUUM), shares)
    arrives = EFFICIENCY * theory.transmission(LOSS_DB_PER_KM * length_km)
    light = 1 - np.exp(-arrives * np.array(decoys.means))
    seen = 1 - (1 - 2 * DARK_COUNT) * (1 - light)
    wrong = DARK_COUNT + ERROR * light + AFTERPULSES * seen / 2
    seen *= 1 + AFTERPULSES
    pulses = block / (share_x**2 * float(np.dot(shares, seen)))
    each = pulses * np.array(shares)
    test = each * (1 - share_x) ** 2
    sifted = Sifted(each * share_x**2 * seen, test * seen, test * wrong)
    observed = float(np.dot(shares, wrong) / np.dot(shares, seen))
    length = _length(decoys, sifted, block, CORRECTION * block * binary_entropy(observed))
    return length / block if length <= 0 else SOME + log2(length / pulses)


def _length(decoys: Decoys, sifted: Sifted, block: float, leaked: float) -> float:
    """Return the length of the key, of whose bits each has its share of eps_sec."""
    length = block / 10
    for _ in range(ROUNDS):
        eps = SECRET * max(length, 1.0)
        secret = bounds(decoys, sifted, eps).secret
        length = secret - leaked - 6 * log2(TERMS / eps) - log2(2 / SECRET)
    return length
