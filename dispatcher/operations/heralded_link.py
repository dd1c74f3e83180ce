"""Two nodes whose qubits attempt to emit, and the station between them: how often, how well."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dispatcher.approximations import (
    CLASSICAL_LIGHT,
    EXACT,
    READY_STATION,
    STRAYED,
    UNEQUAL_ARMS,
    UNLIKE_DETECTORS,
    Approximations,
    approximation,
)
from dispatcher.devices.heralding import Arm, Heralds, single_click, two_click
from dispatcher.devices.overlap import Overlap, Spectrum, overlap
from dispatcher.layer.ownership import BlockName
from dispatcher.operations.station_path import StationPath
from wire.config import FiberEnd
from wire.parameters.physics import Device, Emitter


class Offer(NamedTuple):
    """A node whose qubits attempt to emit into a port, for one half of a block."""

    name: BlockName
    end: FiberEnd
    frequency_mhz: int
    cutoff_s: float  # of the memory: what is older is dropped


@dataclass(frozen=True)
class Link:
    """The properties of a heralded pair before anything is drawn."""

    devices: tuple[Device, Device]  # of the hosts of halves 0 and 1
    paths: tuple[StationPath, StationPath]
    station: Device
    start_ns: int  # when the first attempt begins
    cutoff_ns: float = float("inf")  # a pair with an older half is dropped and made again

    @property
    def emitters(self) -> tuple[Emitter, Emitter]:
        return self.devices[0].emitter, self.devices[1].emitter

    @property
    def scheme(self) -> str:
        return self.emitters[0].scheme

    @property
    def modes(self) -> int:
        """Return how many attempts are made at once."""
        return min(emitter.modes for emitter in self.emitters)

    @property
    def preparation_ns(self) -> int:
        """Return how long qubits are prepared before an attempt."""
        return round(max(emitter.preparation_s for emitter in self.emitters) * 1e9)

    @property
    def flight_ns(self) -> int:
        """Return how long light of the farther host is on its way."""
        return max(path.delay_ns for path in self.paths)

    @property
    def period_ns(self) -> int:
        """Return how long after an attempt the next one is made: it has been heard of by then."""
        return max(self.preparation_ns + 2 * self.flight_ns, 1)

    @property
    def overlap(self) -> Overlap:
        first, second = (
            Spectrum(device.source.bandwidth_nm, path.dispersion_ps_per_nm, path.frequency_mhz)
            for device, path in zip(self.devices, self.paths, strict=True)
        )
        return overlap(first, second, self.station.analyser.bandwidth_rad_per_s)

    def spread_ps(self, half: int) -> float:
        """Return how far fibres spread the light of a half in time, rms."""
        width_nm = self.devices[half].source.bandwidth_nm
        return abs(width_nm * self.paths[half].dispersion_ps_per_nm)

    @property
    def visibility(self) -> float:
        """Return the most that photons can have, however they come."""
        return self.station.analyser.visibility * float(self.overlap.most)

    @property
    def heralds(self) -> Heralds:
        """Return how likely an attempt is heralded, of light that is most alike."""
        return self.heralds_of(self.visibility)

    def heralds_of(self, visibility: float) -> Heralds:
        """Return the same of light that interferes so well."""
        kind = two_click if self.scheme == "two-click" else single_click
        return kind(self.arms, self.dark, visibility)

    @property
    def seen(self) -> float:
        """Return how likely a photon clicks in the mean of both detectors of a mode."""
        detectors = self.station.detectors
        return detectors.efficiency * (1 - detectors.efficiency_mismatch / 2)

    @property
    def arms(self) -> tuple[Arm, Arm]:
        first, second = (
            Arm(
                emitter.efficiency * path.transmission * self.seen,
                emitter.bright_state,
                emitter.phase_rad,
            )
            for emitter, path in zip(self.emitters, self.paths, strict=True)
        )
        return first, second

    @property
    def dark(self) -> float:
        """Return how likely a detector clicks without light of the hosts, in a mode.

        Noise photons of the fibres are in any mode, and behind the beam splitter on either side.
        """
        detectors = self.station.detectors
        share = 1 / 4 if self.scheme == "two-click" else 1 / 2
        scattered = share * self.seen * sum(path.noise_photons for path in self.paths)
        return float(-np.expm1(-detectors.dark_count_hz * detectors.gate_s - scattered))

    @property
    def psi_minus(self) -> float:
        """Return how likely a herald tells Psi-: of one click, the lesser detector's."""
        less = 1 - self.station.detectors.efficiency_mismatch
        return 2 * less / (1 + less) ** 2 if self.scheme == "two-click" else less / (1 + less)

    @property
    def approximations(self) -> Approximations:
        """Return what of the heralds is not what the physics does, whatever fibres do."""
        heralds, detectors = self.heralds, self.station.detectors
        every = EXACT
        if heralds.unequal:
            every |= approximation(UNEQUAL_ARMS, heralds.unequal)
        others = 1 - heralds.chances[0] / heralds.probability if heralds.probability else 0.0
        if detectors.efficiency_mismatch:
            every |= approximation(UNLIKE_DETECTORS, detectors.efficiency_mismatch * others)
        if any(path.noise_photons for path in self.paths):
            every |= approximation(CLASSICAL_LIGHT, others)
        if strays := max(path.strays for path in self.paths):
            every |= approximation(STRAYED, strays)
        if unready := self._unready:
            every |= approximation(READY_STATION, unready)
        return every

    @property
    def _unready(self) -> float:
        """Return of which share of the heralds dead times and afterpulses decide, at most."""
        detectors = self.station.detectors
        single = self.scheme == "single-click"
        light = sum(arm.efficiency * (arm.bright_state if single else 1) for arm in self.arms) / 2
        clicks = self.modes * (light + 2 * self.dark)  # of one detector, in all modes of a round
        dead_ns = detectors.dead_time_s * 1e9
        rounds = dead_ns // self.period_ns + (dead_ns > 0 and self.modes > 1)
        share = clicks * rounds + detectors.afterpulse_probability
        # Of two clicks in one detector, in time bins, nobody says how far they are apart.
        twice = dead_ns > 0 and not single and detectors.encoding == "time-bin"
        return min(share + twice * (1 - self.psi_minus), 1.0)

    @property
    def told_wrongly(self) -> float:
        """Return how likely one click is reported by the other detector, or one of two is."""
        error = self.station.detectors.readout_error
        return error if self.scheme == "single-click" else 2 * error * (1 - error)

    def emitted_ns(self, half: int, rounds: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return when qubits have emitted, in these rounds: the nearer host waits for the other."""
        return self._first_emission_ns(half) + rounds * self.period_ns

    def _first_emission_ns(self, half: int) -> int:
        late_ns = self.flight_ns - self.paths[half].delay_ns
        return self.start_ns + self.preparation_ns + late_ns

    @property
    def youngest_ns(self) -> int:
        """Return how old the older half of a pair is when its clicks are."""
        return self.clicks_ns(1) - min(self._first_emission_ns(half) for half in (0, 1))

    def young(self, rounds: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which pairs of these rounds, ascending, are kept when the last one clicks."""
        ages_ns = (rounds[-1] - rounds) * self.period_ns + self.youngest_ns
        return np.asarray(ages_ns <= self.cutoff_ns)

    def clicks_ns(self, rounds: int) -> int:
        """Return the time of the clicks of the last of these rounds."""
        return self.start_ns + rounds * self.period_ns - self.flight_ns
