"""The interface of noise models: passages of photons in, effects out.

A noise model turns physical parameters, and what the channel did before, into erasures, Paulis,
angles and delays; it does not simulate. Models without memory are here, the others in
dispatcher/fiber/fluctuations.py. A model of your own has the form of NoiseModel: see README.md.

The memory of a channel: values that a noise model has found in one fibre and direction.

A value holds from its time on, until the next one. The dispatcher's history keeps the last of
them, as many as it is deep.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from dispatcher.approximations import EXACT, Approximations
from dispatcher.fiber.turn import Turn
from dispatcher.photon_random import PhotonRandom, Source

Times = NDArray[np.int64]
Values = NDArray[np.float64]
NO_TIMES: Times = np.zeros(0, np.int64)


class NoiseHistory:
    """Values over time: the latest `depth` of them at least, none if that is 0."""

    def __init__(self, depth: int) -> None:
        self._depth = depth
        self._chunks: deque[tuple[Times, Values]] = deque()
        self._count = 0

    @property
    def latest(self) -> tuple[int, float] | None:
        """The last value and the time it holds from, None if nothing is remembered."""
        if not self._chunks:
            return None
        times_ns, values = self._chunks[-1]
        return int(times_ns[-1]), float(values[-1])

    @property
    def latest_ns(self) -> int | None:
        """The time from which the last value holds, None if nothing is remembered."""
        return int(self._chunks[-1][0][-1]) if self._chunks else None

    @property
    def latest_values(self) -> tuple[int, Values] | None:
        """The same as `latest` where a value is an array, shape (c,)."""
        return (int(self._chunks[-1][0][-1]), self._chunks[-1][1][-1]) if self._chunks else None

    def remember(self, times_ns: Times, values: Values) -> None:
        """Add values at ascending times, shape (k,) or (k, c); early ones hold from the latest on.

        Blocks that pass at the same time may be resolved in any order.
        """
        if self._chunks:
            times_ns = np.maximum(times_ns, self._chunks[-1][0][-1])
        latest = slice(max(len(times_ns) - self._depth, 0), None)
        if not len(times_ns[latest]):
            return
        self._chunks.append((times_ns[latest], values[latest]))
        self._count += len(times_ns[latest])
        while self._count - len(self._chunks[0][0]) >= self._depth:
            self._count -= len(self._chunks.popleft()[0])

    def at(self, times_ns: Times) -> Values:
        """Return what held at these ascending times, shape (k,); the first value before it."""
        chunks: deque[tuple[Times, Values]] = deque()
        for chunk in reversed(self._chunks):
            chunks.appendleft(chunk)
            if chunk[0][0] <= times_ns[0]:
                break
        since_ns = np.concatenate([times for times, _values in chunks])
        values = np.concatenate([values for _times, values in chunks])
        first, last = since_ns.searchsorted(times_ns[[0, -1]], side="right")
        during = slice(max(first - 1, 0), max(last, 1))
        begins = times_ns.searchsorted(since_ns[during])
        begins[0] = 0
        return np.repeat(values[during], np.diff(begins, append=len(times_ns)), axis=0)


Z = 2


@dataclass(frozen=True)
class Pattern:
    """Photons one after the other: photon j at j interval_ns after the first."""

    interval_ns: float
    photons: int

    @cached_property
    def offsets_ns(self) -> NDArray[np.int64]:
        """How long after the first each photon comes, shape (k,)."""
        return self.of(np.arange(self.photons))

    def of(self, photons: NDArray[np.int64]) -> NDArray[np.int64]:
        """How long after the first these photons come."""
        return (self.pulses_of(photons) * self.interval_ns).astype(np.int64)

    @property
    def rests_ps(self) -> NDArray[np.float64]:
        """How much later each photon comes than `offsets_ns` has it, shape (k,)."""
        exact_ns = self.pulses_of(np.arange(self.photons)) * self.interval_ns
        return np.asarray((exact_ns - self.offsets_ns) * 1e3)

    def pulses_of(self, photons: NDArray[np.int64]) -> NDArray[np.int64]:
        return photons


@dataclass(frozen=True)
class PatternOfAll(Pattern):
    """All photons of pulses one after the other: the own one of each pulse, and further ones.

    pulse        0   1   2 2   3
    photon       0   1   2 3   4        of which 3 is a further one
    """

    extra_pairs: NDArray[np.int64]  # the pulse of each further photon, ascending

    @cached_property
    def pulses(self) -> NDArray[np.int64]:
        """In which pulse each photon is, shape (k,), ascending."""
        own = np.arange(self.photons - self.extra_pairs.size)
        return np.sort(np.concatenate([own, self.extra_pairs]), kind="stable")

    @property
    def of_own(self) -> NDArray[np.int64]:
        """Which photons are the own ones of their pulses, in the order of pulses."""
        own = np.arange(self.photons - self.extra_pairs.size)
        return own + self.extra_pairs.searchsorted(own)

    @property
    def of_extra_pairs(self) -> NDArray[np.int64]:
        """Which photons are the further ones, in their order."""
        return self.extra_pairs + 1 + np.arange(self.extra_pairs.size)

    def pulses_of(self, photons: NDArray[np.int64]) -> NDArray[np.int64]:
        return self.pulses[photons]


@dataclass(frozen=True)
class Schedule:
    """When the photons of a block are at a point: an array that is made when all are asked for."""

    first_ns: int
    pattern: Pattern
    rest_ps: float = 0.0  # by which all photons come later than `times_ns` has them

    def __len__(self) -> int:
        return self.pattern.photons

    def __getitem__(self, photon: int) -> int:
        """Return the time of one photon; -1 is the last."""
        return self.last_ns if photon == -1 else self.time_ns(photon)

    def __array__(self, dtype: None = None, copy: bool | None = None) -> NDArray[np.int64]:
        """The time of each photon, shape (k,)."""
        return self.times_ns

    @property
    def photons(self) -> int:
        return self.pattern.photons

    @property
    def interval_ns(self) -> float:
        """How long after each photon the next one comes."""
        return self.pattern.interval_ns

    @cached_property
    def times_ns(self) -> NDArray[np.int64]:
        """The time of each photon, shape (k,), ascending."""
        return self.pattern.offsets_ns + self.first_ns

    def of(self, photons: NDArray[np.int64]) -> NDArray[np.int64]:
        return self.pattern.of(photons) + self.first_ns

    def time_ns(self, photon: int) -> int:
        return self.first_ns + int(self.pattern.of(np.array(photon)))

    @property
    def last_ns(self) -> int:
        return self.time_ns(self.photons - 1)


class Passage(PhotonRandom):
    """The input of a noise model: a block's photons at the far end of a fibre.

    `photons` is k, `schedule` when they are there, `history` what this model remembered of this
    fibre in this direction; uniform, normal, events and happens draw (dispatcher/photon_random.py).
    All k photons count, also those that have taken another way: the noise is the channel's.
    """

    def __init__(
        self,
        draws: Source,
        block: tuple[int, int, int],
        place: str,
        schedule: Schedule,
        history: NoiseHistory,
        width_rad_per_s: float = 0.0,
        looks_ns: Times = NO_TIMES,
    ) -> None:
        super().__init__(draws, block, place, schedule.photons)
        self.schedule, self.history = schedule, history
        self.width_rad_per_s = width_rad_per_s  # rms; 0: of one colour
        self.looks_ns = looks_ns  # ascending: of compensators, at reference light in this fibre

    @property
    def times_ns(self) -> NDArray[np.int64]:
        """When each photon is at the far end, shape (k,), ascending."""
        return self.schedule.times_ns

    def beside(self, photons: int) -> "Passage":
        schedule = replace(self.schedule, pattern=Pattern(self.schedule.interval_ns, photons))
        place, width = f"{self._place} beside", self.width_rad_per_s
        return Passage(self._draws, self._block, place, schedule, self.history, width)

    def of_all(self, pattern: PatternOfAll) -> "Passage":
        schedule, width = replace(self.schedule, pattern=pattern), self.width_rad_per_s
        return Passage(self._draws, self._block, self._place, schedule, self.history, width)


class Effect(NamedTuple):
    """The effects on each of k photons; None: no effect."""

    lost: NDArray[np.bool_] | None = None
    paulis: NDArray[np.uint8] | None = None  # 0 I, 1 X, 2 Z, 3 XZ
    # Coherent rotation about the Z axis. Angles add up and become a Pauli at the measurement.
    angles_rad: NDArray[np.float64] | None = None
    turn: Turn | None = None  # about any axis; turns are composed, and become Paulis too
    polarization: Turn | None = None  # of light whose qubits are not in its polarisation
    delays_ps: NDArray[np.float64] | None = None
    transmission: float = 1.0  # how likely light that is in the same pulse comes through
    exact: bool = True  # whether this is what the physics does, or an approximation of it
    extras: NDArray[np.uint8] | None = None  # more photons that come out with each
    # Kraus operators, of which each photon meets one, behind all the rest: shape (m, 2, 2), or
    # (k, m, 2, 2), those of each photon. On the backend dense alone.
    kraus: NDArray[np.complex128] | None = None
    named: Approximations = EXACT  # if it is not exact: which approximations, and how large
    # Paulis of further photons, which err each by itself: of their passage and their pulses.
    of_extra_pairs: Callable[[Passage, NDArray[np.int64]], NDArray[np.uint8]] | None = None

    @property
    def approximations(self) -> Approximations:
        return EXACT if self.exact else self.named


class NoiseModel(Protocol):
    """One kind of noise with its parameters."""

    def effect(self, passage: Passage) -> Effect:
        """Draw what happens to each photon."""


@dataclass(frozen=True)
class Loss:
    """Photons are absorbed: of an attenuation in dB, 10^(-loss_db / 10) come through."""

    loss_db: float

    @property
    def transmission(self) -> float:
        return float(10 ** (-self.loss_db / 10))

    def effect(self, passage: PhotonRandom) -> Effect:
        lost = ~passage.happens("pass", self.transmission)
        return Effect(lost=lost, transmission=self.transmission)


@dataclass(frozen=True)
class Depolarizing:
    """With probability p a photon is replaced by noise: X, Z and XZ happen with p/4 each."""

    p: float

    def effect(self, passage: PhotonRandom) -> Effect:
        return Effect(paulis=depolarized(passage, passage.events("error", 0.75 * self.p)))


@dataclass(frozen=True)
class Dephasing:
    """With this probability a photon's phase flips: Z."""

    probability: float

    def effect(self, passage: PhotonRandom) -> Effect:
        paulis = np.zeros(passage.photons, dtype=np.uint8)
        paulis[passage.events("flip", self.probability)] = Z
        return Effect(paulis=paulis)


@dataclass(frozen=True)
class PauliChannel:
    """With these probabilities X, Y or Z happens, one of them at most."""

    x: float
    y: float
    z: float

    def effect(self, passage: PhotonRandom) -> Effect:
        paulis = np.zeros(passage.photons, dtype=np.uint8)
        hit = passage.events("error", self.x + self.y + self.z)
        drawn = passage.which_of("which", hit, (self.x, self.z, self.y))
        paulis[hit] = 1 + drawn  # 1 X, 2 Z, 3 XZ: Y but for a phase
        return Effect(paulis=paulis)


Memoryless = Loss | Depolarizing | Dephasing | PauliChannel
# Each photon for itself, whenever it comes.
MEMORYLESS = Loss, Depolarizing, Dephasing, PauliChannel


def depolarized(passage: PhotonRandom, photons: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Return X, Z or XZ, any alike, for these photons; shape (k,)."""
    paulis = np.zeros(passage.photons, dtype=np.uint8)
    paulis[photons] = passage.paulis_of("which", photons)
    return paulis
