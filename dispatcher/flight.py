"""The way of a block's photons through fibres and switches, photon by photon.

A beam is a part of the block that has taken one way so far. Each beam is resolved when the
clock has passed its last photon, so what the switches did meanwhile is known.
"""

import heapq
from dataclasses import dataclass, field
from functools import cache, partial
from itertools import count

import numpy as np
from numpy.typing import NDArray

from dispatcher.clock import Clock
from dispatcher.network import Line, Network
from dispatcher.noise import NoiseModel
from dispatcher.optical_switch import Light, OpticalSwitch
from dispatcher.ownership import Block
from dispatcher.sabot.draws import Draws
from dispatcher.sabot.registers import Mask
from dispatcher.sabot.simulation import Simulation
from wire.config import FiberEnd

MAX_FIBERS = 64  # light in a ring of cross-connects has faded by then


@dataclass(frozen=True)
class Departure:
    """When photons leave (photon k at start_ns + k / rate_hz), and their colour."""

    start_ns: int
    rate_hz: int
    photons: int
    frequency_mhz: int

    @property
    def last_ns(self) -> int:
        """Return when the last photon leaves."""
        return self.start_ns + int((self.photons - 1) * (1e9 / self.rate_hz))

    def times_ns(self, delay_ns: int) -> NDArray[np.int64]:
        """Return when each photon is where it comes to after a delay, shape (k,)."""
        offsets = (np.arange(self.photons) * (1e9 / self.rate_hz)).astype(np.int64)
        offsets += self.start_ns + delay_ns
        return offsets


@dataclass
class Beam:
    """Photons of one block on one way."""

    line: Line  # the fibre they are in
    delay_ns: int  # from their departure to the fibre's far end
    members: Mask
    fibers_passed: int
    errors: NDArray[np.int64] = field(default_factory=lambda: np.zeros(4, dtype=np.int64))


@dataclass(frozen=True)
class Arrival:
    """What of a block has come to one port."""

    end: FiberEnd
    members: Mask
    times_ns: NDArray[np.int64]
    fibers_passed: int
    errors: NDArray[np.int64]  # how often each Pauli happened on the way


class Flight:
    """Takes one block from a port to all the ports where its light comes out."""

    def __init__(
        self, block: Block, departure: Departure, network: Network, sabot: Simulation, draws: Draws
    ) -> None:
        """Prepare the flight of a block that has left."""
        self._block, self._departure = block, departure
        self._network, self._sabot, self._draws = network, sabot, draws
        self._queue: list[tuple[int, int, Beam]] = []
        self._number = count()
        self.lost = 0

    def launch(self, end: FiberEnd) -> None:
        """Let the light into the fibre that begins at a port."""
        everything = np.ones(self._departure.photons, dtype=bool)
        self._enter(end, everything, 0, self._block.fibers_passed)

    async def next_arrival(self, clock: Clock) -> Arrival | None:
        """Wait for the next beam to come out at a node, None if no light is left."""
        while self._queue:
            time_ns, _number, beam = heapq.heappop(self._queue)
            await clock.wait_until(time_ns)
            self._pass(beam, beam.line.noise)
            if not self._lit(beam.members):
                continue
            switch = self._network.switches.get(beam.line.far.node)
            if switch is None:
                times_ns = self._departure.times_ns(beam.delay_ns)
                return Arrival(
                    beam.line.far, beam.members, times_ns, beam.fibers_passed, beam.errors
                )
            self._cross(beam, switch)
        return None

    def _cross(self, beam: Beam, switch: OpticalSwitch) -> None:
        """Send a beam on through the switch that it has come to."""
        in_port = int(beam.line.far.port)
        members = beam.members & self._block.register.present
        if beam.fibers_passed >= MAX_FIBERS:
            switch.lose(in_port, int(np.count_nonzero(members)))
            self._lose(members)
            return
        times_ns = self._departure.times_ns(beam.delay_ns)
        light = Light(members, times_ns, self._departure.frequency_mhz)
        # Photons of one block that leave by several ports share their draws.
        uniform = cache(partial(self._uniform, "switch", beam.fibers_passed))
        for out_port, leaving in switch.cross(in_port, light, uniform).items():
            members &= ~leaving
            if rotation := switch.rotation(in_port, out_port):
                paulis = leaving * np.uint8(rotation)
                place = f"rotation of {switch.name}, {in_port} -> {out_port}"
                self._sabot.explain(self._block.register, place, paulis)
                self._sabot.pauli(self._block.register, paulis)
            end = FiberEnd(switch.name, str(out_port))
            self._enter(end, leaving, beam.delay_ns, beam.fibers_passed, beam.errors)
        if members.any():
            self._sabot.explain(self._block.register, f"in {switch.name}", members)
            self._lose(members)

    def _enter(
        self,
        end: FiberEnd,
        members: Mask,
        delay_ns: int,
        fibers_passed: int,
        errors: NDArray[np.int64] | None = None,
    ) -> None:
        line = self._network.line(end)
        if line is None:
            self._lose(members)
            return
        beam = Beam(line, delay_ns + line.delay_ns, members, fibers_passed + 1)
        if errors is not None:
            beam.errors += errors
        time_ns = self._departure.last_ns + beam.delay_ns
        heapq.heappush(self._queue, (time_ns, next(self._number), beam))

    def _pass(self, beam: Beam, noise: tuple[NoiseModel, ...]) -> None:
        """Apply what a fibre does to the photons of a beam."""
        block = self._block
        way = f"{beam.line.far.port} of {beam.line.far.node}"
        for model in noise:
            place = f"{type(model).__name__.lower()} in the fibre to {way}"
            effect = model.effect(partial(self._uniform, "fiber", beam.fibers_passed))
            if effect.lost is not None:
                lost = effect.lost & beam.members
                self._sabot.explain(block.register, place, lost)
                self._lose(lost)
            if effect.paulis is not None:
                paulis = effect.paulis * (beam.members & block.register.present)
                beam.errors += np.bincount(paulis, minlength=4)
                self._sabot.explain(block.register, place, paulis)
                self._sabot.pauli(block.register, paulis)

    def _uniform(self, where: str, fibers_passed: int, purpose: str) -> NDArray[np.float64]:
        """Draw a number for each photon of the block, for a purpose at one point of its way."""
        key = f"{where} {fibers_passed} {purpose}"
        return self._draws.uniform(self._block.name, key, self._departure.photons)

    def _lose(self, members: Mask) -> None:
        self.lost += self._sabot.lose(self._block.register, members)

    def _lit(self, members: Mask) -> bool:
        return bool((members & self._block.register.present).any())
