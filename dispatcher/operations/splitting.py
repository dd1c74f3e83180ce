"""Photon-number splitting: counts the photons of pulses, and takes one out of those with several.

    pulse      0   1   2    3
    photons    1   0   3    2        told, and no state is looked at
    taken      .   .   one  one      into a block of their own, each in the place of its pulse

No law of physics forbids it, though nobody has built it (Brassard, Luetkenhaus, Mor, Sanders,
Phys. Rev. Lett. 85, 1330 (2000)). Light without a state, such as Raman noise, is not counted.
"""

from collections import Counter
from dataclasses import replace

import grpc
import numpy as np
from numpy.typing import NDArray

from dispatcher.devices import hardware
from dispatcher.layer import drift
from dispatcher.layer.layer import PhysicalLayer, block_name
from dispatcher.layer.ownership import Block, BlockName, Further
from dispatcher.operations.gathering import require_places
from dispatcher.refusal import Refusal, invalid
from dispatcher.sabot.registers import Mask, Pick
from wire.dispatcher_pb2 import Feedback, SplitRequest
from wire.features import MEASURE

MOST_COUNTED = 254  # a byte tells it, and 255 is not a count
SEVERAL = 2


class Splitting:
    """Split."""

    def __init__(self, layer: PhysicalLayer) -> None:
        self._layer = layer

    def split(self, node: str, request: SplitRequest) -> Feedback:
        """Count the photons of each pulse; take one of those that have several into a new block."""
        layer, name, into = self._layer, block_name(request.block), block_name(request.into)
        block = layer.ownership.require(name, node)
        hardware.require(layer.devices, node, MEASURE)
        if layer.ownership.taken(into, node):
            message = f"{into} exists, here or elsewhere; discard it or take another number"
            raise Refusal(grpc.StatusCode.ALREADY_EXISTS, message)
        if into[:2] == name[:2]:
            raise invalid(f"{into} is of the block that is split; take another number")
        require_places(layer, block.node, block.register.size)
        layer.take_up(block)
        counts = photons(block)
        taken = self._take(block, into, counts >= SEVERAL)
        layer.ownership.add(taken)
        told = Counter(np.minimum(counts, SEVERAL + 1).tolist())
        words = " ".join(f"{_named(count)}={told[count]}" for count in sorted(told))
        layer.record(
            node,
            "split",
            block,
            detail=f"photons in pulses: {words}; one of several into {into.number}/{into.half}",
            each=lambda position: f"{counts[position]} photons",
        )
        feedback = layer.feedback(block, taken)
        feedback.outcomes = counts.tobytes()
        return feedback

    def _take(self, block: Block, into: BlockName, several: Mask) -> Block:
        """Take a photon out of each of these pulses, its own if that is there."""
        layer = self._layer
        drift.twirl_turn(block, layer.sabot, layer.draws)
        own = several & block.register.present
        others = self._take_further(block, several & ~own)
        taken = Block(
            into,
            layer.sabot.part(block.register, own),
            block.node,
            first_ns=block.first_ns,
            last_ns=block.last_ns,
            fibers_passed=block.fibers_passed,
            pulses=replace(block.pulses, extras=None),
            further=others,
            start_ns=block.start_ns,
            interval_ns=block.interval_ns,
            way_ps=block.way_ps,
            retimed=block.retimed,
            lineage=f"split off {block.name} {block.lineage}",
        )
        block.pulses.approximations |= taken.pulses.approximations
        return taken

    def _take_further(self, block: Block, members: Mask) -> Further | None:
        """Take one of the photons beside the own ones of these pulses, which have lost theirs."""
        light = block.further
        if light is None or not members.any():
            return None
        there = np.flatnonzero(light.register.present & members[light.pulses])
        _pulses, first = np.unique(light.pulses[there], return_index=True)
        chosen = there[first]
        register = self._layer.sabot.gather([Pick(light.register, chosen.astype(np.uint32))])
        return Further(register, light.pulses[chosen])


def photons(block: Block) -> NDArray[np.uint8]:
    """Return how many photons with a state each pulse has, MOST_COUNTED at most; shape (k,)."""
    counts: NDArray[np.int64] = block.register.present.astype(np.int64)
    if block.further is not None:
        at = block.further.pulses[block.further.register.present]
        counts += np.bincount(at, minlength=counts.size)
    return np.minimum(counts, MOST_COUNTED).astype(np.uint8)


def _named(count: int) -> str:
    return str(count) if count <= SEVERAL else "more"
