"""A relay of MDI-QKD that lies: of a part of what it has measured it tells Psi- for Psi+, and back.

qmn run qkd --protocol mdi --device charlie.detectors.noise=docs/mdi/lying_relay.py:Liar \
    --device charlie.detectors.noise_parameters='{"share": 0.3}'

In the basis Z that changes nothing; in X every bit is wrong that it lies of. So the error rate is
half the share of lies, 15 % here, and above 10 % there is no key: the run says so.
"""

from dataclasses import dataclass

import numpy as np

from dispatcher.devices.hardware import Moment
from dispatcher.fiber.noise import Effect

PHASE = np.uint8(2)  # by which Psi+ and Psi- differ


@dataclass(frozen=True)
class Liar:
    """Lies of a share of what it has found."""

    share: float

    def effect(self, moment: Moment) -> Effect:
        """Return what is changed of what the detectors tell."""
        return Effect(paulis=moment.happens("lie", self.share) * PHASE)
