"""Measurements of blocks by the node that holds them: first states, then detectors."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dispatcher.approximations import SEVERAL_PAIRS, of_outcomes
from dispatcher.devices import hardware
from dispatcher.devices.analyser import Analyser, Analysis, Half
from dispatcher.devices.detector import Slots, Train
from dispatcher.devices.detectors import ClickReport, Detection, ExtraBits
from dispatcher.devices.overlap import Overlap, overlap
from dispatcher.fiber.turn import alignment
from dispatcher.layer import device_noise, drift, extra_pairs, pulses
from dispatcher.layer.layer import PhysicalLayer, block_name, tally
from dispatcher.layer.ownership import Block, Pulses
from dispatcher.layer.weak_pairs import WeakHalf
from dispatcher.layer.weak_pulses import BasesAt, WeakPulses
from dispatcher.operations import imperfections, limits, weak_bell, weak_light
from dispatcher.operations.blocks import require_pairs
from dispatcher.operations.interference import Interference
from dispatcher.operations.outcomes import (
    Outcomes,
    basis_and_outcome,
    outcome,
    tell_bell_states,
    tell_bits,
    tell_gaps,
)
from dispatcher.operations.paths import nanoseconds
from dispatcher.operations.weak_bell import ArmClicks
from dispatcher.operations.weak_light import train
from dispatcher.photon_random import PhotonRandom, PhotonsByKey
from dispatcher.sabot.backend import Bytes
from dispatcher.sabot.capacity import DIAGONAL, GateStep
from dispatcher.sabot.draws import PhotonDraws
from dispatcher.sabot.registers import Mask
from wire.dispatcher_pb2 import BellMeasureRequest, Feedback, MeasureRequest
from wire.features import MEASURE
from wire.outcomes import BASES, BELL_STATES, NO_CLICK, PAULI_BASES
from wire.parameters.fiber import SPEED_IN_FIBER_M_PER_S
from wire.parameters.physics import BEAM_SPLITTER, BellAnalyser

ARM = 2  # detectors, one for each outcome
DIGITS_PS = 3  # to which ways are compared: sums of delays in another order differ by less


class Places(NamedTuple):
    """The slots of a detection, how late light comes there, and the channels of outcome 0."""

    slots: Slots
    late_ps: NDArray[np.float64] | None
    first_channels: Bytes
    arm: str = ""  # of a Bell analyser


class Measurements:
    def __init__(self, layer: PhysicalLayer) -> None:
        self._layer = layer

    def measure(self, node: str, request: MeasureRequest) -> Feedback:
        layer = self._layer
        block = layer.ownership.require(block_name(request.block), node)
        hardware.require(layer.devices, node, MEASURE)
        hardware.require_encoding(layer.devices, node, block.pulses.encoding)
        if not request.key:
            limits.require_outcomes(layer, block)
        bases = limits.bases(request, block.size)
        if block.weak is not None:
            if (obstacle := self._obstacle(block, request, bases)) is None:
                return self._measure_weak(block, block.weak, request, bases)
            weak_light.draw(layer, obstacle, block)
        values = bases(np.arange(block.size))
        self._require_capacity(block, values)
        done_ns = layer.clock.now_ns()  # however long it takes to simulate
        layer.take_up(block)
        drift.twirl_turn(block, layer.sabot, layer.draws)
        if values.any():  # a measurement of Z does not see the angles
            drift.twirl(block, layer.sabot, layer.draws)
        feedback = layer.feedback(block)
        feedback.time_ns = done_ns
        effect = imperfections.noise_of_detectors(layer, block, "measure")
        device_noise.in_front(layer.sabot, layer.draws, block, effect, "measure", values)
        bits = layer.sabot.measure(block.register, values, self._draws(block))
        more = extra_pairs.measure(layer.sabot, block, values, layer.draws, "measure")
        layer.ownership.remove(block)
        place = block.draws_for(f"detectors of {node}")
        detection = clicks(layer, block, train(block), place, bits, more)
        outcomes, wrong = imperfections.misread(layer, block, detection.bits, "measure")
        outcomes = device_noise.reported(outcomes, effect)
        incidents = detection.incidents() | ({"misread": wrong} if wrong else {})
        if self._is_observed(block):
            random = PhotonRandom(layer.draws, block.name, place, block.size)
            self._observe(block, detection, outcomes, _places(block, random, values))
        self._report(block, feedback, values, outcomes, incidents)
        feedback.clicks = detection.clicks
        tell_bits(feedback, outcomes, request)
        seconds = layer.devices.of(node).gates.readout_s if block.kept else 0.0
        return imperfections.lasts(feedback, seconds)

    def _measure_weak(
        self,
        block: Block,
        light: WeakPulses,
        request: MeasureRequest,
        bases: BasesAt,
    ) -> Feedback:
        """Measure and use up weak pulses, of which only those are simulated that may click."""
        layer = self._layer
        feedback = layer.feedback(block)
        place = block.draws_for(f"detectors of {block.node}")
        slots, detection = weak_light.detect(layer, block, light, place, bases)
        layer.ownership.remove(block)
        bits, wrong = imperfections.misread(layer, block, detection.bits, "measure")
        incidents = detection.incidents() | ({"misread": wrong} if wrong else {})
        outcomes = Outcomes(slots, bits)
        if layer.observer is not None:
            random = PhotonRandom(layer.draws, block.name, place, block.size)
            block.pulses.delays_ps = light.delays_ps(slots)
            late_ps = pulses.late_ps(block.pulses, PhotonsByKey.of(random, slots))
            self._observe(
                block, detection, bits, Places(slots, late_ps, bases(slots) * np.uint8(ARM))
            )
        self._report(block, feedback, bases(slots), bits, incidents, outcomes.each(bases))
        feedback.clicks = detection.clicks
        if request.key:
            tell_gaps(feedback, slots, bits)
        else:
            tell_bits(feedback, outcomes.of_all(light.count), request)
        return feedback

    def _obstacle(self, block: Block, request: MeasureRequest, bases: BasesAt) -> str | None:
        """Return what weak pulses have to be drawn for before a measurement; None: nothing."""
        by_array = isinstance(block.weak, WeakHalf) and not request.key
        if by_array and (bases(np.arange(block.size)) >= PAULI_BASES).any():
            return "pairs measured between Z and X"
        if self._layer.devices.noise(block.node, "detectors") is not None:
            return "noise of detectors"
        return self._layer.waits(block)

    def _report(
        self,
        block: Block,
        feedback: Feedback,
        values: Bytes,
        outcomes: Bytes,
        incidents: dict[str, int],
        each: Callable[[int], str] | None = None,
    ) -> None:
        """Report bases and outcomes: of all photons, or of those with clicks."""
        layer = self._layer
        feedback.exact = layer.count_exact((block,))
        detail = f"{tally(values, BASES)}: {tally(outcomes, ('0', '1'))}" + listed(incidents)
        each = each or partial(basis_and_outcome, values, outcomes)
        layer.record(block.node, "measure", block, detail=detail, each=each)

    def _observe(
        self, block: Block, detection: Detection, reported: Bytes, places: "Places"
    ) -> None:
        layer, at = self._layer, np.flatnonzero(detection.bits != NO_CLICK)
        assert layer.observer is not None
        nowhere = np.zeros(reported.size, bool)
        purpose = block.draws_for(f"times {places.arm} at {block.node}")
        both, lightless = (
            (nowhere if mask is None else mask)[at]
            for mask in (detection.twice, detection.lightless)
        )
        report = ClickReport(
            block.node,
            block.name,
            train(block),
            block.path_ps - 1e3 * nanoseconds(block.path_ps),
            places.slots[at],
            detection.bits[at],
            reported[at],
            both,
            lightless,
            None if places.late_ps is None else places.late_ps[at],
            not places.arm,
            places.first_channels[at],
            layer.draws.generator(block.name, purpose),
        )
        layer.observer.observe(report)

    def _is_observed(self, block: Block) -> bool:
        """Return whether there is an observer, and clicks are of light that comes in pulses."""
        return self._layer.observer is not None and not block.kept and bool(block.interval_ns)

    def _observe_arms(self, block: Block, arms: Sequence["ArmClicks"], apart_ps: float) -> None:
        """Report the clicks of both arms of an analyser, the first so much later."""
        for arm, (slots, delays_ps, detection) in enumerate(arms):
            late_ps = np.zeros(slots.size) if delays_ps is None else delays_ps
            channels = np.full(slots.size, (len(BASES) + arm) * ARM, np.uint8)
            places = Places(slots, late_ps - apart_ps * arm, channels, f"arm {arm}")
            self._observe(block, detection, detection.bits, places)

    def _require_capacity(self, block: Block, values: Bytes) -> None:
        """Refuse bases between those of Pauli operators that the backend cannot hold."""
        if (values >= PAULI_BASES).any():
            registers = [
                block.register,
                *([block.extra_pairs.register] if block.extra_pairs else []),
            ]
            for register in registers:
                self._layer.sabot.require_capacity(register, [DIAGONAL])

    def bell_measure(self, node: str, request: BellMeasureRequest) -> Feedback:
        names = block_name(request.first), block_name(request.second)
        first, second = (self._layer.ownership.require(name, node) for name in names)
        return self.bell_measure_blocks(node, first, second, request.packed)

    def bell_measure_blocks(
        self, node: str, first: Block, second: Block, packed: bool = False
    ) -> Feedback:
        layer = self._layer
        obstacle = weak_bell.obstacle(layer, node, first, second)
        if obstacle is not None:
            weak_light.draw(layer, obstacle, first, second)
        self._take_up(node, first, second)
        if first.weak is not None:
            weak_bell.require_capacity_for(layer, node, first, second)
        feedback = layer.feedback(first, second)
        feedback.first_ns = min(first.first_ns, second.first_ns)
        feedback.last_ns = max(first.last_ns, second.last_ns)
        device = layer.devices.of(node).analyser
        matched = _matched(device, first.pulses, second.pulses, first.size)
        apart = "", 0.0
        if device.kind != "gates":
            apart = self._let_wait(device, matched, (first, second))
        measure = self._bell_measure_weak if first.weak is not None else self._bell_measure_pairs
        return measure(feedback, (first, second), matched, apart, packed)

    def _bell_measure_pairs(
        self,
        feedback: Feedback,
        blocks: tuple[Block, Block],
        matched: Overlap,
        apart: tuple[str, float],
        packed: bool,
    ) -> Feedback:
        layer, (first, second), (waited, apart_ps) = self._layer, blocks, apart
        node = first.node
        device = layer.devices.of(node).analyser
        by_gates = device.kind == "gates"
        errors = imperfections.before_bell_measurement(layer, first, second) if by_gates else {}
        effect = imperfections.noise_of_detectors(layer, first, "Bell")
        as_it_is = np.zeros(first.register.size, np.uint8)
        device_noise.in_front(layer.sabot, layer.draws, first, effect, "Bell", as_it_is)
        look = self._interfere if device.kind == BEAM_SPLITTER else self._analyse
        analysis = look(node, blocks, matched, apart_ps)
        if self._is_observed(first):
            arms = zip(blocks, analysis.detections, strict=False)
            looks = [
                ArmClicks(np.arange(seen.bits.size), half.pulses.delays_ps, seen)
                for half, seen in arms
            ]
            self._observe_arms(first, looks, apart_ps)
        feedback.exact = layer.count_exact(blocks)
        outcomes = device_noise.reported(analysis.outcomes, effect, device_noise.BELL_STATE)
        outcomes = self._analyser(node).named(outcomes)
        if by_gates:
            outcomes, wrong = imperfections.misread(layer, first, outcomes, "Bell", bits=2)
            errors |= {"misread": wrong} if wrong else {}
        detail = f"with {second.name.number}/{second.name.half}: {tally(outcomes, BELL_STATES)}"
        detail += waited + listed(errors) + listed(analysis.incidents)
        each = partial(outcome, outcomes, BELL_STATES)
        layer.record(node, "bell-measure", first, detail=detail, each=each)
        feedback.clicks = analysis.clicks
        tell_bell_states(feedback, outcomes, packed)
        gates = layer.devices.of(node).gates
        return imperfections.lasts(feedback, imperfections.of_bell_measurement(gates) * by_gates)

    def _bell_measure_weak(
        self,
        feedback: Feedback,
        blocks: tuple[Block, Block],
        matched: Overlap,
        apart: tuple[str, float],
        packed: bool,
    ) -> Feedback:
        """Bell-measure and use up weak pairs, of which those are simulated that may click."""
        layer, (first, second), (waited, apart_ps) = self._layer, blocks, apart
        node, count = first.node, first.size
        analyser, random = self._analyser(node), self._random(node, first)
        meeting = weak_bell.WeakPairsMeeting(layer, blocks, analyser, random, apart_ps)
        seen = meeting.analyse(matched)
        if self._is_observed(first):
            self._observe_arms(first, seen.arms, apart_ps)
        for block in blocks:
            layer.ownership.remove(block)
        feedback.exact = layer.count_exact(blocks)
        outcomes = Outcomes(seen.slots, seen.analysis.outcomes)
        detail = f"with {second.name.number}/{second.name.half}: "
        detail += tally(outcomes.bits, BELL_STATES) + waited + listed(seen.analysis.incidents)
        layer.record(node, "bell-measure", first, detail=detail, each=outcomes.bell_state)
        feedback.clicks = seen.analysis.clicks
        outcomes.tell_bell_states(feedback, count, packed)
        return feedback

    def _take_up(self, node: str, first: Block, second: Block) -> None:
        layer = self._layer
        require_pairs(first, second)
        hardware.require(layer.devices, node, MEASURE)
        for block in (first, second):
            hardware.require_encoding(layer.devices, node, block.pulses.encoding)
        layer.sabot.require_capacity(first.register, [GateStep("CX", second.register)])
        layer.take_up_pair(first, second)

    def _analyse(
        self, node: str, blocks: tuple[Block, Block], matched: Overlap, apart_ps: float
    ) -> Analysis:
        layer, (first, second) = self._layer, blocks
        present = first.register.present, second.register.present
        states = layer.sabot.bell_measure(
            first.register, second.register, (self._draws(first), self._draws(second))
        )
        random, several = self._random(node, first), extra_pairs.several(first, second)
        analyser = self._analyser(node)
        halves = self._halves(analyser, first, second, present, random)
        drift.twirl_pairs(first, second, states, layer.draws)
        for block in blocks:
            layer.ownership.remove(block)
        analysis = analyser.analyse(states, halves, random, matched, apart_ps)
        if several is not None:  # they would interfere
            coincident = analysis.outcomes != NO_CLICK
            first.pulses.approximations |= of_outcomes(SEVERAL_PAIRS, several, coincident)
        return analysis

    def _interfere(
        self, node: str, blocks: tuple[Block, Block], matched: Overlap, apart_ps: float
    ) -> Analysis:
        """Let all photons of two blocks meet at a beam splitter; the blocks are used up."""
        one, other = (
            Half(block.register.present, block.pulses.extras, block.pulses.delays_ps, train(block))
            for block in blocks
        )
        meeting = Interference(self._layer, blocks, self._random(node, blocks[0]))
        return meeting.analyse(self._analyser(node), (one, other), matched, apart_ps)

    def _random(self, node: str, block: Block) -> PhotonRandom:
        place = block.draws_for(f"analyser of {node}")
        return PhotonRandom(self._layer.draws, block.name, place, block.size)

    def _let_wait(
        self, device: BellAnalyser, matched: Overlap, halves: tuple[Block, Block]
    ) -> tuple[str, float]:
        """Let light whose way was shorter wait in a delay line, if it comes too early otherwise.

        Return what the event log says, and how much later the first half comes all the same.
        Sources emit pulse by pulse together; what a memory gives out, or was in no fibre, comes
        when it is wanted.
        """
        first, second = halves
        later_ps = round(first.path_ps - second.path_ps, DIGITS_PS)
        if not later_ps or any(half.retimed or not half.fibers_passed for half in halves):
            return "", 0.0
        too_early = abs(later_ps) > device.coincidence_window_s * 1e12 or matched.rad_per_s > 0
        most_ps = device.delay_line_km * 1e15 / SPEED_IN_FIBER_M_PER_S
        waits_ps = min(abs(later_ps), most_ps) if too_early else 0.0
        left_ps = later_ps - float(np.sign(later_ps)) * waits_ps
        detail = f", {abs(left_ps) / 1e3:g} ns apart" if left_ps else ""
        if not waits_ps:
            return detail, left_ps
        waiting = second if later_ps > 0 else first
        length_km = waits_ps * 1e-15 * SPEED_IN_FIBER_M_PER_S
        return self._delay(
            waiting, length_km, device.delay_line_db_per_km * length_km
        ) + detail, left_ps

    def _delay(self, block: Block, length_km: float, loss_db: float) -> str:
        """Let a block pass a delay line of this loss; return what the event log says."""
        layer, lost = self._layer, 0
        if loss_db:
            place = block.draws_for("delay line")
            random = PhotonRandom(layer.draws, block.name, place, block.size)
            passes = 10 ** (-loss_db / 10)
            if block.weak is not None:
                lost = block.weak.pass_on(passes, random, "pass")
            else:
                lost = layer.sabot.lose(block.register, ~random.happens("pass", passes))
                everything = np.ones(block.size, dtype=bool)
                extra_pairs.thin(layer.sabot, block, everything, passes, random, "further")
            layer.photons_lost += lost
            layer.photons_lost_waiting += lost
        which = f"{block.name.number}/{block.name.half}"
        return f", {which} waited in {length_km:g} km of fibre, lost={lost}"

    def _halves(
        self,
        analyser: Analyser,
        first: Block,
        second: Block,
        present: tuple[Mask, Mask],
        random: PhotonRandom,
    ) -> tuple[Half, Half]:
        """Return the light that comes to both arms, its further photons measured."""
        more = self._extra_pairs(analyser, first, second, random)
        one, other = (
            Half(there, block.pulses.extras, block.pulses.delays_ps, train(block), bits)
            for there, block, bits in zip(present, (first, second), more, strict=True)
        )
        return one, other

    def _extra_pairs(
        self, analyser: Analyser, first: Block, second: Block, random: PhotonRandom
    ) -> tuple[ExtraBits | None, ExtraBits | None]:
        """Bell-measure further photons; one alone takes either detector of its arm at random."""
        layer = self._layer
        matched = extra_pairs.bell_measure(layer.sabot, first, second, layer.draws)
        if matched is None:
            return None, None
        drift.twirl_extra_pairs(first, second, matched.pulses, matched.outcomes, layer.draws)
        there = matched.outcomes != NO_CLICK
        pulses = matched.pulses[there]
        outcomes = analyser.at_detectors(matched.outcomes[there], random.at("further pairs"))
        arms = []
        for arm, bits in enumerate((outcomes >> np.uint8(1), outcomes & np.uint8(1))):
            alone = matched.alone[arm]
            coins = random.coins(f"further photon alone {arm}", alone.size)
            arms.append(ExtraBits(np.append(pulses, alone), np.append(bits, coins)))
        return arms[0], arms[1]

    def _analyser(self, node: str) -> Analyser:
        devices = self._layer.devices
        arms = devices.detectors(node, "phase"), devices.detectors(node, "parity")
        return Analyser(devices.of(node), arms, self._layer.observer is not None)

    def _draws(self, block: Block) -> PhotonDraws:
        purpose = block.draws_for("measure")
        return self._layer.draws.photons(block.name, purpose, block.register.size)


def _places(block: Block, random: PhotonRandom, bases: Bytes) -> Places:
    late_ps = pulses.late_ps(block.pulses, random)
    return Places(np.arange(block.size), late_ps, bases * np.uint8(ARM))


def _matched(device: BellAnalyser, one: Pulses, other: Pulses, photons: int) -> Overlap:
    spectra = overlap(one.spectrum, other.spectrum, device.bandwidth_rad_per_s)
    aligned = alignment(one.polarization, other.polarization, photons)
    return spectra._replace(most=spectra.most * aligned)


def clicks(
    layer: PhysicalLayer, light: Block, when: Train, place: str, bits: Bytes, more: ExtraBits | None
) -> Detection:
    """Return what the detectors of a block's node see of its light, in the state of these bits."""
    random = PhotonRandom(layer.draws, light.name, place, bits.size)
    return layer.devices.detectors(light.node, "measure").detect(
        bits,
        light.pulses.extras,
        when,
        random,
        more,
        late_ps=pulses.late_ps(light.pulses, random),
        timed=True,
    )


def listed(incidents: dict[str, int]) -> str:
    return "".join(f", {name}={count}" for name, count in incidents.items())
