"""Classical traffic in the same fibre: its light scatters into the quantum channel."""

import numpy as np

from dispatcher.fiber.noise import Effect, Passage
from dispatcher.switch.steps import Steps
from wire.optical import DEFAULT_FREQUENCY_MHZ
from wire.parameters.fiber import FiberOptics

PLANCK_J_S = 6.626_070_15e-34
MOST_EXTRAS = 255
FEW = 0.1  # noise photons a pulse


class ClassicalLight:
    """Spontaneous Raman scattering of a classical signal that travels the same way.

    Power P (at the far end) scatters P L rho filter into the quantum channel (Eraerds et al., New
    Journal of Physics 12, 063027 (2010), equation 2: rho about 2e-9 for each km and nm near
    1550 nm), and of a pulse's window that is P L rho filter window / (h f) photons, Poisson
    distributed. They are unpolarised; an approximation, because they are noise that comes with
    a pulse, and light within the window is all one.
    """

    def __init__(self, optics: FiberOptics) -> None:
        """Scatter in this fibre; `power_mw` can be changed later."""
        self.power_mw = Steps(optics.classical_mw)
        photon_mj = PLANCK_J_S * DEFAULT_FREQUENCY_MHZ * 1e6 * 1e3
        scattered = optics.raman_per_km_nm * optics.length_km * optics.filter_nm
        transmission = 10 ** (-optics.loss_db / 10)
        self.photons_per_mw = transmission * scattered * optics.pulse_window_s / photon_mj

    def effect(self, passage: Passage) -> Effect:
        """Draw how many noise photons come with each pulse."""
        schedule = passage.schedule
        highest_mw = self.power_mw.highest(schedule.first_ns, schedule.last_ns)
        if highest_mw == 0:
            return Effect()
        generator = passage.generator("raman")
        if highest_mw * self.photons_per_mw > FEW:
            means = self.power_mw.at(passage.times_ns) * self.photons_per_mw
            extras = np.minimum(generator.poisson(means, passage.photons), MOST_EXTRAS)
            return Effect(extras=extras.astype(np.uint8), exact=False)
        # A Poisson process along the block, thinned where the power was lower.
        count = generator.poisson(highest_mw * self.photons_per_mw * passage.photons)
        pulses = np.sort(generator.integers(0, passage.photons, count))
        if not count:
            return Effect()
        power_mw = self.power_mw.at(schedule.of(pulses))
        kept = generator.random(count) * highest_mw < power_mw
        hit, times = np.unique(pulses[kept], return_counts=True)
        extras = np.zeros(passage.photons, dtype=np.uint8)
        extras[hit] = np.minimum(times, MOST_EXTRAS)
        return Effect(extras=extras, exact=False)
