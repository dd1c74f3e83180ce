"""Entangled pairs that both ends measure: several in a pulse, keys, an eavesdropper, a tamper seal.

    alice --- charlie --- bob          alice === eve === bob

Keys over distance are those of BBM92, and of E91 with its CHSH test; detectors, errors and fibres
are those of evidence.curves.bb84. An end whose two detectors both click has a random bit.
"""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from applications.interception.photons import LEFT_ALONE
from applications.qkd.bell_test import LOCAL, Correlations
from applications.qkd.key_length import asymptotic_fraction
from applications.sealing.sequential_test import Question, SequentialTest, tapped_error
from dispatcher.sabot.backend import Bytes
from evidence.curves import theory
from evidence.curves.bb84 import (
    DARK_COUNT,
    EFFICIENCY,
    ERROR,
    LOSS_DB_PER_KM,
    TO_BOB,
    TO_EVE,
    detectors,
)
from evidence.curves.estimates import NOTHING, Estimate, proportion
from evidence.curves.experiment import Outcome
from evidence.curves.link import blocks, fiber, network, share
from evidence.curves.parameters import Point
from evidence.curves.wald import pairs_to_alarm
from evidence.laboratory import Laboratory
from wire.outcomes import NO_CLICK, PAULI_BASES
from wire.parameters.physics import Detectors, Device, PairSource

ENDS = {"alice": ("charlie-q0", "alice-q0"), "bob": ("charlie-q1", "bob-q0")}
TESTED = 0.2  # of bob's photons in E91
SEALED_PAIRS = 10_000

Bools = NDArray[np.bool_]
Theory = dict[str, float | None]


@dataclass
class Comparison:
    """Outcomes of both ends in bases at random: of the key, and of the Bell test."""

    pairs: int = 0
    both: int = 0
    sifted: int = 0
    wrong: int = 0
    bell: Correlations = field(default_factory=Correlations)

    def add(self, hers: Bytes, his: Bytes, tested: Bools, ours: Bytes, theirs: Bytes) -> None:
        """Add bases and outcomes of a block; those tested are between the bases of the key."""
        seen, differ = (ours != NO_CLICK) & (theirs != NO_CLICK), (ours ^ theirs) & np.uint8(1)
        self.both += int(seen.sum())
        chosen, same = seen & tested, seen & ~tested & (hers == his)
        self.bell.add(hers[chosen], his[chosen], differ[chosen])
        self.sifted, self.wrong = (
            self.sifted + int(same.sum()),
            self.wrong + int(differ[same].sum()),
        )

    @property
    def qber(self) -> Estimate:
        return proportion(self.wrong, self.sifted)

    @property
    def s(self) -> Estimate:
        return Estimate(self.bell.s, self.bell.error)


def his_bases(his: Bytes, tested: Bools) -> Bytes:
    return np.where(tested, his + PAULI_BASES, his).astype(np.uint8)


async def resent(laboratory: Laboratory, block: int, size: int, bases: Bytes, taken: Bools) -> None:
    """Send half of each pair past eve to bob, who measures some of them and sends new ones."""
    alice, eve, bob = (laboratory.host(name) for name in ("alice", "eve", "bob"))
    await share(alice, eve, size, block, TO_EVE)
    await eve.resend((block, 1), np.where(taken, bases, LEFT_ALONE).astype(np.uint8))
    await eve.send({(block, 1): TO_BOB[0]})
    await bob.receive((block, 1), TO_BOB[1])


async def eavesdropping(v: Point, seed: int) -> Outcome:
    """Keep half of each pair at alice, send the other past eve, and measure both as E91 does."""
    noise = theory.of_fidelity(v.fidelity)
    laboratory = network(seed, [fiber(*TO_EVE, depolarizing=noise), fiber(*TO_BOB)])
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    random, comparison = np.random.default_rng(seed), Comparison()
    for block, size in blocks(v.pairs):
        hers, his, eves = random.integers(0, 2, (3, size), dtype=np.uint8)
        tested = random.random(size) < 1 / 2
        await resent(laboratory, block, size, eves, random.random(size) < v.fraction)
        theirs = await bob.measure((block, 1), bases=his_bases(his, tested))
        comparison.add(hers, his, tested, await alice.measure((block, 0), bases=hers), theirs)
    return {"chsh": comparison.s, "qber": comparison.qber}


def of_eavesdropping(v: Point) -> Theory:
    intact = 1 - v.fraction / 2
    qber = (1 - intact * (4 * v.fidelity - 1) / 3) / 2
    return {"chsh": intact * theory.chsh(v.fidelity), "qber": qber}


async def halves(
    laboratory: Laboratory, block: int, size: int, bases: tuple[Bytes | None, Bytes | None]
) -> list[Bytes]:
    """Send both halves of charlie's pulses; return what the ends see of them, in Z or in bases."""
    charlie, seen = laboratory.host("charlie"), []
    await charlie.create(size, block)
    await charlie.send({(block, half): way[0] for half, way in enumerate(ENDS.values())})
    hosts = [laboratory.host(name) for name in ENDS]
    came = [
        await host.receive((block, half), ENDS[host.name][1]) for half, host in enumerate(hosts)
    ]
    for half, host in enumerate(hosts):
        none = np.full(size, NO_CLICK, np.uint8)
        read = came[half] is not None
        seen.append(await host.measure((block, half), bases=bases[half]) if read else none)
    return seen


async def multi_pair(v: Point, seed: int) -> Outcome:
    """Send both halves of pulses over lossy ways; compare what the ends see in Z."""
    ways = zip(ENDS.values(), _losses(v), strict=True)
    dark_count_hz = -math.log1p(-v.dark_count) / Detectors().gate_s
    end = Device(detectors=Detectors(dark_count_hz=dark_count_hz))
    source, fibers = _source(v), [fiber(*way, connectors_db=db) for way, db in ways]
    laboratory = network(seed, fibers, charlie=Device(source), alice=end, bob=end)
    pulses = both = wrong = 0
    for block, size in blocks(v.pairs):
        mine, yours = await halves(laboratory, block, size, (None, None))
        coincident = (mine != NO_CLICK) & (yours != NO_CLICK)
        pulses, both = pulses + size, both + int(np.count_nonzero(coincident))
        wrong += int(np.count_nonzero(coincident & (mine != yours)))
    return {"qber": proportion(wrong, both), "coincidences": proportion(both, pulses)}


def _source(v: Point) -> PairSource:
    return PairSource(str(v["statistics"]), v.mean_pairs)


def _losses(v: Point) -> tuple[float, float]:
    """Return what is lost on the way to alice and to bob (dB)."""
    return v.loss_db, v.loss_db + v.further_db


def of_multi_pair(v: Point) -> Theory:
    to_alice, to_bob = map(theory.transmission, _losses(v))
    qber, both = theory.several_pairs(
        str(v["statistics"]), v.mean_pairs, (to_alice, to_bob), v.dark_count
    )
    return {"qber": qber, "coincidences": both}


async def pair_keys(v: Point, seed: int) -> Outcome:
    """Send halves to both ends, which measure them in bases at random."""
    optics: dict[str, Any] = {"length_km": v.length_km / 2, "loss_db_per_km": LOSS_DB_PER_KM}
    fibers = [
        fiber(*ENDS["alice"], **optics),
        fiber(*ENDS["bob"], **optics, depolarizing=2 * ERROR),
    ]
    end = Device(detectors=detectors())
    laboratory = network(seed, fibers, alice=end, bob=end, charlie=Device(_source(v)))
    random, comparison = np.random.default_rng(seed), Comparison()
    for block, size in blocks(v.pairs):
        hers, his = random.integers(0, 2, (2, size), dtype=np.uint8)
        tested = random.random(size) < _tested(v)
        seen = await halves(laboratory, block, size, (hers, his_bases(his, tested)))
        comparison.pairs += size
        comparison.add(hers, his, tested, *seen)
    return key_of(v, comparison)


def key_of(v: Point, comparison: Comparison) -> Outcome:
    """Return what was measured, and the key of it: none if there is a test and it fails."""
    gain, qber = proportion(comparison.both, comparison.pairs), comparison.qber
    fails = v["protocol"] == "e91" and not comparison.bell.s > LOCAL
    fraction = 0.0 if fails else gain.value * (1 - _tested(v)) / 2
    rate = fraction * asymptotic_fraction(qber.value)
    by_qber = rate - fraction * asymptotic_fraction(qber.value + qber.error)
    error = math.hypot(rate * gain.error / gain.value if gain.value else 0.0, by_qber)
    key = Estimate(rate, max(error, 1 / comparison.pairs))
    chsh = NOTHING if v["protocol"] == "bbm92" else comparison.s
    return {"gain": gain, "qber": qber, "key": key, "chsh": chsh}


def _tested(v: Point) -> float:
    return TESTED if v["protocol"] == "e91" else 0.0


def of_pair_keys(v: Point) -> Theory:
    """Of single pairs S and E in equal bases: of both photons seen, at neither end a second click.

    Of several there is no closed form here in bases between those of the key.
    """
    arrives = EFFICIENCY * theory.transmission(LOSS_DB_PER_KM * v.length_km / 2)
    has_test, chsh, key = v["protocol"] == "e91", None, None
    if v["statistics"] == "single":
        clicks = 1 - (1 - arrives) * (1 - DARK_COUNT) ** 2
        correlation = (1 - 2 * ERROR) * (arrives * (1 - DARK_COUNT) / clicks) ** 2
        qber, gain = (1 - correlation) / 2, clicks**2
        chsh = 2 * math.sqrt(2) * correlation if has_test else None
    else:
        statistics = str(v["statistics"])
        qber, gain = theory.several_pairs(
            statistics, v.mean_pairs, (arrives, arrives), DARK_COUNT, ERROR
        )
    if chsh is not None and chsh <= LOCAL:
        key = 0.0
    elif chsh is not None or not has_test:
        fraction = (1 - _tested(v)) / 2
        key = gain * fraction * max(0.0, 1 - 2 * theory.entropy((qber, 1 - qber)))
    return {"gain": gain, "qber": qber, "chsh": chsh, "key": key}


async def seal(v: Point, seed: int) -> Outcome:
    """Watch until a number of alarms, each by a watch of its own."""
    laboratory = network(seed, [fiber(*TO_EVE, depolarizing=v.depolarizing), fiber(*TO_BOB)])
    draws = np.random.default_rng([seed, 1])
    test, block = SequentialTest(question(v)), 0
    compared: list[int] = []
    while len(compared) < v.alarms:
        differ = await _sealed(laboratory, block, v.tapped, draws)
        block += 1
        while differ.size and len(compared) < v.alarms:
            seen = test.compared
            test.add(differ)
            differ = differ[test.compared - seen :]
            if test.alarm:
                compared.append(test.compared)
                test = SequentialTest(question(v))
    counts = np.array(compared)
    return {"pairs": Estimate(float(counts.mean()), float(counts.std() / np.sqrt(counts.size)))}


async def _sealed(
    laboratory: Laboratory, block: int, tapped: float, draws: np.random.Generator
) -> Bools:
    """Return which pairs of a block that were measured in equal bases differ."""
    eves = draws.integers(0, 2, SEALED_PAIRS, dtype=np.uint8)
    await resent(laboratory, block, SEALED_PAIRS, eves, draws.random(SEALED_PAIRS) < tapped)
    mine, yours = (draws.integers(0, 2, SEALED_PAIRS, dtype=np.uint8) for _ in range(2))
    ours = await laboratory.host("alice").measure((block, 0), bases=mine)
    theirs = await laboratory.host("bob").measure((block, 1), bases=yours)
    there = (mine == yours) & (ours != NO_CLICK) & (theirs != NO_CLICK)
    differ: Bools = (ours != theirs)[there]
    return differ


def question(v: Point) -> Question:
    return Question(v.whole_error, v.fraction, v.false_alarm, v.missed)


def sealed_error(v: Point) -> float:
    """Return which part of the pairs differs: noise, and what is intercepted and resent."""
    return tapped_error(theory.bit_error(v.depolarizing), v.tapped)


def of_seal(v: Point) -> Theory:
    return {"pairs": pairs_to_alarm(question(v), sealed_error(v))}
