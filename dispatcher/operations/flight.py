"""The way of a block's light through fibres and switches, photon by photon.

A beam is the light that has taken one way so far: a part of the block, which comes apart where a
switch sends photons different ways, those of one pulse, too. Each beam is resolved when the clock
has passed its last photon, so what the switches did meanwhile is known. Its Paulis are collected
and applied when it arrives.
"""

import heapq
import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count

import numpy as np
from numpy.typing import NDArray

from dispatcher.clock import Clock
from dispatcher.devices.overlap import angular_width
from dispatcher.fiber.custom_noise import OwnNoise, of_all
from dispatcher.fiber.fiber_noise import meets, obstacle
from dispatcher.fiber.noise import MEMORYLESS, Effect, NoiseModel, Passage, Pattern, Schedule
from dispatcher.fiber.polarization_modes import PolarizationDependentLoss, effect_on
from dispatcher.fiber.turn import STILL, Turn, unseen
from dispatcher.layer import drift, extra_pairs, pulses
from dispatcher.layer.compensation import every_look
from dispatcher.layer.device_noise import Channels
from dispatcher.layer.layer import PhysicalLayer
from dispatcher.layer.network import Line
from dispatcher.layer.ownership import Block, ExtraPairs
from dispatcher.operations import weak_light
from dispatcher.operations.paths import MAX_FIBERS, nanoseconds, path_of
from dispatcher.photon_random import PhotonRandom
from dispatcher.refusal import Refusal
from dispatcher.sabot.kraus import Operators
from dispatcher.sabot.registers import Mask, everything
from dispatcher.switch.optical_switch import Light, OpticalSwitch, Passed, Through
from wire.config import FiberEnd

Noise = NDArray[np.uint8] | None  # photons that are noise in each pulse, shape (k,)


@dataclass(frozen=True)
class Departure:
    """When photons leave, and their colour."""

    start_ns: int
    pattern: Pattern
    frequency_mhz: int

    @property
    def last_ns(self) -> int:
        return self.start_ns + int((self.pattern.photons - 1) * self.pattern.interval_ns)

    def after(self, delay_ps: float) -> Schedule:
        """Return when the photons are where they come to after a delay."""
        whole_ns = nanoseconds(delay_ps)
        return Schedule(self.start_ns + whole_ns, self.pattern, delay_ps - whole_ns * 1e3)


@dataclass
class Beam:
    block: Block  # the part of it that is on this way
    members: Mask  # pulses of it, whether or not any photon is still there
    fibers_passed: int
    delay_ps: float = 0.0  # from its departure to the far end of the fibre that it is in
    noise: NDArray[np.uint8] | None = None  # Paulis that fibres have added up to, shape (k,)
    applied: NDArray[np.uint8] | None = None  # what of that is in the state already
    rotation: int = 0  # Pauli that switches have added up to, and that is not in it
    turn: Turn | None = None  # rotations of polarisation by fibres, behind that Pauli
    polarization: Turn | None = None  # the same of light whose qubits are not in it
    dispersion_ps_per_nm: float = 0.0


@dataclass(frozen=True)
class Arrival:
    """The part of a block that has come to one port."""

    end: FiberEnd
    beam: Beam
    schedule: Schedule
    errors: list[int]  # to how many photons X, Z and XZ happened on the way


class Flight:
    """Takes one block from a port to all the ports where its light comes out."""

    def __init__(self, block: Block, departure: Departure, layer: PhysicalLayer) -> None:
        self._block, self._departure, self._layer = block, departure, layer
        self._queue: list[tuple[int, int, Line, Beam]] = []
        self._number = count()
        self.ended = list[Block]()  # parts of the block that came out nowhere
        self.lost = 0
        self.known_ns = departure.last_ns  # when news is back from where light has ended
        self._start = FiberEnd("", "")
        layer.compensation.light_begins(departure.start_ns)

    @property
    def start_ns(self) -> int:
        return self._departure.start_ns

    @property
    def due_ns(self) -> float:
        return self._queue[0][0] if self._queue else math.inf

    @cached_property
    def _looks(self) -> dict[str, NDArray[np.int64]]:
        """Return the looks of compensators that this light can tell; asked for when it has left."""
        return self._layer.compensation.looks(self.start_ns, self._departure.last_ns)

    def launch(self, end: FiberEnd) -> None:
        self._start = end
        members = everything(self._block.register.size)
        self._enter(end, Beam(self._block, members, self._block.fibers_passed))

    @property
    def has_light(self) -> bool:
        return any(_is_lit(beam) for _time_ns, _number, _line, beam in self._queue)

    def give_up(self) -> list[Block]:
        """Return the parts of the block that come out nowhere, with those still under way."""
        self.ended += [beam.block for _time_ns, _number, _line, beam in self._queue]
        self._queue.clear()
        return self.ended

    def announce(self, end: FiberEnd) -> None:
        """Let other channels know of light that leaves a port, on the way that it has just now."""
        if not self._layer.network.has_crosstalk:
            return
        frequency_mhz, photons = self._departure.frequency_mhz, self._block.remaining
        share = photons / self._departure.pattern.photons
        for step in path_of(self._layer, end, frequency_mhz):
            if step.line.traffic is not None:
                schedule = self._departure.after(step.delay_ps)
                step.line.traffic.add(schedule, share * step.transmission)

    async def next_arrival(self, clock: Clock) -> Arrival | None:
        """Wait for the next beam to come out at a node, None if no light is left."""
        while self._queue:
            await clock.wait_until(self._queue[0][0])
            time_ns, _number, line, beam = heapq.heappop(self._queue)
            if beam.members.size < beam.block.register.size:  # its photons were drawn meanwhile
                beam.members = everything(beam.block.register.size)
            self._pass(beam, line)
            if self._layer.compensation.at(line.far) is not None and beam.block.weak is None:
                self._compensate(beam, line.far)
            switch = self._layer.network.switches.get(line.far.node)
            if _is_lit(beam):
                if switch is None:
                    return self._arrive(beam, line.far)
                in_flight = len(self._queue)
                self._cross(beam, switch, int(line.far.port))
                if len(self._queue) > in_flight:
                    continue
            else:
                self.ended.append(beam.block)
            # A host expects light at its time; from a switch news has to come back.
            back_ns = nanoseconds(beam.delay_ps) if switch is not None else 0
            self.known_ns = max(self.known_ns, time_ns + back_ns)
        return None

    def _arrive(self, beam: Beam, end: FiberEnd) -> Arrival:
        photons = beam.block.register.present
        errors = [0, 0, 0]
        if beam.noise is not None:
            noise = beam.noise * photons
            errors = [int(np.count_nonzero(noise == pauli)) for pauli in (1, 2, 3)]
        self._apply(beam, photons)
        beam.turn, beam.polarization = unseen(beam.turn), unseen(beam.polarization)
        return Arrival(end, beam, self._departure.after(beam.delay_ps), errors)

    def _apply(self, beam: Beam, photons: Mask) -> None:
        """Let the Paulis that a beam has met so far be in the state of these photons."""
        block, rotation = beam.block, np.uint8(beam.rotation)
        if beam.noise is not None:
            noise = beam.noise if beam.applied is None else beam.noise ^ beam.applied
            self._layer.sabot.pauli(block.register, (noise ^ rotation) * photons)
        elif beam.rotation:
            self._layer.sabot.pauli(block.register, photons * rotation)
        if block.extra_pairs is not None:
            turn = Effect(paulis=np.full(block.extra_pairs.pulses.size, rotation))
            extra_pairs.meet(self._layer.sabot, block, beam.members, turn)

    def _meet_channel(self, beam: Beam, operators: Operators, place: str, cause: str) -> None:
        """Let Kraus operators act on a beam, behind what it has met before."""
        block = beam.block
        channels = Channels(self._layer.sabot, self._layer.draws, block, place, cause)
        channels.settle_turn()
        self._apply(beam, block.register.present)
        beam.applied, beam.rotation = beam.noise, 0
        if beam.turn is not None:
            channels.turn(beam.turn, beam.members)
            looked, beam.turn = beam.turn.looked, None
            if looked is not None:
                beam.turn = replace(STILL, looked=looked)
        channels.settle_angles(beam.members)
        channels.act(operators, beam.members)

    def _cross(self, beam: Beam, switch: OpticalSwitch, in_port: int) -> None:
        block = beam.block
        if beam.fibers_passed >= MAX_FIBERS:
            switch.lose(in_port, block.remaining)
            self._absorb(beam)
            return
        schedule = self._departure.after(beam.delay_ps)
        if block.weak is not None:
            through = switch.through(in_port, schedule, self._departure.frequency_mhz)
            if through is not None:
                self._go_through(beam, switch, in_port, through)
                return
            if not self._draw_for(beam, f"paths in {switch.name}"):
                return
        photons = block.register.present
        others = _others(block)
        light = Light(beam.members, photons, schedule, self._departure.frequency_mhz, others)
        random = self._chance(f"switch {beam.fibers_passed}")
        paths = list(switch.cross(in_port, light, random).items())
        went = sum((passed.photons for _port, passed in paths), np.zeros_like(photons))
        self._lose(block, photons & ~went, f"in {switch.name}")
        if not paths:
            self._absorb(beam)
        noises = [_noise_of(block, others, passed.others) for _port, passed in paths]
        for place, ((out_port, passed), noise) in enumerate(zip(paths, noises, strict=True)):
            separate = self._stay if place + 1 == len(paths) else self._part
            leaving = separate(block, passed, noise)
            extra_pairs.thin(
                self._layer.sabot,
                leaving,
                everything(photons.size),
                passed.transmission,
                random,
                f"extras {out_port}",
            )
            self._leave(replace(beam, block=leaving), passed, switch, (in_port, out_port))

    def _leave(
        self, beam: Beam, passed: Passed, switch: OpticalSwitch, ports: tuple[int, int]
    ) -> None:
        """Let a beam out of a switch, turned as the switch turns light between these ports."""
        block = beam.block
        if rotation := switch.rotation(*ports):
            paulis = passed.pulses * np.uint8(rotation)
            cause = f"rotation of {switch.name}, {ports[0]} -> {ports[1]}"
            self._layer.sabot.explain(block.register, cause, paulis)
            drift.reflect(block.pulses, paulis)
        beam.members = passed.pulses | extra_pairs.lit(block)
        beam.turn = beam.turn.behind(rotation) if beam.turn else None
        beam.rotation ^= rotation
        self._enter(FiberEnd(switch.name, str(ports[1])), beam)

    def _go_through(
        self, beam: Beam, switch: OpticalSwitch, in_port: int, through: Through
    ) -> None:
        """Let weak pulses take the one path of a switch."""
        light, out_port = beam.block.weak, through.interval.out_port
        assert light is not None
        came, place = light.expected, f"switch {beam.fibers_passed}"
        rotation = switch.rotation(in_port, out_port)
        self.lost += weak_light.cross(light, through, self._chance(place), rotation)
        switch.count_passed(in_port, through, came, light.expected)
        self._enter(FiberEnd(switch.name, str(out_port)), beam)

    def _draw_for(self, beam: Beam, obstacle: str) -> bool:
        """Draw the photons of weak pulses if something on their way needs it.

        Return whether there was room; if not the light ends here, and the event log says so.
        """
        block = beam.block
        if obstacle and block.weak is not None:
            light = block.weak
            try:
                weak_light.draw(self._layer, obstacle, block)
            except Refusal as refusal:
                self.lost += light.expected
                light.transmission, light.expected = 0.0, 0
                self._layer.record("", "dark", block, detail=f"{obstacle}: {refusal}")
                self._layer.drawn_for[f"{obstacle} (without room: this light was lost)"] = None
                return False
            beam.members = everything(block.register.size)
        return True

    def _part(self, block: Block, passed: Passed, noise: Noise) -> Block:
        layer, size = self._layer, _size_of_extra_pairs(block)
        part = replace(
            block,
            register=layer.sabot.part(block.register, passed.photons),
            pulses=pulses.split_noise(block.pulses, noise),
            extra_pairs=extra_pairs.part_of(layer.sabot, block, passed.others[:size]),
        )
        layer.ownership.add(part)
        return part

    def _stay(self, block: Block, passed: Passed, noise: Noise) -> Block:
        """Let a block have no light but what leaves by a port, its own photons apart."""
        block.pulses.extras = noise
        if block.extra_pairs is not None:
            size = _size_of_extra_pairs(block)
            self._layer.sabot.lose(block.extra_pairs.register, ~passed.others[:size])
        return block

    def _enter(self, end: FiberEnd, beam: Beam) -> None:
        """Let a beam into the fibre that begins at a port, if there is one."""
        line = self._layer.network.line(end)
        if line is None or not line.passes(self._departure.frequency_mhz):
            self._absorb(beam)
            return
        beam.delay_ps += line.delay_ps
        beam.fibers_passed += 1
        time_ns = self._departure.last_ns + nanoseconds(beam.delay_ps)
        heapq.heappush(self._queue, (time_ns, next(self._number), line, beam))

    def _pass(self, beam: Beam, line: Line) -> None:
        block = beam.block
        schedule = self._departure.after(beam.delay_ps)
        width_rad_per_s = angular_width(block.pulses.bandwidth_nm)
        beam.dispersion_ps_per_nm += line.fiber.dispersion_ps_per_nm
        encoding = block.pulses.encoding
        models = {name: each for name, each in line.noise.items() if meets(encoding, each)}
        if block.weak is not None:
            models = {name: weak_light.steady(each, schedule) for name, each in models.items()}
        disturbed = self._layer.compensation.disturbs(line.far)
        cause = obstacle(encoding, models.values()) or "a compensator" * disturbed
        if not self._draw_for(beam, cause):
            return
        looks_ns = every_look(self._looks)
        for name, model in models.items():
            history = self._layer.history.of_model(line.near.node, line.near.port, name)
            place = block.draws_for(f"fiber {beam.fibers_passed} {name}")
            draws = self._layer.draws
            if block.weak is not None:
                random = PhotonRandom(draws, block.name, place, block.size)
                self.lost += weak_light.meet(block.weak, model, random)
                continue
            passage = Passage(
                draws, block.name, place, schedule, history, width_rad_per_s, looks_ns
            )
            effect, of_extra_pairs = _effects(encoding, model, passage, block.extra_pairs)
            if effect.transmission < 1:
                # Noise of other pulses may be in another fibre now, in the same places.
                purpose = "extras" if block is self._block else f"extras to {line.far.node}"
                pulses.thin(block.pulses, beam.members, effect.transmission, passage, purpose)
            where = f"in the fibre to {line.far.port} of {line.far.node}"
            self._meet(beam, effect, f"{type(model).__name__} {where}")
            if of_extra_pairs is not None:
                extra_pairs.meet(self._layer.sabot, block, beam.members, of_extra_pairs)
            if effect.kraus is not None:
                self._meet_channel(beam, effect.kraus, place, f"noise {where}")

    def _meet(self, beam: Beam, effect: Effect, cause: str) -> None:
        """Let a beam's own photons meet what a fibre does, but for Kraus operators."""
        block = beam.block
        if effect.lost is not None:
            self._lose(block, effect.lost & beam.members, cause)
        if effect.paulis is not None:
            paulis = effect.paulis * beam.members
            self._layer.sabot.explain(block.register, cause, paulis)
            drift.reflect(block.pulses, paulis)
            beam.noise = paulis if beam.noise is None else beam.noise ^ paulis
        pulses.pass_on(block.pulses, beam.members, effect)
        if effect.turn is not None:
            beam.turn = effect.turn.after(beam.turn)
        if effect.polarization is not None:
            beam.polarization = effect.polarization.after(beam.polarization)

    def _compensate(self, beam: Beam, end: FiberEnd) -> None:
        """Let light meet the compensator of a port."""
        layer, block = self._layer, beam.block
        in_bins = block.pulses.encoding != "polarization"
        turn, leaves = beam.polarization if in_bins else beam.turn, self._departure.after(0.0)
        path = self._start, end
        corrects, dark, detail = layer.compensation.correct(path, self._looks, turn, leaves)
        if corrects is not None and in_bins:
            beam.polarization = unseen(corrects.after(turn))
        elif corrects is not None:
            beam.turn = unseen(corrects.after(turn))
        if dark is not None:
            self._lose(block, dark & beam.members, f"interrupted by the compensator of {end.node}")
            extra_pairs.darken(layer.sabot, block, dark & beam.members)
        if detail:
            layer.record(end.node, "compensate", block, end.port, detail)

    def _chance(self, place: str) -> PhotonRandom:
        block, photons = self._block, self._departure.pattern.photons
        return PhotonRandom(self._layer.draws, block.name, block.draws_for(place), photons)

    def _absorb(self, beam: Beam) -> None:
        if beam.block.weak is not None:
            self.lost += beam.block.weak.expected
        self._lose(beam.block, beam.members, "nowhere to go")
        extra_pairs.darken(self._layer.sabot, beam.block, beam.members)
        self.ended.append(beam.block)

    def _lose(self, block: Block, photons: Mask, cause: str) -> None:
        if np.count_nonzero(photons):
            self._layer.sabot.explain(block.register, cause, photons)
            self.lost += self._layer.sabot.lose(block.register, photons)


def _is_lit(beam: Beam) -> bool:
    light = beam.block.weak
    return (
        light.transmission > 0
        if light is not None
        else bool(np.count_nonzero(extra_pairs.lit(beam.block)))
    )


def _size_of_extra_pairs(block: Block) -> int:
    return 0 if block.extra_pairs is None else block.extra_pairs.pulses.size


def _others(block: Block) -> NDArray[np.int64]:
    """Return the pulses of all light of a block beside own photons: further ones, then noise."""
    places = np.zeros(0, np.int64) if block.extra_pairs is None else block.extra_pairs.pulses
    if block.pulses.extras is None:
        return places
    noisy = np.flatnonzero(block.pulses.extras > 0)
    return np.concatenate([places, np.repeat(noisy, block.pulses.extras[noisy])])


def _noise_of(block: Block, others: NDArray[np.int64], chosen: Mask) -> Noise:
    """Return how many photons that are noise each pulse has, of those chosen of _others."""
    if block.pulses.extras is None:
        return None
    size = _size_of_extra_pairs(block)
    counts = np.bincount(others[size:][chosen[size:]], minlength=block.register.size)
    return counts.astype(np.uint8)


def _effects(
    encoding: str, model: NoiseModel, passage: Passage, light: ExtraPairs | None
) -> tuple[Effect, Effect | None]:
    """Return what a fibre does to pulses and their own photons, and to further ones, if any.

    Each further photon is lost and errs by itself.
    """
    if light is None or not light.pulses.size:
        return effect_on(encoding, model, passage), None
    if isinstance(model, OwnNoise):
        return of_all(model, passage, light.pulses)
    effect, beside = effect_on(encoding, model, passage), passage.beside(light.pulses.size)
    if isinstance(model, (*MEMORYLESS, PolarizationDependentLoss)):
        return effect, effect_on(encoding, model, beside)
    paulis = None if effect.of_extra_pairs is None else effect.of_extra_pairs(beside, light.pulses)
    lost = None
    if effect.transmission < 1:
        lost = beside.happens("lost", 1 - effect.transmission)
    return effect, Effect(lost=lost, paulis=paulis)
