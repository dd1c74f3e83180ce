"""Photon-number splitting (Brassard, Luetkenhaus, Mor, Sanders 2000).

    photons in a pulse    0   1   1   2   3
    sent on               0   1   -   1   2      only as many as are expected
    kept in the memory                1   1      until their bases are told

The way from here loses less than the two ends expect. Pulses of several photons lose one; of the
others, and of these only if they alone are too many, some are held back, so that as many clicks
come as without this host. No state is disturbed: the error rate stays what it was.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hosts.hardware.qnic import BlockName, Qnic, Symbols
from hosts.middleware.services.interception.attack import choices

OWN_NUMBERS = 1 << 31  # of blocks that are kept: that of the light, and this
TRASH_NUMBERS = 3 << 30
SEVERAL = 2


@dataclass(frozen=True)
class Way:
    """What light loses from here to a click: as both ends expect it, and as it is."""

    expected_db: float = 0.0
    onward_db: float = 0.0

    def sent_on(self, pulses: Sequence[int]) -> tuple[float, float]:
        """Return which share of pulses to send on with one photon, and with several.

        There are so many with 0, 1, … photons. As many click then as on the expected way, where n
        photons do with 1 - (1 - t)^n.
        """
        expected, onward = (10 ** (-loss / 10) for loss in (self.expected_db, self.onward_db))
        counts = np.arange(len(pulses))
        there = np.asarray(pulses, dtype=np.float64)
        wanted = float(there @ (1 - (1 - expected) ** counts))
        left = np.where(counts >= SEVERAL, counts - 1, 0)
        by_several = float(there @ (1 - (1 - onward) ** left))
        if by_several >= wanted:
            return 0.0, wanted / by_several if by_several else 0.0
        singles = float(there[1]) * onward if len(pulses) > 1 else 0.0
        return min(1.0, (wanted - by_several) / singles) if singles else 0.0, 1.0


@dataclass
class Split:
    """What was done so far, in pulses."""

    multi_photon: int = 0  # with several photons
    single_photon: int = 0
    held_back: int = 0  # of both
    let_go: int = 0  # photons that were kept, and had to make room


class PhotonSplitting:
    """Splits photons off, and keeps them."""

    def __init__(self, qnic: Qnic, way: Way, seeds: tuple[int, ...], memory_qubits: int) -> None:
        self._qnic, self._way, self._seeds = qnic, way, seeds
        self._room = memory_qubits
        self._kept: deque[tuple[BlockName, int]] = deque()  # and how many photons
        self._split = Split()

    @property
    def summary(self) -> dict[str, Any]:
        """What was done so far."""
        return {**asdict(self._way), **asdict(self._split)}

    async def attack(self, block: BlockName, photons: int) -> dict[str, Any]:
        """Keep one photon of each pulse that has several; hold some single ones back."""
        into = BlockName(block.session, block.number | OWN_NUMBERS, block.half)
        counts = await self._qnic.split(block, into)
        several = int(np.count_nonzero(counts >= SEVERAL))
        await self._keep(into, several)
        single = int(np.count_nonzero(counts == 1))
        back = self._held_back(block, counts)
        if back.size:
            await self._hold_back(block, back)
        self._split.multi_photon += several
        self._split.single_photon += single
        self._split.held_back += back.size
        return {"multi_photon": several, "single_photon": single, "held_back": back.size}

    async def end(self) -> None:
        """Let go of the photons that are kept."""
        while self._kept:
            await self._let_go()

    async def _keep(self, block: BlockName, photons: int) -> None:
        """Store photons that were split off; those that came first make room for them."""
        kept = sum(count for _block, count in self._kept) + photons
        while self._kept and kept > self._room:
            gone = await self._let_go()
            kept, self._split.let_go = kept - gone, self._split.let_go + gone
        self._kept.append((block, photons))
        if photons > self._room:
            self._split.let_go += await self._let_go()
            return
        await self._qnic.store(block)

    async def _let_go(self) -> int:
        block, photons = self._kept.popleft()
        await self._qnic.discard_block(block.session, block.number)
        return photons

    def _held_back(self, block: BlockName, counts: Symbols) -> NDArray[np.intp]:
        """Return which pulses with light are not sent on."""
        single, several = self._way.sent_on(np.bincount(counts).tolist())
        shares = np.where(counts >= SEVERAL, several, single)
        drawn = choices(self._seeds, block).random(counts.size)
        return np.flatnonzero((counts > 0) & (drawn >= shares))

    async def _hold_back(self, block: BlockName, places: NDArray[np.intp]) -> None:
        trash = BlockName(block.session, block.number | TRASH_NUMBERS, block.half)
        await self._qnic.gather(trash, {block: places}, keep_rest=True)
        await self._qnic.discard_block(trash.session, trash.number)
