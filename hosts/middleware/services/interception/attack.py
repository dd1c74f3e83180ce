"""What every attack on light does, whichever it is."""

from typing import Any, Protocol

import numpy as np

from hosts.hardware.qnic import BlockName


class Attack(Protocol):
    """What is done to blocks of light that are at this host, before they are sent on."""

    @property
    def summary(self) -> dict[str, Any]:
        """What was done so far."""

    async def attack(self, block: BlockName, photons: int) -> dict[str, Any]:
        """Do it to a block with so many places for photons; return what is told of it."""

    async def end(self) -> None:
        """Let go of what was kept."""


def choices(seeds: tuple[int, ...], block: BlockName) -> np.random.Generator:
    """Return random choices for a block: the same block, the same ones, whenever it comes."""
    first, *rest = seeds
    return np.random.default_rng((first, block.session, block.number, block.half, *rest))
