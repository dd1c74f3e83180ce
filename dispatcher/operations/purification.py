"""One round of purification of a block in a memory of a switch, as one end of its pairs does it.

    pulse 0, pulse 2, …   --o--   stay, where the outcomes at both ends agree
    pulse 1, pulse 3, …   --X--   measured

The operations, their noise and their order are those of hosts
(hosts/middleware/services/distribution/purification.py, which has the sources).
"""

import numpy as np
from numpy.typing import NDArray

from dispatcher.devices import hardware
from dispatcher.layer.layer import PhysicalLayer, block_id
from dispatcher.layer.ownership import Block, BlockName
from dispatcher.operations.blocks import Operations
from dispatcher.operations.gathering import Gathering
from dispatcher.operations.measurements import Measurements
from dispatcher.refusal import invalid
from dispatcher.sabot.backend import Bytes
from wire.analyser_frames import CYCLES, PHOTONS, QUARTER_TURNS, THIRD, LocalGate
from wire.dispatcher_pb2 import ApplyRequest, Feedback, Gate, GatherRequest, MeasureRequest, Pick
from wire.features import GATE, MEASURE
from wire.outcomes import NO_CLICK
from wire.positions import pack

DEJMPS = 2  # half of its methods
TARGETS, FIRST_THIRD = 2, 3  # halves that no source makes, beside those of the block


class Purification:
    """Compares the pulses of blocks that wait in memories."""

    def __init__(
        self, layer: PhysicalLayer, blocks: Operations, measurements: Measurements
    ) -> None:
        self._layer, self._blocks, self._measurements = layer, blocks, measurements
        self._gathering = Gathering(layer)

    def round(self, block: Block, order: Bytes, method: int) -> tuple[Block, Bytes, Feedback]:
        """Compare the pulses of a block that an order names, two by two.

        Return what is left in memory, the outcomes of the measured, and when it is over.
        """
        node, name, half = block.node, block.name, method % 2
        named = np.flatnonzero(order != NO_CLICK)
        pairs = named.size // PHOTONS
        if not pairs:
            raise invalid(f"{named.size} pulses to purify: name two at least")
        for feature in (GATE, MEASURE):
            hardware.require(self._layer.devices, node, feature)
        block.port = ""
        self._gather(node, name, {name: named})
        size, paulis = named.size, order[named] % THIRD
        if method // 2 == DEJMPS:
            places = np.arange(size)
            self._apply(node, name, paulis, *QUARTER_TURNS[half])
        else:
            self._apply(node, name, paulis)
            places = self._turn_thirds(node, name, order[named] // THIRD, CYCLES[half])
        targets = name._replace(half=name.half + TARGETS)
        self._gather(node, targets, {name: places[1 : 2 * pairs : 2]}, keep_rest=True)
        self._gather(node, name, {name: places[0 : 2 * pairs : 2]})
        compared = Gate(name=Gate.CX, target=block_id(targets))
        self._blocks.apply(node, ApplyRequest(block=block_id(name), gates=[compared]))
        over = self._measurements.measure(node, MeasureRequest(block=block_id(targets)))
        left = self._layer.ownership.require(name, node)
        return left, np.frombuffer(over.outcomes, np.uint8), over

    def _turn_thirds(
        self, node: str, name: BlockName, thirds: Bytes, cycle: tuple[tuple[LocalGate, ...], ...]
    ) -> NDArray[np.intp]:
        """Turn each third of a block by its gates; return where each pulse is in it then."""
        parts: dict[BlockName, NDArray[np.intp]] = {}
        for third, gates in enumerate(cycle):
            mine = np.flatnonzero(thirds == third)
            if mine.size:
                part = name._replace(half=name.half + 2 * (FIRST_THIRD + third))
                self._gather(node, part, {name: mine}, keep_rest=True)
                self._apply(node, part, np.zeros(mine.size, np.uint8), *gates)
                parts[part] = np.arange(mine.size)
        self._blocks.discard(node, block_id(name))
        self._gather(node, name, parts)
        return np.argsort(np.argsort(thirds, kind="stable"))

    def _gather(
        self,
        node: str,
        into: BlockName,
        picks: dict[BlockName, NDArray[np.intp]],
        keep_rest: bool = False,
    ) -> None:
        picked = [Pick(block=block_id(name), photons=pack(at)) for name, at in picks.items()]
        request = GatherRequest(into=block_id(into), picks=picked, keep_rest=keep_rest)
        self._gathering.gather(node, request)

    def _apply(self, node: str, name: BlockName, paulis: Bytes, *gates: LocalGate) -> None:
        """Apply a Pauli operator to each photon where one is not I, then gates to all."""
        values = paulis.tobytes() if paulis.any() else b""
        if values or gates:
            made = [Gate(name=gate) for gate in gates]
            self._blocks.apply(node, ApplyRequest(block=block_id(name), paulis=values, gates=made))
