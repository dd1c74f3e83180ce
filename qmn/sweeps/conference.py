"""Conference keys of GHZ states: error rates of both tests, and the key of endless sessions."""

import numpy as np
from numpy.typing import NDArray

from hosts.middleware.qkd.conference import asymptotic_rate
from qmn.sweeps import theory
from qmn.sweeps.estimates import Estimate, of_counts, proportion
from qmn.sweeps.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from qmn.sweeps.ghz import HOSTS, NOISE, line, states
from qmn.sweeps.parameters import Values
from qmn.sweeps.superdense import blocks
from wire.dispatcher_pb2 import MeasureRequest

Counts = NDArray[np.int64]  # wrong and right, of the parity in X and of each other host in Z


async def agree(values: Values, seed: int) -> Outcome:
    """Measure half of the states in X and half in Z at all hosts."""
    hosts, ways = line(values, seed)
    counts = np.zeros((len(hosts), 2), np.int64)
    number_of_pair = 0
    for basis in (MeasureRequest.X, MeasureRequest.Z):
        for size in blocks(int(values["pairs"]) // 2):
            kept, _there = await states(hosts, ways, number_of_pair, size)
            number_of_pair += len(ways)
            found = np.vstack(
                [await host.measure(name, basis) for host, name in zip(hosts, kept, strict=True)]
            )
            _count(counts, found, in_x=basis == MeasureRequest.X)
    in_x, *in_z = (proportion(int(wrong), int(wrong + right)) for wrong, right in counts)
    return {
        "qber_x": in_x,
        "qber_z": max(in_z, key=lambda estimate: estimate.value),
        "key": _key(counts),
    }


def _count(counts: Counts, found: NDArray[np.uint8], *, in_x: bool) -> None:
    """Count what is wrong and right, of outcomes of shape (hosts, states)."""
    wrong = [found.sum(axis=0) & 1] if in_x else list(found[1:] ^ found[:1])
    places = [0] if in_x else range(1, len(counts))
    for place, each in zip(places, wrong, strict=True):
        counts[place] += np.bincount(1 - each, minlength=2)


def _key(counts: Counts) -> Estimate:
    def rate(numbers: NDArray[np.float64]) -> float:
        in_x, *in_z = (wrong / (wrong + right) for wrong, right in numbers)
        return asymptotic_rate(in_x, max(in_z))

    return of_counts(rate, counts)


def _qber(values: Values) -> float:
    """Return (1 - (1 - p)^(N - 1))/2: each link flips bit, and phase, with p/2."""
    links = number(values, HOSTS.name) - 1
    return float((1 - (1 - number(values, NOISE.name)) ** links) / 2)


def key(values: Values) -> float:
    """Return 1 - 2 h(Q), at least 0: the last host differs as often as the parity in X is odd."""
    qber = _qber(values)
    return max(0.0, 1 - 2 * theory.entropy((qber, 1 - qber)))


CONFERENCE = Experiment(
    "conference",
    "conference keys of a line of hosts, by GHZ states",
    (NOISE, HOSTS, pairs_parameter(40_000)),
    (
        Measure("qber_x", "parities in X that are odd", _qber),
        Measure("qber_z", "bits that differ in Z, of the worst host", _qber),
        Measure("key", "secret bits of a state in Z", key),
    ),
    agree,
)
