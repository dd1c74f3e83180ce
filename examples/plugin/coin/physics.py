"""Detectors that wear out: a noise model with a parameter of its own, and hosts that have it.

qmn run coin --device bob.detectors.wear.misread=0.1
qmn run coin --node bob=worn
"""

from dataclasses import dataclass, replace

import numpy as np

from qmn.physics import Device, Effect, Moment, NodeKind

X = np.uint8(1)
MISREAD = 0.25  # of hosts of the kind


@dataclass(frozen=True)
class Wear:
    """An outcome is reported wrong with some probability, so that 1 - this of all coins agree."""

    misread: float  # probability, 0 to 0.5

    def __post_init__(self) -> None:
        if not 0 <= self.misread <= 0.5:
            raise ValueError(f"misread {self.misread!r}: choose 0 to 0.5")

    def effect(self, moment: Moment) -> Effect:
        """Return which outcomes are flipped."""
        return Effect(paulis=moment.happens("misread", self.misread) * X)


def worn(base: Device) -> Device:
    """Return a device with such detectors."""
    parameters = {"misread": MISREAD}
    return replace(
        base, detectors=replace(base.detectors, noise="wear", noise_parameters=parameters)
    )


WORN = NodeKind(f"detectors that misread {MISREAD:.0%} of the outcomes", worn)
