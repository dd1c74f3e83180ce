"""Measurements of blocks by the node that holds them: first states, then detectors."""

from functools import partial

import numpy as np

from dispatcher.devices import abilities
from dispatcher.devices.analyser import Analyser, Half
from dispatcher.devices.detector import Train
from dispatcher.devices.detectors import Told
from dispatcher.layer import drift, further, pulses
from dispatcher.layer.layer import PhysicalLayer, tally
from dispatcher.layer.ownership import Block, BlockName
from dispatcher.operations import gate_noise
from dispatcher.operations.blocks import require_pairs
from dispatcher.photon_random import PhotonRandom
from dispatcher.refusal import invalid
from dispatcher.sabot.backend import Bytes
from dispatcher.sabot.capacity import GateStep
from dispatcher.sabot.draws import PhotonDraws
from dispatcher.sabot.limits import packed
from dispatcher.sabot.registers import Mask
from wire.dispatcher_pb2 import Feedback, MeasureRequest
from wire.features import MEASURE
from wire.outcomes import BASES, NO_CLICK
from wire.parameters.fiber import SPEED_IN_FIBER_M_PER_S
from wire.parameters.physics import BELL_STATES


class Measurements:
    """Measure and Bell-measure."""

    def __init__(self, layer: PhysicalLayer) -> None:
        """Act on this layer."""
        self._layer = layer

    def measure(self, node: str, name: BlockName, basis: int, bases: bytes) -> Feedback:
        """Measure and use up every photon, each in its basis."""
        layer = self._layer
        block = layer.ownership.require(name, node)
        abilities.require(layer.devices, node, MEASURE)
        abilities.require_encoding(layer.devices, node, block.pulses.encoding)
        size = block.register.size
        if basis not in MeasureRequest.Basis.values():
            raise invalid(f"basis {basis} is unknown; use Z, X or Y")
        values = np.full(size, basis, np.uint8)
        if bases:
            values = packed("bases", bases, size, 2)
        layer.take_up(block)
        drift.twirl_turn(block, layer.sabot, layer.draws)
        if values.any():  # a measurement of Z does not see the angles
            drift.twirl(block, layer.sabot, layer.draws)
        feedback = layer.feedback(block)
        bits = layer.sabot.measure(block.register, values, self._draws(block))
        more = further.measure(layer.sabot, block, values, layer.draws, "measure")
        layer.ownership.remove(block)
        place = block.draws_for(f"detectors of {node}")
        random = PhotonRandom(layer.draws, block.name, place, size)
        detectors = layer.devices.detectors(node, "measure")
        found = detectors.detect(
            bits,
            block.pulses.extras,
            train(block),
            random,
            more,
            late_ps=pulses.late_ps(block.pulses, size, random),
            timed=True,
        )
        told = f"{tally(values, BASES)}: {tally(found.bits, ('0', '1'))}"
        each = partial(outcome, found.bits, ("0", "1"))
        layer.record(node, "measure", block, detail=told + listed(found.incidents()), each=each)
        feedback.clicks, feedback.outcomes = found.clicks, found.bits.tobytes()
        return feedback

    def bell_measure(self, node: str, names: tuple[BlockName, BlockName]) -> Feedback:
        """Measure and use up pairs of photons, in the Bell basis."""
        layer = self._layer
        first, second = (layer.ownership.require(name, node) for name in names)
        require_pairs(first, second)
        abilities.require(layer.devices, node, MEASURE)
        for block in (first, second):
            abilities.require_encoding(layer.devices, node, block.pulses.encoding)
        layer.sabot.require_capacity(first.register, [GateStep("CX", second.register)])
        layer.take_up_pair(first, second)
        feedback = layer.feedback(first, second)
        feedback.first_ns = min(first.first_ns, second.first_ns)
        feedback.last_ns = max(first.last_ns, second.last_ns)
        by_gates = layer.devices.of(node).analyser.kind == "gates"
        waited = "" if by_gates else self._let_wait(node, first, second)
        errors = gate_noise.before_bell_measurement(layer, first, second) if by_gates else {}
        present = first.register.present, second.register.present
        states = layer.sabot.bell_measure(
            first.register, second.register, (self._draws(first), self._draws(second))
        )
        place = first.draws_for(f"analyser of {node}")
        random = PhotonRandom(layer.draws, first.name, place, first.register.size)
        halves = self._halves(first, second, present, random)
        drift.twirl_pairs(first, second, states, layer.draws)
        feedback.exact = layer.count_exact((first, second))
        for block in (first, second):
            layer.ownership.remove(block)
        found = self._analyser(node).analyse(states, halves, random)
        told = f"with {second.name.number}/{second.name.half}: {tally(found.outcomes, BELL_STATES)}"
        told += waited + listed(errors)
        each = partial(outcome, found.outcomes, BELL_STATES)
        layer.record(node, "bell-measure", first, detail=told + listed(found.incidents), each=each)
        feedback.clicks = found.clicks
        feedback.coincidences = int(np.count_nonzero(found.outcomes != NO_CLICK))
        feedback.outcomes = found.outcomes.tobytes()
        return feedback

    def _let_wait(self, node: str, first: Block, second: Block) -> str:
        """Let light wait whose way was shorter, in a delay line; return what the event log says.

        Sources emit pulse by pulse together; what a memory lets go comes when it is wanted.
        """
        later_ns = first.way_ns - second.way_ns
        per_km = self._layer.devices.of(node).analyser.delay_line_db_per_km
        if first.retimed or second.retimed or not later_ns or not per_km:
            return ""
        layer, waiting = self._layer, second if later_ns > 0 else first
        length_km = abs(later_ns) * 1e-12 * SPEED_IN_FIBER_M_PER_S
        place = waiting.draws_for(f"delay line of {node}")
        random = PhotonRandom(layer.draws, waiting.name, place, waiting.register.size)
        passes = 10 ** (-per_km * length_km / 10)
        lost = layer.sabot.lose(waiting.register, ~random.happens("pass", passes))
        everything = np.ones(waiting.register.size, dtype=bool)
        further.thin(layer.sabot, waiting, everything, passes, random, "further")
        layer.photons_lost += lost
        which = waiting.name
        return f", {which.number}/{which.half} waited in {length_km:g} km of fibre, lost={lost}"

    def _halves(
        self, first: Block, second: Block, present: tuple[Mask, Mask], random: PhotonRandom
    ) -> tuple[Half, Half]:
        """Return the light that comes to both arms, its further photons measured."""
        more = self._further(first, second, random)
        one, other = (
            Half(there, block.pulses.extras, block.pulses.delays_ps, train(block), told)
            for there, block, told in zip(present, (first, second), more, strict=True)
        )
        return one, other

    def _further(
        self, first: Block, second: Block, random: PhotonRandom
    ) -> tuple[Told | None, Told | None]:
        """Bell-measure further photons; one alone takes either detector of its arm at random."""
        layer = self._layer
        matched = further.bell_measure(layer.sabot, first, second, layer.draws)
        if matched is None:
            return None, None
        first.pulses.exact = second.pulses.exact = False  # photons of pairs interfere
        drift.twirl_further(first, second, matched.pulses, matched.outcomes, layer.draws)
        there = matched.outcomes != NO_CLICK
        pulses, outcomes = matched.pulses[there], matched.outcomes[there]
        told = []
        for arm, bits in enumerate((outcomes >> np.uint8(1), outcomes & np.uint8(1))):
            alone = matched.alone[arm]
            coins = random.coins(f"further photon alone {arm}", alone.size)
            told.append(Told(np.append(pulses, alone), np.append(bits, coins)))
        return told[0], told[1]

    def _analyser(self, node: str) -> Analyser:
        devices = self._layer.devices
        arms = devices.detectors(node, "phase"), devices.detectors(node, "parity")
        return Analyser(devices.of(node), arms)

    def _draws(self, block: Block) -> PhotonDraws:
        purpose = block.draws_for("measure")
        return self._layer.draws.photons(block.name, purpose, block.register.size)


def outcome(found: Bytes, names: tuple[str, ...], position: int) -> str:
    """Return what was found of one photon or pair."""
    outcome = int(found[position])
    return "no click" if outcome == NO_CLICK else names[outcome]


def train(block: Block) -> Train:
    return Train(block.start_ns, block.interval_ns, block.register.size)


def listed(incidents: dict[str, int]) -> str:
    return "".join(f", {name}={count}" for name, count in incidents.items())
