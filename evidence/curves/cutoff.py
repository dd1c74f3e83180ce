"""Pairs that are heralded one after the other until two are there, none older than the cut-off."""

import math

import numpy as np

from dispatcher.laboratory import Laboratory, outcomes
from evidence.curves import theory
from evidence.curves.estimates import Estimate, proportion
from evidence.curves.experiment import Experiment, Measure, Outcome, number
from evidence.curves.heralding import MAX_S, PSI_MINUS, WAYS
from evidence.curves.link import configuration, fiber
from evidence.curves.parameters import Parameter, Values
from wire.dispatcher_pb2 import MeasureRequest
from wire.parameters.physics import BellAnalyser, Device, Emitter, Memory

CUTOFF = Parameter("cutoff_s", math.inf, 1e-9, math.inf, "s")
T2 = Parameter("t2_s", 0.02, 1e-12, math.inf, "s")
EFFICIENCY = Parameter("efficiency", 0.5, 0.01, 1.0)
PAIRS = Parameter("pairs", 2_000, 100, 1_000_000)
ATTEMPT_S, KM = 1e-3, 0.01
BOTH = 2


async def wait(values: Values, seed: int) -> Outcome:
    """Herald two pairs again and again, and measure them in X as soon as both are there."""
    emitter = Emitter("two-click", number(values, EFFICIENCY.name), preparation_s=ATTEMPT_S)
    memory = Memory(t2_s=number(values, T2.name), cutoff_s=number(values, CUTOFF.name))
    host = Device(memory=memory, emitter=emitter)
    station = Device(analyser=BellAnalyser("linear"))
    fibers = [fiber(*way, length_km=KM) for way in WAYS.values()]
    network = configuration(seed, fibers, dict.fromkeys(WAYS, host) | {"charlie": station})
    laboratory = Laboratory(network)
    attempts, right = [], 0
    for block in range(int(values["pairs"]) // BOTH):
        for half, (name, (port, _far)) in enumerate(WAYS.items()):
            await laboratory.host(name).attempt((block, half), port)
        ports = ("charlie-q0", "charlie-q1")
        found = await laboratory.host("charlie").herald(BOTH, ports, MAX_S, block)
        attempts.append(found.attempts)
        mine, yours = [
            await laboratory.host(name).measure((block, half), MeasureRequest.X)
            for half, name in enumerate(WAYS)
        ]
        right += int((mine[0] ^ yours[0]) == (outcomes(found)[0] == PSI_MINUS))
    error = float(np.std(attempts, ddof=1)) / math.sqrt(len(attempts))
    rate = 1 / (float(np.mean(attempts)) * _attempt_s())
    share = proportion(right, len(attempts))
    return {
        "rate": Estimate(rate, rate * error / float(np.mean(attempts))),
        "fidelity": share,  # T2 alone: of Psi+ or Psi-, and never of another Bell state
    }


def rate(values: Values) -> float:
    chance, rounds = _chance(values), _rounds(values)
    return 1 / (theory.attempts_until_two(chance, rounds) * _attempt_s())


def fidelity(values: Values) -> float:
    step = math.exp(-2 * _attempt_s() / number(values, T2.name))
    return (1 + theory.kept_over_gap(_chance(values), _rounds(values), step)) / 2


def _chance(values: Values) -> float:
    return theory.two_clicks(number(values, EFFICIENCY.name), 1.0)[0]


def _flight_s() -> float:
    return fiber(*WAYS["alice"], length_km=KM).delay_s


def _attempt_s() -> float:
    return ATTEMPT_S + 2 * _flight_s()


def _rounds(values: Values) -> float:
    """Return how many attempts behind the first the second may be; it also waits for its clicks."""
    cutoff_s = number(values, CUTOFF.name)
    if math.isinf(cutoff_s):
        return cutoff_s
    return math.floor((cutoff_s - _flight_s()) / _attempt_s() + 1e-9)


CUTOFF_TIMES = Experiment(
    "cutoff",
    "two pairs heralded one after the other, dropped if they are older than the cut-off",
    (CUTOFF, T2, EFFICIENCY, PAIRS),
    (
        Measure("rate", "how often both are there (1/s)", rate),
        Measure("fidelity", "fidelity of the older one", fidelity),
    ),
    wait,
)
