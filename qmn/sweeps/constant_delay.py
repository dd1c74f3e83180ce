"""A noise model for fibres that delays every photon alike, as a delay line out of place does."""

from dataclasses import dataclass

import numpy as np

from dispatcher.fiber.noise import Effect, Passage


@dataclass(frozen=True)
class ConstantDelay:
    """Photons come later by so much; the receiver's delay lines know nothing of it."""

    delay_ps: float

    def effect(self, passage: Passage) -> Effect:
        """Delay all photons."""
        return Effect(delays_ps=np.full(passage.photons, self.delay_ps))
