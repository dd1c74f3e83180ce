"""A host's Bell analyser: from the Bell state of each pair of photons to what detectors tell.

Each photon of a pair is looked at by two detectors: those of one arm tell the pair's phase (Phi+
from Phi-), those of the other its parity (Phi from Psi). A coincidence is a click in either arm at
most a window apart. Photons are distinguishable by how much later one half has come as
a whole, but for what a delay line has taken out, the drift and jitter of each photon, different
rates, different colours (dispatcher.devices.overlap), and of qubits in time bins how fibres have
turned their polarisation (dispatcher.fiber.turn). A lone photon takes either detector of
its arm at random.

Distinguishable photons interfere less (Hong, Ou, Mandel, Phys. Rev. Lett. 59, 2044): with
visibility V = V0 |<1|2>|^2 the phase is wrong with probability (1 - V) / 2.
Linear optics tell Psi+ and Psi- from the rest, and Phi+ from Phi- not (Mattle, Weinfurter, Kwiat,
Zeilinger, Phys. Rev. Lett. 76, 4656): both reach either detector of the phase, alike, and that
outcome is reported as Phi+. A host that measures by gates (dispatcher.operations.imperfections)
lets nothing interfere: neither mismatch nor window matter.
Either arm tells its bit wrongly with the detectors' readout error, whatever has made them click.
See dispatcher.devices.overlap for all photons of two pulses at a beam splitter.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dispatcher.devices.decay import Each
from dispatcher.devices.detector import Slots, Train, among
from dispatcher.devices.detectors import Detection, DetectorPair, ExtraBits, hide
from dispatcher.devices.overlap import Overlap
from dispatcher.photon_random import PhotonRandom
from dispatcher.sabot.registers import Mask
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Device

Bytes = NDArray[np.uint8]
Picoseconds = NDArray[np.float64]

PHI_MINUS = 2
PHASE = np.uint8(2)  # by which Phi+ and Phi- differ, and Psi+ and Psi-
PARITY = np.uint8(1)  # by which Phi+ and Psi+ differ, and Phi- and Psi-
SURE_SIGMAS = 14.0  # no number is drawn so far out: 53 random bits do not reach there


@dataclass(frozen=True)
class Half:
    """The light that comes to one arm."""

    present: Mask
    extras: Bytes | None
    delays_ps: Picoseconds | None
    train: Train
    extra_pairs: ExtraBits | None = None  # in this arm, with the bits that its detectors tell

    @property
    def brings_more(self) -> bool:
        return self.extras is not None or self.extra_pairs is not None


@dataclass(frozen=True)
class Analysis:
    """The analyser's outcomes of k pairs."""

    outcomes: Bytes  # 0 Phi+, 1 Psi+, 2 Phi-, 3 Psi-; NO_CLICK without a coincidence
    clicks: int
    incidents: dict[str, int]  # what was out of the ordinary
    detections: tuple[Detection, ...] = ()  # of both arms; none: detectors were not looked at


class Mismatch:
    """How much later photon k of one half has come than photon k of the other."""

    def __init__(
        self, halves: tuple[Half, Half], apart_ps: float, slots: Slots | None = None
    ) -> None:
        """Compare the halves, or their photons at some slots; the first is so much later.

        `ps` is None if no photon differs from the others: all are `all_ps` apart.
        """
        first, second = halves
        self.ps: Picoseconds | None = None
        self.all_ps = apart_ps
        intervals_ns = first.train.interval_ns, second.train.interval_ns
        if all(intervals_ns) and intervals_ns[0] != intervals_ns[1]:
            slower_ps = (intervals_ns[0] - intervals_ns[1]) * 1e3
            at = np.arange(first.train.count) if slots is None else slots
            self.ps = at.astype(np.float64) * slower_ps
        for delays_ps, sign in ((first.delays_ps, 1), (second.delays_ps, -1)):
            if delays_ps is not None:
                self.ps = sign * delays_ps if self.ps is None else self.ps + sign * delays_ps
        self.most_ps = abs(apart_ps)
        if self.ps is not None:
            self.ps = self.ps + apart_ps if apart_ps else self.ps
            self.most_ps = max(float(self.ps.max(initial=0.0)), -float(self.ps.min(initial=0.0)))


class Analyser:
    def __init__(
        self, device: Device, arms: tuple[DetectorPair, DetectorPair], observed: bool = False
    ) -> None:
        """Look with the detectors of these arms: phase, parity; observed: always with them."""
        self._observed = observed
        self._device, self._detectors, self.arms = device.analyser, device.detectors, arms
        self._interferes = device.analyser.kind != "gates"  # light; qubits are measured apart

    def analyse(
        self,
        states: Bytes,
        halves: tuple[Half, Half],
        random: PhotonRandom,
        overlap: Overlap = Overlap(),  # noqa: B008 - immutable
        apart_ps: float = 0.0,
    ) -> Analysis:
        """Return the outcomes of pairs in these Bell states (NO_CLICK: a photon is missing).

        Photons that come together overlap so well; the first half comes so much later.
        """
        mismatch = Mismatch(halves, apart_ps)
        incidents = {}
        flips = np.zeros(0, dtype=np.intp)
        if self._interferes:
            flips = self._distinguished(mismatch, overlap, random)
        if flips.size:
            flips = flips[states[flips] != NO_CLICK]
            states = states.copy()
            states[flips] ^= PHASE
            incidents["distinguishable"] = flips.size
        ideal = all(arm.ideal for arm in self.arms) and not self._observed
        if ideal and not any(half.brings_more for half in halves):
            outcomes, coincident = states.copy(), states != NO_CLICK
            clicks = sum(int(np.count_nonzero(half.present)) for half in halves)
            detections = None
        else:
            detections = self._look(self.at_detectors(states, random), halves, random)
            outcomes, coincident, clicks, more = _combine(detections, states)
            incidents |= more
        late = np.zeros(0, dtype=np.intp)
        if self._interferes:
            late = self.late(coincident, detections, halves, mismatch, random)
        self._spoil(outcomes, late, incidents, random)
        return Analysis(self.named(outcomes), clicks, incidents, detections or ())

    @property
    def best(self) -> tuple[float, float]:
        """How likely either arm sees a photon at its better detector."""
        phase, parity = (float(arm.efficiencies.max()) for arm in self.arms)
        return phase, parity

    def analyse_few(
        self,
        slots: Slots,
        detections: tuple[Detection, Detection],
        halves: tuple[Half, Half],
        random: PhotonRandom,
        together: Slots,
        apart_ps: float,
    ) -> tuple[Slots, Analysis]:
        """Return the outcomes of slots at which both arms click, and the slots that are left.

        In some pulses a pair has made both click; delays of halves are those of the slots.
        """
        states = np.where(among(slots, together), np.uint8(0), np.uint8(NO_CLICK))
        outcomes, coincident, clicks, incidents = _combine(detections, states)
        mismatch, random = Mismatch(halves, apart_ps, slots), random.beside(slots.size)
        late = self.late(coincident, detections, halves, mismatch, random)
        self._spoil(outcomes, late, incidents, random)
        left = outcomes != NO_CLICK
        return slots[left], Analysis(self.named(outcomes[left]), clicks, incidents)

    def _spoil(
        self,
        outcomes: Bytes,
        late: NDArray[np.intp],
        incidents: dict[str, int],
        random: PhotonRandom,
    ) -> None:
        """Drop outcomes of light that came too late, and misread others; count both."""
        if late.size:
            outcomes[late] = NO_CLICK
            incidents["late"] = late.size
        if wrong := self.misread(outcomes, random):
            incidents["misread"] = wrong

    def named(self, outcomes: Bytes) -> Bytes:
        if self._device.kind != "linear":
            return outcomes
        named: Bytes = outcomes ^ ((outcomes == PHI_MINUS) * PHASE)
        return named

    def at_detectors(self, states: Bytes, random: PhotonRandom) -> Bytes:
        """Return the states as whose detectors pairs click: of linear optics either Phi for Phi."""
        if self._device.kind != "linear":
            return states
        coins = random.coins("phase of Phi", states.size)
        clicking: Bytes = states ^ ((states & PARITY == 0) * coins * PHASE)
        return clicking

    def _distinguished(
        self, mismatch: Mismatch, overlap: Overlap, random: PhotonRandom
    ) -> NDArray[np.intp]:
        """Draw which pairs show no interference, so that their phase is wrong."""
        worst = (1 - self._device.visibility * overlap.least(mismatch.most_ps)) / 2
        if worst == 0:
            return np.zeros(0, dtype=np.intp)
        # Draw as if all were as far apart as the worst; keep of those what their own mismatch says.
        some = random.events("interference", worst)
        if not isinstance(overlap.most, np.ndarray) and (
            mismatch.ps is None or not overlap.rad_per_s
        ):
            return some
        apart_ps = mismatch.all_ps if mismatch.ps is None else mismatch.ps[some]
        wrong = self.wrong(apart_ps, overlap.of(some))
        return some[random.generator("visibility").random(some.size) * worst < wrong]

    def wrong(self, mismatch_ps: Each, overlap: Overlap) -> Each:
        """Return how likely a phase is wrong after a mismatch."""
        return (1 - self.visibility(mismatch_ps, overlap)) / 2

    def visibility(self, mismatch_ps: Each, overlap: Overlap) -> Each:
        """Return how well photons interfere after a mismatch."""
        return self._device.visibility * overlap.apart(mismatch_ps)

    def _look(
        self, states: Bytes, halves: tuple[Half, Half], random: PhotonRandom
    ) -> tuple[Detection, Detection]:
        both = states != NO_CLICK
        detections = []
        for arm, half in enumerate(halves):
            inside = random.at(f"arm {arm}")
            bits = hide(states & np.uint8(1) if arm else states >> np.uint8(1), ~both)
            lone = np.flatnonzero(half.present & ~both)
            if lone.size:
                bits[lone] = inside.coins("lone photon", lone.size)
            detections.append(
                self.arms[arm].detect(bits, half.extras, half.train, inside, half.extra_pairs)
            )
        return detections[0], detections[1]

    def misread(
        self, outcomes: Bytes, random: PhotonRandom, bits: tuple[np.uint8, ...] = (PHASE, PARITY)
    ) -> int:
        """Let detectors tell their arm's bit wrongly now and then; return how many outcomes err."""
        error = self._detectors.readout_error
        if not error or not self._interferes:
            return 0
        flips = np.zeros(outcomes.size, np.uint8)
        for arm, bit in enumerate(bits):
            flips[random.events(f"readout of arm {arm}", error)] ^= bit
        flips[outcomes == NO_CLICK] = 0
        outcomes ^= flips
        return int(np.count_nonzero(flips))

    def late(
        self,
        coincident: Mask,
        detections: tuple[Detection, Detection] | None,
        halves: tuple[Half, Half],
        mismatch: Mismatch,
        random: PhotonRandom,
    ) -> NDArray[np.intp]:
        """Return the pairs whose clicks are too far apart."""
        window_ps = self._device.coincidence_window_s * 1e12
        jitter_ps = self._detectors.jitter_ps * np.sqrt(2)  # of the difference of two clicks
        gate_ps = self._detectors.gate_s * 1e12
        lightless = [None, None] if detections is None else [arm.lightless for arm in detections]
        dark = any(mask is not None for mask in lightless)
        most_ps = mismatch.most_ps + SURE_SIGMAS * jitter_ps + gate_ps * dark
        if most_ps <= window_ps:
            return np.zeros(0, dtype=np.intp)
        pairs = np.flatnonzero(coincident)
        if mismatch.ps is None:
            apart_ps: Picoseconds = np.full(pairs.size, mismatch.all_ps)
        else:
            apart_ps = mismatch.ps[pairs]
        if jitter_ps:
            apart_ps += random.generator("jitter").standard_normal(pairs.size) * jitter_ps
        for half, mask, sign in zip(halves, lightless, (1, -1), strict=True):
            if mask is None:
                continue
            # A click without light comes at any time while the detector looks.
            without = np.flatnonzero(mask[pairs])
            if half.delays_ps is not None:
                apart_ps[without] -= sign * half.delays_ps[pairs[without]]
            moments = random.generator(f"moment in the gate {sign}").random(without.size) - 0.5
            apart_ps[without] += sign * moments * gate_ps
        late: NDArray[np.intp] = pairs[np.abs(apart_ps) > window_ps]
        return late


def _combine(
    detections: tuple[Detection, Detection], states: Bytes
) -> tuple[Bytes, Mask, int, dict[str, int]]:
    phase, parity = detections
    coincident = (phase.bits != NO_CLICK) & (parity.bits != NO_CLICK)
    outcomes = hide(parity.bits | (phase.bits << np.uint8(1)), ~coincident)
    genuine = phase.own & parity.own & (states != NO_CLICK)
    incidents = {**phase.incidents()}
    for name, count in parity.incidents().items():
        incidents[name] = incidents.get(name, 0) + count
    if accidental := int(np.count_nonzero(coincident & ~genuine)):
        incidents["accidental"] = accidental
    return outcomes, coincident, phase.clicks + parity.clicks, incidents
