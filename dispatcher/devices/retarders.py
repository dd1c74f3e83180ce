"""Variable retarders in a row, whose axes are Z, X, Z and X of the Poincare sphere by turns.

As three Euler angles any turn is Z(c) X(b) Z(a), twice with retardances in [0, 2 pi): (a, b, c) and
(a + pi, 2 pi - b, c + pi). A fourth one, X(d), leaves a choice, which spares long ways back.
"""

import numpy as np
from numpy.typing import NDArray

from dispatcher.fiber.turn import INVERSE, Quaternions, product

Settings = NDArray[np.float64]  # retardances in rad, shape (..., n)

WHOLE_TURN = 2 * np.pi
CHOICES = 64  # of the fourth retardance
AS_GOOD = 1e-12  # in the overlap of two turns


def turn_by(settings: Settings) -> Quaternions:
    """Return the turn that retarders make, shape (..., 4)."""
    whole = np.zeros((*settings.shape[:-1], 4))
    whole[..., 0] = 1.0
    for number, half in enumerate(np.moveaxis(settings, -1, 0) / 2):
        each = np.zeros_like(whole)
        each[..., 0], each[..., 1 if number % 2 else 3] = np.cos(half), np.sin(half)
        whole = product(each, whole)
    return whole


def settings_for(target: Quaternions, held: Settings, range_rad: float) -> Settings:
    """Return the retardances within the range that come closest to a turn, shape (n,).

    Of several that are as close, the ones that are nearest to those held.
    """
    tried = _solutions(target[None], held[:3], range_rad)
    if held.size > tried.shape[-1]:
        last = np.append(np.linspace(0, range_rad, CHOICES), held[3])
        fourth_alone = np.pad(-last[:, None], ((0, 0), (3, 0)))
        before = product(turn_by(fourth_alone), target)
        tried = _solutions(before, held[:3], range_rad)
        tried = np.concatenate([tried, np.tile(last, 2)[:, None]], axis=1)
    overlaps = np.abs(turn_by(tried) @ target)
    moves = np.abs(tried - held).max(axis=1)
    best = np.flatnonzero(overlaps >= overlaps.max() - AS_GOOD)
    chosen: Settings = tried[best[moves[best].argmin()]]
    return chosen


def angle(quaternion: Quaternions) -> float:
    """Return the angle of a turn, up to pi."""
    return float(2 * np.arctan2(np.linalg.norm(quaternion[1:]), abs(quaternion[0])))


def error_rate(quaternion: Quaternions) -> float:
    """Return how likely a turn makes a bit wrong, on average of the bases Z and X."""
    _w, x, y, z = np.square(quaternion)
    return float((x + z) / 2 + y)


def inverse(quaternions: Quaternions) -> Quaternions:
    return quaternions * INVERSE


def _solutions(targets: Quaternions, held: Settings, range_rad: float) -> Settings:
    """Return both settings of three retarders for each of m turns, shape (2 m, 3)."""
    w, x, y, z = targets.T
    b = 2 * np.arctan2(np.hypot(x, y), np.hypot(w, z))
    both, between = np.arctan2(z, w), np.arctan2(y, x)  # (c + a) / 2 and (c - a) / 2
    one = np.stack([both - between, b, both + between], axis=1)
    other = one * [1, -1, 1] + [np.pi, 0, np.pi]
    return _within(np.concatenate([one, other]), held, range_rad)


def _within(settings: Settings, held: Settings, range_rad: float) -> Settings:
    """Return equal retardances in the range, next to those held; if there are none, the nearest."""
    least = settings % WHOLE_TURN
    most = least + np.floor((range_rad - least) / WHOLE_TURN) * WHOLE_TURN
    near = held + (settings - held + np.pi) % WHOLE_TURN - np.pi
    clipped = np.where(least - range_rad < WHOLE_TURN - least, range_rad, 0.0)
    inside: Settings = np.where(most < least, clipped, np.clip(near, least, most))
    return inside
