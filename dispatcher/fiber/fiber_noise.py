"""The noise models of a fibre: those whose parameters say that something happens.

Among them classical traffic in the same fibre: its light scatters into the quantum channel.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dispatcher.fiber import custom_noise
from dispatcher.fiber.fluctuations import Bursts, PhaseDrift, PolarizationDrift, ThermalDrift
from dispatcher.fiber.noise import (
    Dephasing,
    Depolarizing,
    Effect,
    Loss,
    NoiseModel,
    Passage,
    PauliChannel,
)
from dispatcher.fiber.polarization_modes import (
    PolarizationDependentLoss,
    PolarizationModeDispersion,
)
from dispatcher.switch.steps import Steps
from wire.optical import DEFAULT_FREQUENCY_MHZ
from wire.parameters.fiber import FiberOptics
from wire.parameters.switch import QuantumSwitch

PS_PER_S_AND_PPM = 1e6
PLANCK_J_S = 6.626_070_15e-34
MOST_EXTRAS = 255
FEW = 0.1  # noise photons a pulse


def models(optics: FiberOptics) -> dict[str, NoiseModel]:
    """Return a fibre's noise models by name, in the order in which light meets them."""
    return {
        f"{number} {type(model).__name__}": model for number, model in enumerate(_models(optics))
    }


@dataclass(frozen=True)
class DepolarizingSwitch(Depolarizing):
    """A switch that makes noise of some of what leaves it."""


def of_switch(switch: QuantumSwitch) -> dict[str, NoiseModel]:
    """Return the noise that light takes along from a switch into the fibres there."""
    if not switch.depolarizing:
        return {}
    return {DepolarizingSwitch.__name__: DepolarizingSwitch(switch.depolarizing)}


def _models(optics: FiberOptics) -> Iterator[NoiseModel]:
    if optics.loss_db > 0:
        yield Loss(optics.loss_db)
    if optics.depolarizing > 0:
        yield Depolarizing(optics.depolarizing)
    if optics.dephasing > 0:
        yield Dephasing(optics.dephasing)
    if optics.pauli_x + optics.pauli_y + optics.pauli_z > 0:
        yield PauliChannel(optics.pauli_x, optics.pauli_y, optics.pauli_z)
    if optics.burst_depolarizing > 0 and optics.burst_start_hz > 0:
        yield Bursts(optics.burst_depolarizing, optics.burst_start_hz, optics.burst_end_hz)
    drift_rad = optics.phase_drift_rad_per_sqrt_km * math.sqrt(optics.length_km)
    if drift_rad > 0:
        yield PhaseDrift(drift_rad, optics.phase_drift_time_s)
    turn_rad = optics.polarization_drift_rad_per_sqrt_km * math.sqrt(optics.length_km)
    if turn_rad > 0:
        yield PolarizationDrift(turn_rad, optics.polarization_drift_time_s)
    if optics.pdl_db > 0:
        yield PolarizationDependentLoss(optics.pdl_db)
    pmd_ps = optics.pmd_ps_per_sqrt_km * math.sqrt(optics.length_km)
    if pmd_ps > 0:
        yield PolarizationModeDispersion(pmd_ps, optics.polarization_drift_time_s)
    ps_per_k = optics.delay_s * optics.thermal_ppm_per_k * PS_PER_S_AND_PPM
    if ps_per_k * (abs(optics.temperature_slope_k_per_s) + optics.temperature_walk_k_per_sqrt_s):
        yield ThermalDrift(
            ps_per_k, optics.temperature_slope_k_per_s, optics.temperature_walk_k_per_sqrt_s
        )
    light = ClassicalLight(optics)
    if light.photons_per_mw > 0:
        yield light
    if optics.noise:
        yield custom_noise.load(optics.noise, optics.noise_parameters)


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
