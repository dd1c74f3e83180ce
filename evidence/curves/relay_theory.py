"""Closed forms of the relay of MDI-QKD: laser pulses without a fixed phase at a beam splitter.

Four threshold detectors, of which two of different polarisation have to click; `a` and `b` are the
mean photon numbers that detectors of efficiency 1 would see of either arm. Lo, Curty, Qi, Phys.
Rev. Lett. 108, 130503 (2012); the formulas are those of Ma and Razavi, Phys. Rev. A 86, 062319
(2012), appendix B.
"""

from math import exp

import numpy as np
from numpy.typing import NDArray

from evidence.curves.theory import entropy

PHASES = 64  # of which a mean is exact, of pulses of few photons
Gains = dict[tuple[int, int], tuple[float, float]]
CLICKS = {"Psi+": ((0, 1), (2, 3)), "Psi-": ((0, 3), (2, 1))}  # of c H, c V, d H, d V


def rectilinear(a: float, b: float, dark: float, error: float) -> tuple[float, float]:
    """Return how likely pulses in Z bases are announced, and with bits that do not fit."""
    both = (1 - dark) ** 2 * exp(-(a + b) / 2)
    right = 2 * both * (1 - (1 - dark) * exp(-a / 2)) * (1 - (1 - dark) * exp(-b / 2))
    bessel = float(np.i0((a * b) ** 0.5))
    wrong = 2 * dark * both * (bessel - (1 - dark) * exp(-(a + b) / 2))
    return right + wrong, error * right + (1 - error) * wrong


def diagonal(a: float, b: float, dark: float, error: float) -> tuple[float, float]:
    y, x = (1 - dark) * exp(-(a + b) / 4), (a * b) ** 0.5 / 2
    one, two = float(np.i0(x)), float(np.i0(2 * x))
    gain = 2 * y**2 * (1 + 2 * y**2 - 4 * y * one + two)
    return gain, gain / 2 - 2 * (1 / 2 - error) * y**2 * (two - 1)


def single_photons(a: float, b: float, dark: float, error: float) -> tuple[float, float]:
    """Return the same of one photon in each arm, either basis; a, b: how likely each is seen."""
    none = (1 - dark) ** 2
    gain = none * (a * b / 2 + (2 * a + 2 * b - 3 * a * b) * dark + 4 * (1 - a) * (1 - b) * dark**2)
    return gain, gain / 2 - (1 / 2 - error) * none * a * b / 2


def endless_key(mean: float, arrives: float, dark: float, error: float, correction: float) -> float:
    """Return the secret bits of a signal pulse of Z in both arms, photon numbers being known."""
    announced, wrong = single_photons(arrives, arrives, dark, error)
    gain, differ = rectilinear(mean * arrives, mean * arrives, dark, error)
    single = (mean * exp(-mean)) ** 2 * announced
    spread = entropy((wrong / announced, 1 - wrong / announced))
    leak = correction * gain * entropy((differ / gain, 1 - differ / gain))
    return max(0.0, single * (1 - spread) - leak)


def decoy_key(means: tuple[float, ...], in_z: Gains, in_x: Gains, correction: float) -> float:
    """Return the same of two decoys, by the bounds of Xu, Curty, Qi, Lo, New J. Phys. 15, 113007.

    Gains and how many err of them, by the intensity of either arm: signal 0, weak 1, vacuum 2.
    """
    signal, weak, vacuum = means

    def difference(table: Gains, level: int, which: int) -> float:
        ways = ((level, level, 1), (2, 2, 1), (level, 2, -1), (2, level, -1))
        return sum(sign * exp(means[i] + means[j]) * table[i, j][which] for i, j, sign in ways)

    def single(table: Gains) -> float:
        by_weak = (signal**2 - vacuum**2) * (signal - vacuum) * difference(table, 1, 0)
        by_signal = (weak**2 - vacuum**2) * (weak - vacuum) * difference(table, 0, 0)
        gaps = (signal - vacuum) ** 2 * (weak - vacuum) ** 2 * (signal - weak)
        return (by_weak - by_signal) / gaps

    announced = signal**2 * exp(-2 * signal) * single(in_z)
    errs = min(0.5, difference(in_x, 1, 1) / (weak - vacuum) ** 2 / single(in_x))
    gain, wrong = in_z[0, 0]
    leak = correction * gain * entropy((wrong / gain, 1 - wrong / gain))
    return max(0.0, announced * (1 - entropy((errs, 1 - errs))) - leak)


def clicks(
    first: NDArray[np.complex128], second: NDArray[np.complex128], dark: float
) -> dict[str, float]:
    """Return how likely Psi+ and Psi- are found, by the mean over the phase between two pulses.

    Amplitudes of H and V, shape (2,) each. No formula of the papers is used: light of a phase
    that is known makes each detector click for itself.
    """
    turned = second[:, None] * np.exp(2j * np.pi * np.arange(PHASES) / PHASES)
    mean = np.concatenate([abs(first[:, None] + turned) ** 2, abs(first[:, None] - turned) ** 2])
    silent = (1 - dark) * np.exp(-mean / 2)
    announced = {}
    for state, ways in CLICKS.items():
        chances = np.zeros(PHASES)
        for way in ways:
            others = [mode for mode in range(4) if mode not in way]
            chances += np.prod(1 - silent[list(way)], axis=0) * np.prod(silent[others], axis=0)
        announced[state] = float(chances.mean())
    return announced
