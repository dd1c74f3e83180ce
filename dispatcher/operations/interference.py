"""Bell measurements by a beam splitter: all photons of two pulses meet, however many they are.

Photons that are alone go by either output, each for itself. One in each arm are Bell-measured,
whatever they are entangled with. Several, as of weak laser pulses, interfere all at once: how they
leave follows from their states (dispatcher.devices.overlap), which have to be known for it.
A photon of the second arm that is distinguishable from those of the first, by time, colour or, of
qubits in time bins, polarisation, is alone.

The cardinal states of qubits, of those that are in no joint state with others.

Only a simulation knows; a caller must reveal no more of it than a measurement does.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dispatcher.approximations import CROWD, of_outcomes
from dispatcher.devices.analyser import PHASE, Analyser, Analysis, Half, Mismatch
from dispatcher.devices.overlap import (
    MODES,
    MOST_PHOTONS,
    Overlap,
    detected_in,
    of_bell_states,
    outputs,
    read,
)
from dispatcher.layer import drift
from dispatcher.layer.layer import PhysicalLayer
from dispatcher.layer.ownership import Block
from dispatcher.photon_random import PhotonRandom
from dispatcher.refusal import precondition
from dispatcher.sabot.backend import Backend, Bytes
from dispatcher.sabot.dense import Dense
from dispatcher.sabot.registers import Mask, Pick, Register
from wire.outcomes import NO_CLICK

CLOSE = 1e-9  # of a component of the Bloch vector to 1


def cardinal_states(register: Register) -> Bytes:
    """Return of each qubit 0 |0>, 1 |1>, 2 |+>, 3 |->, 4 |+i>, 5 |-i>; shape (k,).

    NO_CLICK: it is in another state, or shares one with others.
    """
    states = np.full(register.size, NO_CLICK, np.uint8)
    for share in register.shares:
        state = share.component.state
        if state.qubits == 1:
            states[share.positions] = _of_one(state)
    return states


def _of_one(state: Backend) -> Bytes:
    if isinstance(state, Dense):
        return _of_vectors(state.amplitudes)
    x, z, signs = state.generators()
    basis = 1 + int(z[0, 0]) if x[0, 0] else 0  # Z, X, Y
    states: Bytes = signs[0] + np.uint8(2 * basis)
    return states


def _of_vectors(amplitudes: NDArray[np.complex128]) -> Bytes:
    zero, one = amplitudes.T
    both = 2 * zero.conj() * one
    bloch = np.stack([abs(zero) ** 2 - abs(one) ** 2, both.real, both.imag])
    basis = abs(bloch).argmax(axis=0)
    along = np.take_along_axis(bloch, basis[None], axis=0)[0]
    states: Bytes = (2 * basis + (along < 0)).astype(np.uint8)
    states[abs(along) < 1 - CLOSE] = NO_CLICK
    return states


Z = 0
Pulses = NDArray[np.int64]


class Photons(NamedTuple):
    """All photons of an arm that are there, by the pulses that they are of."""

    register: Register
    pulses: Pulses  # ascending


class Left(NamedTuple):
    """Photons that have left a beam splitter: of which pulse, and by which mode."""

    pulses: Pulses
    modes: Bytes


NOTHING = Left(np.zeros(0, np.int64), np.zeros(0, np.uint8))


class Interference:
    """The meeting of the pulses of two blocks, which are used up."""

    def __init__(
        self, layer: PhysicalLayer, blocks: tuple[Block, Block], random: PhotonRandom
    ) -> None:
        self._layer, self._blocks, self._random = layer, blocks, random
        self._incidents: dict[str, int] = {}
        # Pulses of which photons go otherwise than they are taken to.
        self._wrong = np.zeros(blocks[0].register.size, dtype=bool)

    def analyse(
        self, analyser: Analyser, halves: tuple[Half, Half], overlap: Overlap, apart_ps: float
    ) -> Analysis:
        """Return what the detectors tell; photons that come together overlap so well."""
        mismatch = Mismatch(halves, apart_ps)
        left = self._meet(analyser, mismatch, overlap)
        noise, size = _noise(halves, self._random), halves[0].present.size
        detections = [
            arm.detect(
                np.full(size, NO_CLICK, np.uint8),
                None if noise is None else noise[polarisation],
                halves[0].train,
                self._random.at(f"polarisation {polarisation}"),
                detected_in(polarisation, *left),
            )
            for polarisation, arm in enumerate(analyser.arms)
        ]
        outcomes = read((detections[0], detections[1]))
        late = analyser.late(
            outcomes != NO_CLICK, (detections[0], detections[1]), halves, mismatch, self._random
        )
        outcomes[late] = NO_CLICK
        wrong_pulses = of_outcomes(CROWD, self._wrong, outcomes != NO_CLICK)
        self._blocks[0].pulses.approximations |= wrong_pulses
        for detection in detections:
            for name, count in detection.incidents().items():
                self._incidents[name] = self._incidents.get(name, 0) + count
        if late.size:
            self._incidents["late"] = late.size
        # A wrong output makes Psi- of Psi+, and a second one Psi+ again.
        if wrong := analyser.misread(outcomes, self._random, (PHASE, PHASE)):
            self._incidents["misread"] = wrong
        clicks = sum(each.clicks for each in detections)
        return Analysis(outcomes, clicks, self._incidents, tuple(detections))

    def _meet(self, analyser: Analyser, mismatch: Mismatch, overlap: Overlap) -> Left:
        """Let all photons pass the beam splitter."""
        arms = [self._photons(block) for block in self._blocks]
        size = self._blocks[0].register.size
        meets = self._indistinguishable(analyser, mismatch, overlap, arms[1].pulses)
        counts = (
            np.bincount(arms[0].pulses, minlength=size),
            np.bincount(arms[1].pulses[meets], minlength=size),
        )
        few = counts[0] + counts[1] <= MOST_PHOTONS
        both = (counts[0] > 0) & (counts[1] > 0) & few
        pair = (counts[0] == 1) & (counts[1] == 1)
        self._note_crowds((counts[0] > 0) & (counts[1] > 0) & ~few)
        kinds = [np.where(pair, 1, 2) * both] * 2
        kinds_of_arms = [kinds[0][arms[0].pulses], kinds[1][arms[1].pulses] * meets]
        parts = [
            [
                self._taken(arm, kind == number)
                for arm, kind in zip(arms, kinds_of_arms, strict=True)
            ]
            for number in range(3)
        ]
        left = [self._alone(each, f"arm {arm}") for arm, each in enumerate(parts[0])]
        left += [self._paired(*parts[1]), self._crowded(*parts[2])]
        for arm in arms:
            self._release(arm.register)
        for block in self._blocks:
            self._layer.drop(block)
        return Left(*(np.concatenate(each) for each in zip(*left, strict=True)))

    def _photons(self, block: Block) -> Photons:
        drift.twirl(block, self._layer.sabot, self._layer.draws)
        present = np.flatnonzero(block.register.present)
        picks, pulses = [Pick(block.register, present.astype(np.uint32))], present
        if block.extra_pairs is not None:
            there = np.flatnonzero(block.extra_pairs.register.present)
            picks.append(Pick(block.extra_pairs.register, there.astype(np.uint32)))
            pulses = np.concatenate([present, block.extra_pairs.pulses[there]])
        gathered = Photons(self._layer.sabot.gather(picks), pulses)
        order = np.argsort(pulses, kind="stable")
        if (np.diff(order) == 1).all():
            return gathered
        ordered = self._ordered(gathered, order)
        self._release(gathered.register)
        return ordered

    def _release(self, register: Register) -> None:
        draws = self._layer.draws.photons(self._blocks[0].name, "released", register.size)
        self._layer.sabot.drop(register, draws)

    def _ordered(self, photons: Photons, order: NDArray[np.intp]) -> Photons:
        pick = Pick(photons.register, order.astype(np.uint32))
        return Photons(self._layer.sabot.gather([pick]), photons.pulses[order])

    def _taken(self, photons: Photons, chosen: Mask) -> Photons:
        if not chosen.any():
            return Photons(Register(0), photons.pulses[chosen])
        return self._ordered(photons, np.flatnonzero(chosen))

    def _indistinguishable(
        self, analyser: Analyser, mismatch: Mismatch, overlap: Overlap, pulses: Pulses
    ) -> Mask:
        """Draw which photons of the second arm are indistinguishable from those of the first."""
        apart_ps = mismatch.ps[pulses] if mismatch.ps is not None else np.float64(mismatch.all_ps)
        alike = analyser.visibility(apart_ps, overlap.of(pulses))
        if np.all(alike == 1):
            return np.ones(pulses.size, dtype=bool)
        distinguishable = self._random.generator("distinguishable").random(pulses.size) >= alike
        if count := int(np.count_nonzero(distinguishable)):
            self._incidents["distinguishable"] = count
        return ~distinguishable

    def _note_crowds(self, crowded: Mask) -> None:
        if count := int(np.count_nonzero(crowded)):
            self._incidents["crowded"] = count
            self._wrong |= crowded

    def _alone(self, photons: Photons, which: str) -> Left:
        """Let photons go each for itself."""
        if not photons.pulses.size:
            return NOTHING
        polarisations = self._bits(photons.register, f"alone {which}")
        outlets = self._random.coins(f"alone {which}", photons.pulses.size) << np.uint8(1)
        return Left(photons.pulses, outlets | polarisations)

    def _bits(self, register: Register, which: str) -> Bytes:
        block = self._blocks[0]
        draws = self._layer.draws.photons(block.name, block.draws_for(which), register.size)
        return self._layer.sabot.measure(register, np.full(register.size, Z, np.uint8), draws)

    def _paired(self, first: Photons, second: Photons) -> Left:
        if not first.pulses.size:
            return NOTHING
        draws = [
            self._layer.draws.photons(block.name, block.draws_for("paired"), first.pulses.size)
            for block in self._blocks
        ]
        draw = self._layer.sabot.bell_measure
        states = draw(first.register, second.register, (draws[0], draws[1]))
        coins = self._random.generator("pairs").integers(0, 4, states.size, dtype=np.uint8)
        modes = of_bell_states(states, coins)
        return Left(np.repeat(first.pulses, 2), modes.reshape(-1))

    def _crowded(self, first: Photons, second: Photons) -> Left:
        """Let several photons interfere; those of one pulse of both arms at once."""
        if not first.pulses.size:
            return NOTHING
        states = [self._states(arm, f"crowd {which}") for which, arm in enumerate((first, second))]
        pulses = np.unique(first.pulses)
        paths = [
            np.split(parts, np.searchsorted(arm.pulses, pulses)[1:])
            for parts, arm in zip(states, (first, second), strict=True)
        ]
        kinds: dict[tuple[tuple[int, ...], ...], list[int]] = {}
        for place, met in enumerate(zip(*paths, strict=True)):
            key = tuple(tuple(sorted(arm.tolist())) for arm in met)
            kinds.setdefault(key, []).append(place)
        drawn = self._random.generator("crowds").random(pulses.size)
        left = []
        for (one, other), places in kinds.items():
            if len(set(one)) > 1 or len(set(other)) > 1:
                self._wrong[pulses[places]] = True  # noise makes one distinguishable
            photons, chances = outputs(one, other)
            chosen = photons[np.searchsorted(chances.cumsum()[:-1], drawn[places], side="right")]
            modes = np.tile(np.arange(MODES, dtype=np.uint8), len(places))
            counts = chosen.reshape(-1)
            at = np.repeat(pulses[places], MODES)
            left.append(Left(np.repeat(at, counts), np.repeat(modes, counts)))
        return Left(*(np.concatenate(each) for each in zip(*left, strict=True)))

    def _states(self, photons: Photons, which: str) -> Bytes:
        """Return the states of photons, which are used up; what is entangled is measured."""
        register = photons.register
        if not register.shares:
            raise precondition("states are in a Sabot server: start the network without --sabot")
        states = cardinal_states(register)
        bits = self._bits(register, which)
        if (unknown := states == NO_CLICK).any():
            self._wrong[photons.pulses[unknown]] = True
            states = np.where(unknown, bits, states)
        return states


def _noise(halves: tuple[Half, Half], random: PhotonRandom) -> tuple[Bytes, Bytes] | None:
    """Return how many photons that are noise come to the detectors of either polarisation."""
    extras = [half.extras for half in halves if half.extras is not None]
    if not extras:
        return None
    counts = np.minimum(sum(extra.astype(np.int64) for extra in extras), 255)
    first = random.generator("noise").binomial(counts, 0.5)
    return first.astype(np.uint8), (counts - first).astype(np.uint8)
