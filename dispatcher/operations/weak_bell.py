"""Bell measurements of weak pairs, of whose photons those alone are drawn that may click.

A pair that comes whole is in the Bell state of all Paulis that its halves have met: its outcome
needs no qubits. A photon alone takes either detector of its arm. Pairs of one pulse do so each for
itself, as where all photons are drawn (dispatcher/layer/extra_pairs.py).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dispatcher.approximations import SEVERAL_PAIRS, approximation
from dispatcher.devices.analyser import PARITY, PHASE, Analyser, Analysis, Half, Mismatch
from dispatcher.devices.detector import Slots, among
from dispatcher.devices.detectors import Detection, ExtraBits
from dispatcher.devices.overlap import Overlap
from dispatcher.layer.layer import PhysicalLayer
from dispatcher.layer.ownership import Block
from dispatcher.layer.weak_pairs import WeakHalf, seen_together
from dispatcher.layer.weak_pulses import Photons, WeakPulses
from dispatcher.operations import limits, weak_light
from dispatcher.operations.weak_light import train
from dispatcher.photon_random import PhotonRandom, PhotonsByKey
from dispatcher.sabot.backend import Bytes
from dispatcher.sabot.registers import Mask

THINNED = "complete", "linear"  # analysers at which photons of one pair alone meet

Both = tuple[Photons, Photons]


class ArmClicks(NamedTuple):
    """The clicks of an arm of an analyser, by slots, and how late light of these is."""

    slots: Slots
    delays_ps: NDArray[np.float64] | None
    detection: Detection


class Seen(NamedTuple):
    """The slots that have an outcome, and what either arm has seen at slots of its own."""

    slots: Slots
    analysis: Analysis
    arms: list[ArmClicks]


def obstacle(layer: PhysicalLayer, node: str, first: Block, second: Block) -> str | None:
    """Return what weak pulses have to be drawn for before a Bell measurement; None: nothing."""
    if first.weak is None and second.weak is None:
        return None
    kind = layer.devices.of(node).analyser.kind
    if not _are_halves(first.weak, second.weak):
        return "a Bell measurement of photons of unlike pairs"
    if kind not in THINNED:
        return f"a Bell measurement by {kind}"
    if layer.devices.noise(node, "detectors") is not None:
        return "noise of detectors"
    return layer.waits(first) or layer.waits(second)


def _are_halves(one: WeakPulses | None, other: WeakPulses | None) -> bool:
    if not (isinstance(one, WeakHalf) and isinstance(other, WeakHalf)):
        return False
    return one is not other and one.pairs is other.pairs


def require_capacity_for(layer: PhysicalLayer, node: str, first: Block, second: Block) -> None:
    """Refuse if too many photons of weak pairs may be seen, or have outcomes."""
    photons = 0.0
    for block, arm in ((first, "phase"), (second, "parity")):
        limits.require_outcomes(layer, block)
        assert block.weak is not None
        best = float(layer.devices.detectors(node, arm).efficiencies.max())
        photons += block.weak.most_photons(best)
    weak_light.require_capacity_for(layer, first, photons)


def measured(_layer: PhysicalLayer, lights: tuple[WeakHalf, WeakHalf], whole: Both) -> Bytes:
    """Return the Bell states of pairs whose photons are both there; shape (m,)."""
    mine, theirs = (light.paulis(each) for light, each in zip(lights, whole, strict=True))
    return mine ^ theirs


class WeakPairsMeeting:
    """The halves of weak pairs at an analyser, the first of them so much later."""

    def __init__(
        self,
        layer: PhysicalLayer,
        blocks: tuple[Block, Block],
        analyser: Analyser,
        random: PhotonRandom,
        apart_ps: float,
    ) -> None:
        first, second = (block.weak for block in blocks)
        assert isinstance(first, WeakHalf)
        assert isinstance(second, WeakHalf)
        self._layer, self._blocks, self._lights = layer, blocks, (first, second)
        self._analyser, self._random, self._apart_ps = analyser, random, apart_ps
        self._trains = train(blocks[0]), train(blocks[1])

    def analyse(self, overlap: Overlap) -> Seen:
        """Look at the photons that may click; those that come together overlap so well."""
        lights, best = self._lights, self._analyser.best
        came = seen_together(*lights, best)
        there = [each.fates < light.transmission for each, light in zip(came, lights, strict=True)]
        together = there[0] & there[1]
        pairs = np.flatnonzero(together)
        whole = came[0].chosen(together), came[1].chosen(together)
        states = measured(self._layer, lights, whole)
        flips = self._distinguishable(whole[0], overlap)
        states = self._analyser.at_detectors(
            states ^ flips * PHASE, PhotonsByKey.of(self._random, whole[0].keys)
        )
        arms, both = [], np.ones(pairs.size, bool)
        for arm, bits in enumerate((states >> np.uint8(1), states & PARITY)):
            seen, every = self._seen(arm, came[arm], there[arm], pairs, bits)
            light = ExtraBits(came[arm].pulses[seen], every[seen])
            arms.append(self._detect(arm, light))
            both &= seen[pairs]
        slots, analysis = self._coincidences(arms, whole[0].pulses[both])
        if count := int(np.count_nonzero(flips & both)):
            analysis.incidents["distinguishable"] = count
        self._note_several(came[0].pulses, slots)
        return Seen(slots, analysis, arms)

    def _distinguishable(self, photons: Photons, overlap: Overlap) -> Mask:
        """Draw which pairs show no interference; both halves have left their source together."""
        mismatch = Mismatch(self._halves(None), self._apart_ps, photons.pulses)
        apart_ps = mismatch.all_ps if mismatch.ps is None else mismatch.ps
        wrong = self._analyser.wrong(apart_ps, overlap)
        return PhotonsByKey.of(self._random, photons.keys).happens("interference", wrong)

    def _seen(
        self, arm: int, photons: Photons, there: Mask, pairs: NDArray[np.intp], bits: Bytes
    ) -> tuple[Mask, Bytes]:
        """Return which photons of an arm meet a detector that works, and the bits of all.

        Those of pairs have these bits, and others one at random.
        """
        light, detectors = self._lights[arm], self._analyser.arms[arm]
        seen = there & (photons.fates < self._analyser.best[arm] * light.transmission)
        alone = seen.copy()
        alone[pairs] = False
        every, at = np.zeros(there.size, np.uint8), np.flatnonzero(alone)
        every[pairs] = bits
        by_key = PhotonsByKey.of(self._random, photons.keys[at])
        every[at] = by_key.coins(f"lone photon {arm}", at.size)
        return seen & (photons.fates < detectors.efficiencies[every] * light.transmission), every

    def _detect(self, arm: int, light: ExtraBits) -> ArmClicks:
        random, weak = self._random.at(f"arm {arm}"), self._lights[arm]
        slots, detection = self._analyser.arms[arm].detect_few(light, self._trains[arm], random)
        late_ps = None if self._layer.observer is None else weak.delays_ps(slots)
        return ArmClicks(slots, late_ps, detection)

    def _coincidences(self, arms: list[ArmClicks], together: Slots) -> tuple[Slots, Analysis]:
        """Return outcomes where both arms click; pairs of some pulses have done it together."""
        fewer, others = sorted((arm.slots for arm in arms), key=len)
        slots = fewer[among(fewer, others)]
        phase, parity = (arm.detection.at(arm.slots.searchsorted(slots)) for arm in arms)
        detections = phase, parity
        return self._analyser.analyse_few(
            slots, detections, self._halves(slots), self._random, together, self._apart_ps
        )

    def _halves(self, slots: Slots | None) -> tuple[Half, Half]:
        one, other = (
            Half(
                np.zeros(0, bool),
                None,
                None if slots is None else light.delays_ps(slots),
                when,
            )
            for light, when in zip(self._lights, self._trains, strict=True)
        )
        return one, other

    def _note_several(self, pulses: Slots, slots: Slots) -> None:
        """Note by how much pairs of one pulse, which would interfere, change a share of outcomes.

        As `approximations.of_outcomes`: w pulses have photons of several pairs left, and c others
        tell an outcome. Pairs of which no photon may click are not drawn: both are of Poisson's.
        """
        pairs, (best, other) = self._lights[0].pairs, self._analyser.best
        shares = [light.transmission for light in self._lights]
        left = pairs.mean * _either(*shares)
        drawn = pairs.mean * _either(best * shares[0], other * shares[1])
        likely = max(-math.expm1(-left) - left * math.exp(-left), 0.0)
        several = int(self._random.generator("several").binomial(pairs.count, likely))
        if several:
            here = pulses.searchsorted(slots, "right") - pulses.searchsorted(slots)
            alone = int(np.count_nonzero(here <= 1)) * math.exp(drawn - left)
            size = several / (several + alone)
            self._blocks[0].pulses.approximations |= approximation(SEVERAL_PAIRS, size)


def _either(one: float, other: float) -> float:
    return one + other - one * other
