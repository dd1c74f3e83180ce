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
    UNEQUAL_ARMS,
    Approximations,
    approximation,
    twirled_phase,
    twirled_turn,
)
from dispatcher.devices.heralding import phase_wrong
from dispatcher.fiber.turn import TRANSPOSED, Turn, product
from dispatcher.layer.layer import PhysicalLayer
from dispatcher.layer.ownership import BlockName
from dispatcher.operations.heralded_link import Link
from dispatcher.operations.station_way import PHASE, Follower, Met
from dispatcher.photon_random import PhotonRandom

PSI_PLUS, PSI_MINUS = np.uint8(1), np.uint8(3)
TURNED = np.array([1, 3, 2, 0], np.uint8)  # X, XZ, Z by their chances, or I
STILL = Turn(np.zeros(1, np.int64), np.array([[1.0, 0.0, 0.0, 0.0]]))
Bytes = NDArray[np.uint8]
MAX_BATCHES = 5_000  # in which pairs are drawn; many of them are dropped for their age then


@dataclass
class Heralded:
    """Pairs of n attempts that were heralded; arrays have shape (n,)."""

    rounds: NDArray[np.int64]  # which round each was in, ascending
    kind: Bytes  # what the qubits are in: dispatcher.devices.heralding.KINDS
    told: Bytes  # the Bell state that the clicks tell
    paulis: tuple[Bytes, Bytes]  # errors of either qubit
    approximations: Approximations = EXACT

    @property
    def count(self) -> int:
        """Return how many there are."""
        return self.rounds.size

    def only(self, chosen: NDArray[np.bool_]) -> "Heralded":
        """Return some of them."""
        first, second = (each[chosen] for each in self.paulis)
        return Heralded(
            self.rounds[chosen],
            self.kind[chosen],
            self.told[chosen],
            (first, second),
            self.approximations,
        )

    @classmethod
    def none(cls) -> "Heralded":
        """Return no pairs."""
        nothing = np.zeros(0, np.uint8)
        return cls(np.zeros(0, np.int64), nothing, nothing, (nothing, nothing))

    def joined(self, more: "Heralded") -> "Heralded":
        """Return these and later ones."""
        first, second = (
            np.concatenate(both) for both in zip(self.paulis, more.paulis, strict=True)
        )
        return Heralded(
            np.concatenate((self.rounds, more.rounds)),
            np.concatenate((self.kind, more.kind)),
            np.concatenate((self.told, more.told)),
            (first, second),
            self.approximations | more.approximations,
        )


class Drawing:
    """Draws the heralds of one block."""

    def __init__(self, layer: PhysicalLayer, link: Link, names: Sequence[BlockName]) -> None:
        """Draw for the two halves of a block of pairs that a link makes."""
        self._layer, self._link, self._names = layer, link, names
        self._batches = 0
        self.dropped = 0  # pairs, by the cut-off of a memory
        self._followers = [
            Follower(layer, way, device.source, link.scheme == "single-click")
            for way, device in zip(link.ways, link.devices, strict=True)
        ]

    async def draw(self, count: int, rounds: int) -> tuple[Heralded, int]:
        """Return heralds, at most so many of so many rounds, and how many rounds that took.

        Pairs that get too old before there are as many are dropped, and made again.
        Returns when the clicks of the last round are. Light that proves not to have come through
        is drawn anew, from the attempt behind it.
        """
        link, chance = self._link, self._link.heralds.probability
        found, begin, most = Heralded.none(), 0, rounds * link.modes
        while chance and found.count < count and begin < most and self._batches < MAX_BATCHES:
            wanted, self._batches = count - found.count, self._batches + 1
            place = f"heralds {self._batches}"
            await asyncio.sleep(0)  # others are served meanwhile
            random = PhotonRandom(self._layer.draws, self._names[0], place, wanted)
            places = begin - 1 + _until(random.generator("gaps").geometric(chance, wanted), most)
            places = places[places < most]
            if places.size:
                in_rounds = places // link.modes
                await self._layer.clock.wait_until(link.clicks_ns(int(in_rounds[-1]) + 1))
                found = self._kept(found.joined(self._meet(in_rounds, place)))
            begin = int(places[-1]) + 1 if places.size == wanted else most
        used = -(-begin // link.modes) if chance else rounds
        await self._layer.clock.wait_until(link.clicks_ns(used))
        self._count(used * link.modes)
        return found, used

    def _kept(self, found: Heralded) -> Heralded:
        """Return those that are young enough when the last has come."""
        if self._link.cutoff_ns == np.inf or not found.count:
            return found
        young = self._link.young(found.rounds)
        self.dropped += int(np.count_nonzero(~young))
        return found.only(young)

    def _count(self, attempts: int) -> None:
        """Let the switches count the photons of all attempts."""
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
        light ^= _distinguished(link, met, random)
        light[random.events("readout", link.told_wrongly)] ^= PHASE
        first = light * (kind == 0)  # the others are entangled with no light
        second = np.zeros(count, np.uint8)
        for errors, name, emitter in zip((first, second), self._names, link.emitters, strict=True):
            own = random.at(f"emitter {name.half}")
            at = own.events("error", 1 - emitter.fidelity)
            errors[at] ^= 1 + own.which("which", at.size, np.ones(3))
        told = np.where(random.coins("detector", count), PSI_MINUS, PSI_PLUS).astype(np.uint8)
        come = met[0].arrived & met[1].arrived
        every = twirled | met[0].approximations | met[1].approximations
        if link.heralds.unequal:
            every |= approximation(UNEQUAL_ARMS, link.heralds.unequal)
        errors = first[come], second[come]
        return Heralded(rounds[come], kind[come], told[come], errors, every)


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


def _distinguished(link: Link, met: Sequence[Met], random: PhotonRandom) -> Bytes:
    """Return which phases are wrong, as light of both hosts could be told apart."""
    wrong = np.zeros(random.photons, np.uint8)
    if not link.overlap.rad_per_s or all(each.delays_ps is None for each in met):
        chance = float(phase_wrong(link.scheme, link.heralds, link.visibility))
        wrong[random.events("interference", chance)] = PHASE
        return wrong
    first, second = (0.0 if each.delays_ps is None else each.delays_ps for each in met)
    own = link.station.analyser.visibility * link.overlap.apart(first - second)
    chances = phase_wrong(link.scheme, link.heralds, own)
    return (random.uniform("interference") < chances) * PHASE
