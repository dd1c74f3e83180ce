"""Distributed phase sensing: the error of the mean phase of a line of hosts.

With GHZ states the sum of phases is one fringe; with separate probes each host has its own. All are
measured in the middle of their fringes, where hosts come to measure after some blocks, and what is
lost at detectors is lost as a whole state, or as one probe.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import pi, sqrt

import numpy as np
from numpy.typing import NDArray

from dispatcher.laboratory import BlockKey, Laboratory, LaboratoryHost
from dispatcher.operations.emission import STATES
from dispatcher.sabot.backend import Bytes
from evidence.curves.estimates import Estimate
from evidence.curves.experiment import Experiment, Measure, Outcome, number
from evidence.curves.ghz import states
from evidence.curves.link import configuration, fiber
from evidence.curves.parameters import Parameter, Values
from hosts.middleware.services.sensing.fringe import QUARTER, Fringe, in_rad, in_steps
from hosts.middleware.services.sensing.protocol import GHZ, PROBES
from wire.dispatcher_pb2 import Gate, MeasureRequest
from wire.parameters.physics import Detectors, Device, Sensor

KIND = Parameter("probes", GHZ, choices=PROBES)
HOSTS = Parameter("hosts", 3, 2, 8)
NOISE = Parameter("depolarizing", 0.0, 0.0, 0.9)
EFFICIENCY = Parameter("efficiency", 1.0, 0.1, 1.0)
COUNT = Parameter("states", 200, 50, 1_000_000)  # for one estimate
ESTIMATES = Parameter("estimates", 250, 20, 1_000_000)
BLOCK = 8192
PHASE_STEP_RAD = 0.2  # from host to host
PLUS = STATES.index("|+>")


@dataclass
class Line:
    """The hosts of a line, and what was measured of them."""

    hosts: list[LaboratoryHost]
    ways: list[tuple[str, str]]
    number: int = 0  # of the next block

    async def ghz(self, count: int, steps: int) -> Bytes:
        """Return parities of `count` states, 2 where one was not seen, at an angle."""
        found, missing = [np.zeros(0, np.uint8)], count
        while missing > 0:
            size = min(missing, BLOCK)
            kept, there = await states(self.hosts, self.ways, self.number, size)
            self.number += len(self.ways)
            angles = [steps, *[0] * (len(kept) - 1)]
            outcomes = [
                await exposed(host, block, angle)
                for host, block, angle in zip(self.hosts, kept, angles, strict=True)
            ]
            found.append(parities(np.vstack(outcomes)[:, there]))
            missing -= int(np.count_nonzero(there))
        return np.concatenate(found)[:count]

    async def separate(self, host: LaboratoryHost, count: int, steps: int) -> Bytes:
        """Return outcomes of `count` probes of one host, 2 where one was not seen, at an angle."""
        self.number += 1
        await host.prepare(np.full(count, PLUS, dtype=np.uint8), self.number)
        return parities((await exposed(host, (self.number, 0), steps))[None])


async def exposed(host: LaboratoryHost, block: BlockKey, steps: int) -> Bytes:
    """Let a block take the phase of its host, and measure it at an angle."""
    await host.sense(block)
    await host.apply(block, gates=[Gate(name=Gate.RZ, angle_rad=-in_rad(steps))])
    return await host.measure(block, MeasureRequest.X)


def parities(outcomes: NDArray[np.uint8]) -> Bytes:
    """Return parities of outcomes, shape (hosts, states); 2 where one is missing."""
    return np.where((outcomes <= 1).all(axis=0), outcomes.sum(axis=0) & 1, 2).astype(np.uint8)


async def sense(values: Values, seed: int) -> Outcome:
    """Estimate the mean phase again and again; return how wrong that is."""
    line, phases = _line(values, seed), _phases(values)
    count, estimates = int(values[COUNT.name]), int(values[ESTIMATES.name])
    if values[KIND.name] == GHZ:
        total = float(sum(phases))
        top, middle = in_steps(total), in_steps(total - QUARTER)
        seen = await line.ghz(count * estimates, middle)
        wrong = _wrong(await line.ghz(BLOCK, top), seen.reshape(estimates, count), total)
    else:
        wrong = np.zeros(estimates)
        for host, phase in zip(line.hosts, phases, strict=True):
            top, middle = in_steps(phase), in_steps(phase - QUARTER)
            seen = await line.separate(host, count * estimates, middle)
            reference = await line.separate(host, BLOCK, top)
            wrong += _wrong(reference, seen.reshape(estimates, count), phase)
    error = sqrt(float((wrong**2).mean())) / len(phases)
    return {"mean_error": Estimate(error, error / sqrt(2 * estimates))}


def _wrong(reference: Bytes, seen: NDArray[np.uint8], phase_rad: float) -> NDArray[np.float64]:
    """Return by how much each estimate is wrong; the reference tells the visibility."""
    found = []
    for outcomes in seen:
        fringe = Fringe()
        fringe.add(in_steps(phase_rad), reference[reference <= 1])
        fringe.add(in_steps(phase_rad - QUARTER), outcomes[outcomes <= 1])
        found.append(fringe.phase().phase_rad)
    return (np.array(found) - phase_rad + pi) % (2 * pi) - pi


def _line(values: Values, seed: int) -> Line:
    names = [f"h{each}" for each in range(int(values[HOSTS.name]))]
    ways = [(f"{a}-q1", f"{b}-q0") for a, b in pairwise(names)]
    fibers = [fiber(*way, depolarizing=number(values, NOISE.name)) for way in ways]
    detectors = Detectors(efficiency=number(values, EFFICIENCY.name))
    devices = {
        name: Device(detectors=detectors, sensor=Sensor(phase))
        for name, phase in zip(names, _phases(values), strict=True)
    }
    laboratory = Laboratory(configuration(seed, fibers, devices))
    return Line([laboratory.host(name) for name in names], ways)


def _phases(values: Values) -> Sequence[float]:
    return [PHASE_STEP_RAD * (each + 1) for each in range(int(values[HOSTS.name]))]


def mean_error(values: Values) -> float:
    """Return 1/(V sqrt n) of the fringe: one of n = M eta^N states, or N of n = M eta probes."""
    hosts, count = number(values, HOSTS.name), number(values, COUNT.name)
    efficiency = number(values, EFFICIENCY.name)
    if values[KIND.name] != GHZ:
        return 1 / sqrt(hosts * count * efficiency)
    visibility = (1 - number(values, NOISE.name)) ** (hosts - 1)
    return float(1 / (hosts * visibility * sqrt(count * efficiency**hosts)))


def limits(hosts: int, count: int) -> tuple[float, float]:
    return 1 / (hosts * sqrt(count)), 1 / sqrt(hosts * count)


SENSING = Experiment(
    "sensing",
    "distributed phase sensing by GHZ states, and by separate probes",
    (KIND, HOSTS, NOISE, EFFICIENCY, COUNT, ESTIMATES),
    (Measure("mean_error", "error of the mean phase (rad)", mean_error, logarithmic=True),),
    sense,
)
