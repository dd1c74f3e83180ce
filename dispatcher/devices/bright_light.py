"""Bright light on devices that are made for single photons: it blinds detectors and reads sources.

An avalanche photodiode in continuous light loses the voltage that lets one photon start an
avalanche. It is then an ordinary photodiode behind a comparator: it clicks for a pulse above a
power, whatever the pulse's photons are (Lydersen et al., Nature Photonics 4, 686, 2010; thresholds
of that order). A monitor of the photocurrent sees the continuous light (Yuan, Dynes, Shields, Appl.
Phys. Lett. 98, 231104, 2011).

A source sends some of the light back that somebody sends into it, modulated as its own (Gisin et
al., Phys. Rev. A 73, 022320, 2006). An isolator weakens it on its way in; a monitor sees it.

Such light is classical: powers, mean photon numbers and polarisations say all of it.
"""

from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import NDArray

from dispatcher.sabot.backend import Bytes
from dispatcher.sabot.registers import Mask

Powers = NDArray[np.float64]

_ROOT = 2**-0.5
# Amplitudes of the states that hosts prepare (wire/dispatcher.proto: 2 * basis + bit, Z then X).
STATES = np.array([[1.0, 0.0], [0.0, 1.0], [_ROOT, _ROOT], [_ROOT, -_ROOT]])


def shares(states: Bytes, bases: Bytes) -> Powers:
    """Return which share of light of these states each arm of a measurement gets, shape (k, 2)."""
    found = STATES.reshape(2, 2, 2)[bases]  # by photon, arm, amplitude
    amplitudes: Powers = np.einsum("kab,kb->ka", found, STATES[states])
    return amplitudes**2


@dataclass(frozen=True)
class AvalanchePhotodiode:
    """A single-photon detector and what it does in bright light."""

    blinding_w: float = 400e-6  # continuous light from which no single photon is seen
    never_w: float = 650e-6  # peak of a pulse up to which it never clicks while it is blind
    always_w: float = 930e-6  # from which it always does; in between the likelihood rises evenly
    responsivity_a_per_w: float = 1.0  # of the diode without an avalanche
    alarm_a: float = inf  # photocurrent at which its monitor tells; inf: it has none

    def is_blind(self, continuous_w: float) -> bool:
        return continuous_w >= self.blinding_w

    def tells(self, continuous_w: float) -> bool:
        return self.responsivity_a_per_w * continuous_w >= self.alarm_a

    def clicks(self, pulses_w: Powers, continuous_w: float, random: np.random.Generator) -> Mask:
        """Return which bright pulses it clicks for; one that sees photons does so for all."""
        if not self.is_blind(continuous_w):
            return pulses_w > 0
        likely = (pulses_w - self.never_w) / (self.always_w - self.never_w)
        clicked: Mask = random.random(pulses_w.shape) < likely
        return clicked


@dataclass(frozen=True)
class ReflectingSource:
    """A source that sends back some of what is sent into it."""

    reflection_db: float = 60.0  # that its light loses from the entrance to the mirror and back
    isolator_db: float = 0.0  # more that it loses on its way in
    alarm_photons: float = inf  # a pulse at the entrance, at which its monitor tells; inf: none

    def tells(self, photons: float) -> bool:
        return photons >= self.alarm_photons

    def reflected(self, photons: float) -> float:
        return float(photons * 10 ** (-(self.reflection_db + self.isolator_db) / 10))
