"""Intercept and resend: measures some photons of a block and puts new ones in their places.

    bases      Z   -   X   Z   -        -: left alone (255)
    before     a   b   c   d   e
    outcomes   0       1   no click
    after     |0>  b  |->      e

What is put in a place is one photon, which leaves when the other would have left.
"""

from functools import partial

import numpy as np

from dispatcher.devices import hardware
from dispatcher.fiber.turn import merged
from dispatcher.layer import drift, further, part_noise, pulses
from dispatcher.layer.layer import PhysicalLayer, block_name, tally
from dispatcher.layer.ownership import Block, Pulses
from dispatcher.operations import imperfections, preparation
from dispatcher.operations.measurements import clicks, listed, outcome, train
from dispatcher.refusal import exhausted, invalid
from dispatcher.sabot.backend import Bytes
from dispatcher.sabot.limits import packed
from dispatcher.sabot.registers import Mask, Register
from wire.dispatcher_pb2 import Feedback, ResendRequest
from wire.features import MEASURE
from wire.outcomes import BASES, NO_CLICK, PAULI_BASES

ALONE = 255


class Resending:
    """Resend."""

    def __init__(self, layer: PhysicalLayer) -> None:
        """Act on this layer."""
        self._layer = layer

    def resend(self, node: str, request: ResendRequest) -> Feedback:
        """Measure the photons that have a basis, and replace them by what was found."""
        layer, name = self._layer, block_name(request.block)
        block = layer.ownership.require(name, node)
        hardware.require(layer.devices, node, MEASURE)
        hardware.require_encoding(layer.devices, node, block.pulses.encoding)
        size = block.register.size
        values = _bases(request.bases, size)
        fresh = self._fresh(size)
        layer.take_up(block)
        chosen = values != ALONE
        free = self._free(block)
        taken = self._take(block, chosen)
        place = block.draws_for(f"resend {block.resends}")
        block.resends += 1
        draws = layer.draws.photons(name, place, size)
        effect = imperfections.noise_of_detectors(layer, taken, place)
        block.pulses.approximations |= taken.pulses.approximations
        looked_at = values * chosen
        part_noise.in_front(layer.sabot, layer.draws, taken, effect, place, looked_at)
        bits = layer.sabot.measure(taken.register, looked_at, draws)
        more = further.measure(layer.sabot, taken, looked_at, layer.draws, place)
        detectors = f"{place}, detectors of {node}"
        found = clicks(layer, taken, train(block), detectors, bits, more)
        outcomes = found.bits | (~chosen * np.uint8(NO_CLICK))
        told, wrong = imperfections.misread(layer, block, outcomes, "resend")
        told = part_noise.told(told, effect)
        again = (told != NO_CLICK) & free
        left = outcomes if block.kept else told  # new light is as what was told
        self._replace(block, fresh, again, values << np.uint8(1) | left & np.uint8(1))
        incidents = found.incidents() | ({"misread": wrong} if wrong else {})
        detail = f"{tally(values, BASES)}: {tally(told, ('0', '1'))}{listed(incidents)}"
        layer.record(node, "resend", block, detail=detail, each=partial(_each, chosen, told))
        feedback = layer.feedback(block)
        feedback.clicks, feedback.outcomes = found.clicks, told.tobytes()
        seconds = layer.devices.of(node).gates.readout_s if block.kept else 0.0
        return imperfections.lasts(feedback, seconds, [block])

    def _fresh(self, size: int) -> Register:
        """Return new qubits, one for each place; refuse if there is no room for them."""
        layer = self._layer
        live = layer.sabot.live_qubits
        if live + size > layer.max_live_qubits:
            raise exhausted(
                f"{size} photons to resend with {live} qubits live exceed the limit of "
                f"{layer.max_live_qubits}; measure or discard some first, or use smaller blocks"
            )
        return layer.sabot.zeros(size)

    def _free(self, block: Block) -> Mask:
        """Return which places no photon has that is elsewhere, and could come here later."""
        parts = self._layer.ownership.parts(block.name)
        if sum(part.maker == block.maker for part in parts) == 1:
            return np.ones(block.register.size, dtype=bool)
        return block.register.present.copy()

    def _take(self, block: Block, chosen: Mask) -> Block:
        """Take photons out of a block, and what is known of their light."""
        layer = self._layer
        drift.twirl_turn(block, layer.sabot, layer.draws)
        own = pulses.part(block.pulses, chosen)
        part = Block(
            block.name,
            layer.sabot.part(block.register, chosen),
            block.node,
            fibers_passed=block.fibers_passed,
            pulses=own,
            lineage=block.lineage,
            maker=block.maker,
            further=further.part(layer.sabot, block, chosen),
        )
        drift.twirl(part, layer.sabot, layer.draws)
        _renew(block.pulses, chosen)
        block.pulses.approximations |= own.approximations
        return part

    def _replace(self, block: Block, fresh: Register, again: Mask, states: Bytes) -> None:
        """Put photons in these states into the places; discard the rest of the fresh ones."""
        layer = self._layer
        photons = layer.sabot.part(fresh, again)
        purpose = block.draws_for("not resent")
        layer.sabot.drop(fresh, layer.draws.photons(block.name, purpose, fresh.size))
        preparation.turn(layer.sabot, photons, states * again)
        layer.sabot.unite(block.register, photons)


def _bases(bases: bytes, size: int) -> Bytes:
    values = packed("bases", bases, size, ALONE)
    unknown = np.flatnonzero((values >= PAULI_BASES) & (values != ALONE))
    if unknown.size:
        at = int(unknown[0])
        raise invalid(f"bases[{at}] is {values[at]}; use 0 Z, 1 X, 2 Y, or {ALONE} to leave it")
    return values


def _each(chosen: Mask, outcomes: Bytes, position: int) -> str:
    """Return what was found of one photon."""
    return outcome(outcomes, ("0", "1"), position) if chosen[position] else "left alone"


def _renew(light: Pulses, members: Mask) -> None:
    """Forget of the members' pulses how late and how turned they were: their light is new."""
    if light.delays_ps is not None:
        light.delays_ps = light.delays_ps * ~members
    if light.angles_rad is not None:
        light.angles_rad = light.angles_rad * ~members
    light.polarization = merged(light.polarization, None, members)
