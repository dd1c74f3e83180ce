"""Superdense coding over one fibre: two bits a pair."""

from collections.abc import Iterator, Sequence

import numpy as np

from dispatcher.laboratory import LaboratoryHost
from dispatcher.sabot.backend import Bytes
from qmn.sweeps import theory
from qmn.sweeps.estimates import information, mean, proportion
from qmn.sweeps.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from qmn.sweeps.link import LINK, PLAIN, TESTED, is_plain, link
from qmn.sweeps.parameters import Values

BLOCK_PAIRS = 65_536
NO_COINCIDENCE = 255


async def run(values: Values, seed: int) -> Outcome:
    """Send random dibits and count what comes of them."""
    laboratory = link(values, seed)
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    random = np.random.default_rng(seed)
    errors = np.zeros(4, np.int64)  # how often sent XOR received was 0, 1, 2, 3
    pairs = int(values["pairs"])
    for block, size in enumerate(blocks(pairs)):
        sent = random.integers(0, 4, size, dtype=np.uint8)
        received = await transmit(alice, bob, block, sent)
        came = received != NO_COINCIDENCE
        errors += np.bincount((sent ^ received)[came], minlength=4)
    return outcome(errors.tolist(), pairs)


async def transmit(alice: LaboratoryHost, bob: LaboratoryHost, block: int, sent: Bytes) -> Bytes:
    """Send a dibit a pair; return what bob sees, 255 where no pair came; shape (k,)."""
    await alice.create(len(sent), block)
    await alice.apply((block, 0), sent)
    await alice.send({(block, 0): TESTED[0], (block, 1): PLAIN[0]})
    await bob.receive((block, 0), TESTED[1])
    await bob.receive((block, 1), PLAIN[1])
    return await bob.bell_measure((block, 0), (block, 1))


def blocks(pairs: int) -> Iterator[int]:
    """Yield the sizes of the blocks that make up so many pairs."""
    yield from [BLOCK_PAIRS] * (pairs // BLOCK_PAIRS)
    if pairs % BLOCK_PAIRS:
        yield pairs % BLOCK_PAIRS


def outcome(errors: Sequence[int], pairs: int) -> Outcome:
    """Return what follows from the counts of each dibit error (0: none) in so many pairs."""
    came = sum(errors)
    return {
        # The two bits of a dibit are not independent: it counts as one draw.
        "bit_error": mean((0, 0.5, 0.5, 1), errors),
        "dibit_error": proportion(came - errors[0], came),
        "capacity": information(errors),
        "arrived": proportion(came, pairs),
    }


def depolarizing(values: Values) -> float | None:
    """Return the depolarising of pairs that arrive, None if other noise is there too."""
    if not is_plain(values, "depolarizing", "source_fidelity", "length_km", "loss_db_per_km"):
        return None
    source = theory.of_fidelity(number(values, "source_fidelity"))
    return theory.together(number(values, "depolarizing"), source)


def bit_error(values: Values) -> float | None:
    """Return the theory of bit_error."""
    p = depolarizing(values)
    return None if p is None else theory.bit_error(p)


def dibit_error(values: Values) -> float | None:
    """Return the theory of dibit_error."""
    p = depolarizing(values)
    return None if p is None else theory.dibit_error(p)


def capacity(values: Values) -> float | None:
    """Return the theory of capacity."""
    p = depolarizing(values)
    return None if p is None else theory.capacity(p)


def arrived(values: Values) -> float | None:
    """Return the theory of arrived."""
    if depolarizing(values) is None:
        return None
    return theory.transmission(number(values, "length_km") * number(values, "loss_db_per_km"))


SUPERDENSE = Experiment(
    "sdc",
    "superdense coding over one fibre",
    (*LINK, pairs_parameter()),
    (
        Measure("bit_error", "bit error", bit_error),
        Measure("dibit_error", "dibit error", dibit_error),
        Measure("capacity", "capacity (bits per pair)", capacity),
        Measure("arrived", "pairs that arrive", arrived),
    ),
    run,
)
