"""Keys of entangled pairs over distance: BBM92, and E91 with its CHSH test.

A source in the middle sends half of each pair to either end, one pair a pulse, or several (SPDC).
Detectors, errors and the fibres are those of evidence.curves.decoy_states; a click of both
detectors of an end counts as a random bit.
"""

from dataclasses import replace
from math import hypot, sqrt
from typing import Any

import numpy as np

from dispatcher.laboratory import Laboratory
from evidence.curves import multi_pair, theory
from evidence.curves.decoy_states import (
    DARK_COUNT,
    EFFICIENCY,
    ERROR,
    LENGTH,
    LOSS_DB_PER_KM,
    detectors,
)
from evidence.curves.estimates import NOTHING, Estimate, proportion
from evidence.curves.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from evidence.curves.link import configuration, fiber
from evidence.curves.multi_pair import MEAN, source_of
from evidence.curves.parameters import Parameter, Values
from evidence.curves.superdense import blocks
from hosts.middleware.qkd.bell_test import LOCAL, Correlations
from hosts.middleware.qkd.key_length import asymptotic_fraction
from wire.outcomes import NO_CLICK, PAULI_BASES
from wire.parameters.physics import Device

TO_ALICE, TO_BOB = ("charlie-q0", "alice-q0"), ("charlie-q1", "bob-q0")
STATISTICS = replace(multi_pair.STATISTICS, default="single")
PROTOCOL = Parameter("protocol", "bbm92", choices=("bbm92", "e91"))
TESTED = 0.2  # of bob's photons in E91


async def share(values: Values, seed: int) -> Outcome:
    """Send halves to both ends, which measure them in bases at random."""
    length_km = number(values, LENGTH.name) / 2
    optics: dict[str, Any] = {"length_km": length_km, "loss_db_per_km": LOSS_DB_PER_KM}
    fibers = [fiber(*TO_ALICE, **optics), fiber(*TO_BOB, **optics, depolarizing=2 * ERROR)]
    devices = dict.fromkeys(("alice", "bob"), Device(detectors=detectors()))
    devices["charlie"] = Device(source=source_of(values))
    laboratory = Laboratory(configuration(seed, fibers, devices))
    alice, charlie, bob = (laboratory.host(name) for name in ("alice", "charlie", "bob"))
    random, bell = np.random.default_rng(seed), Correlations()
    pairs, both, sifted, wrong = 0, 0, 0, 0
    for block, size in enumerate(blocks(int(values["pairs"]))):
        hers, his = random.integers(0, 2, (2, size), dtype=np.uint8)
        tested = random.random(size) < _tested(values)
        await charlie.create(size, block)
        await charlie.send({(block, 0): TO_ALICE[0], (block, 1): TO_BOB[0]})
        pairs += size
        there = [await alice.receive((block, 0), TO_ALICE[1])]
        there += [await bob.receive((block, 1), TO_BOB[1])]
        if None in there:
            continue
        bases = np.where(tested, his + PAULI_BASES, his).astype(np.uint8)
        ours = await alice.measure((block, 0), bases=hers)
        theirs = await bob.measure((block, 1), bases=bases)
        seen, differ = (ours != NO_CLICK) & (theirs != NO_CLICK), (ours ^ theirs) & np.uint8(1)
        both += int(seen.sum())
        chosen = seen & tested
        bell.add(hers[chosen], his[chosen], differ[chosen])
        same = seen & ~tested & (hers == his)
        sifted, wrong = sifted + int(same.sum()), wrong + int(differ[same].sum())
    return outcome(values, pairs, proportion(both, pairs), proportion(wrong, sifted), bell)


def outcome(
    values: Values, pairs: int, gain: Estimate, qber: Estimate, bell: Correlations
) -> Outcome:
    """Return what was measured, and the key of it: none if there is a test and it fails."""
    fails = values[PROTOCOL.name] == "e91" and not bell.s > LOCAL
    share = 0.0 if fails else gain.value * (1 - _tested(values)) / 2
    rate = share * asymptotic_fraction(qber.value)
    by_qber = rate - share * asymptotic_fraction(qber.value + qber.error)
    error = hypot(rate * gain.error / gain.value if gain.value else 0.0, by_qber)
    chsh = NOTHING if values[PROTOCOL.name] == "bbm92" else _s(bell)
    return {"gain": gain, "qber": qber, "key": Estimate(rate, max(error, 1 / pairs)), "chsh": chsh}


def _s(bell: Correlations) -> Estimate:
    return Estimate(bell.s, bell.error)


def _tested(values: Values) -> float:
    return TESTED if values[PROTOCOL.name] == "e91" else 0.0


def _arrives(values: Values) -> float:
    arm_db = LOSS_DB_PER_KM * number(values, LENGTH.name) / 2
    return EFFICIENCY * theory.transmission(arm_db)


def _clicks(values: Values) -> tuple[float, float]:
    arrives = _arrives(values)
    return arrives, 1 - (1 - arrives) * (1 - DARK_COUNT) ** 2


def _pulses(values: Values) -> tuple[float, float]:
    """Return the error rate and how many pulses are seen at both ends, of several pairs in one."""
    statistics, mean = str(values[STATISTICS.name]), number(values, MEAN.name)
    return theory.several_pairs(statistics, mean, (_arrives(values),) * 2, DARK_COUNT, ERROR)


def _is_single(values: Values) -> bool:
    return values[STATISTICS.name] == STATISTICS.default


def _gain(values: Values) -> float:
    return _clicks(values)[1] ** 2 if _is_single(values) else _pulses(values)[1]


def _correlation(values: Values) -> float:
    """Return E in equal bases: of both photons seen, and of neither end by a second click."""
    arrives, clicks = _clicks(values)
    return (1 - 2 * ERROR) * (arrives * (1 - DARK_COUNT) / clicks) ** 2


def _qber(values: Values) -> float:
    return (1 - _correlation(values)) / 2 if _is_single(values) else _pulses(values)[0]


def _chsh(values: Values) -> float | None:
    if values[PROTOCOL.name] == "bbm92" or not _is_single(values):
        return None
    return 2 * sqrt(2) * _correlation(values)


def _key(values: Values) -> float | None:
    chsh = _chsh(values)
    if values[PROTOCOL.name] == "e91" and chsh is None:
        return None  # several pairs in bases between those of the key: no closed form here
    if chsh is not None and chsh <= LOCAL:
        return 0.0
    kept = (1 - _tested(values)) / 2
    return (
        _gain(values) * kept * max(0.0, 1 - 2 * theory.entropy((_qber(values), 1 - _qber(values))))
    )


PAIR_KEYS = Experiment(
    "pair-keys",
    "BBM92 and E91 over distance",
    (LENGTH, PROTOCOL, STATISTICS, MEAN, pairs_parameter(2_000_000)),
    (
        Measure("gain", "pairs seen at both ends", _gain),
        Measure("qber", "error rate (QBER)", _qber),
        Measure("chsh", "S", _chsh),
        Measure("key", "secret bits per pair", _key),
    ),
    share,
)
