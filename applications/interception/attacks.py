"""Attacks on light that goes by way of a host, as protocols of what its hardware does.

Intercept and resend: a fraction is measured in Z or X, at random, and sent on as found.

Photon-number splitting (Brassard, Luetkenhaus, Mor, Sanders 2000):

    photons in a pulse    0   1   1   2   3
    sent on               0   1   -   1   2      only as many as are expected
    kept in the memory                1   1      until their bases are public

The way from here loses less than the two ends expect. Pulses of several photons lose one; of the
others, and of these only if they alone are too many, some are held back, so that as many clicks
come as without this host. No state is disturbed: the error rate stays what it was.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from applications.interception.photons import LEFT_ALONE, resend, split
from hosts.hardware.block_name import BlockName
from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import Symbols
from hosts.middleware.session.protocol import Steps, do
from wire.outcomes import NO_COINCIDENCE

BASES = ("Z", "X")
OWN_NUMBERS = 1 << 31  # of blocks that are kept: that of the light, and this
TRASH_NUMBERS = 3 << 30
SEVERAL = 2


class Attack(Protocol):
    """An attack on blocks of light at this host, before they are sent on."""

    @property
    def summary(self) -> dict[str, Any]:
        """Counts so far."""

    def attack(self, block: BlockName, photons: int) -> Steps[dict[str, Any]]:
        """Attack a block with `photons` places for photons; return its counts."""

    def end(self) -> Steps[None]:
        """Discard what was kept."""


def choices(seeds: tuple[int, ...], block: BlockName) -> np.random.Generator:
    """Return random choices for a block: the same block, the same ones, whenever it comes."""
    first, *rest = seeds
    return np.random.default_rng((first, block.session, block.number, block.half, *rest))


@dataclass
class Seen:
    measured: int = 0  # places that were looked at
    zeros: int = 0
    ones: int = 0


class InterceptResend:
    """Measures a fraction of the photons."""

    def __init__(self, fraction: float, seeds: tuple[int, ...]) -> None:
        self._fraction, self._seeds = fraction, seeds
        self._seen = Seen()

    @property
    def summary(self) -> dict[str, Any]:
        return asdict(self._seen)

    def attack(self, block: BlockName, photons: int) -> Steps[dict[str, Any]]:
        """Measure photons of a block and put new ones in their places."""
        bases = self._choose(block, photons)
        outcomes = np.full(bases.size, NO_COINCIDENCE, dtype=np.uint8)
        if (bases != LEFT_ALONE).any():
            outcomes = yield from do(resend, block, bases)
        zeros, ones = (int(np.count_nonzero(outcomes == bit)) for bit in (0, 1))
        self._seen.measured += int(np.count_nonzero(bases != LEFT_ALONE))
        self._seen.zeros += zeros
        self._seen.ones += ones
        return {"zeros": zeros, "ones": ones}

    def end(self) -> Steps[None]:
        """Discard nothing: what was measured is gone."""
        yield from ()

    def _choose(self, block: BlockName, photons: int) -> Symbols:
        random = choices(self._seeds, block)
        chosen = random.random(photons) < self._fraction
        bases = random.integers(0, len(BASES), photons, dtype=np.uint8)
        return np.where(chosen, bases, LEFT_ALONE).astype(np.uint8)


@dataclass(frozen=True)
class PathLosses:
    """The loss of light from here to a click: expected by both ends, and real."""

    expected_db: float = 0.0
    onward_db: float = 0.0

    def sent_on(self, pulses: Sequence[int]) -> tuple[float, float]:
        """Return which share of pulses to send on with one photon, and with several.

        There are `pulses` with 0, 1, … photons. As many click then as on the expected way, where n
        photons do with 1 - (1 - t)^n.
        """
        expected, onward = (10 ** (-loss / 10) for loss in (self.expected_db, self.onward_db))
        counts = np.arange(len(pulses))
        there = np.asarray(pulses, dtype=np.float64)
        clicks = float(there @ (1 - (1 - expected) ** counts))
        left = np.where(counts >= SEVERAL, counts - 1, 0)
        by_several = float(there @ (1 - (1 - onward) ** left))
        if by_several >= clicks:
            return 0.0, clicks / by_several if by_several else 0.0
        singles = float(there[1]) * onward if len(pulses) > 1 else 0.0
        return min(1.0, (clicks - by_several) / singles) if singles else 0.0, 1.0


@dataclass
class Split:
    """Counts so far, in pulses."""

    multi_photon: int = 0  # with several photons
    single_photon: int = 0
    held_back: int = 0  # of both
    discarded: int = 0  # photons that were kept, and had to make room


class PhotonSplitting:
    """Splits photons off, and keeps them."""

    def __init__(self, losses: PathLosses, seeds: tuple[int, ...], memory_qubits: int) -> None:
        self._losses, self._seeds = losses, seeds
        self._capacity = memory_qubits
        self._kept: deque[tuple[BlockName, int]] = deque()  # and how many photons
        self._split = Split()

    @property
    def summary(self) -> dict[str, Any]:
        return {**asdict(self._losses), **asdict(self._split)}

    def attack(self, block: BlockName, photons: int) -> Steps[dict[str, Any]]:
        """Keep one photon of each pulse that has several; hold some single ones back."""
        into = BlockName(block.session, block.number | OWN_NUMBERS, block.half)
        counts = yield from do(split, block, into)
        several = int(np.count_nonzero(counts >= SEVERAL))
        yield from self._keep(into, several)
        single = int(np.count_nonzero(counts == 1))
        back = self._held_back(block, counts)
        if back.size:
            yield from self._hold_back(block, back)
        self._split.multi_photon += several
        self._split.single_photon += single
        self._split.held_back += back.size
        return {"multi_photon": several, "single_photon": single, "held_back": back.size}

    def end(self) -> Steps[None]:
        while self._kept:
            yield from self._discard()

    def _keep(self, block: BlockName, photons: int) -> Steps[None]:
        """Store photons that were split off; those that came first make room for them."""
        total = sum(count for _block, count in self._kept) + photons
        while self._kept and total > self._capacity:
            gone = yield from self._discard()
            total, self._split.discarded = total - gone, self._split.discarded + gone
        self._kept.append((block, photons))
        if photons > self._capacity:
            self._split.discarded += yield from self._discard()
            return
        yield from do(Qnic.store, block)

    def _discard(self) -> Steps[int]:
        block, photons = self._kept.popleft()
        yield from do(Qnic.discard_block, block.session, block.number)
        return photons

    def _held_back(self, block: BlockName, counts: Symbols) -> NDArray[np.intp]:
        """Return which pulses with light are not sent on."""
        single, several = self._losses.sent_on(np.bincount(counts).tolist())
        shares = np.where(counts >= SEVERAL, several, single)
        drawn = choices(self._seeds, block).random(counts.size)
        return np.flatnonzero((counts > 0) & (drawn >= shares))

    def _hold_back(self, block: BlockName, places: NDArray[np.intp]) -> Steps[None]:
        trash = BlockName(block.session, block.number | TRASH_NUMBERS, block.half)
        yield from do(Qnic.gather, trash, {block: places}, keep_rest=True)
        yield from do(Qnic.discard_block, trash.session, trash.number)
