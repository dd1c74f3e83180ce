"""BB84 by prepared states, by the light of many sources, past an eavesdropper who splits photons.

Detectors and errors are those of arXiv:1311.7129, section IV, but for afterpulses: efficiency 10 %,
6e-7 dark counts in a gate, errors of .5 %, .2 dB/km, error correction at 1.16 times the limit.

    alice === eve === bob          what alice and bob take for loss is what eve makes of it

Eve keeps a photon of each pulse of several, sends on only as many pulses as are expected, and
measures hers when the bases are announced (Brassard, Luetkenhaus, Mor, Sanders 2000).
"""

import math
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from applications.interception import attacks
from applications.qkd.decoy import SHARES, Decoys, Sifted, bounds
from applications.qkd.key_length import asymptotic_fraction, binary_entropy
from dispatcher.sabot.backend import Bytes
from evidence.curves import theory
from evidence.curves.estimates import Estimate, of_counts, proportion
from evidence.curves.experiment import Outcome
from evidence.curves.link import TESTED, Ports, blocks, fiber, network
from evidence.curves.parameters import Point
from evidence.laboratory import Laboratory, LaboratoryHost
from wire.outcomes import NO_CLICK
from wire.parameters.fiber import Fiber
from wire.parameters.physics import Detectors, Device, PairSource

Counts = NDArray[np.int64]
Forward = Callable[[int], Awaitable[None]]  # takes a block from alice's fibre to bob's
Listen = Callable[[int, "Block"], Awaitable[None]]
Theory = dict[str, float | None]

WEAK = 0.1  # photons in a decoy
LOSS_DB_PER_KM, EFFICIENCY, DARK_COUNT, ERROR, CORRECTION = 0.2, 0.1, 6e-7, 5e-3, 1.16
GATE_S = 1e-9
X = 1
SOURCES = {  # typed with commas between them; a laser by its mean of photons a pulse
    "single": PairSource(),
    "single-g2-0.02": PairSource(g2=0.02),
    "laser-0.1": PairSource("poisson", 0.1),
    "laser-0.01": PairSource("poisson", 0.01),
    "heralded": PairSource("thermal", 0.02, heralding_efficiency=0.7),
}
TO_EVE, TO_BOB = ("alice-q0", "eve-q0"), ("eve-q1", "bob-q0")
KEPT, TRASH = 1 << 31, 3 << 30  # numbers of eve's blocks, beside that of the light
NO_LEVELS = (1.0, 0.0, 0.0)


@dataclass(frozen=True)
class Block:
    """The bits sent and seen of a block of pulses: arrays of shape (pulses,)."""

    states: Bytes
    bases: Bytes  # of bob
    levels: Bytes  # of intensity
    bits: Bytes  # of bob, NO_CLICK where no detector clicked

    @property
    def sifted(self) -> NDArray[np.bool_]:
        same: NDArray[np.bool_] = (self.bits != NO_CLICK) & (self.bases == self.states >> 1)
        return same


class Exchange:
    """Counts of pulses; arrays end with the level of intensity."""

    def __init__(self, levels: int) -> None:
        self.sent, self.seen = np.zeros((2, levels), np.int64)
        self.counts = np.zeros((2, 2, levels), np.int64)  # sifted: basis, right or wrong, level
        self.ones = 0

    def add(self, block: Block) -> None:
        levels, same, clicked = len(self.sent), block.sifted, block.bits != NO_CLICK
        wrong = (block.bits ^ block.states)[same] & np.uint8(1)
        self.sent += np.bincount(block.levels, minlength=levels)
        self.seen += np.bincount(block.levels[clicked], minlength=levels)
        self.ones += int((block.bits == 1).sum())
        np.add.at(self.counts, (block.bases[same], wrong, block.levels[same]), 1)

    def gain(self, level: int = 0) -> Estimate:
        return proportion(int(self.seen[level]), int(self.sent[level]))

    @property
    def qber(self) -> Estimate:
        """The share of wrong bits among those of the first level."""
        signal = self.counts[:, :, 0].sum(axis=0)
        return proportion(int(signal[1]), int(signal.sum()))


async def exchange(
    laboratory: Laboratory,
    pulses: float,
    random: np.random.Generator,
    shares: Sequence[float] = (),
    path: Ports = TESTED,
    forward: Forward | None = None,
    listen: Listen | None = None,
) -> Exchange:
    """Send pulses from alice, by `path` to bob, and count them.

    Pulses have levels with these shares, or one. `forward` carries each block on at a host between
    the two; `listen` gets the outcome.
    """
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    totals = Exchange(len(shares) or 1)
    for number, size in blocks(pulses):
        states, bases = random.integers(0, (4, 2), (size, 2), dtype=np.uint8).T.copy()
        levels = np.zeros(size, np.uint8)
        if shares:
            levels = random.choice(len(shares), size, p=shares).astype(np.uint8)
        await alice.prepare(states, number, levels if shares else None)
        await alice.send({(number, 0): path[0]})
        if forward is not None:
            await forward(number)
        bits = np.full(size, NO_CLICK, np.uint8)
        if await bob.receive((number, 0), path[1]) is not None:
            bits = await bob.measure((number, 0), bases=bases)
        block = Block(states, bases, levels, bits)
        totals.add(block)
        if listen is not None:
            await listen(number, block)
    return totals


async def weak_pulses(v: Point, seed: int) -> Outcome:
    source = PairSource("poisson", v.mean_photons)
    way = fiber(*TESTED, connectors_db=v.loss_db)
    laboratory = network(seed, [way], alice=Device(source))
    totals = await exchange(laboratory, v.pairs, np.random.default_rng(seed))
    gain, qber = totals.gain(), totals.qber.value if totals.counts.sum() else 0.0
    single = 1 - source.multi_photon / gain.value if gain.value else 0.0
    return {
        "gain": gain,
        "key": Estimate(gain.value / 2 * asymptotic_fraction(qber, single), gain.error),
    }


def of_weak_pulses(v: Point) -> Theory:
    seen = v.mean_photons * theory.transmission(v.loss_db)
    return {"gain": theory.gain(seen), "key": theory.key_without_decoys(v.mean_photons, seen)}


async def light_sources(v: Point, seed: int) -> Outcome:
    source = SOURCES[str(v["source"])]
    bob = Device(detectors=detectors(v.efficiency_mismatch))
    laboratory = network(seed, [way(v)], alice=Device(source), bob=bob)
    totals = await exchange(laboratory, v.pairs, np.random.default_rng(seed))
    return {
        "gain": totals.gain(),
        "qber": totals.qber,
        "ones": proportion(totals.ones, int(totals.seen.sum())),
        "key": long_key(totals.gain(), totals.qber, source.multi_photon),
    }


def way(v: Point) -> Fiber:
    """Return the fibre: depolarising by p is an error of p/2 in either basis."""
    losses: dict[str, Any] = {"length_km": v.length_km, "loss_db_per_km": LOSS_DB_PER_KM}
    return fiber(*TESTED, **losses, depolarizing=2 * ERROR)


def detectors(mismatch: float = 0.0) -> Detectors:
    """Return the detectors, of which that of 1 sees so much less."""
    dark_count_hz = -math.log1p(-DARK_COUNT) / GATE_S
    return Detectors(EFFICIENCY, dark_count_hz, GATE_S, efficiency_mismatch=mismatch)


def long_key(gain: Estimate, qber: Estimate, several: float) -> Estimate:
    """Return the secret bits of a pulse of long keys (GLLP); its error is propagated."""

    def rate(seen: float, wrong: float) -> float:
        return seen / 2 * asymptotic_fraction(wrong, 1 - several / seen) if seen else 0.0

    by_gain = rate(gain.value + gain.error, qber.value) - rate(gain.value, qber.value)
    by_qber = rate(gain.value, qber.value) - rate(gain.value, qber.value + qber.error)
    error = float(np.hypot(by_gain, by_qber))
    return Estimate(rate(gain.value, qber.value), max(error, gain.error / 2))


def of_light_sources(v: Point) -> Theory:
    """Return what detectors that are alike see; of others, ones of single photons nearby.

    Dark counts are some 1e-5 of what is seen there.
    """
    source, quiet, less = SOURCES[str(v["source"])], 1 - DARK_COUNT, v.efficiency_mismatch
    expected: Theory = dict.fromkeys(("gain", "qber", "ones", "key"))
    if source == SOURCES["single"] and not v.length_km > 0:
        dark = DARK_COUNT * (1 - EFFICIENCY)
        one, zero = EFFICIENCY * (1 - less) / 2 + dark, EFFICIENCY / 2 + dark
        expected["ones"] = one / (one + zero)
    if less:
        return expected
    arrives = EFFICIENCY * theory.transmission(LOSS_DB_PER_KM * v.length_km)
    right, wrong = (quiet * _missed(source, arrives * e) for e in (1 - ERROR, ERROR))
    neither = quiet**2 * _missed(source, arrives)
    both = 1 - right - wrong + neither
    gain = 1 - neither
    qber = (right - neither + both / 2) / gain
    key = theory.gllp(gain, qber, 1 - source.multi_photon / gain) / 2
    return expected | {"gain": gain, "qber": qber, "key": key}


def _missed(source: PairSource, arrives: float) -> float:
    """Return how likely no photon of a pulse is among those that arrive so likely, in theory."""
    if source.statistics == "single":
        second = source.multi_photon
        return (1 - arrives) * (1 - second + second * (1 - arrives))
    mean = source.mean_pairs
    if not source.heralding_efficiency:
        return theory.no_click(source.statistics, mean, arrives)
    both = 1 - (1 - source.heralding_efficiency) * (1 - arrives)  # neither half is seen
    missed = theory.no_click(source.statistics, mean, arrives)
    unheralded = theory.no_click(source.statistics, mean, source.heralding_efficiency)
    return unheralded + missed - theory.no_click(source.statistics, mean, both)


async def decoy_states(v: Point, seed: int) -> Outcome:
    decoys = decoys_of(v)
    laboratory = network(seed, [way(v)], **devices(decoys))
    totals = await exchange(laboratory, v.pairs, np.random.default_rng(seed), SHARES)
    gains = {"gain": totals.gain(), "weak": totals.gain(1)}
    return {
        **gains,
        "qber": totals.qber,
        "key": decoy_key(decoys, totals.counts, int(totals.sent.sum())),
    }


def decoys_of(v: Point) -> Decoys:
    return Decoys((v.mean_photons, WEAK, 0.0))


def devices(decoys: Decoys) -> dict[str, Device]:
    laser = PairSource("poisson", decoys.means[0], decoys=decoys.means[1:])
    return {"alice": Device(laser), "bob": Device(detectors=detectors())}


def decoy_key(decoys: Decoys, counts: Counts, pulses: int) -> Estimate:
    """Return the secret bits of a pulse of endless keys; its error is propagated count by count."""

    def rate(array: NDArray[Any]) -> float:
        sifted = Sifted(array[X].sum(axis=0), array[1 - X].sum(axis=0), array[1 - X][1])
        leak = CORRECTION * sifted.key.sum() * binary_entropy(array[X][1].sum() / sifted.key.sum())
        return max(0.0, float(bounds(decoys, sifted, None).secret - leak)) / pulses

    return of_counts(rate, counts)


def of_decoy_states(v: Point) -> Theory:
    arrives = EFFICIENCY * theory.transmission(LOSS_DB_PER_KM * v.length_km)
    means = decoys_of(v).means
    seen = [theory.weak_pulse(mean * arrives, DARK_COUNT, ERROR) for mean in means]
    (gain, wrong), (weak, _wrong), _vacuum = seen
    key = theory.decoy_key(means, SHARES, seen, CORRECTION)
    return {"gain": gain, "weak": weak, "qber": wrong / gain, "key": key}


async def photon_splitting(v: Point, seed: int) -> Outcome:
    totals, known_counts = await spied(v, seed)
    gain, tagged = totals.gain(), PairSource("poisson", v.mean_photons).multi_photon
    if v["decoys"] == "on":
        key = decoy_key(decoys_of(v), totals.counts, int(totals.sent.sum()))
    else:  # long keys without errors (quant-ph/0212066)
        key = Estimate(max(0.0, gain.value - tagged) / 2, gain.error / 2)
    known_bits = proportion(int(known_counts.sum()), int(totals.counts.sum()))
    return {
        "gain": gain,
        "weak": totals.gain(1),
        "qber": totals.qber,
        "known": known_bits,
        "key": key,
    }


async def spied(v: Point, seed: int) -> tuple[Exchange, Counts]:
    """Send pulses past eve; return the counts, and of the sifted those that eve knows, by basis."""
    laboratory, random = scene(v, seed), np.random.default_rng(seed)
    eve, known_counts = laboratory.host("eve"), np.zeros(2, np.int64)
    splits = attacks.PathLosses(v.loss_db) if v["eve"] == "on" else None

    async def forward(number: int) -> None:
        await eve.receive((number, 0), TO_EVE[1])
        if splits is not None:
            await split(eve, number, splits, random)
        await eve.send({(number, 0): TO_BOB[0]})

    async def listen(number: int, block: Block) -> None:
        if splits is not None:  # the bases are public when all is measured
            same, states = block.sifted, block.states
            hers = await eve.measure((number | KEPT, 0), bases=states >> np.uint8(1))
            agree = hers[same] == states[same] & np.uint8(1)
            known_counts[:] += np.bincount(block.bases[same][agree], minlength=2)

    path = TO_EVE[0], TO_BOB[1]
    totals = await exchange(laboratory, v.pairs, random, _shares(v), path, forward, listen)
    return totals, known_counts


async def split(
    eve: LaboratoryHost, block: int, losses: attacks.PathLosses, random: np.random.Generator
) -> None:
    light = (block, 0)
    photons: Bytes = await eve.split(light, (block | KEPT, 0))
    shares = np.array(losses.sent_on(np.bincount(photons).tolist()))
    chances = shares[(photons >= attacks.SEVERAL).astype(int)]
    back = np.flatnonzero((photons > 0) & (random.random(photons.size) >= chances))
    if back.size:
        await eve.gather((block | TRASH, 0), {light: back}, keep_rest=True)
        await eve.discard((block | TRASH, 0))


def scene(v: Point, seed: int) -> Laboratory:
    """Return the three hosts; what eve does not do, the fibre behind her does."""
    loss_db = 0.0 if v["eve"] == "on" else v.loss_db
    fibers = [fiber(*TO_EVE), fiber(*TO_BOB, connectors_db=loss_db)]
    return network(seed, fibers, alice=devices(decoys_of(v))["alice"])


def _shares(v: Point) -> tuple[float, ...]:
    return SHARES if v["decoys"] == "on" else NO_LEVELS


def mean_of(shares: Sequence[float], values: Sequence[float]) -> float:
    return sum(share * value for share, value in zip(shares, values, strict=True))


def of_photon_splitting(v: Point) -> Theory:
    """Return what is seen, and of how many sifted bits eve has a photon."""
    means, shares, t = decoys_of(v).means, _shares(v), theory.transmission(v.loss_db)
    seen, share_known = [theory.gain(mean * t) for mean in means], 0.0
    if v["eve"] == "on":
        single, several = theory.sent_on(means, shares, t)
        many = [theory.several_photons(mean) for mean in means]
        seen = [
            single * theory.poisson(mean, 1) + several * more
            for mean, more in zip(means, many, strict=True)
        ]
        share_known = several * mean_of(shares, many) / mean_of(shares, seen)
    key = max(0.0, seen[0] - theory.several_photons(means[0])) / 2
    if v["decoys"] == "on":
        key = theory.decoy_key(means, SHARES, [(gain, 0.0) for gain in seen], CORRECTION)
    return {"gain": seen[0], "weak": seen[1], "qber": 0.0, "known": share_known, "key": key}
