"""Further photons in the pulses of a block, of pairs that are not simulated."""

import numpy as np
from numpy.typing import NDArray

from dispatcher.block_draws import BlockDraws


def further(pairs: NDArray[np.uint8]) -> NDArray[np.uint8] | None:
    """Return how many photons there are beside the first in each pulse; None: in no pulse any."""
    if not (pairs > 1).any():
        return None
    extras: NDArray[np.uint8] = pairs - (pairs > 0)
    return extras


def thin(
    extras: NDArray[np.uint8], transmission: float, draws: BlockDraws
) -> NDArray[np.uint8] | None:
    """Return how many further photons of each pulse come through; None: no photon of any."""
    pulses = np.flatnonzero(extras)
    owners = np.repeat(pulses, extras[pulses])
    through = draws.few("further photons", owners.size) < transmission
    if not through.any():
        return None
    return np.bincount(owners[through], minlength=extras.size).astype(np.uint8)
