"""A repeater that swaps by gates, which err and take time, as its readings do."""

import math
from typing import Any

from dispatcher.laboratory import Laboratory
from evidence.curves import theory
from evidence.curves.estimates import proportion
from evidence.curves.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from evidence.curves.gated_bell import ONE, TWO
from evidence.curves.link import configuration, fiber
from evidence.curves.parameters import Parameter, Values
from evidence.curves.teleportation import BASES, fidelity_of
from wire.dispatcher_pb2 import MeasureRequest
from wire.parameters.physics import BellAnalyser, Device, Gates, Memory

TWO_S = Parameter("two_qubit_s", 0.0, 0.0, 10.0, "s")
READOUT_S = Parameter("readout_s", 0.0, 0.0, 10.0, "s")
MISREAD = Parameter("readout_error", 0.0, 0.0, 0.5)
T2 = Parameter("t2_s", 0.1, 1e-12, math.inf, "s")
WAYS = {"alice": ("r1-q0", "alice-q0"), "bob": ("r1-q1", "bob-q0")}


async def swap(values: Values, seed: int) -> Outcome:
    """Join pairs r1-alice and r1-bob; measure the fidelity of alice-bob with Phi+."""
    given = (ONE, TWO, TWO_S, READOUT_S, MISREAD)
    like: dict[str, Any] = {each.name: number(values, each.name) for each in given}
    gates = Gates("any", **like)
    end = Device(memory=Memory(t2_s=number(values, T2.name)))
    devices = {"alice": end, "bob": end, "r1": Device(gates=gates, analyser=BellAnalyser("gates"))}
    fibers = [fiber(*way, length_km=0.0) for way in WAYS.values()]
    laboratory = Laboratory(configuration(seed, fibers, devices))
    repeater, each = laboratory.host("r1"), int(values["pairs"]) // len(BASES)
    agreeing = []
    for turn, basis in enumerate(BASES):
        blocks = {name: len(WAYS) * turn + link for link, name in enumerate(WAYS)}
        for name, block in blocks.items():
            near, far = WAYS[name]
            await repeater.create(each, block)
            await repeater.store((block, 0))
            await repeater.send({(block, 1): near})
            await laboratory.host(name).receive((block, 1), far)
        for name, block in blocks.items():
            await laboratory.host(name).store((block, 1))
        first, second = blocks.values()
        outcomes = await repeater.bell_measure((first, 0), (second, 0))
        await laboratory.host("bob").apply((second, 1), outcomes)
        mine, yours = [
            await laboratory.host(name).measure((block, 1), basis) for name, block in blocks.items()
        ]
        right = int(((mine ^ yours) == (basis == MeasureRequest.Y)).sum())
        agreeing.append(proportion(right, each))
    return {"fidelity": fidelity_of(agreeing)}


def fidelity(values: Values) -> float:
    """Return the theory of it: both ends decohere while the gate and the readings last."""
    waited_s = number(values, TWO_S.name) + number(values, READOUT_S.name)
    kept = math.exp(-2 * waited_s / number(values, T2.name))
    one, two, misread = (number(values, each.name) for each in (ONE, TWO, MISREAD))
    return theory.gated_swap_fidelity(one, two, misread, kept)


GATED_SWAP = Experiment(
    "gated-swap",
    "a repeater whose gates and readings err and take time",
    (ONE, TWO, TWO_S, READOUT_S, MISREAD, T2, pairs_parameter(60_000)),
    (Measure("fidelity", "fidelity of the swapped pairs", fidelity),),
    swap,
)
