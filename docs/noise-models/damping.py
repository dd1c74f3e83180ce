"""Noise of one's own by Kraus operators: amplitude damping, which no Paulis are.

qmn run distribute --backend dense --rate-hz 1000000 --count 100 --sample 0.9 \
    --fiber noise=docs/noise-models/damping.py:Damping --fiber noise_parameters='{"gamma": 0.1}'

Each half passes two fibres, of which g = 1 - (1 - gamma)^2 becomes: the fidelity of pairs is
((2 - g)^2 + g^2) / 4, here .8281. The backend dense alone can hold that: others refuse it.
"""

from dataclasses import dataclass

import numpy as np

from dispatcher.devices.hardware import Moment
from dispatcher.fiber.noise import Effect, Passage


@dataclass(frozen=True)
class Damping:
    """Of |1>, |0> becomes with gamma (Nielsen and Chuang, section 8.3.5): in a fibre, or a part."""

    gamma: float

    def effect(self, _passage: Passage) -> Effect:
        """Return the operators that each qubit meets one of, shape (2, 2, 2)."""
        kept, gone = np.sqrt(1 - self.gamma), np.sqrt(self.gamma)
        return Effect(kraus=np.array([[[1, 0], [0, kept]], [[0, gone], [0, 0]]], np.complex128))


@dataclass(frozen=True)
class Relaxing:
    """A memory that relaxes with T1 = time_s, towards a state that is |1> with `excited`."""

    time_s: float
    excited: float = 0.0

    def effect(self, moment: Moment) -> Effect:
        """Return operators for each qubit by its wait, shape (k, 4, 2, 2)."""
        relaxed = -np.expm1(-moment.waited_s / self.time_s)
        kept, gone = np.sqrt(1 - relaxed), np.sqrt(relaxed)
        operators = np.zeros((moment.photons, 4, 2, 2), dtype=np.complex128)
        operators[:, 0, 0, 0], operators[:, 0, 1, 1], operators[:, 1, 0, 1] = 1, kept, gone
        operators[:, 2, 0, 0], operators[:, 2, 1, 1], operators[:, 3, 1, 0] = kept, 1, gone
        operators[:, :2] *= np.sqrt(1 - self.excited)
        operators[:, 2:] *= np.sqrt(self.excited)
        return Effect(kraus=operators)
