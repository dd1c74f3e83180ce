"""Turns of polarisation: one for each stretch of photons, as unit quaternions (w, x, y, z).

A turn is the operator w - i (x X + y Y + z Z): by an angle a about an axis n, w = cos(a / 2) and
(x, y, z) = sin(a / 2) n.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Quaternions = NDArray[np.float64]  # shape (..., 4)

# How conjugation by I, X, Z and XZ changes the signs of a quaternion, and transposition does.
SIGNS = np.array([[1, 1, 1, 1], [1, 1, -1, -1], [1, -1, -1, 1], [1, -1, 1, -1]], np.float64)
TRANSPOSED = np.array([1, 1, -1, 1], np.float64)


@dataclass(frozen=True)
class Turn:
    """The turn `quaternions[j]`, shape (s, 4), from photon `starts[j]`, shape (s,), on."""

    starts: NDArray[np.int64]  # ascending, the first is 0
    quaternions: Quaternions

    def stretch(self, photons: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return in which stretch each of these photons is."""
        return self.starts.searchsorted(photons, side="right") - 1

    def after(self, earlier: "Turn | None") -> "Turn":
        """Return an earlier turn and then this one."""
        if earlier is None:
            return self
        starts = np.union1d(self.starts, earlier.starts)
        mine, theirs = (each.quaternions[each.stretch(starts)] for each in (self, earlier))
        return Turn(starts, product(mine, theirs))

    def behind(self, pauli: int) -> "Turn":
        """Return the turn that follows a Pauli as this one comes before it: P T = T' P."""
        return Turn(self.starts, self.quaternions * SIGNS[pauli])


def product(later: Quaternions, earlier: Quaternions) -> Quaternions:
    """Return the quaternions of one turn after another; shapes (..., 4)."""
    a, b, c, d = np.moveaxis(later, -1, 0)
    w, x, y, z = np.moveaxis(earlier, -1, 0)
    parts = (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )
    return np.stack(parts, axis=-1)


def of_vectors(vectors_rad: NDArray[np.float64]) -> Quaternions:
    """Return turns about these vectors by their lengths; shape (..., 3) to (..., 4)."""
    angles = np.linalg.norm(vectors_rad, axis=-1, keepdims=True)
    halves = np.sinc(angles / (2 * np.pi)) / 2  # sin(a / 2) / a
    return np.concatenate([np.cos(angles / 2), halves * vectors_rad], axis=-1)
