"""Somebody on a fibre who measures some of its photons in Z or X and sends others in their place.

As nobody here wants to know what is found, that is a Pauli channel, exactly: a measurement in Z
leaves a state or flips its phase, each with 1/2; one in X leaves or flips the bit.
"""

import numpy as np
from numpy.typing import NDArray

from dispatcher.fiber.noise import Effect, Passage, Z
from dispatcher.switch.steps import Steps

X = 1


class Tap:
    """Intercept and resend, of a fraction of the photons that can be changed."""

    NAME = "tap"  # among the models of a fibre

    def __init__(self) -> None:
        self.fraction = Steps(0.0)

    def effect(self, passage: Passage) -> Effect:
        """Draw which photons are turned: X or Z."""
        schedule = passage.schedule
        if self.fraction.highest(schedule.first_ns, schedule.last_ns) == 0:
            return Effect()
        likely = self.fraction.at(schedule.times_ns) / 2

        def of_further(beside: Passage, pulses: NDArray[np.int64]) -> NDArray[np.uint8]:
            return _turned(beside, likely[pulses] if isinstance(likely, np.ndarray) else likely)

        return Effect(paulis=_turned(passage, likely), of_further=of_further)


def _turned(passage: Passage, likely: float | NDArray[np.float64]) -> NDArray[np.uint8]:
    """Let X or Z happen to photons with this probability; return which, shape (k,)."""
    turned = passage.happens("turned", likely)
    paulis = np.zeros(passage.photons, dtype=np.uint8)
    count = int(np.count_nonzero(turned))
    paulis[turned] = np.where(passage.coins("basis", count), np.uint8(X), np.uint8(Z))
    return paulis
