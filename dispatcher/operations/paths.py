"""The way that light has just now: from fibre to fibre by the cross-connects that are open."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from dispatcher.fiber.noise import Loss
from dispatcher.layer.layer import PhysicalLayer
from dispatcher.layer.network import Line
from dispatcher.switch.optical_switch import OpticalSwitch
from wire.config import FiberEnd

MAX_FIBERS = 64  # light in a ring of cross-connects has faded by then


def nanoseconds(delay_ps: float) -> int:
    return round(delay_ps / 1e3)


class Crossing(NamedTuple):
    switch: OpticalSwitch
    in_port: int
    out_port: int
    delay_ps: float  # from the beginning to it
    transmission: float  # from the beginning to its output


class Step(NamedTuple):
    line: Line
    delay_ps: float  # from the beginning to its far end
    transmission: float
    crossing: Crossing | None


def path_of(layer: PhysicalLayer, start: FiberEnd, frequency_mhz: int) -> Iterator[Step]:
    """Yield the fibres of the way on which light of a colour leaves a port just now."""
    now = np.array([layer.clock.now_ns()])
    end: FiberEnd | None = start
    delay_ps, transmission = 0.0, 1.0
    for _ in range(MAX_FIBERS):
        line = layer.network.line(end) if end is not None else None
        if line is None or not line.passes(frequency_mhz):
            return
        delay_ps += line.delay_ps
        for model in line.noise.values():
            if isinstance(model, Loss):
                transmission *= model.transmission
        crossing, end = None, None
        switch = layer.network.switches.get(line.far.node)
        in_port = int(line.far.port) if switch is not None else 0
        if switch is not None and (out_port := switch.timeline.connections.get(in_port)):
            through = float(switch.transmission(in_port, out_port, now, frequency_mhz)[0])
            crossing = Crossing(switch, in_port, out_port, delay_ps, transmission * through)
            end = FiberEnd(switch.name, str(out_port))
        yield Step(line, delay_ps, transmission, crossing)
        if crossing is not None:
            transmission = crossing.transmission
