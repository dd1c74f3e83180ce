"""Draws which attempts of a link are heralded, and what errors their pairs have.

Between two heralds there is a geometrically distributed number of attempts: those that fail cost
nothing here.
"""

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dispatcher.approximations import (
    EXACT,
    Approximations,
    twirled_phase,
    twirled_turn,
)
from dispatcher.devices.decay import Each
from dispatcher.devices.heralding import KINDS, phase_wrong
from dispatcher.fiber.noise import Effect
from dispatcher.fiber.turn import STILL, TRANSPOSED, alignment, product
from dispatcher.layer.layer import PhysicalLayer
from dispatcher.layer.ownership import BlockName
from dispatcher.operations.heralded_link import Link
from dispatcher.operations.station_path import PHASE, Follower, Met
from dispatcher.photon_random import PhotonRandom
from wire.config import BadConfig

BOTH_BRIGHT = KINDS.index("11")
PSI_PLUS, PSI_MINUS = np.uint8(1), np.uint8(3)
TURNED = np.array([1, 3, 2, 0], np.uint8)  # X, XZ, Z by their chances, or I
Bytes = NDArray[np.uint8]
MAX_BATCHES = 5_000  # in which pairs are drawn; many of them are dropped for their age then
# Attempts in a row of which no light came in its gate, until the station reports: in a few
# seconds of this computer. A small batch takes as long as one of SMALL.
MAX_EMPTY, SMALL = 1_000_000, 2000


@dataclass
class Heralded:
    """Pairs of n attempts that were heralded; arrays have shape (n,)."""

    rounds: NDArray[np.int64]  # which round each was in, ascending
    kind: Bytes  # what the qubits are in: dispatcher.devices.heralding.KINDS
    bell_states: Bytes  # the Bell state that the clicks tell
    paulis: tuple[Bytes, Bytes]  # errors of either qubit
    approximations: Approximations = EXACT

    @property
    def count(self) -> int:
        return self.rounds.size

    def only(self, chosen: NDArray[np.bool_]) -> "Heralded":
        first, second = (pauli[chosen] for pauli in self.paulis)
        return Heralded(
            self.rounds[chosen],
            self.kind[chosen],
            self.bell_states[chosen],
            (first, second),
            self.approximations,
        )

    @classmethod
    def none(cls) -> "Heralded":
        nothing = np.zeros(0, np.uint8)
        return cls(np.zeros(0, np.int64), nothing, nothing, (nothing, nothing))

    def joined(self, more: "Heralded") -> "Heralded":
        first, second = (
            np.concatenate(both) for both in zip(self.paulis, more.paulis, strict=True)
        )
        return Heralded(
            np.concatenate((self.rounds, more.rounds)),
            np.concatenate((self.kind, more.kind)),
            np.concatenate((self.bell_states, more.bell_states)),
            (first, second),
            self.approximations | more.approximations,
        )


class Drawing:
    def __init__(
        self, layer: PhysicalLayer, node: str, link: Link, names: Sequence[BlockName]
    ) -> None:
        self._layer, self._node, self._link, self._names = layer, node, link, names
        self._batches = self._empty = 0
        self.dropped = 0  # pairs, by the cut-off of a memory
        self._followers = [
            Follower(layer, path, device.source, link.scheme == "single-click")
            for path, device in zip(link.paths, link.devices, strict=True)
        ]

    async def draw(self, count: int, rounds: int, first: int) -> tuple[Heralded, int]:
        """Return at most `count` heralds of at most `rounds` rounds, and the rounds that were used.

        If these bring none, one of at most `first` rounds.
        Pairs that get too old before there are as many are dropped, and made again. Fewer rounds
        are made where light hardly ever comes in its gate.
        Returns when the clicks of the last round are. Light that proves not to have come through
        is drawn again, from the attempt behind it.
        """
        link, chance = self._link, self._link.heralds.probability
        heralded, begin = Heralded.none(), 0
        soon = rounds * link.modes
        most = end = max(rounds, first) * link.modes
        while chance and heralded.count < count and begin < end and not self._gives_up:
            missing, self._batches = count - heralded.count, self._batches + 1
            place = f"heralds {self._batches}"
            await asyncio.sleep(0)  # others are served meanwhile
            random = PhotonRandom(self._layer.draws, self._names[0], place, missing)
            places = begin - 1 + _until(random.generator("gaps").geometric(chance, missing), most)
            places = places[places < most]
            late = not heralded.count and places.size and places[0] >= soon
            places = places[:1] if late else places[places < soon]
            if places.size:
                in_rounds = places // link.modes
                await self._layer.clock.wait_until(link.clicks_ns(int(in_rounds[-1]) + 1))
                batch = self._meet(in_rounds, place)
                self._empty = 0 if batch.count else self._empty + max(places.size, SMALL)
                heralded = self._kept(heralded.joined(batch))
            if late or places.size == missing:
                begin = int(places[-1]) + 1
            else:
                begin = soon if places.size or heralded.count else most
            end = soon if heralded.count else most
        used = -(-begin // link.modes) if chance else rounds
        await self._layer.clock.wait_until(link.clicks_ns(used))
        self._count(used * link.modes)
        return heralded, used

    @property
    def _gives_up(self) -> bool:
        return self._batches >= MAX_BATCHES or self._empty >= MAX_EMPTY

    def _kept(self, heralded: Heralded) -> Heralded:
        if self._link.cutoff_ns == np.inf or not heralded.count:
            return heralded
        young = self._link.young(heralded.rounds)
        self.dropped += int(np.count_nonzero(~young))
        return heralded.only(young)

    def _count(self, attempts: int) -> None:
        for name, follower, emitter in zip(
            self._names, self._followers, self._link.emitters, strict=True
        ):
            bright = emitter.bright_state if self._link.scheme == "single-click" else 1.0
            follower.count(attempts, emitter.efficiency * bright, name)

    def _meet(self, rounds: NDArray[np.int64], place: str) -> Heralded:
        """Return those of heralded attempts whose light has really come, with their errors."""
        link, count = self._link, rounds.size
        random = PhotonRandom(self._layer.draws, self._names[0], place, count)
        kind = random.which("kind", count, link.heralds.chances)
        met = [
            follower.follow(name, place, link.emitted_ns(half, rounds))
            for half, (follower, name) in enumerate(zip(self._followers, self._names, strict=True))
        ]
        rotated, twirled = _rotated(met, random)
        light = met[0].paulis ^ met[1].paulis ^ rotated
        visibility = _visibility(link, met)
        light ^= _distinguished(link, visibility, random)
        light[random.events("readout", link.told_wrongly)] ^= PHASE
        first = light * (kind == 0)  # the others are entangled with no light
        second = np.zeros(count, np.uint8)
        emitters = zip((first, second), link.emitters, strict=True)
        for half, (errors, emitter) in enumerate(emitters):
            at_emitter = random.at(f"emitter {half}")
            at = at_emitter.events("error", 1 - emitter.fidelity)
            errors[at] ^= 1 + at_emitter.which("which", at.size, np.ones(3))
        outcomes = np.where(_minus(link, random), PSI_MINUS, PSI_PLUS).astype(np.uint8)
        successful = _clicked(link, met, kind, random) & _bunched(link, kind, visibility, random)
        every = twirled | met[0].approximations | met[1].approximations | link.approximations
        effect = self._custom_noise(place, count)
        if effect is not None:
            every |= effect.approximations
            first ^= np.uint8(0) if effect.paulis is None else effect.paulis
            successful &= True if effect.lost is None else ~effect.lost
        errors = first[successful], second[successful]
        return Heralded(rounds[successful], kind[successful], outcomes[successful], errors, every)

    def _custom_noise(self, place: str, count: int) -> Effect | None:
        model = self._layer.devices.noise(self._node, "detectors")
        if model is None:
            return None
        when, waited = self._layer.clock.now_ns(), np.zeros(count)
        draws = self._layer.draws
        effect = model.effect(draws, self._names[0], "detectors", place, when, waited)
        if effect.kraus is not None:
            raise BadConfig(
                f"Kraus operators of the noise of {self._node}'s detectors: heralds cannot meet "
                "any; let the model return Paulis"
            )
        return effect


def _minus(link: Link, random: PhotonRandom) -> NDArray[np.bool_]:
    if link.psi_minus == 1 / 2:
        return random.coins("detector", random.photons).astype(bool)
    return random.happens("detector", link.psi_minus)


def _clicked(
    link: Link, met: Sequence[Met], kind: Bytes, random: PhotonRandom
) -> NDArray[np.bool_]:
    """Draw which heralds there are, of those that there would be if all light came in its gate.

    Entangled ones of two clicks need the light of both hosts, others of one; of single clicks
    those need none that the dark makes of at most one emission.
    """
    detectors, single = link.station.detectors, link.scheme == "single-click"
    late = [
        _late_ps(detectors.jitter_ps, link.spread_ps(half), each, random.at(f"clicks {half}"))
        for half, each in enumerate(met)
    ]
    gate_ps = detectors.gate_s * 1e12
    there = [
        each.arrived if ps is None else each.arrived & (np.abs(ps) <= gate_ps / 2)
        for each, ps in zip(met, late, strict=True)
    ]
    both = there[0] & there[1]
    if not both.all():
        one = np.where(random.uniform("arm") < link.heralds.first, there[0], there[1])
        needs_both = np.zeros(kind.size, bool) if single else kind == 0
        needs_none = single & (kind > 0) & (kind != BOTH_BRIGHT)
        both = np.where(needs_both, both, one | needs_none)
    if not single and any(ps is not None for ps in late):
        first, second = (0.0 if ps is None else ps for ps in late)
        both = both & (np.abs(first - second) <= link.station.analyser.coincidence_window_s * 1e12)
    opened: NDArray[np.bool_] = both & met[0].open & met[1].open
    return opened


def _late_ps(
    jitter_ps: float, spread_ps: float, met: Met, random: PhotonRandom
) -> NDArray[np.float64] | None:
    late_ps = met.delays_ps
    for what, rms_ps in (("jitter", jitter_ps), ("wavelength", spread_ps)):
        if rms_ps:
            more_ps = random.normal(what) * rms_ps
            late_ps = more_ps if late_ps is None else late_ps + more_ps
    return late_ps


def _until(gaps: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    """Return the sums of gaps up to the first that is above `most`; all of them may be huge."""
    above = int(np.searchsorted(gaps.cumsum(dtype=np.float64), most, side="right"))
    return np.minimum(gaps[: above + 1], most + 1).cumsum()


def _rotated(met: Sequence[Met], random: PhotonRandom) -> tuple[Bytes, Approximations]:
    """Return the errors that coherent rotations of both photons amount to, twirled."""
    paulis, twirled = np.zeros(random.photons, np.uint8), EXACT
    if any(each.angles_rad is not None for each in met):
        # In Psi the angles of both qubits count against each other.
        first, second = (0.0 if each.angles_rad is None else each.angles_rad for each in met)
        paulis ^= (random.uniform("angle") < np.sin((first - second) / 2) ** 2) * PHASE
        twirled |= twirled_phase(float(np.abs(first - second).max(initial=0.0)))
    if any(each.turn is not None for each in met):
        every = np.arange(random.photons)
        left, right = (
            turn.quaternions[turn.stretch(every)] for turn in (each.turn or STILL for each in met)
        )
        whole = product(left, right * TRANSPOSED)
        chances, twirled = whole[:, 1:] ** 2, twirled | twirled_turn(whole)
        drawn = random.uniform("turn")
        paulis ^= TURNED[(drawn[:, None] >= chances.cumsum(axis=1)).sum(axis=1)]
    return paulis, twirled


def _visibility(link: Link, met: Sequence[Met]) -> Each:
    first, second = (0.0 if each.delays_ps is None else each.delays_ps for each in met)
    overlap = link.overlap.apart(first - second) if link.overlap.rad_per_s else link.overlap.most
    aligned = alignment(met[0].polarization, met[1].polarization, met[0].arrived.size)
    return link.station.analyser.visibility * overlap * aligned


def _distinguished(link: Link, visibility: Each, random: PhotonRandom) -> Bytes:
    """Return which phases are wrong because light of both hosts was distinguishable."""
    chances = phase_wrong(link.scheme, link.heralds, visibility)
    wrong = np.zeros(random.photons, np.uint8)
    if isinstance(chances, np.ndarray):
        wrong[random.uniform("interference") < chances] = PHASE
    else:
        wrong[random.events("interference", chances)] = PHASE
    return wrong


def _bunched(link: Link, kind: Bytes, visibility: Each, random: PhotonRandom) -> NDArray[np.bool_]:
    """Draw which heralds there are, of those that there would be of light that is most alike.

    Two photons that are less alike leave together less often, by which a chance falls linearly.
    """
    if np.all(visibility == link.visibility):
        return np.ones(kind.size, bool)
    most, least = (np.array(link.heralds_of(v).chances)[kind] for v in (link.visibility, 0.0))
    falls = (most - least) * (1 - visibility / link.visibility)
    together: NDArray[np.bool_] = random.uniform("bunching") * most >= falls
    return together
