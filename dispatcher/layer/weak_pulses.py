"""Pulses of a laser whose photons are drawn only when something looks at them.

Each photon has one number for its fate, uniform in [0, 1): it comes through what lets a share T of
the light pass if its fate is below T, so losses multiply T and cost nothing. The photons of a block
are drawn in layers of fates, [1/2, 1), [1/4, 1/2), ..., each from a stream of its own; a detector
behind 30 dB draws the layers below 1/1024 alone. Photons in a layer are a Poisson process over
the pulses, independent of other layers (Kingman, Poisson Processes, chapter 2).

All else that a photon meets is keyed by its pulse and its fate, whichever others are drawn.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dispatcher.photon_random import PhotonRandom, PhotonsByKey
from dispatcher.sabot.backend import Bytes
from dispatcher.sabot.draws import PhotonDraws
from wire import dibits
from wire.keyed import KeyedChoices, Words, identities

LAYERS = 16  # in the last one are all fates below 2 ** -LAYERS

Pulses = NDArray[np.int64]
Places = NDArray[np.intp]
BasesAt = Callable[[Pulses], Bytes]  # the bases of some pulses
Noise = Callable[[PhotonRandom], Bytes]  # Paulis of some photons, by random numbers of each


class Photons(NamedTuple):
    """Some photons, by their pulses, ascending; all shape (m,)."""

    pulses: Pulses
    fates: NDArray[np.float64]
    keys: Words  # of what else each draws

    def chosen(self, mask: NDArray[np.bool_]) -> "Photons":
        places = np.flatnonzero(mask)  # several times as fast as by a mask
        return Photons(self.pulses[places], self.fates[places], self.keys[places])


@dataclass(frozen=True)
class ArrayChoices:
    """The states that a host has chosen for pulses, and their levels of intensity; shape (k,)."""

    each_state: Bytes
    each_level: Bytes | None

    @property
    def count(self) -> int:
        return self.each_state.size

    @property
    def places(self) -> int:
        return self.count

    def states(self, at: Pulses) -> Bytes:
        return self.each_state[at]

    def levels(self, at: Pulses) -> Bytes | None:
        return None if self.each_level is None else self.each_level[at]

    def mean(self, values: NDArray[np.float64]) -> float:
        """Return the mean over all pulses of a value that each level has."""
        if self.each_level is None:
            return float(values[0])
        return float(np.bincount(self.each_level, minlength=values.size) @ values) / self.count


Choices = ArrayChoices | KeyedChoices


@dataclass(frozen=True)
class Operators:
    """The Paulis that a host has applied, and what errs with photons that met any but I."""

    packed: bytes  # two bits for each pulse, the first lowest
    random: PhotonRandom
    noise: Noise | None

    def of(self, photons: Photons) -> Bytes:
        paulis = dibits.at(self.packed, photons.pulses, "little")
        if self.noise is None:
            return paulis
        return paulis ^ self.noise(PhotonsByKey.of(self.random, photons.keys)) * (paulis > 0)


@dataclass(eq=False, slots=True, kw_only=True)
class WeakPulses(ABC):
    """A block of pulses on its way: its light is all that has happened to it so far."""

    count: int
    mean: float  # photons of a pulse of the highest intensity
    random: PhotonRandom  # of the source
    jitter_ps: float = 0.0
    transmission: float = 1.0
    expected: int = 0  # photons that are left, drawn for the counters on the way alone
    of_pulses: list[tuple[PhotonRandom, Noise]] = field(default_factory=list)
    of_photons: list[tuple[PhotonRandom, Noise]] = field(default_factory=list)
    applied: list[Operators] = field(default_factory=list)

    def pass_on(self, transmission: float, random: PhotonRandom, purpose: str) -> int:
        """Let so much of the light through; return how many photons are lost, to be counted."""
        self.transmission *= transmission
        left = int(random.generator(f"{purpose} count").binomial(self.expected, transmission))
        lost, self.expected = self.expected - left, left
        return lost

    def photons(self, share: float = 1.0) -> Photons:
        """Draw the photons that have come so far, of which such a share may be seen."""
        drawn = self.below(self.transmission * share)
        return drawn.chosen(drawn.fates < share * self.thresholds(drawn))

    @property
    @abstractmethod
    def places(self) -> int:
        """For how many pulses something is kept."""

    @abstractmethod
    def states(self, photons: Photons, bases: Bytes | None = None) -> Bytes:
        """Return the state of each photon before all noise, measured in its basis; shape (m,).

        Without bases: the state in which it is if no other photon depends on it.
        """

    @abstractmethod
    def below(self, threshold: float) -> Photons:
        """Draw all photons whose fate is below a threshold, by their pulses."""

    def thresholds(self, photons: Photons) -> NDArray[np.float64]:
        """Return below which fate each photon has come so far, shape (m,)."""
        return np.full(photons.pulses.size, self.transmission)

    def paulis(self, photons: Photons) -> Bytes:
        """Return all that noise and hosts have done to photons: 0 I, 1 X, 2 Z, 3 XZ; shape (m,)."""
        paulis = np.zeros(photons.pulses.size, np.uint8)
        for keys, noises in (
            (photons.pulses, self.of_pulses),
            (photons.keys, self.of_photons),
        ):
            for random, noise in noises:
                paulis ^= noise(PhotonsByKey.of(random, keys))
        for operators in self.applied:
            paulis ^= operators.of(photons)
        return paulis

    def delays_ps(self, pulses: Pulses) -> NDArray[np.float64] | None:
        """Return how late pulses have left their source, shape (m,)."""
        if not self.jitter_ps:
            return None
        return PhotonsByKey.of(self.random, pulses).normal("jitter") * self.jitter_ps

    def draws(self, photons: Photons, random: PhotonRandom) -> PhotonDraws:
        by_key = PhotonsByKey.of(random, photons.keys)
        return PhotonDraws(
            lambda: (by_key.uniform("bit") < 0.5).astype(np.uint8),
            lambda: by_key.uniform("fraction"),
        )

    def most_photons(self, share: float) -> float:
        """Return how many photons `photons` has to draw, on average."""
        return self.count * self.mean * 2.0 ** -first_layer(self.transmission * share)


@dataclass(eq=False, slots=True, kw_only=True)
class LaserPulses(WeakPulses):
    """Pulses of states that a host has chosen."""

    shares: NDArray[np.float64]  # of the mean, by level
    choices: Choices

    @property
    def places(self) -> int:
        return self.choices.places

    def states(self, photons: Photons, bases: Bytes | None = None) -> Bytes:
        return self.choices.states(photons.pulses)

    def thresholds(self, photons: Photons) -> NDArray[np.float64]:
        levels = self.choices.levels(photons.pulses)
        shares = np.ones(photons.pulses.size) if levels is None else self.shares[levels]
        return self.transmission * shares

    def below(self, threshold: float) -> Photons:
        layers = range(first_layer(threshold), LAYERS + 1)
        pulses, fates = map(np.concatenate, zip(*map(self._layer, layers), strict=True))
        some = np.flatnonzero(fates < threshold)
        pulses, order = in_order(pulses[some])
        fates = fates[some[order]]
        return Photons(pulses, fates, identities(pulses, fates))

    def _layer(self, number: int) -> tuple[Pulses, NDArray[np.float64]]:
        most = 2.0**-number
        least = 0.0 if number == LAYERS else most / 2
        random = self.random.generator(f"photons {number}")
        count = random.poisson(self.count * self.mean * (most - least))
        pulses = np.sort(random.integers(0, self.count, count))
        return pulses, least + random.random(count) * (most - least)


def in_order(pulses: Pulses) -> tuple[Pulses, Places]:
    """Return pulses ascending, and where each was; photons of one pulse stay as they are."""
    bits = pulses.size.bit_length()
    placed = np.sort(pulses << bits | np.arange(pulses.size))
    return placed >> bits, placed & ((1 << bits) - 1)


def first_layer(threshold: float) -> int:
    """Return the first layer that has fates below a threshold."""
    _mantissa, exponent = np.frexp(threshold)
    return min(max(-int(exponent), 0), LAYERS) if threshold else LAYERS


def by_rank(pulses: Pulses) -> tuple[Places, Places]:
    """Return where the first photon of each pulse is, and where the others are."""
    first = np.ones(pulses.size, bool)
    first[1:] = pulses[1:] != pulses[:-1]
    return np.flatnonzero(first), np.flatnonzero(~first)


def laser_pulses(
    intensities: tuple[float, ...], choices: Choices, random: PhotonRandom
) -> LaserPulses:
    mean, count = intensities[0], choices.count
    shares = np.array(intensities) / mean if mean else np.ones(len(intensities))
    light = LaserPulses(count=count, mean=mean, random=random, shares=shares, choices=choices)
    light.expected = int(
        random.generator("photons count").poisson(count * mean * choices.mean(shares))
    )
    return light
