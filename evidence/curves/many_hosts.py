"""States of a line of hosts, by fusing pairs over their links: GHZ, graphs, keys, sensing.

Over distance: fibres of .2 dB/km, errors of .5 % of a link, detectors as superconducting nanowires
(those of evidence.curves.mdi). States of a conference count that every host has seen, and every
fusion. Sensors are measured in the middle of their fringes, where hosts come to measure after some
blocks; what is lost at detectors is lost as a whole state, or as one probe.
"""

from collections.abc import Sequence
from itertools import pairwise, product
from math import pi, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from applications.ghz.witness import Tally, chosen_bases
from applications.graph_states.graph import NAMED, Graph
from applications.graph_states.witness import Stabilisers
from applications.qkd.conference import asymptotic_rate
from applications.sensing.fringe import QUARTER, Fringe, in_rad, in_steps
from dispatcher.operations.emission import STATES
from dispatcher.sabot.backend import Bytes
from evidence.curves import theory
from evidence.curves.bb84 import ERROR, LOSS_DB_PER_KM
from evidence.curves.estimates import Estimate, of_counts, proportion
from evidence.curves.experiment import Outcome
from evidence.curves.link import blocks, fiber, network, share
from evidence.curves.mdi import DARK_COUNT, DETECTORS, EFFICIENCY
from evidence.curves.parameters import Point
from evidence.laboratory import BlockKey, LaboratoryHost, block_id
from wire.dispatcher_pb2 import Gate, MeasureRequest
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Detectors, Device, Sensor

SENSED_STATES = 8192  # in a block
PHASE_STEP_RAD = 0.2  # from host to host
PHASE = 2  # Z, as a Pauli operator
PLUS = STATES.index("|+>")

Bools = NDArray[np.bool_]
Counts = NDArray[np.int64]  # wrong and right, of the parity in X and of each other host in Z
Theory = dict[str, float]


class Line:
    """Hosts in a row, and the pairs that they make of their links."""

    def __init__(self, devices: Sequence[Device], seed: int, **optics: Any) -> None:
        names = [f"h{each}" for each in range(len(devices))]
        self.ways = [(f"{a}-q1", f"{b}-q0") for a, b in pairwise(names)]
        fibers = [fiber(*way, **optics) for way in self.ways]
        laboratory = network(seed, fibers, **dict(zip(names, devices, strict=True)))
        self.hosts = [laboratory.host(name) for name in names]
        self.number = 0  # of the next pairs

    async def link(self, place: int, pairs: int) -> int:
        """Make pairs of a host and the next; return their number."""
        number, way = self.number, self.ways[place]
        self.number += 1
        await share(self.hosts[place], self.hosts[place + 1], pairs, number, way)
        return number

    async def ghz(self, size: int) -> tuple[list[BlockKey], Bools]:
        """Make states; return the block of each host, and of which all fusions were seen."""
        first, *_others = numbers = [
            await self.link(place, size) for place in range(len(self.ways))
        ]
        flips, there = np.zeros(size, dtype=np.uint8), np.ones(size, dtype=bool)
        for host, pair in zip(self.hosts[1:], numbers, strict=True):
            is_last = host is self.hosts[-1]
            bits = flips * 0 if is_last else await joined(host, (pair, 1), (pair + 1, 0))
            there &= bits <= 1
            await host.apply((pair, 1), paulis=flips)
            flips = flips ^ np.where(bits <= 1, bits, 0).astype(np.uint8)
        return [(first, 0), *((pair, 1) for pair in numbers)], there

    async def graph(self, graph: Graph, size: int) -> list[BlockKey]:
        """Make states of a pair for each edge; return the block of each host."""
        flips = np.zeros((graph.hosts, size), dtype=np.uint8)
        ends: list[list[End]] = [[] for _ in self.hosts]
        for a, b in graph.edges:
            numbers = [await self.link(place, size) for place in range(a, b)]
            for place, (came, half) in enumerate(pairwise(numbers), a + 1):
                flips[b] ^= await joined(self.hosts[place], (came, 1), (half, 0))
                flips[a] ^= await self.hosts[place].measure((came, 1), MeasureRequest.X)
            await self.hosts[b].apply((numbers[-1], 1), gates=[Gate(name=Gate.H)])
            ends[a].append(End((numbers[0], 0), b))
            ends[b].append(End((numbers[-1], 1), a))
        for host, (qubits, *others) in zip(self.hosts, ends, strict=True):
            for end in others:
                flips[end.far] ^= await joined(host, qubits.block, end.block)
        for host, (qubits, *_others), own_flips in zip(self.hosts, ends, flips, strict=True):
            await host.apply(qubits.block, paulis=own_flips * PHASE)
        return [qubits.block for qubits, *_others in ends]

    async def measure(
        self, keys: Sequence[BlockKey], bases: NDArray[np.uint8]
    ) -> NDArray[np.uint8]:
        """Return outcomes of each host in its bases; both of shape (hosts, states)."""
        return np.vstack(
            [
                await host.measure(name, bases=basis)
                for host, name, basis in zip(self.hosts, keys, bases, strict=True)
            ]
        )


class End(NamedTuple):
    """Half of an edge's pair at a host, and the host that has the other."""

    block: BlockKey
    far: int


async def joined(host: LaboratoryHost, key: BlockKey, other: BlockKey) -> Bytes:
    """Fuse two halves at a host by a CX; return what the other one is measured to be."""
    await host.apply(key, gates=[Gate(name=Gate.CX, target=block_id(other))])
    return await host.measure(other)


def line_of(v: Point, seed: int) -> Line:
    return Line([Device()] * int(v.hosts), seed, depolarizing=v.depolarizing)


async def ghz(v: Point, seed: int) -> Outcome:
    line, random, tally = line_of(v, seed), np.random.default_rng(seed), Tally()
    for _block, size in blocks(v.pairs):
        qubits, _there = await line.ghz(size)
        bases = chosen_bases(random, len(line.hosts), size)
        tally.add(bases, await line.measure(qubits, bases))
    equal, right = proportion(tally.equal, tally.in_z), proportion(tally.right, tally.in_x)
    error = float(np.hypot(equal.error / 2, right.error))
    return {"fidelity": Estimate(float(tally.summary()["fidelity"]), error), "equal": equal}


def of_ghz(v: Point) -> Theory:
    p, links = v.depolarizing, v.hosts - 1
    equal = (1 - p / 2) ** links
    return {"fidelity": (equal + (1 - p) ** links) / 2, "equal": equal}


async def graph(v: Point, seed: int) -> Outcome:
    """Make graph states, and measure a stabiliser of each."""
    shape = graph_of(v)
    line, random, tally = line_of(v, seed), np.random.default_rng(seed), Stabilisers(shape)
    for _block, size in blocks(v.pairs):
        qubits = await line.graph(shape, size)
        bases = tally.bases(random, size)
        tally.add(bases, await line.measure(qubits, bases))
    summary = tally.summary()
    return {"fidelity": Estimate(summary["fidelity"], summary["fidelity_error"])}


def graph_of(v: Point) -> Graph:
    hosts = int(v.hosts)
    return Graph(hosts, tuple(NAMED[str(v["graph"])](hosts)))


def of_graph(v: Point) -> Theory:
    """Return the mean of all stabilisers, which keep 1 - p for each link of edges they touch."""
    graph, intact = graph_of(v), 1 - v.depolarizing
    chosen = np.array(list(product((False, True), repeat=graph.hosts)))
    links: NDArray[np.int64] = sum(
        ((chosen[:, a] | chosen[:, b]) * (b - a) for a, b in graph.edges),
        start=np.zeros(len(chosen), np.int64),
    )
    return {"fidelity": float((intact**links).mean())}


async def conference(v: Point, seed: int) -> Outcome:
    counts, _seen = await _compared(line_of(v, seed), v.pairs)
    return _errors(counts) | {"key": _key(counts)}


async def far_conference(v: Point, seed: int) -> Outcome:
    """Use fibres that lose light; a key is of all states that were attempted in Z."""
    devices = [Device(detectors=DETECTORS)] * int(v.hosts)
    line = Line(
        *(devices, seed),
        depolarizing=2 * ERROR,
        length_km=v.length_km,
        loss_db_per_km=LOSS_DB_PER_KM,
    )
    counts, seen = await _compared(line, v.pairs)
    gain, share = proportion(*seen), _key(counts)
    spread = float(np.hypot(gain.error * share.value, gain.value * share.error))
    return _errors(counts) | {"gain": gain, "key": Estimate(gain.value * share.value, spread)}


async def _compared(line: Line, pairs: float) -> tuple[Counts, tuple[int, int]]:
    """Return errors of what all have seen, how many states that were, and how many there were."""
    counts = np.zeros((len(line.hosts), 2), np.int64)
    seen, attempted = 0, 0
    for basis in (MeasureRequest.X, MeasureRequest.Z):
        for _block, size in blocks(int(pairs) // 2):
            qubits, there = await line.ghz(size)
            ends = zip(line.hosts, qubits, strict=True)
            outcomes = np.vstack([await host.measure(name, basis) for host, name in ends])
            there &= (outcomes != NO_CLICK).all(axis=0)
            _count(counts, outcomes[:, there], in_x=basis == MeasureRequest.X)
            seen, attempted = seen + int(there.sum()), attempted + size
    return counts, (seen, attempted)


def _errors(counts: Counts) -> Outcome:
    in_x, *in_z = (proportion(int(wrong), int(wrong + right)) for wrong, right in counts)
    return {"qber_x": in_x, "qber_z": max(in_z, key=lambda estimate: estimate.value)}


def _count(counts: Counts, outcomes: NDArray[np.uint8], *, in_x: bool) -> None:
    """Count what is wrong and right, of outcomes of shape (hosts, states)."""
    wrong = [outcomes.sum(axis=0) & 1] if in_x else list(outcomes[1:] ^ outcomes[:1])
    places = [0] if in_x else range(1, len(counts))
    for place, each in zip(places, wrong, strict=True):
        counts[place] += np.bincount(1 - each, minlength=2)


def _key(counts: Counts) -> Estimate:
    def rate(numbers: NDArray[np.float64]) -> float:
        in_x, *in_z = (wrong / (wrong + right) for wrong, right in numbers)
        return asymptotic_rate(in_x, max(in_z))

    return of_counts(rate, counts)


def of_conference(v: Point) -> Theory:
    """Return Q = (1 - (1 - p)^(N - 1))/2, as each link flips bit, and phase, with p/2.

    The last host differs as often as the parity in X is odd.
    """
    return _tests((1 - (1 - v.depolarizing) ** (v.hosts - 1)) / 2)


def _tests(qber: float) -> Theory:
    key = max(0.0, 1 - 2 * theory.entropy((qber, 1 - qber)))
    return {"qber_x": qber, "qber_z": qber, "key": key}


def of_far_conference(v: Point) -> Theory:
    """Return how likely all see a state, and how often it then has an error of either test.

    A present qubit is measured rightly with r and wrongly with w, a lost one with u as either bit.
    Every lost one leaves the last bit, and the parity in X, to chance; each of N - 1 links has
    another bit, and another phase, with p/2. Of the 2 N - 2 readings, N decide about an error:
    in X those of all hosts, in Z those of the first, of the last and of all fusions between.
    """
    links, dark = int(v.hosts) - 1, DARK_COUNT
    either = dark * (1 - dark) + dark**2 / 2
    wrong = EFFICIENCY * dark / 2 + (1 - EFFICIENCY) * either
    right = EFFICIENCY * (1 - dark / 2) + (1 - EFFICIENCY) * either
    comes = theory.transmission(LOSS_DB_PER_KM * v.length_km)
    seen = right + wrong
    gain = seen**links * (comes * seen + (1 - comes) * 2 * either) ** links
    keeps = (comes * (1 - 2 * ERROR) * seen) ** links * seen**-1 * (right - wrong) ** (links + 1)
    tests = _tests((1 - keeps / gain) / 2)
    return tests | {"gain": gain, "key": gain * tests["key"]}


async def sensing(v: Point, seed: int) -> Outcome:
    """Estimate the mean phase again and again; return how wrong that is.

    With GHZ states the sum of phases is one fringe; with separate probes each host has its own.
    """
    phases = [PHASE_STEP_RAD * (each + 1) for each in range(int(v.hosts))]
    detectors = Detectors(efficiency=v.efficiency)
    devices = [Device(detectors=detectors, sensor=Sensor(phase)) for phase in phases]
    line = Line(devices, seed, depolarizing=v.depolarizing)
    count, estimates = int(v.states), int(v.estimates)
    if v["probes"] == "ghz":
        total = float(sum(phases))
        seen = await _fringe(line, count * estimates, in_steps(total - QUARTER))
        reference = await _fringe(line, SENSED_STATES, in_steps(total))
        wrong = _wrong(reference, seen.reshape(estimates, count), total)
    else:
        wrong = np.zeros(estimates)
        for host, phase in zip(line.hosts, phases, strict=True):
            seen = await _probed(line, host, count * estimates, in_steps(phase - QUARTER))
            reference = await _probed(line, host, SENSED_STATES, in_steps(phase))
            wrong += _wrong(reference, seen.reshape(estimates, count), phase)
    error = sqrt(float((wrong**2).mean())) / len(phases)
    return {"mean_error": Estimate(error, error / sqrt(2 * estimates))}


async def _fringe(line: Line, count: int, steps: int) -> Bytes:
    """Return parities of `count` states, 2 where one was not seen, at an angle."""
    bits, missing = [np.zeros(0, np.uint8)], count
    while missing > 0:
        qubits, there = await line.ghz(min(missing, SENSED_STATES))
        angles = [steps, *[0] * (len(qubits) - 1)]
        exposed = [
            await _exposed(host, block, angle)
            for host, block, angle in zip(line.hosts, qubits, angles, strict=True)
        ]
        bits.append(parities(np.vstack(exposed)[:, there]))
        missing -= int(np.count_nonzero(there))
    return np.concatenate(bits)[:count]


async def _probed(line: Line, host: LaboratoryHost, count: int, steps: int) -> Bytes:
    """Return outcomes of `count` probes of one host, 2 where one was not seen, at an angle."""
    line.number += 1
    await host.prepare(np.full(count, PLUS, dtype=np.uint8), line.number)
    return parities((await _exposed(host, (line.number, 0), steps))[None])


async def _exposed(host: LaboratoryHost, block: BlockKey, steps: int) -> Bytes:
    """Expose a block to the phase of its host, and measure it at an angle."""
    await host.sense(block)
    await host.apply(block, gates=[Gate(name=Gate.RZ, angle_rad=-in_rad(steps))])
    return await host.measure(block, MeasureRequest.X)


def parities(outcomes: NDArray[np.uint8]) -> Bytes:
    """Return parities of outcomes, shape (hosts, states); 2 where one is missing."""
    return np.where((outcomes <= 1).all(axis=0), outcomes.sum(axis=0) & 1, 2).astype(np.uint8)


def _wrong(reference: Bytes, seen: NDArray[np.uint8], phase_rad: float) -> NDArray[np.float64]:
    """Return by how much each estimate is wrong; the reference has the visibility."""
    phases_rad = []
    for outcomes in seen:
        fringe = Fringe()
        fringe.add(in_steps(phase_rad), reference[reference <= 1])
        fringe.add(in_steps(phase_rad - QUARTER), outcomes[outcomes <= 1])
        phases_rad.append(fringe.phase().phase_rad)
    return (np.array(phases_rad) - phase_rad + pi) % (2 * pi) - pi


def of_sensing(v: Point) -> Theory:
    """Return 1/(V sqrt n) of the fringe: one of n = M eta^N states, or N of n = M eta probes."""
    hosts, count, efficiency = v.hosts, v.states, v.efficiency
    if v["probes"] != "ghz":
        return {"mean_error": 1 / sqrt(hosts * count * efficiency)}
    visibility = (1 - v.depolarizing) ** (hosts - 1)
    return {"mean_error": 1 / (hosts * visibility * sqrt(count * efficiency**hosts))}


def limits(hosts: int, count: int) -> tuple[float, float]:
    return 1 / (hosts * sqrt(count)), 1 / sqrt(hosts * count)
