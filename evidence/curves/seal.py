"""A tamper seal: how many pairs it compares until an intruder is found.

alice (source, half 0)   half 1 --- fibre --- eve --- fibre --- bob
"""

import numpy as np

from dispatcher.laboratory import Laboratory
from evidence.curves import theory
from evidence.curves.estimates import Estimate
from evidence.curves.experiment import Experiment, Measure, Outcome, number
from evidence.curves.link import configuration, fiber
from evidence.curves.parameters import Parameter, Values
from evidence.curves.wald import pairs_to_alarm
from hosts.hardware.qnic import LEFT_ALONE
from hosts.middleware.services.sealing.sequential_test import (
    Question,
    SequentialTest,
    tapped_error,
)
from wire.outcomes import NO_CLICK

TAPPED = Parameter("tapped", 0.25, 0.01, 1.0)
NOISE = Parameter("depolarizing", 0.01, 0.0, 0.2)
WHOLE = Parameter("whole_error", 0.01, 1e-6, 0.2)
FRACTION = Parameter("fraction", 0.25, 0.001, 1.0)
FALSE_ALARM = Parameter("false_alarm", 1e-6, 1e-15, 0.1)
MISSED = Parameter("missed", 0.01, 1e-15, 0.1)
ALARMS = Parameter("alarms", 400, 10, 1_000_000)
BLOCK_PAIRS = 10_000


async def seal(values: Values, seed: int) -> Outcome:
    """Watch until a number of alarms, each by a watch of its own."""
    noise = number(values, NOISE.name)
    ways = [fiber("alice-q0", "eve-q0", depolarizing=noise), fiber("eve-q1", "bob-q0")]
    laboratory = Laboratory(configuration(seed, ways))
    draws = np.random.default_rng([seed, 1])
    test, block = SequentialTest(question(values)), 0
    found: list[int] = []
    while len(found) < int(values[ALARMS.name]):
        differ = await _block(laboratory, block, number(values, TAPPED.name), draws)
        block += 1
        while differ.size and len(found) < int(values[ALARMS.name]):
            seen = test.compared
            test.add(differ)
            differ = differ[test.compared - seen :]
            if test.alarm:
                found.append(test.compared)
                test = SequentialTest(question(values))
    counts = np.array(found)
    return {"pairs": Estimate(float(counts.mean()), float(counts.std() / np.sqrt(counts.size)))}


async def _block(
    laboratory: Laboratory, block: int, tapped: float, draws: np.random.Generator
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return which pairs of a block that were measured in equal bases differ."""
    alice, eve, bob = (laboratory.host(name) for name in ("alice", "eve", "bob"))
    await alice.create(BLOCK_PAIRS, block)
    await alice.send({(block, 1): "alice-q0"})
    await eve.receive((block, 1), "eve-q0")
    hers = draws.integers(0, 2, BLOCK_PAIRS, dtype=np.uint8)
    taps = draws.random(BLOCK_PAIRS) < tapped
    await eve.resend((block, 1), np.where(taps, hers, np.uint8(LEFT_ALONE)).astype(np.uint8))
    await eve.send({(block, 1): "eve-q1"})
    await bob.receive((block, 1), "bob-q0")
    mine, yours = (draws.integers(0, 2, BLOCK_PAIRS, dtype=np.uint8) for _ in range(2))
    ours = await alice.measure((block, 0), bases=mine)
    theirs = await bob.measure((block, 1), bases=yours)
    there = (mine == yours) & (ours != NO_CLICK) & (theirs != NO_CLICK)
    differ: np.ndarray[tuple[int], np.dtype[np.bool_]] = (ours != theirs)[there]
    return differ


def question(values: Values) -> Question:
    return Question(*(number(values, each.name) for each in (WHOLE, FRACTION, FALSE_ALARM, MISSED)))


def error(values: Values) -> float:
    """Return which part of the pairs differs: noise, and what is intercepted and resent."""
    noise = theory.bit_error(number(values, NOISE.name))
    return tapped_error(noise, number(values, TAPPED.name))


SEAL = Experiment(
    "seal",
    "a tamper seal of entangled pairs, with somebody who intercepts and resends",
    (TAPPED, NOISE, WHOLE, FRACTION, FALSE_ALARM, MISSED, ALARMS),
    (
        Measure(
            "pairs",
            "pairs compared until the alarm",
            lambda values: pairs_to_alarm(question(values), error(values)),
            logarithmic=True,
        ),
    ),
    seal,
)
