"""A fringe: outcomes at known angles, and the phase that they tell.

Of probes with the phase Phi that are measured between X and Y at an angle t, even outcomes less
odd ones are V cos(Phi - t) = a cos t + b sin t. Least squares over all angles give a and b: the
phase is their direction, the visibility V their length. In the middle of the fringe, at
t = Phi - pi/2, n probes tell the phase to 1 / (V sqrt n), the most that they can (quantum
Cramer-Rao bound); so the first ones are measured in X and in Y, and the others in what is the
middle by all before.
"""

from math import atan2, hypot, pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

QUARTER = pi / 2
TURN = 2 * pi
STEPS = 1 << 32  # of a turn, as angles travel
X, Y = 0, STEPS // 4


class Phase(NamedTuple):
    phase_rad: float  # from -pi to pi
    error_rad: float  # standard error
    visibility: float


class Fringe:
    """Outcomes so far, by the angles at which they were found."""

    def __init__(self) -> None:
        self._counts: dict[int, NDArray[np.int64]] = {}  # by angle in steps: even, odd

    @property
    def seen(self) -> int:
        return int(sum(counts.sum() for counts in self._counts.values()))

    def add(self, steps: int, parities: NDArray[np.uint8]) -> None:
        """Take in outcomes at an angle, 0 even and 1 odd."""
        counts = np.bincount(parities, minlength=2)
        self._counts[steps] = self._counts.get(steps, np.zeros(2, np.int64)) + counts

    def next_steps(self) -> int:
        """Return at which angle to measure next: X, then Y, then the middle of the fringe."""
        for steps in (X, Y):
            if not self._told(steps):
                return steps
        return in_steps(self.phase().phase_rad - QUARTER)

    @property
    def located(self) -> bool:
        return self._told(X) and self._told(Y)

    def _told(self, steps: int) -> bool:
        return steps in self._counts and bool(self._counts[steps].any())

    def phase(self) -> Phase:
        """Return what all outcomes tell; those in X and Y must be among them."""
        angles = np.array([in_rad(steps) for steps in self._counts])
        even, odd = np.array(list(self._counts.values()), np.float64).T
        counts = even + odd
        axes = np.stack([np.cos(angles), np.sin(angles)])  # shape (2, angles)
        inverse = np.linalg.inv(counts * axes @ axes.T)
        a, b = inverse @ axes @ (even - odd)
        likely = (even + 1) / (counts + 2)  # with one of either kind more: never certain (Laplace)
        spread = 4 * counts * likely * (1 - likely)
        covariance = inverse @ (spread * axes @ axes.T) @ inverse
        phase, visibility = atan2(b, a), hypot(a, b)
        across = np.array([-np.sin(phase), np.cos(phase)])
        # A visibility above 1 is chance, and would make the error less than it can be.
        error = sqrt(across @ covariance @ across) / min(visibility, 1.0) if visibility else pi
        return Phase(phase, min(error, pi), visibility)


def in_steps(angle_rad: float) -> int:
    return round(angle_rad / TURN * STEPS) % STEPS


def in_rad(steps: int) -> float:
    return steps * TURN / STEPS
