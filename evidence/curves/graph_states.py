"""Graph states of a line of hosts: a pair for each edge, swapped and fused at the hosts."""

from collections.abc import Sequence
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dispatcher.laboratory import BlockKey, LaboratoryHost, block_id
from dispatcher.sabot.backend import Bytes
from evidence.curves.estimates import Estimate
from evidence.curves.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from evidence.curves.ghz import NOISE, line
from evidence.curves.parameters import Parameter, Values
from evidence.curves.superdense import blocks
from hosts.middleware.services.graph_states.graph import NAMED, Graph
from hosts.middleware.services.graph_states.witness import Stabilisers
from wire.dispatcher_pb2 import Gate, MeasureRequest

SHAPE = Parameter("graph", "ring", choices=tuple(NAMED))
HOSTS = Parameter("hosts", 4, 3, 6)
PHASE = 2  # Z, as a Pauli operator


class End(NamedTuple):
    """Half of an edge's pair at a host, and the host that has the other."""

    block: BlockKey
    far: int


async def fuse(values: Values, seed: int) -> Outcome:
    """Make graph states, and measure a stabiliser of each."""
    graph = _graph(values)
    hosts, ways = line(int(values[HOSTS.name]), seed, depolarizing=number(values, NOISE.name))
    random, tally, first = np.random.default_rng(seed), Stabilisers(graph), 0
    for size in blocks(int(values["pairs"])):
        kept = await states(graph, hosts, ways, first, size)
        first += graph.pairs
        bases = tally.bases(random, size)
        found = [
            await host.measure(name, bases=own)
            for host, name, own in zip(hosts, kept, bases, strict=True)
        ]
        tally.add(bases, np.vstack(found))
    summary = tally.summary()
    return {"fidelity": Estimate(summary["fidelity"], summary["fidelity_error"])}


def _graph(values: Values) -> Graph:
    hosts = int(values[HOSTS.name])
    return Graph(hosts, tuple(NAMED[str(values[SHAPE.name])](hosts)))


async def states(
    graph: Graph,
    hosts: Sequence[LaboratoryHost],
    ways: Sequence[tuple[str, str]],
    first: int,
    size: int,
) -> list[BlockKey]:
    """Make states of pairs that are numbered from the first on; return the block of each host."""
    flips = np.zeros((graph.hosts, size), dtype=np.uint8)
    ends: list[list[End]] = [[] for _ in hosts]
    for a, b in graph.edges:
        numbers = range(first, first := first + b - a)
        for place, pair in enumerate(numbers, a):
            await hosts[place].create(size, pair)
            await hosts[place].send({(pair, 1): ways[place][0]})
            await hosts[place + 1].receive((pair, 1), ways[place][1])
        for place, (came, own) in enumerate(pairwise(numbers), a + 1):
            flips[b] ^= await _joined(hosts[place], (came, 1), (own, 0))
            flips[a] ^= await hosts[place].measure((came, 1), MeasureRequest.X)
        await hosts[b].apply((numbers[-1], 1), gates=[Gate(name=Gate.H)])
        ends[a].append(End((numbers[0], 0), b))
        ends[b].append(End((numbers[-1], 1), a))
    for host, (kept, *others) in zip(hosts, ends, strict=True):
        for end in others:
            flips[end.far] ^= await _joined(host, kept.block, end.block)
    for host, (kept, *_others), own_flips in zip(hosts, ends, flips, strict=True):
        await host.apply(kept.block, paulis=own_flips * PHASE)
    return [kept.block for kept, *_others in ends]


async def _joined(host: LaboratoryHost, kept: BlockKey, other: BlockKey) -> Bytes:
    """Return what a half is measured to be after CX from another one."""
    await host.apply(kept, gates=[Gate(name=Gate.CX, target=block_id(other))])
    return await host.measure(other)


def fidelity(values: Values) -> float:
    """Return the mean of all stabilisers, which keep 1 - p for each link of edges they touch."""
    graph, kept = _graph(values), 1 - number(values, NOISE.name)
    chosen = np.array(list(product((False, True), repeat=graph.hosts)))
    links: NDArray[np.int64] = sum(
        ((chosen[:, a] | chosen[:, b]) * (b - a) for a, b in graph.edges),
        start=np.zeros(len(chosen), np.int64),
    )
    return float((kept**links).mean())


GRAPH = Experiment(
    "graph",
    "graph states of a line of hosts",
    (NOISE, SHAPE, HOSTS, pairs_parameter(40_000)),
    (Measure("fidelity", "fidelity to the graph state", fidelity),),
    fuse,
)
