"""Teleportation of the six cardinal states, and entanglement swapping, by imperfect pairs.

Werner pairs of fidelity F are made as experiments have them: half of a perfect pair passes a
fibre that depolarises with p = 4 (1 - F)/3.
"""

import numpy as np

from dispatcher.laboratory import Laboratory, LaboratoryHost
from dispatcher.sabot.backend import Bytes
from evidence.curves import theory
from evidence.curves.estimates import Estimate, proportion
from evidence.curves.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from evidence.curves.link import TESTED, configuration, fiber, link
from evidence.curves.parameters import Parameter, Values
from wire.dispatcher_pb2 import CreateRequest, Gate, MeasureRequest

FIDELITY = Parameter("fidelity", 1.0, 0.25, 1.0)
FIRST, SECOND = (Parameter(f"{name}_fidelity", 1.0, 0.25, 1.0) for name in ("first", "second"))
IDENTITY, FLIP = 0, 1
H, S, S_DAG = (Gate(name=name) for name in (Gate.H, Gate.S, Gate.S_DAG))
# How each cardinal state is made of |0>, and brought back to |0> or |1>.
CARDINAL: list[tuple[int, list[Gate], list[Gate]]] = [
    (pauli, gates, back)
    for pauli in (IDENTITY, FLIP)
    for gates, back in (([], []), ([H], [H]), ([H, S], [S_DAG, H]))
]
BASES = (MeasureRequest.X, MeasureRequest.Y, MeasureRequest.Z)


async def teleport(values: Values, seed: int) -> Outcome:
    """Teleport each cardinal state equally often and count how often it comes out right."""
    p = theory.of_fidelity(number(values, "fidelity"))
    laboratory = link({"depolarizing": p}, seed)
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    each = int(values["pairs"]) // len(CARDINAL)
    right = 0
    for number_of, (pauli, gates, back) in enumerate(CARDINAL):
        pair, state = 2 * number_of, 2 * number_of + 1
        await alice.create(each, pair)
        await alice.send({(pair, 1): TESTED[0]})
        await bob.receive((pair, 1), TESTED[1])
        await alice.create(each, state, CreateRequest.ZEROS)
        await alice.apply((state, 0), np.full(each, pauli, np.uint8), gates)
        correction = await alice.bell_measure((state, 0), (pair, 0))
        await bob.apply((pair, 1), correction, back)
        right += int(np.count_nonzero(await bob.measure((pair, 1)) == pauli))
    return {"teleported": proportion(right, each * len(CARDINAL))}


async def swap(values: Values, seed: int) -> Outcome:
    """Join pairs charlie-alice and charlie-bob; measure the fidelity of alice-bob with Phi+."""
    laboratory = _star(number(values, FIRST.name), number(values, SECOND.name), seed)
    alice, bob, charlie = map(laboratory.host, ("alice", "bob", "charlie"))
    each = int(values["pairs"]) // len(BASES)
    agreeing = []
    for number_of, basis in enumerate(BASES):
        first, second = 2 * number_of, 2 * number_of + 1
        await _share(charlie, alice, each, first, "charlie-q0", "alice-q0")
        await _share(charlie, bob, each, second, "charlie-q1", "bob-q0")
        correction = await charlie.bell_measure((first, 0), (second, 0))
        await bob.apply((second, 1), correction)
        mine, yours = await alice.measure((first, 1), basis), await bob.measure((second, 1), basis)
        # In the Y basis the halves of Phi+ disagree.
        agreeing.append(_equal(mine, yours ^ np.uint8(basis == MeasureRequest.Y)))
    return {"swapped": fidelity_of(agreeing)}


def fidelity_of(agreeing: list[Estimate]) -> Estimate:
    """Return F = (1 + <XX> - <YY> + <ZZ>)/4 of how often each correlation was as in Phi+."""
    value = (1 + sum(2 * each.value - 1 for each in agreeing)) / 4
    return Estimate(value, sum(each.error**2 for each in agreeing) ** 0.5 / 2)


def _equal(mine: Bytes, yours: Bytes) -> Estimate:
    return proportion(int(np.count_nonzero(mine == yours)), len(mine))


def _star(first: float, second: float, seed: int) -> Laboratory:
    depolarizing = (theory.of_fidelity(first), theory.of_fidelity(second))
    fibers = [
        fiber("charlie-q0", "alice-q0", depolarizing=depolarizing[0]),
        fiber("charlie-q1", "bob-q0", depolarizing=depolarizing[1]),
    ]
    return Laboratory(configuration(seed, fibers))


async def _share(
    giver: LaboratoryHost, taker: LaboratoryHost, pairs: int, block: int, out: str, into: str
) -> None:
    await giver.create(pairs, block)
    await giver.send({(block, 1): out})
    await taker.receive((block, 1), into)


TELEPORT = Experiment(
    "teleport",
    "teleportation by Werner pairs, averaged over the six cardinal states",
    (FIDELITY, pairs_parameter()),
    (
        Measure(
            "teleported",
            "average fidelity of the teleported state",
            lambda values: theory.teleported_fidelity(number(values, "fidelity")),
        ),
    ),
    teleport,
)
SWAP = Experiment(
    "swap",
    "entanglement swapping of two Werner pairs",
    (FIRST, SECOND, pairs_parameter()),
    (
        Measure(
            "swapped",
            "fidelity of the swapped pair",
            lambda values: theory.swapped_fidelity(
                number(values, "first_fidelity"), number(values, "second_fidelity")
            ),
        ),
    ),
    swap,
)
