"""A round of BBPSSW at the two ends of a link, by their gates and readings, which err."""

from typing import Any

from evidence.curves import theory
from evidence.curves.estimates import Estimate, proportion
from evidence.curves.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from evidence.curves.gated_bell import TWO
from evidence.curves.gated_swap import MISREAD
from evidence.curves.nested import FIDELITY, Chain
from evidence.curves.parameters import Values
from evidence.curves.teleportation import BASES, fidelity_of
from hosts.middleware.services.distribution.purification import PHOTONS, Protocol
from wire.dispatcher_pb2 import MeasureRequest
from wire.parameters.physics import Gates

ENDS = (0, 1)


async def purify(values: Values, seed: int) -> Outcome:
    """Purify pairs, and measure a third of what is left in each basis."""
    misread = number(values, MISREAD.name)
    like: dict[str, Any] = {TWO.name: number(values, TWO.name), MISREAD.name: misread}
    chain = Chain(1, number(values, FIDELITY.name), seed, Gates("any", **like))
    made = PHOTONS * int(values["pairs"]) // len(BASES)
    kept, agreeing = 0, []
    for block, basis in enumerate(BASES):
        pairs = await chain.link(0, made, block)
        for half, end in enumerate(ENDS):  # readings are of what is kept
            await chain.nodes[end].host.store((block, half))
        left = await chain.purify(ENDS, (block, block), pairs, Protocol.BBPSSW)
        mine, yours = [
            await chain.nodes[end].host.measure((block, half), basis)
            for half, end in enumerate(ENDS)
        ]
        right = int(((mine ^ yours) == (basis == MeasureRequest.Y)).sum())
        kept += left
        agreeing.append(proportion(right, left))
    # Two readings spoil each correlation.
    read, seen = (1 - 2 * misread) ** 2, fidelity_of(agreeing)
    fidelity = Estimate(1 / 4 + (seen.value - 1 / 4) / read, seen.error / read)
    return {"fidelity": fidelity, "success": proportion(kept, made * len(BASES) // PHOTONS)}


def expected(values: Values) -> tuple[float, float]:
    return theory.purified(*(number(values, each.name) for each in (FIDELITY, TWO, MISREAD)))


PURIFICATION = Experiment(
    "purification",
    "a round of BBPSSW by gates and readings that err",
    (FIDELITY, TWO, MISREAD, pairs_parameter(60_000)),
    (
        Measure("fidelity", "fidelity of the pairs kept", lambda values: expected(values)[0]),
        Measure("success", "pairs kept, of each two", lambda values: expected(values)[1]),
    ),
    purify,
)
