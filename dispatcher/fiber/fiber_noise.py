"""The noise models of a fibre: those whose parameters say that something happens."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from dispatcher.fiber import custom_noise
from dispatcher.fiber.classical_light import ClassicalLight
from dispatcher.fiber.fluctuations import Bursts, PhaseDrift, PolarizationDrift, ThermalDrift
from dispatcher.fiber.noise import (
    MEMORYLESS,
    Dephasing,
    Depolarizing,
    Loss,
    NoiseModel,
    PauliChannel,
)
from dispatcher.fiber.polarization_modes import (
    PolarizationDependentLoss,
    PolarizationModeDispersion,
)
from wire.parameters.fiber import COMPENSATED, FiberOptics
from wire.parameters.switch import QuantumSwitch

PS_PER_S_AND_PPM = 1e6


def models(optics: FiberOptics) -> dict[str, NoiseModel]:
    """Return a fibre's noise models by name, in the order in which light meets them."""
    return {
        f"{number} {type(model).__name__}": model for number, model in enumerate(_models(optics))
    }


def meets(encoding: str, model: NoiseModel) -> bool:
    if isinstance(model, ClassicalLight):
        return not model.dark
    return encoding == "time-bin" or not isinstance(model, PhaseDrift)


def obstacle(encoding: str, models: Iterable[NoiseModel]) -> str:
    """Return which noise of a fibre weak pulses have to be drawn for; empty: none."""
    met = (model for model in models if meets(encoding, model))
    return next((type(each).__name__ for each in met if not isinstance(each, MEMORYLESS)), "")


@dataclass(frozen=True)
class DepolarizingSwitch(Depolarizing):
    """A switch that makes noise of some of what leaves it."""


def of_switch(switch: QuantumSwitch) -> dict[str, NoiseModel]:
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
    if turn_rad > 0 and optics.birefringence != COMPENSATED:
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
