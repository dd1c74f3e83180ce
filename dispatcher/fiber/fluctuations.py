"""Noise with a memory: it changes over time, and blocks that are close in time meet much the same.

Each model follows a random process through the times at which photons pass, and keeps its
values in a Past. Values that were reached before are looked up there; beyond, it continues from
the latest one.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dispatcher.approximations import PHASE, TURN, approximation
from dispatcher.fiber.noise import Effect, Passage, depolarized
from dispatcher.fiber.turn import Turn, of_vectors, product

Values = NDArray[np.float64]
# Continues a process: seconds since the latest value (None: there is none), that value, seconds
# between new values, and for each of these a normal draw.
Continue = Callable[[float | None, float, float, Values], Values]

MOST_OF_A_PIECE = 1.0  # rms turn in rad
STEPS_A_TIME = 64  # how often a process is evaluated in its correlation time
STEPS_A_BLOCK = 64  # the same for one without


@dataclass(frozen=True)
class PhaseDrift:
    """The phase between time bins wanders: an Ornstein-Uhlenbeck process.

    d(angle) = -angle dt / T + rms sqrt(2 / T) dW: mean 0, the given rms, autocorrelation
    rms^2 exp(-t / T) (Uhlenbeck and Ornstein, Physical Review 36, 823 (1930)). It is evaluated
    64 times in T. Angles of several fibres add up and become one Z with probability
    sin^2(angle / 2) at the measurement, which is an approximation.
    """

    rms_rad: float
    time_s: float

    def effect(self, passage: Passage) -> Effect:
        angles_rad = follow(passage, self.time_s / STEPS_A_TIME, self._continue)
        return Effect(angles_rad=angles_rad, exact=False, named=approximation(PHASE, 0.0))

    def _continue(self, gap_s: float | None, latest: float, step_s: float, drawn: Values) -> Values:
        keep = np.exp(-step_s / self.time_s)
        values = drawn * (self.rms_rad * np.sqrt(-np.expm1(-2 * step_s / self.time_s)))
        values[0] = drawn[0] * self.rms_rad
        if gap_s is not None:
            values[0] *= np.sqrt(-np.expm1(-2 * gap_s / self.time_s))
            values[0] += latest * np.exp(-gap_s / self.time_s)
        return _accumulate(values, keep)


@dataclass(frozen=True)
class PolarizationDrift:
    """Birefringence turns the polarisation about any axis: a random walk along the fibre.

    The fibre is cut into n pieces, each of which turns by a vector of three independent normal
    components that wander as in PhaseDrift; the rms of its length is rms_rad / sqrt(n), at most
    MOST_OF_A_PIECE. In any basis the polarisation is wrong with (1 - c^n) / 2 on average, with
    c = (1 + 2 (1 - v) e^(-v / 2)) / 3 and v = rms_rad^2 / 3n: about (1 - e^(-rms_rad^2 / 3)) / 2,
    half where nothing is left of it. (Foschini and Poole, J. Lightwave Technol. 9, 1439 (1991),
    have such a walk on the Poincare sphere.) Turns of fibres are composed and become Paulis at
    the measurement, which is an approximation.
    """

    rms_rad: float
    time_s: float

    @property
    def pieces(self) -> int:
        return max(int(np.ceil((self.rms_rad / MOST_OF_A_PIECE) ** 2)), 1)

    def effect(self, passage: Passage) -> Effect:
        components = 3 * self.pieces
        rms_rad = self.rms_rad / np.sqrt(components)
        looks_ns, history = passage.looks_ns, passage.history
        _wander_to(passage, looks_ns, rms_rad, self.time_s, components)
        starts, vectors = wander(passage, rms_rad, self.time_s, components)
        looked = None
        if looks_ns.size and history.latest_ns is not None:
            looked = self._whole(history.at(looks_ns))
        turn = Turn(starts, self._whole(vectors), looked)
        return Effect(turn=turn, exact=False, named=approximation(TURN, 0.0))

    def _whole(self, vectors: Values) -> Values:
        """Compose the turns of the pieces, shape (n, 3 pieces), to quaternions, shape (n, 4)."""
        turns = of_vectors(vectors.reshape(-1, self.pieces, 3))
        whole = turns[:, 0]
        for piece in range(1, self.pieces):
            whole = product(turns[:, piece], whole)
        return whole


@dataclass(frozen=True)
class ThermalDrift:
    """The path gets longer as the fibre warms: delay = ps_per_k times the warming.

    The warming since the last calibration, or since the first light, is a slope and a Wiener
    process: variance walk^2 t. 8.2e-6 of the delay for each kelvin are the 40 ps/(km K) of
    Slavik et al., Scientific Reports 5, 15447 (2015).
    """

    ps_per_k: float
    slope_k_per_s: float
    walk_k_per_sqrt_s: float

    def effect(self, passage: Passage) -> Effect:
        schedule = passage.schedule
        block_s = schedule.interval_ns * schedule.photons / 1e9
        delays_ps = follow(passage, block_s / STEPS_A_BLOCK, self._continue)  # kelvins so far
        delays_ps *= self.ps_per_k
        return Effect(delays_ps=delays_ps)

    def _continue(self, gap_s: float | None, latest: float, step_s: float, drawn: Values) -> Values:
        gaps_s = np.full(len(drawn), step_s)
        gaps_s[0] = gap_s or 0.0
        moved = gaps_s * self.slope_k_per_s + np.sqrt(gaps_s) * self.walk_k_per_sqrt_s * drawn
        values: Values = latest + moved.cumsum()
        return values


@dataclass(frozen=True)
class Bursts:
    """The channel is good or bad, and depolarises while it is bad.

    The model of Gilbert, Bell System Technical Journal 39, 1253 (1960), and Elliott, ibid. 42,
    1977 (1963), in continuous time: it turns bad at the rate start_hz and good at end_hz. So it
    is bad for start / (start + end) of the time, for 1 / end on average, and forgets within
    1 / (start + end). That is the same as to draw a new state, bad with that probability, at
    the rate start + end.
    """

    p: float
    start_hz: float
    end_hz: float

    def effect(self, passage: Passage) -> Effect:
        states = self.states(passage)
        if not states.any():
            return Effect()

        def of_extra_pairs(beside: Passage, pulses: NDArray[np.int64]) -> NDArray[np.uint8]:
            return self._paulis(beside, states[pulses])

        return Effect(paulis=self._paulis(passage, states), of_extra_pairs=of_extra_pairs)

    def _paulis(self, passage: Passage, states: NDArray[np.bool_]) -> NDArray[np.uint8]:
        bad = np.flatnonzero(states)
        hit = passage.generator("error").random(len(bad)) < 0.75 * self.p
        return depolarized(passage, bad[hit])

    def states(self, passage: Passage) -> NDArray[np.bool_]:
        """Return which photons pass while the channel is bad, shape (k,)."""
        schedule, history, photons = passage.schedule, passage.history, passage.photons
        past = reached(passage)
        if past == photons:
            return history.at(passage.times_ns) > 0
        renewed = passage.events("renew", self._renewal(schedule.interval_ns))
        starts = np.concatenate([[past], renewed[renewed.searchsorted(past, "right") :]])
        generator = passage.generator("state")
        drawn = generator.random(len(starts)) * (self.start_hz + self.end_hz) < self.start_hz
        if history.latest is not None:
            since_ns, latest = history.latest
            if generator.random() >= self._renewal(schedule.time_ns(past) - since_ns):
                drawn[0] = latest > 0
        states = np.repeat(drawn, np.diff(starts, append=photons))
        if past:
            states = np.concatenate([history.at(passage.times_ns[:past]) > 0, states])
        history.remember(schedule.of(starts), drawn.astype(np.float64))
        return states

    def _renewal(self, interval_ns: float) -> float:
        return float(-np.expm1(-(self.start_hz + self.end_hz) * interval_ns / 1e9))


def follow(passage: Passage, step_s: float, go_on: Continue) -> Values:
    """Return a process at each photon, a new array (k,): looked up, or gone on with by steps."""
    schedule, history, photons = passage.schedule, passage.history, passage.photons
    past = reached(passage)
    if past == photons:
        return history.at(passage.times_ns)
    stride = min(max(int(step_s * 1e9 / schedule.interval_ns), 1), photons)
    starts = np.arange(past, photons, stride)
    gap_s, latest = None, 0.0
    if history.latest is not None:
        since_ns, latest = history.latest
        gap_s = (schedule.time_ns(past) - since_ns) / 1e9
    drawn = passage.generator("step").standard_normal(len(starts))
    values = go_on(gap_s, latest, stride * schedule.interval_ns / 1e9, drawn)
    repeated = np.repeat(values, stride)[: photons - past]
    if past:
        repeated = np.concatenate([history.at(passage.times_ns[:past]), repeated])
    history.remember(schedule.of(starts), values)
    return repeated


def wander(
    passage: Passage, rms: float, time_s: float, components: int
) -> tuple[NDArray[np.int64], Values]:
    """Follow independent processes as PhaseDrift's, evaluated 64 times in their time.

    Evaluate more than three the more often: turns of many pieces change the sooner.
    Return from which photons on they have which values: shapes (s,) and (s, components).
    """
    schedule, history = passage.schedule, passage.history
    stride = int(3 * time_s / components / STEPS_A_TIME * 1e9 / schedule.interval_ns)
    starts = np.arange(0, schedule.photons, min(max(stride, 1), schedule.photons))
    times_ns = schedule.of(starts)
    latest_ns = history.latest_ns
    past = 0 if latest_ns is None else int(times_ns.searchsorted(latest_ns, side="right"))
    values = _wander_on(passage, times_ns[past:], rms, time_s, components)
    if past:
        values = np.concatenate([history.at(times_ns[:past]), values])
    history.remember(times_ns[past:], values[past:])
    return starts, values


def _wander_to(
    passage: Passage, looks_ns: NDArray[np.int64], rms: float, time_s: float, components: int
) -> None:
    """Evaluate such processes at looks between the latest values and the first photon."""
    history, latest_ns = passage.history, passage.history.latest_ns
    for look_ns in looks_ns[looks_ns < passage.schedule.first_ns]:
        if latest_ns is None or look_ns > latest_ns:
            at, purpose = np.array([look_ns]), f"look {look_ns}"
            history.remember(at, _wander_on(passage, at, rms, time_s, components, purpose))


def _wander_on(
    passage: Passage,
    times_ns: NDArray[np.int64],
    rms: float,
    time_s: float,
    components: int,
    purpose: str = "step",
) -> Values:
    """Return the components at new times, shape (s, components)."""
    drawn = passage.generator(purpose).standard_normal((times_ns.size, components))
    values: Values = drawn * rms
    if not times_ns.size:
        return values
    step_s = float(times_ns[1] - times_ns[0]) / 1e9 if times_ns.size > 1 else 0.0
    values[1:] *= np.sqrt(-np.expm1(-2 * step_s / time_s))
    latest = passage.history.latest_values
    if latest is not None:
        since_ns, held = latest
        gap_s = (int(times_ns[0]) - since_ns) / 1e9
        values[0] *= np.sqrt(-np.expm1(-2 * gap_s / time_s))
        values[0] += held * np.exp(-gap_s / time_s)
    return _accumulate(values, float(np.exp(-step_s / time_s)))


def reached(passage: Passage) -> int:
    latest = passage.history.latest
    if latest is None or latest[0] < passage.schedule.first_ns:
        return 0
    return int(passage.times_ns.searchsorted(latest[0], side="right"))


def _accumulate(values: Values, keep: float) -> Values:
    """Return x with x[0] = values[0], x[j] = keep x[j - 1] + values[j], by doubling strides."""
    stride = 1
    while stride < len(values) and keep > 1e-17:
        shifted = values.copy()
        shifted[stride:] += keep * values[:-stride]
        values, keep, stride = shifted, keep * keep, 2 * stride
    return values
