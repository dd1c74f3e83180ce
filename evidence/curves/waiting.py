"""Pairs that come one by one into the memories at both ends, and wait until the last has come."""

import math

import numpy as np

from dispatcher.laboratory import Laboratory
from evidence.curves import theory
from evidence.curves.estimates import proportion
from evidence.curves.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from evidence.curves.link import TESTED, configuration, fiber
from evidence.curves.parameters import Parameter, Values
from wire.dispatcher_pb2 import MeasureRequest
from wire.parameters.physics import Device, Memory

BLOCK = 1_000  # pairs
RATE = Parameter("rate_hz", 1_000, 1, 1_000_000_000, "Hz")
STORED = Parameter("stored", 1, 0, 1)  # 0: what nobody stores waits there as well
T1, T2 = (Parameter(f"t{i}_s", math.inf, 1e-12, math.inf, "s") for i in (1, 2))
BASES = {"xx": MeasureRequest.X, "zz": MeasureRequest.Z}


async def wait(values: Values, seed: int) -> Outcome:
    """Store both halves as they come, or neither; count how often they agree in X and in Z."""
    device = Device(memory=Memory(t1_s=number(values, T1.name), t2_s=number(values, T2.name)))
    network = configuration(seed, [fiber(*TESTED)], dict.fromkeys(("alice", "bob"), device))
    laboratory = Laboratory(network)
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    blocks = int(values["pairs"]) // BLOCK // len(BASES)
    agreeing = dict.fromkeys(BASES, 0)
    for block in range(blocks * len(BASES)):
        name = list(BASES)[block % len(BASES)]
        await alice.create(BLOCK, block)
        if values[STORED.name]:
            await alice.store((block, 0))
        await alice.send({(block, 1): TESTED[0]}, int(values[RATE.name]))
        await bob.receive((block, 1), TESTED[1])
        if values[STORED.name]:
            await bob.store((block, 1))
        mine = await alice.measure((block, 0), BASES[name])
        agreeing[name] += int(np.count_nonzero(mine == await bob.measure((block, 1), BASES[name])))
    return {name: proportion(count, blocks * BLOCK) for name, count in agreeing.items()}


def _waits_s(values: Values) -> list[tuple[float, float]]:
    """Return how long both halves of each pair wait; alice's also while the other one flies."""
    flight_s = fiber(*TESTED).delay_s
    last = [(BLOCK - 1 - pair) / number(values, RATE.name) for pair in range(BLOCK)]
    return [(waited_s + flight_s, waited_s) for waited_s in last]


def agree_in_x(values: Values) -> float:
    """Return the theory of X and X: coherence is lost with T2 at either end."""
    return theory.agreement_in_x(_waits_s(values), number(values, T2.name))


def agree_in_z(values: Values) -> float:
    """Return the theory of Z and Z: either end relaxes to |0> with T1."""
    return theory.agreement_in_z(_waits_s(values), number(values, T1.name))


WAITING = Experiment(
    "memory",
    "pairs that wait in memories at both ends, each from its own arrival",
    (RATE, T1, T2, STORED, pairs_parameter()),
    (
        Measure("xx", "how often X and X agree", agree_in_x),
        Measure("zz", "how often Z and Z agree", agree_in_z),
    ),
    wait,
)
