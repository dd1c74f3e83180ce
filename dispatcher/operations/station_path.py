"""The way of light from a host that attempts to the station that heralds, and what it meets there.

Of the photons of all attempts only those are followed that are heralded: what fibres and switches
absorb is in the probability of a herald, and counted where switches count.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dispatcher.approximations import EXACT, Approximations
from dispatcher.devices.overlap import angular_width
from dispatcher.fiber.channels import ChannelCrosstalk
from dispatcher.fiber.classical_light import ClassicalLight
from dispatcher.fiber.fiber_noise import meets
from dispatcher.fiber.noise import Loss, Passage, Pattern, Schedule
from dispatcher.fiber.polarization_modes import effect_on
from dispatcher.fiber.turn import Turn
from dispatcher.layer.layer import PhysicalLayer
from dispatcher.layer.network import Line
from dispatcher.layer.ownership import BlockName
from dispatcher.operations.paths import Crossing, Step, nanoseconds, path_of
from dispatcher.photon_random import PhotonRandom
from dispatcher.refusal import precondition
from dispatcher.sabot.registers import Mask
from wire.config import BadConfig, FiberEnd
from wire.parameters.physics import PairSource

PHASE = np.uint8(2)
FLIPS_BIT = np.uint8(1)


@dataclass(frozen=True)
class StationPath:
    """The fibres and switches between a host and a station, as they are when it begins."""

    lines: tuple[Line, ...]
    crossings: tuple[Crossing, ...]
    delay_ps: float
    transmission: float
    dispersion_ps_per_nm: float
    frequency_mhz: int
    noise_photons: float = 0.0  # of classical light in its fibres, at the station with each attempt

    @property
    def delay_ns(self) -> int:
        """Return how long light takes, as the clock has it: a host emits by that."""
        return nanoseconds(self.delay_ps)

    @property
    def end(self) -> FiberEnd:
        return self.lines[-1].far

    @property
    def strays(self) -> float:
        """Return how likely light would leave it in switches with crosstalk, at most."""
        stays = 1.0
        for crossing in self.crossings:
            if len(crossing.switch.timeline.connections) > 1:  # else it is lost in a dark port
                stays *= 1 - crossing.switch.crosstalk
        return 1 - stays

    @property
    def rotation(self) -> int:
        whole = 0
        for switch, in_port, out_port, _delay_ps, _transmission in self.crossings:
            whole ^= switch.rotation(in_port, out_port)
        return whole


@dataclass
class Met:
    """Effects on light on its way; arrays have shape (k,), None: no effect."""

    open: Mask  # its way has been open all the time
    arrived: Mask  # it has not been lost beside what the chance of a herald knows
    paulis: NDArray[np.uint8]
    angles_rad: NDArray[np.float64] | None = None
    turn: Turn | None = None
    polarization: Turn | None = None  # of light whose qubits are not in it
    delays_ps: NDArray[np.float64] | None = None
    approximations: Approximations = EXACT


def find_path(layer: PhysicalLayer, start: FiberEnd, frequency_mhz: int) -> StationPath:
    """Return the way on which light leaves a port just now; refuse if it ends in the dark."""
    steps = list(path_of(layer, start, frequency_mhz))
    if steps and steps[-1].line.far.node not in layer.network.switches:
        return StationPath(
            tuple(step.line for step in steps),
            tuple(step.crossing for step in steps if step.crossing is not None),
            steps[-1].delay_ps,
            steps[-1].transmission,
            sum(step.line.fiber.dispersion_ps_per_nm for step in steps),
            frequency_mhz,
            _noise_photons(steps),
        )
    raise precondition(
        f"light that leaves {start.port} of {start.node} comes out nowhere: let the controller "
        "open its path to the station first"
    )


def _noise_photons(steps: Sequence[Step]) -> float:
    """Return how many photons of classical light come to the end with each attempt, on average."""
    end = steps[-1].transmission
    return sum(
        model.mean_now * end / step.transmission
        for step in steps
        for model in step.line.noise.values()
        if isinstance(model, ClassicalLight) and end
    )


class Follower:
    def __init__(
        self, layer: PhysicalLayer, path: StationPath, source: PairSource, phase_only: bool
    ) -> None:
        """Follow light of such qubits; phase_only: a photon or none, with a phase."""
        self._layer, self._path, self._phase_only = layer, path, phase_only
        self._encoding = "time-bin" if phase_only else source.encoding
        self._jitter_ps = source.jitter_ps
        self._width_rad_per_s = angular_width(source.bandwidth_nm)

    def follow(self, name: BlockName, place: str, times_ns: NDArray[np.int64]) -> Met:
        """Return what light has met that left at these ascending times, which are over."""
        everything = np.ones(times_ns.size, bool)
        met = Met(everything, everything, np.full(times_ns.size, self._path.rotation, "u1"))
        if self._jitter_ps:
            emission = PhotonRandom(self._layer.draws, name, f"{place} emission", times_ns.size)
            met.delays_ps = emission.normal("jitter") * self._jitter_ps
        for crossing in self._path.crossings:
            there = times_ns + nanoseconds(crossing.delay_ps)
            switch, ports = crossing.switch, (crossing.in_port, crossing.out_port)
            met.open = met.open & (switch.timeline.path(ports[0], there) == ports[1])
            met.open &= switch.transmission(*ports, there, self._path.frequency_mhz) > 0
        delay_ps = 0.0
        for number, line in enumerate(self._path.lines):
            delay_ps += line.delay_ps
            # To processes of the fibre the photons come evenly, as they do on average.
            interval_ns = (times_ns[-1] - times_ns[0]) / max(times_ns.size - 1, 1)
            pattern = Pattern(max(float(interval_ns), 1.0), times_ns.size)
            schedule = Schedule(int(times_ns[0]) + nanoseconds(delay_ps), pattern)
            self._pass(name, f"{place} fiber {number}", line, schedule, met)
        return met

    def _pass(self, name: BlockName, place: str, line: Line, schedule: Schedule, met: Met) -> None:
        for model_name, model in line.noise.items():
            if isinstance(model, Loss) or not meets(self._encoding, model):
                continue
            if isinstance(model, ClassicalLight):  # its clicks are in the chance of a herald
                continue
            history = self._layer.history.of_model(line.near.node, line.near.port, model_name)
            draws, here = self._layer.draws, f"{place} {model_name}"
            passage = Passage(draws, name, here, schedule, history, self._width_rad_per_s)
            effect = effect_on(self._encoding, model, passage)
            met.approximations |= effect.approximations
            for array, what in ((effect.kraus, "Kraus operators"), (effect.extras, "extras")):
                if array is not None and not isinstance(model, ChannelCrosstalk):
                    raise BadConfig(
                        f"{what} of noise in the fibre to {line.far.port} of {line.far.node}: "
                        "light of heralded attempts cannot meet any; let the model return Paulis"
                    )
            if effect.lost is not None:
                met.arrived = met.arrived & ~effect.lost
            if effect.paulis is not None:
                met.paulis ^= self._of_light(effect.paulis, passage)
            if effect.angles_rad is not None:
                more = effect.angles_rad
                met.angles_rad = more if met.angles_rad is None else met.angles_rad + more
            if effect.turn is not None:
                met.turn = effect.turn.after(met.turn)
            if effect.polarization is not None:
                met.polarization = effect.polarization.after(met.polarization)
            if effect.delays_ps is not None:
                later = effect.delays_ps
                met.delays_ps = later if met.delays_ps is None else met.delays_ps + later

    def _of_light(self, paulis: NDArray[np.uint8], passage: Passage) -> NDArray[np.uint8]:
        """Return the errors of the qubits; light without a second mode can only lose its phase.

        Of the other polarisation it interferes with nothing: then its phase is any.
        """
        if not self._phase_only:
            return paulis
        coins = passage.coins("other polarisation", paulis.size)
        return np.where(paulis & FLIPS_BIT, coins * PHASE, paulis).astype(np.uint8)

    def count(self, attempts: int, efficiency: float, name: BlockName) -> None:
        """Let switches count the photons of these attempts, which emit with this probability."""
        drawn = self._layer.draws.generator(name, "photons of attempts")
        coming, before = int(drawn.binomial(attempts, efficiency)), 1.0
        lines = iter(self._path.lines)
        for crossing in self._path.crossings:
            fiber = 10 ** (-next(lines).fiber.loss_db / 10)
            coming = int(drawn.binomial(coming, fiber))
            through = crossing.transmission / (before * fiber) if crossing.transmission else 0.0
            leaving = int(drawn.binomial(coming, min(through, 1.0)))
            crossing.switch.count_through(crossing.in_port, crossing.out_port, coming, leaving)
            coming, before = leaving, crossing.transmission
