"""Two polarisations that fare differently: one is lost more, or comes later.

Both models have an axis on the Poincare sphere that is any for each photon, as birefringence turns
it from place to place; so they act as a mixture of Pauli operators, an approximation.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dispatcher.approximations import LOSS_OF_POLARISATION, MODE_DISPERSION, approximation
from dispatcher.fiber.fluctuations import PolarizationDrift, wander
from dispatcher.fiber.noise import Effect, NoiseModel, Passage, depolarized
from dispatcher.fiber.turn import of_paulis

MEAN_MAXWELL = math.sqrt(8 / math.pi)  # mean length of three normal components of rms 1


@dataclass(frozen=True)
class PolarizationDependentLoss:
    """One polarisation has an attenuation of loss_db, the one across none (ITU-T G.650.2).

    Of the amplitudes 1 and t = 10^(-loss_db / 20) the filter is a + b (n.sigma), a = (1 + t) / 2,
    b = (1 - t) / 2: unpolarised light passes with a^2 + b^2 = (1 + t^2) / 2, and of what has passed
    b^2 / (a^2 + b^2) has met n.sigma: two thirds of that are wrong in any basis.
    """

    loss_db: float

    def effect(self, passage: Passage) -> Effect:
        amplitude = 10 ** (-self.loss_db / 20)
        passes = (1 + amplitude**2) / 2
        lost = ~passage.happens("pass", passes)
        affected = passage.events("error", ((1 - amplitude) / 2) ** 2 / passes)
        # a b {rho, n.sigma} is left out, and the axis of b^2: at most 2 a b and b^2.
        wrong = approximation(LOSS_OF_POLARISATION, (1 - amplitude) * (3 + amplitude) / 4)
        paulis = depolarized(passage, affected)
        return Effect(lost=lost, paulis=paulis, transmission=passes, exact=False, named=wrong)


@dataclass(frozen=True)
class PolarizationModeDispersion:
    """One polarisation comes later than the one across: by the differential group delay.

    The delay is the length of a vector of three normal components that wander as in PhaseDrift: a
    Maxwell distribution of the given mean, which grows as the root of the length (Foschini and
    Poole, J. Lightwave Technol. 9, 1439 (1991)). Light of an rms width s in rad/s keeps
    c = exp(-(s delay)^2 / 2) of its coherence between both, and (1 - c) / 2 of the photons meet
    n.sigma: on average two thirds of (1 - (1 + (s a)^2)^(-3/2)) / 2 are wrong in any basis, for
    components of rms a. Each photon comes half the delay earlier, or later.
    """

    mean_ps: float
    time_s: float

    def effect(self, passage: Passage) -> Effect:
        starts, vectors = wander(passage, self.mean_ps / MEAN_MAXWELL, self.time_s, 3)
        delays_ps = np.linalg.norm(vectors, axis=1)
        each_ps = np.repeat(delays_ps, np.diff(starts, append=passage.photons))
        later = passage.happens("later", 0.5)
        own_ps = np.where(later, each_ps / 2, each_ps / -2)
        wrong = -np.expm1(-((passage.width_rad_per_s * 1e-12 * delays_ps) ** 2) / 2) / 2
        most = float(wrong.max())

        def paulis(photons: Passage, pulses: NDArray[np.int64]) -> NDArray[np.uint8]:
            affected = photons.events("error", most)
            stretch = starts.searchsorted(pulses[affected], side="right") - 1
            affected = affected[
                photons.generator("own").random(affected.size) * most < wrong[stretch]
            ]
            return depolarized(photons, affected)

        # Of one axis for all (1 - c) / 2 of the photons meet the same operator, not each its own.
        named = approximation(MODE_DISPERSION, most)
        own_paulis = paulis(passage, np.arange(passage.photons))
        return Effect(
            paulis=own_paulis, of_extra_pairs=paulis, delays_ps=own_ps, exact=False, named=named
        )


def effect_on(encoding: str, model: NoiseModel, passage: Passage) -> Effect:
    """Return what a model does to qubits of an encoding.

    Qubits in time bins have one polarisation, which is turned with the light and decides how well
    that interferes with other light. Of mode dispersion the delays alone count: of one photon that
    is exact on average over its axis, |<1|2>|^2 = exp(-(s delay / 2)^2).
    """
    effect = model.effect(passage)
    if encoding == "polarization":
        return effect
    if isinstance(model, PolarizationDrift):
        return effect._replace(turn=None, polarization=effect.turn, exact=True)
    if isinstance(model, PolarizationDependentLoss) and effect.paulis is not None:
        return effect._replace(paulis=None, polarization=of_paulis(effect.paulis))
    if isinstance(model, PolarizationModeDispersion):
        return effect._replace(paulis=None, of_extra_pairs=None)
    return effect
