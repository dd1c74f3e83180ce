"""Classical traffic in the same fibre: its light scatters into the quantum channel."""

import math

import numpy as np

from dispatcher.approximations import CLASSICAL_LIGHT, Approximations, approximation
from dispatcher.fiber.noise import Effect, Passage
from dispatcher.switch.timeline import Steps
from wire.parameters.fiber import FiberOptics

PLANCK_J_S, LIGHT_M_PER_S = 6.626_070_15e-34, 299_792_458
NEPERS_PER_DB = math.log(10) / 10  # of power
MOST_EXTRAS = 255
FEW = 0.1  # noise photons a pulse


def scattering_km(optics: FiberOptics) -> float:
    """Return over which length the power launched scatters as much as over this fibre.

    z km after its launch light has decayed by exp(-c z), and what it scatters there decays with
    the photons' q on its way to their end: L - z km along with them, or, scattered backwards, z.
    So it is the integral from 0 to L of exp(-c z - q (L - z)), or of exp(-(c + q) z). With c = q
    these are the L exp(-q L) and exp(-q L) sinh(q L) / q of Eraerds et al., New Journal of
    Physics 12, 063027 (2010), equations 2 and 3. Connectors and multiplexers are met once.
    """
    length_km, own_db = optics.length_km, optics.loss_db_per_km
    light_db = own_db if optics.classical_db_per_km is None else optics.classical_db_per_km
    own_per_km, light = own_db * NEPERS_PER_DB, light_db * NEPERS_PER_DB
    elsewhere_db = optics.loss_db - own_db * length_km
    if optics.classical_way == "along":
        transmission, exponent = math.exp(-own_per_km * length_km), (light - own_per_km) * length_km
    else:
        transmission, exponent = 1.0, (light + own_per_km) * length_km
    mean = -math.expm1(-exponent) / exponent if exponent else 1.0  # of exp(-x), x up to that
    return 10 ** (-elsewhere_db / 10) * transmission * length_km * mean


class ClassicalLight:
    """Spontaneous Raman scattering of a classical signal along with the photons, or against them.

    Power P scatters P rho filter into the quantum channel on each km (Eraerds et al.: rho about
    2e-9 for each km and nm where both are near 1550 nm), and of a pulse's window that is the same
    times window / (h f) photons, Poisson distributed. They are unpolarised; an approximation,
    because they are noise that comes with a pulse, and light within the window is all one.
    """

    def __init__(self, optics: FiberOptics) -> None:
        """Scatter in this fibre; `power_mw` can be changed later."""
        self.power_mw = Steps(optics.classical_mw)
        photon_mj = PLANCK_J_S * LIGHT_M_PER_S / (optics.filter_center_nm * 1e-9) * 1e3
        scattered = optics.raman_per_km_nm * optics.filter_nm * scattering_km(optics)
        self.photons_per_mw = scattered * optics.pulse_window_s / photon_mj

    @property
    def mean_now(self) -> float:
        return self.power_mw.now * self.photons_per_mw

    @property
    def dark(self) -> bool:
        """Whether there has been none for as long as is remembered."""
        return self.power_mw.largest == 0

    def approximations(self, power_mw: float) -> Approximations:
        """Return what is approximated at this power: of a pulse without a noise photon nothing."""
        return approximation(CLASSICAL_LIGHT, -math.expm1(-power_mw * self.photons_per_mw))

    def effect(self, passage: Passage) -> Effect:
        schedule = passage.schedule
        highest_mw = self.power_mw.highest(schedule.first_ns, schedule.last_ns)
        if highest_mw == 0:
            return Effect()
        generator, named = passage.generator("raman"), self.approximations(highest_mw)
        if highest_mw * self.photons_per_mw > FEW:
            means = self.power_mw.at(passage.times_ns) * self.photons_per_mw
            extras = np.minimum(generator.poisson(means, passage.photons), MOST_EXTRAS)
            return Effect(extras=extras.astype(np.uint8), exact=False, named=named)
        # A Poisson process along the block, thinned where the power was lower.
        count = generator.poisson(highest_mw * self.photons_per_mw * passage.photons)
        pulses = np.sort(generator.integers(0, passage.photons, count))
        if not count:
            return Effect()
        power_mw = self.power_mw.at(schedule.of(pulses))
        accepted = generator.random(count) * highest_mw < power_mw
        hit, times = np.unique(pulses[accepted], return_counts=True)
        extras = np.zeros(passage.photons, dtype=np.uint8)
        extras[hit] = np.minimum(times, MOST_EXTRAS)
        return Effect(extras=extras, exact=False, named=named)
