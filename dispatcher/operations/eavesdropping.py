"""Intercept and resend: measures some photons of a block and puts new ones in their places.

    bases      Z   -   X   Z   -        -: left alone (255)
    before     a   b   c   d   e
    outcomes   0       1   no click
    after     |0>  b  |->      e

The replacement is one photon, which leaves when the other would have left.

Photon-number splitting: counts the photons of pulses, and takes one out of those with several.

    pulse      0   1   2    3
    photons    1   0   3    2        reported; no state is looked at
    taken      .   .   one  one      into a block of their own, each in the place of its pulse

No law of physics forbids it, though nobody has built it (Brassard, Luetkenhaus, Mor, Sanders,
Phys. Rev. Lett. 85, 1330 (2000)). Light without a state, such as Raman noise, is not counted.
"""

from collections import Counter
from dataclasses import replace
from functools import partial

import grpc
import numpy as np
from numpy.typing import NDArray

from dispatcher.devices import hardware
from dispatcher.fiber.turn import merged
from dispatcher.layer import device_noise, drift, extra_pairs, pulses
from dispatcher.layer.layer import PhysicalLayer, block_name, tally
from dispatcher.layer.ownership import Block, BlockName, ExtraPairs, Pulses
from dispatcher.operations import emission, imperfections, weak_light
from dispatcher.operations.gathering import require_places
from dispatcher.operations.measurements import clicks, listed
from dispatcher.operations.outcomes import basis_and_outcome
from dispatcher.operations.weak_light import train
from dispatcher.refusal import Refusal, exhausted, invalid
from dispatcher.sabot.backend import Bytes
from dispatcher.sabot.limits import packed
from dispatcher.sabot.registers import Mask, Pick, Register
from wire.dispatcher_pb2 import Feedback, ResendRequest, SplitRequest
from wire.features import MEASURE
from wire.outcomes import BASES, NO_CLICK, PAULI_BASES

MOST_COUNTED = 254  # a byte tells it, and 255 is not a count
SEVERAL = 2


class Splitting:
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
        weak_light.draw(layer, f"an operation of {node}", block)
        require_places(layer, block.node, block.register.size)
        layer.take_up(block)
        counts = photons(block)
        taken = self._take(block, into, counts >= SEVERAL)
        layer.ownership.add(taken)
        numbers = Counter(np.minimum(counts, SEVERAL + 1).tolist())
        text = " ".join(f"{_named(count)}={numbers[count]}" for count in sorted(numbers))
        layer.record(
            node,
            "split",
            block,
            detail=f"photons in pulses: {text}; one of several into {into.number}/{into.half}",
            each=lambda position: f"{counts[position]} photons",
        )
        feedback = layer.feedback(block, taken)
        feedback.outcomes = counts.tobytes()
        return feedback

    def _take(self, block: Block, into: BlockName, several: Mask) -> Block:
        """Take a photon out of each of these pulses, its own unless that is lost."""
        layer = self._layer
        drift.twirl_turn(block, layer.sabot, layer.draws)
        single = several & block.register.present
        others = self._take_extra_pairs(block, several & ~single)
        taken = Block(
            into,
            layer.sabot.part(block.register, single),
            block.node,
            first_ns=block.first_ns,
            last_ns=block.last_ns,
            fibers_passed=block.fibers_passed,
            pulses=replace(block.pulses, extras=None),
            extra_pairs=others,
            start_ns=block.start_ns,
            interval_ns=block.interval_ns,
            path_ps=block.path_ps,
            retimed=block.retimed,
            lineage=f"split off {block.name} {block.lineage}",
        )
        block.pulses.approximations |= taken.pulses.approximations
        return taken

    def _take_extra_pairs(self, block: Block, members: Mask) -> ExtraPairs | None:
        """Take one of the photons beside the own ones of these pulses, which have lost theirs."""
        light = block.extra_pairs
        if light is None or not members.any():
            return None
        there = np.flatnonzero(light.register.present & members[light.pulses])
        _pulses, first = np.unique(light.pulses[there], return_index=True)
        chosen = there[first]
        register = self._layer.sabot.gather([Pick(light.register, chosen.astype(np.uint32))])
        return ExtraPairs(register, light.pulses[chosen])


def photons(block: Block) -> NDArray[np.uint8]:
    """Return how many photons with a state each pulse has, MOST_COUNTED at most; shape (k,)."""
    counts: NDArray[np.int64] = block.register.present.astype(np.int64)
    if block.extra_pairs is not None:
        at = block.extra_pairs.present_pulses
        counts += np.bincount(at, minlength=counts.size)
    return np.minimum(counts, MOST_COUNTED).astype(np.uint8)


def _named(count: int) -> str:
    return str(count) if count <= SEVERAL else "more"


ALONE = 255


class Resending:
    def __init__(self, layer: PhysicalLayer) -> None:
        self._layer = layer

    def resend(self, node: str, request: ResendRequest) -> Feedback:
        """Measure the photons that have a basis, and replace them by the outcomes."""
        layer, name = self._layer, block_name(request.block)
        block = weak_light.require(layer, name, node)
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
        device_noise.in_front(layer.sabot, layer.draws, taken, effect, place, looked_at)
        bits = layer.sabot.measure(taken.register, looked_at, draws)
        more = extra_pairs.measure(layer.sabot, taken, looked_at, layer.draws, place)
        detectors = f"{place}, detectors of {node}"
        detection = clicks(layer, taken, train(block), detectors, bits, more)
        outcomes = detection.bits | (~chosen * np.uint8(NO_CLICK))
        reported, wrong = imperfections.misread(layer, block, outcomes, "resend")
        reported = device_noise.reported(reported, effect)
        again = (reported != NO_CLICK) & free
        bits_left = outcomes if block.kept else reported  # new light is as reported
        self._replace(block, fresh, again, values << np.uint8(1) | bits_left & np.uint8(1))
        incidents = detection.incidents() | ({"misread": wrong} if wrong else {})
        detail = f"{tally(values, BASES)}: {tally(reported, ('0', '1'))}{listed(incidents)}"
        layer.record(node, "resend", block, detail=detail, each=partial(_each, values, reported))
        feedback = layer.feedback(block)
        feedback.clicks, feedback.outcomes = detection.clicks, reported.tobytes()
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
        taken = pulses.part(block.pulses, chosen)
        part = Block(
            block.name,
            layer.sabot.part(block.register, chosen),
            block.node,
            fibers_passed=block.fibers_passed,
            pulses=taken,
            lineage=block.lineage,
            maker=block.maker,
            extra_pairs=extra_pairs.part(layer.sabot, block, chosen),
        )
        drift.twirl(part, layer.sabot, layer.draws)
        _renew(block.pulses, chosen)
        block.pulses.approximations |= taken.approximations
        return part

    def _replace(self, block: Block, fresh: Register, again: Mask, states: Bytes) -> None:
        """Put photons in these states into the places; discard the rest of the fresh ones."""
        layer = self._layer
        photons = layer.sabot.part(fresh, again)
        purpose = block.draws_for("not resent")
        layer.sabot.drop(fresh, layer.draws.photons(block.name, purpose, fresh.size))
        emission.turn(layer.sabot, photons, states * again)
        layer.sabot.unite(block.register, photons)


def _bases(bases: bytes, size: int) -> Bytes:
    values = packed("bases", bases, size, ALONE)
    unknown = np.flatnonzero((values >= PAULI_BASES) & (values != ALONE))
    if unknown.size:
        at = int(unknown[0])
        raise invalid(f"bases[{at}] is {values[at]}; use 0 Z, 1 X, 2 Y, or {ALONE} to leave it")
    return values


def _each(bases: Bytes, outcomes: Bytes, position: int) -> str:
    left_alone = bases[position] == ALONE
    return "left alone" if left_alone else basis_and_outcome(bases, outcomes, position)


def _renew(light: Pulses, members: Mask) -> None:
    """Forget of the members' pulses how late and how turned they were: their light is new."""
    if light.delays_ps is not None:
        light.delays_ps = light.delays_ps * ~members
    if light.angles_rad is not None:
        light.angles_rad = light.angles_rad * ~members
    light.polarization = merged(light.polarization, None, members)
