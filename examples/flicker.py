"""A noise model of one's own: a lamp flickers beside the fibre, and its light flips phases.

qmn run sdc --frame-bytes 8 --fiber noise=examples/flicker.py:Flicker \
    --fiber noise_parameters='{"flip": 0.005}'

It gets a `Passage`: how many photons pass, when, what it remembers of this fibre; its random
numbers depend on nothing but the seed, the photon and a purpose.
"""

from dataclasses import dataclass

import numpy as np

from dispatcher.fiber.noise import Effect, Passage

Z = np.uint8(2)


@dataclass(frozen=True)
class Flicker:
    """Z with some probability while the lamp is on; it may change between two blocks."""

    flip: float  # probability of Z while the lamp is on
    switched: float = 0.5  # how likely the lamp changes from one block to the next

    def effect(self, passage: Passage) -> Effect:
        """Return what becomes of the photons that pass: who is lost, which Paulis, and so on."""
        before = passage.history.latest  # the time and the value that were remembered last
        on = before is None or before[1] > 0
        if passage.generator("switch").random() < self.switched:
            on = not on
        passage.history.remember(passage.times_ns[-1:], np.array([float(on)]))
        if not on:
            return Effect()
        return Effect(paulis=passage.happens("flip", self.flip) * Z)
