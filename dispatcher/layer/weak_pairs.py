"""Pairs of a source of many modes, of whose photons those alone are drawn that something looks at.

Each pair has a fate for either half (weak_pulses.py). Pairs are drawn in cells, the layers of one
fate times those of the other: a detector that sees a share of 1/8 draws the rows, or columns, below
it. How many are in each cell is drawn at once, and a pair is known by its cell and its place there:
all else is keyed by that.

    fate of half 1
        1/2  c d d      half 0 at a detector with a share of 1/4: draws c and a
        1/4  a b b      half 1 at one with a share of 1/2: draws a and b
          0  a b b      pairs a are the same
            0 1/4 1/2   fate of half 0

A photon of Phi+ that is measured along X, Y or Z gives a fair bit; its partner gives the same bit
along the same axis (the opposite one along Y), and an independent one along another. So each pair
has a bit for each axis, and either half is in that state along its own axis, in whichever order
they are measured. That is no model of measurements between the axes: before these, photons are
drawn.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dispatcher.layer.weak_pulses import (
    LAYERS,
    BasesAt,
    Photons,
    Pulses,
    WeakPulses,
    first_layer,
    in_order,
)
from dispatcher.photon_random import PhotonRandom, PhotonsByKey
from dispatcher.sabot.backend import Bytes
from wire.outcomes import PAULI_BASES

HIGH = 2.0 ** -np.arange(LAYERS + 1.0)  # of the fates in each layer
LOW = np.append(HIGH[1:], 0.0)
NO_LAYER = LAYERS + 1
RANK_BITS = 40  # of a key, below the number of the cell
Y = 2


@dataclass(eq=False, slots=True)
class Pairs:
    """The pairs of a block, of both halves."""

    count: int  # pulses
    mean: float
    random: PhotonRandom  # of the source
    cells: NDArray[np.int64] = field(init=False)
    measured: BasesAt | None = None  # in which one half was measured already

    def __post_init__(self) -> None:
        shares = HIGH - LOW
        means = self.count * self.mean * np.outer(shares, shares)
        self.cells = self.random.generator("pairs in cells").poisson(means)

    def below(self, most: Sequence[float]) -> tuple[Photons, Photons]:
        """Draw all pairs of which either half has a fate below its threshold, as seen by both."""
        first, second = (first_layer(each) if each else NO_LAYER for each in most)
        rows, columns = np.indices(self.cells.shape)
        cells = np.where((rows >= first) | (columns >= second), self.cells, 0).reshape(-1)
        keys = np.repeat((np.arange(cells.size) << RANK_BITS) - cells.cumsum() + cells, cells)
        keys = (keys + np.arange(keys.size)).astype(np.uint64)
        halves = PhotonsByKey.of(self.random, keys).halves("fates")
        fates = [np.ones(keys.size)] * 2  # of a half that nobody looks at
        for half, layers in enumerate((rows.reshape(-1), columns.reshape(-1))):
            if most[half]:
                low, width = (np.repeat(each[layers], cells) for each in (LOW, HIGH - LOW))
                fates[half] = low + halves[half] * width
        some = np.flatnonzero((fates[0] < most[0]) | (fates[1] < most[1]))
        pulses, order = in_order(self._pulses(keys[some]))
        some = some[order]
        one, other = (Photons(pulses, fate[some], keys[some]) for fate in fates)
        return one, other

    def _pulses(self, keys: NDArray[np.uint64]) -> Pulses:
        return (PhotonsByKey.of(self.random, keys).uniform("pulse") * self.count).astype(np.int64)

    def bits(self, keys: NDArray[np.uint64], bases: Bytes) -> Bytes:
        """Return what each pair has for an axis, at half 0; shape (m,)."""
        of_axes = keys * np.uint64(PAULI_BASES) + bases
        return (PhotonsByKey.of(self.random, of_axes).uniform("bit") < 0.5).astype(np.uint8)


@dataclass(eq=False, slots=True, kw_only=True)
class WeakHalf(WeakPulses):
    pairs: Pairs
    half: int

    @property
    def places(self) -> int:
        return 0

    def states(self, photons: Photons, bases: Bytes | None = None) -> Bytes:
        """Return the state of each photon; without bases that in which the other half has left it.

        Where nobody has measured the other half it is in any state, along Z here.
        """
        if bases is None:
            other = self.pairs.measured
            bases = (
                np.zeros_like(photons.keys, np.uint8) if other is None else other(photons.pulses)
            )
        bits = self.pairs.bits(photons.keys, bases)
        if self.half:
            bits ^= bases == Y
        return bases << np.uint8(1) | bits

    def below(self, threshold: float) -> Photons:
        most = (0.0, threshold) if self.half else (threshold, 0.0)
        return self.pairs.below(most)[self.half]


def seen_together(
    first: WeakHalf, second: WeakHalf, shares: tuple[float, float]
) -> tuple[Photons, Photons]:
    """Draw the pairs of which such shares of either half may be seen, as photons of both."""
    most = [0.0, 0.0]
    for light, share in zip((first, second), shares, strict=True):
        most[light.half] = light.transmission * share
    came = first.pairs.below(most)
    return came[first.half], came[second.half]


def weak_halves(pairs: Pairs) -> tuple[WeakHalf, WeakHalf]:
    total = int(pairs.cells.sum())
    one, other = (
        WeakHalf(
            count=pairs.count,
            mean=pairs.mean,
            random=pairs.random,
            expected=total,
            pairs=pairs,
            half=half,
        )
        for half in (0, 1)
    )
    return one, other
