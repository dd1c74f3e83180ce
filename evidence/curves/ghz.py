"""GHZ states of a line of hosts, by fusing pairs over links that depolarise."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dispatcher.laboratory import BlockKey, Laboratory, LaboratoryHost, block_id
from dispatcher.sabot.backend import Bytes
from evidence.curves.estimates import Estimate, proportion
from evidence.curves.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from evidence.curves.link import configuration, fiber
from evidence.curves.parameters import Parameter, Values
from evidence.curves.superdense import blocks
from hosts.middleware.services.ghz.witness import Tally, chosen_bases
from wire.dispatcher_pb2 import Gate
from wire.parameters.physics import Device

NOISE = Parameter("depolarizing", 0.0, 0.0, 1.0)
HOSTS = Parameter("hosts", 3, 3, 8)


async def fuse(values: Values, seed: int) -> Outcome:
    """Send half of each pair to the next host, fuse where two pairs meet, measure stabilisers."""
    hosts, ways = line(int(values[HOSTS.name]), seed, depolarizing=number(values, NOISE.name))
    random, tally = np.random.default_rng(seed), Tally()
    for block, size in enumerate(blocks(int(values["pairs"]))):
        kept, _there = await states(hosts, ways, block * len(ways), size)
        bases = chosen_bases(random, len(hosts), size)
        found = [
            await host.measure(name, bases=own)
            for host, name, own in zip(hosts, kept, bases, strict=True)
        ]
        tally.add(bases, np.vstack(found))
    equal, right = proportion(tally.equal, tally.in_z), proportion(tally.right, tally.in_x)
    error = float(np.hypot(equal.error / 2, right.error))
    return {"fidelity": Estimate(float(tally.summary()["fidelity"]), error), "equal": equal}


def line(
    count: int, seed: int, device: Device | None = None, **optics: Any
) -> tuple[list[LaboratoryHost], list[tuple[str, str]]]:
    """Return hosts in a line, and the ports of the fibres between neighbours; all are alike."""
    names = [f"h{each}" for each in range(count)]
    ways = [(f"{a}-q1", f"{b}-q0") for a, b in pairwise(names)]
    devices = dict.fromkeys(names, device) if device is not None else None
    laboratory = Laboratory(configuration(seed, [fiber(*way, **optics) for way in ways], devices))
    return [laboratory.host(name) for name in names], ways


async def states(
    hosts: Sequence[LaboratoryHost], ways: Sequence[tuple[str, str]], first: int, size: int
) -> tuple[list[BlockKey], NDArray[np.bool_]]:
    """Make states of a line of hosts, of blocks of pairs that are numbered from the first on.

    Return the block of each host, and for which states every fusion was seen; shape (size,).
    """
    for place, way in enumerate(ways):
        await hosts[place].create(size, first + place)
        await hosts[place].send({(first + place, 1): way[0]})
        await hosts[place + 1].receive((first + place, 1), way[1])
    flips, there = np.zeros(size, dtype=np.uint8), np.ones(size, dtype=bool)
    for place, host in enumerate(hosts[1:]):
        bits = await _joined(host, first + place, flips, place + 2 == len(hosts))
        there &= bits <= 1
        flips = flips ^ np.where(bits <= 1, bits, 0).astype(np.uint8)
    return [(first, 0), *((first + place, 1) for place in range(len(ways)))], there


async def _joined(host: LaboratoryHost, pair: int, flips: Bytes, last: bool) -> Bytes:
    """Fuse the half that came with the next pair, and correct it; return what was measured."""
    bits = np.zeros_like(flips)
    if not last:
        cx = Gate(name=Gate.CX, target=block_id((pair + 1, 0)))
        await host.apply((pair, 1), gates=[cx])
        bits = await host.measure((pair + 1, 0))
    await host.apply((pair, 1), paulis=flips)
    return bits


def _fidelity(values: Values) -> float:
    p, links = number(values, NOISE.name), number(values, HOSTS.name) - 1
    return float(((1 - p / 2) ** links + (1 - p) ** links) / 2)


def _equal(values: Values) -> float:
    return float((1 - number(values, NOISE.name) / 2) ** (number(values, HOSTS.name) - 1))


GHZ = Experiment(
    "ghz",
    "GHZ states of a line of hosts",
    (NOISE, HOSTS, pairs_parameter(40_000)),
    (
        Measure("fidelity", "fidelity to GHZ", _fidelity),
        Measure("equal", "outcomes in Z that are equal", _equal),
    ),
    fuse,
)
