"""Turns of polarisation: one for each stretch of photons, as unit quaternions (w, x, y, z).

A turn is the operator w - i (x X + y Y + z Z): by an angle a about an axis n, w = cos(a / 2) and
(x, y, z) = sin(a / 2) n.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Quaternions = NDArray[np.float64]  # shape (..., 4)

# How conjugation by I, X, Z and XZ changes the signs of a quaternion, and transposition does.
SIGNS = np.array([[1, 1, 1, 1], [1, 1, -1, -1], [1, -1, -1, 1], [1, -1, 1, -1]], np.float64)
TRANSPOSED = np.array([1, 1, -1, 1], np.float64)
INVERSE = np.array([1, -1, -1, -1], np.float64)
OF_PAULIS = np.eye(4)[[0, 1, 3, 2]]  # I, X, Z and XZ, but for phases


@dataclass(frozen=True)
class Turn:
    """The turn `quaternions[j]`, shape (s, 4), from photon `starts[j]`, shape (s,), on."""

    starts: NDArray[np.int64]  # ascending, the first is 0
    quaternions: Quaternions
    # What reference light has met, at each look of a flight: shape (n, 4); None: the identity.
    looked: Quaternions | None = None

    def stretch(self, photons: NDArray[np.int64]) -> NDArray[np.int64]:
        return self.starts.searchsorted(photons, side="right") - 1

    def after(self, earlier: "Turn | None") -> "Turn":
        """Return an earlier turn and then this one."""
        if earlier is None:
            return self
        starts, mine, theirs = stretches(self, earlier)
        looked = self.looked
        if looked is None or earlier.looked is None:
            looked = earlier.looked if looked is None else looked
        else:
            looked = product(looked, earlier.looked)
        return Turn(starts, product(mine, theirs), looked)

    def behind(self, pauli: int) -> "Turn":
        """Return the turn that follows a Pauli as this one comes before it: P T = T' P."""
        looked = None if self.looked is None else self.looked * SIGNS[pauli]
        return Turn(self.starts, self.quaternions * SIGNS[pauli], looked)


def unseen(turn: Turn | None) -> Turn | None:
    """Return a turn that no reference light of what follows has met."""
    return turn and replace(turn, looked=None)


STILL = Turn(np.zeros(1, np.int64), np.array([[1.0, 0.0, 0.0, 0.0]]))


def stretches(
    one: Turn | None, other: Turn | None, *others: NDArray[np.int64]
) -> tuple[NDArray[np.int64], Quaternions, Quaternions]:
    """Return where either turn changes, or others say so, and both turns from there on."""
    one, other = one or STILL, other or STILL
    starts = np.unique(np.concatenate([one.starts, other.starts, *others]))
    return starts, one.quaternions[one.stretch(starts)], other.quaternions[other.stretch(starts)]


def of_paulis(paulis: NDArray[np.uint8]) -> Turn:
    """Return the turn of each photon by I, X, Z or XZ, shape (k,)."""
    starts = np.flatnonzero(np.diff(paulis, prepend=np.uint8(255)))
    return Turn(starts, OF_PAULIS[paulis[starts]])


def merged(one: Turn | None, other: Turn | None, members: NDArray[np.bool_]) -> Turn | None:
    """Return one turn, but the other one for the photons of a mask, shape (k,)."""
    if one is other:
        return one
    starts, mine, theirs = stretches(one, other, np.flatnonzero(np.diff(members)) + 1)
    return Turn(starts, np.where(members[starts][:, None], theirs, mine))


def gathered(picks: Sequence[tuple[Turn | None, NDArray[np.uint32]]]) -> Turn | None:
    """Return the turns of the photons at these positions of several, one after the other."""
    if all(turn is None for turn, _positions in picks):
        return None
    each = [(turn or STILL, positions.astype(np.int64)) for turn, positions in picks]
    parts = [turn.quaternions[turn.stretch(positions)] for turn, positions in each]
    quaternions = np.concatenate(parts)
    new = np.ones(len(quaternions), dtype=bool)
    new[1:] = (np.diff(quaternions, axis=0) != 0).any(axis=1)
    starts = np.flatnonzero(new)
    return Turn(starts, quaternions[starts])


def alignment(one: Turn | None, other: Turn | None, photons: int) -> float | NDArray[np.float64]:
    """Return |<H|A* B|H>|^2 of photons that began as H and were turned by A, and by B."""
    if one is other:
        return 1.0
    starts, mine, theirs = stretches(one, other)
    aligned = np.square(product(mine * INVERSE, theirs)[:, [0, 3]]).sum(axis=1)
    if starts.size == 1:
        return float(aligned[0])
    return np.repeat(aligned, np.diff(starts, append=photons))


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
