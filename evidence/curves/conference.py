"""Conference keys of GHZ states: error rates of both tests, and the key of endless sessions.

Over distance: fibres of .2 dB/km, errors of .5 % of a link, detectors as superconducting nanowires
(those of evidence.curves.relayed_keys). States count that every host has seen, and every fusion.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dispatcher.laboratory import LaboratoryHost
from evidence.curves import theory
from evidence.curves.decoy_states import ERROR, LENGTH, LOSS_DB_PER_KM
from evidence.curves.estimates import Estimate, of_counts, proportion
from evidence.curves.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from evidence.curves.ghz import HOSTS, NOISE, line, states
from evidence.curves.parameters import Values
from evidence.curves.relayed_keys import DARK_COUNT, DETECTORS, EFFICIENCY
from evidence.curves.superdense import blocks
from hosts.middleware.qkd.conference import asymptotic_rate
from wire.dispatcher_pb2 import MeasureRequest
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Device

Counts = NDArray[np.int64]  # wrong and right, of the parity in X and of each other host in Z


async def agree(values: Values, seed: int) -> Outcome:
    hosts, ways = line(int(values[HOSTS.name]), seed, depolarizing=number(values, NOISE.name))
    counts, _seen = await _measured(values, hosts, ways)
    return _told(counts) | {"key": _key(counts)}


async def agree_far(values: Values, seed: int) -> Outcome:
    """Do so over fibres that lose light; a key is of all states that were attempted in Z."""
    optics = {"length_km": number(values, LENGTH.name), "loss_db_per_km": LOSS_DB_PER_KM}
    hosts, ways = line(
        int(values[HOSTS.name]), seed, Device(detectors=DETECTORS), depolarizing=2 * ERROR, **optics
    )
    counts, seen = await _measured(values, hosts, ways)
    gain, share = proportion(*seen), _key(counts)
    spread = float(np.hypot(gain.error * share.value, gain.value * share.error))
    key = Estimate(gain.value * share.value, spread)
    return _told(counts) | {"gain": gain, "key": key}


async def _measured(
    values: Values, hosts: Sequence[LaboratoryHost], ways: Sequence[tuple[str, str]]
) -> tuple[Counts, tuple[int, int]]:
    """Return errors of what all have seen, how many states that were, and how many there were."""
    counts = np.zeros((len(hosts), 2), np.int64)
    number_of_pair, seen, attempted = 0, 0, 0
    for basis in (MeasureRequest.X, MeasureRequest.Z):
        for size in blocks(int(values["pairs"]) // 2):
            kept, there = await states(hosts, ways, number_of_pair, size)
            number_of_pair += len(ways)
            found = np.vstack(
                [await host.measure(name, basis) for host, name in zip(hosts, kept, strict=True)]
            )
            there &= (found != NO_CLICK).all(axis=0)
            _count(counts, found[:, there], in_x=basis == MeasureRequest.X)
            seen, attempted = seen + int(there.sum()), attempted + size
    return counts, (seen, attempted)


def _told(counts: Counts) -> Outcome:
    """Return the error rates of both tests."""
    in_x, *in_z = (proportion(int(wrong), int(wrong + right)) for wrong, right in counts)
    return {"qber_x": in_x, "qber_z": max(in_z, key=lambda estimate: estimate.value)}


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


def _far(values: Values) -> tuple[float, float]:
    """Return how likely all see a state, and how often it then has an error of either test.

    A present qubit is measured rightly with r and wrongly with w, a lost one with u as either bit.
    Every lost one leaves the last bit, and the parity in X, to chance; each of N - 1 links has
    another bit, and another phase, with p/2. Of the 2 N - 2 readings, N decide about an error:
    in X those of all hosts, in Z those of the first, of the last and of all fusions between.
    """
    links, dark = int(values[HOSTS.name]) - 1, DARK_COUNT
    either = dark * (1 - dark) + dark**2 / 2
    wrong = EFFICIENCY * dark / 2 + (1 - EFFICIENCY) * either
    right = EFFICIENCY * (1 - dark / 2) + (1 - EFFICIENCY) * either
    comes = theory.transmission(LOSS_DB_PER_KM * number(values, LENGTH.name))
    seen = right + wrong
    gain = seen**links * (comes * seen + (1 - comes) * 2 * either) ** links
    keeps = (comes * (1 - 2 * ERROR) * seen) ** links * seen**-1 * (right - wrong) ** (links + 1)
    return gain, (1 - keeps / gain) / 2


def _far_gain(values: Values) -> float:
    return _far(values)[0]


def _far_qber(values: Values) -> float:
    return _far(values)[1]


def _far_key(values: Values) -> float:
    gain, qber = _far(values)
    return gain * max(0.0, 1 - 2 * theory.entropy((qber, 1 - qber)))


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

FAR_CONFERENCE = Experiment(
    "conference-distance",
    "conference keys of a line of hosts over distance, by GHZ states",
    (LENGTH, HOSTS, pairs_parameter(200_000)),
    (
        Measure("gain", "states that all hosts see", _far_gain),
        Measure("qber_x", "parities in X that are odd", _far_qber),
        Measure("qber_z", "bits that differ in Z, of the worst host", _far_qber),
        Measure("key", "secret bits of a state that is attempted in Z", _far_key),
    ),
    agree_far,
)
