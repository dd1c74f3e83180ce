"""Noise of one's own in a memory: phases flip ever faster, the longer a qubit has waited.

qmn run distribute --rate-hz 100000 --device bob.memory.noise=docs/noise-models/ageing.py:Ageing \
    --device bob.memory.noise_parameters='{"time_s": 0.05}'

Coherence falls as exp(-(t / T)^2), as where something drifts, and not as exp(-t / T2). A model
gets a `Moment`: the number of qubits, and how long each has waited. If a wait is looked at on the
way, it gets each part of it.
"""

from dataclasses import dataclass

import numpy as np

from dispatcher.devices.hardware import Moment
from dispatcher.fiber.noise import Effect

Z = np.uint8(2)


@dataclass(frozen=True)
class Ageing:
    """Z with (1 - exp(-(t / T)^2)) / 2 after a wait of t."""

    time_s: float  # T

    def effect(self, moment: Moment) -> Effect:
        """Return what becomes of the qubits: which Paulis, and who is lost."""
        flip = -np.expm1(-((moment.waited_s / self.time_s) ** 2)) / 2
        return Effect(paulis=moment.happens("flip", flip) * Z)
