"""The interface of a QNIC to the middleware, whatever hardware stands behind it.

Every operation is composed of steps, which the hardware performs (pair_light.py; paper, section
"Host Nodes").
"""

import logging
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from hosts.hardware import steps
from hosts.hardware.operations import OUTCOMES, BlockName, Operation
from hosts.hardware.pair_light import PairLight
from hosts.hardware.replies import (
    Clicks,
    Coincidences,
    HardwareError,
    Outcomes,
    Received,
    Stored,
    Symbols,
    bits_of,
    clicks_of,
    coincidences_of,
    stored_of,
    symbols_of,
)
from wire.analyser_frames import LocalGate
from wire.dispatcher_pb2 import (
    CompensateRequest,
    CreateRequest,
    Gate,
    MeasureRequest,
    ResendRequest,
    SenseRequest,
    SplitRequest,
    Step,
    TellRequest,
)
from wire.keyed import KeyedChoices

log = logging.getLogger("qnic")

Positions = NDArray[np.integer]
LEFT_ALONE = 255  # instead of a basis
MAX_STEPS = 64  # in one order
NO_SESSION = 0


@dataclass(frozen=True)
class Directions:
    """Directions on the Bloch sphere, of k photons; both of shape (k,)."""

    theta_rad: NDArray[np.float64]  # from |0>
    phi_rad: NDArray[np.float64]  # about the Z axis, from |+>


class Qnic(PairLight):
    async def prepare(
        self, session: int, number: int, states: Symbols, levels: Symbols | None = None
    ) -> BlockName:
        """Make a photon in each of these states (half 0), at this host; shape (k,).

        States: 0 |0>, 1 |1>, 2 |+>, 3 |->, 4 |+i>, 5 |-i>. Levels, shape (k,): the intensity of
        each pulse, 0 the source's mean, 1 and 2 its decoys; None: 0 for all.
        """
        name = BlockName(session, number, 0)
        await self.perform(steps.prepare(name, states, levels))
        return name

    async def prepare_by_key(self, session: int, number: int, choices: KeyedChoices) -> BlockName:
        """Make a photon (half 0) in each of the states that a key chooses, at this host."""
        name = BlockName(session, number, 0)
        await self.perform(steps.prepare_by_key(name, choices))
        return name

    async def prepare_along(self, session: int, number: int, directions: Directions) -> BlockName:
        """Make a photon (half 0) in cos(theta/2) |0> + exp(i phi) sin(theta/2) |1> for each."""
        name = BlockName(session, number, 0)
        theta, phi = directions.theta_rad, directions.phi_rad
        zeros = CreateRequest(session=session, number=number, count=theta.size)
        zeros.state = CreateRequest.ZEROS
        about_y, about_z = Gate(name=Gate.RY, angles_rad=theta), Gate(name=Gate.RZ, angles_rad=phi)
        await self.perform(Step(create=zeros), steps.apply(name, None, about_y, about_z))
        return name

    def compensate(self, every_s: float | None) -> None:
        """Have the compensator look now, and from then on so often; None: as its device says."""
        self.begin(NO_SESSION, Step(compensate=CompensateRequest(every_s=every_s)))

    async def send(self, block: BlockName, port: str, rate_hz: int, wavelength_pm: int) -> int:
        """Send photons of this host into a port; return when (ns) the first one left.

        Return when the last photon has left.
        """
        (feedback,) = await self.perform(steps.send({block: port}, rate_hz, wavelength_pm))
        return int(feedback.first_ns)

    async def receive(self, block: BlockName, port: str, timeout_s: float) -> Received:
        """Take the photons that arrive at a port; raise NoLight if none does."""
        (feedback,) = await self.perform(steps.receive(block, port, timeout_s))
        return Received(feedback.photons, feedback.first_ns, feedback.last_ns)

    async def resend(self, block: BlockName, bases: Symbols) -> Symbols:
        """Measure photons at this host and put new ones in their places, in the states found.

        Each has a basis (0 Z, 1 X, 2 Y) or is left alone (255); shape (k,). Return 0 or 1 for
        each, 255 where none was measured or no detector clicked: there, no photon is left.
        """
        resend = ResendRequest(block=steps.block_id(block), bases=bases.tobytes())
        (feedback,) = await self.perform(Step(resend=resend))
        return symbols_of(feedback)

    async def split(self, block: BlockName, into: BlockName) -> Symbols:
        """Count the photons of each pulse at this host; return the counts, shape (k,).

        One photon of each pulse that has several goes into a new block, in the place of its pulse.
        """
        split = SplitRequest(block=steps.block_id(block), into=steps.block_id(into))
        (feedback,) = await self.perform(Step(split=split))
        return symbols_of(feedback)

    async def receive_into_memory(self, block: BlockName, port: str, timeout_s: float) -> Stored:
        """Store the photons that arrive at a port; raise NoLight if none does.

        From then on they decohere until they are used.
        """
        _received, stored = await self.perform(
            steps.receive(block, port, timeout_s), steps.store(block, self.cutoff_s)
        )
        return stored_of(stored.arrived, stored)

    async def apply(self, block: BlockName, paulis: Symbols) -> int:
        """Apply one Pauli operator (two bits: X, Z) to each photon at this host; shape (k,).

        Return when (ns) that was done.
        """
        (feedback,) = await self.perform(steps.apply(block, paulis))
        return int(feedback.time_ns)

    async def rotate(self, block: BlockName, gates: Sequence[LocalGate]) -> None:
        """Apply gates, one after the other, to every photon of a block at this host."""
        await self.perform(steps.apply(block, None, *(Gate(name=gate) for gate in gates)))

    async def controlled_x(self, control: BlockName, target: BlockName) -> None:
        """Apply CX to pairs of photons of two blocks of one size at this host."""
        gate = Gate(name=Gate.CX, target=steps.block_id(target))
        await self.perform(steps.apply(control, None, gate))

    async def store(self, block: BlockName, for_good: bool = False) -> Stored:
        """Put photons at this host into memory, where they decohere until they are used.

        Those that are too old are dropped, unless they are stored for good.
        """
        cutoff_s = math.inf if for_good else self.cutoff_s
        (feedback,) = await self.perform(steps.store(block, cutoff_s))
        return stored_of(feedback.arrived, feedback)

    async def gather(
        self, into: BlockName, picks: Mapping[BlockName, Positions], keep_rest: bool = False
    ) -> None:
        """Make a block of photons at this host, by their positions in blocks, in this order.

        The rest is discarded or, to be kept, stays where it is; at least one photon is picked.
        Photons picked from stored blocks alone are stored, too.
        """
        picked = [steps.pick(block, positions) for block, positions in picks.items()]
        await self.perform(steps.gather(into, picked, keep_rest))

    async def measure(self, block: BlockName, bases: Symbols) -> Symbols:
        """Measure photons at this host, each in a basis (0 Z, 1 X, 2 Y); shape (k,).

        Return 0 or 1 for each, 255 where no detector clicked; the photons are used up.
        """
        return (await self.outcomes(block, bases)).outcomes

    async def outcomes(
        self, block: BlockName, bases: Symbols, paulis: Symbols | None = None
    ) -> Outcomes:
        """Measure photons as `measure` does, behind Pauli operators, if any; also say when."""
        first = () if paulis is None else (steps.apply(block, paulis),)
        feedbacks = await self.perform(*first, steps.measure(block, bases))
        return Outcomes(bits_of(feedbacks[-1]), feedbacks[0].time_ns)

    async def measure_along(
        self, block: BlockName, directions: Directions, paulis: Symbols
    ) -> Outcomes:
        """Apply Paulis to photons at this host, and measure each along its direction.

        Return 0 for one found in its direction and 1 for the opposite, 255 where no detector
        clicked, and when; the photons are used up.
        """
        theta, phi = -directions.theta_rad, -directions.phi_rad
        about_z, about_y = Gate(name=Gate.RZ, angles_rad=phi), Gate(name=Gate.RY, angles_rad=theta)
        measure = MeasureRequest(block=steps.block_id(block), basis=MeasureRequest.Z)
        applied, measured = await self.perform(
            steps.apply(block, paulis, about_z, about_y), Step(measure=measure)
        )
        return Outcomes(symbols_of(measured), applied.time_ns)

    async def sense(self, block: BlockName) -> None:
        """Let photons at this host take the phase of its sensor, which is not reported."""
        await self.perform(Step(sense=SenseRequest(block=steps.block_id(block))))

    async def measure_at(self, block: BlockName, angle_rad: float) -> Symbols:
        """Measure photons at this host between X (angle 0) and Y (pi/2); shape (k,).

        Return 0 for |0> + exp(i angle) |1> and 1 for the opposite, 255 where no detector clicked;
        the photons are used up.
        """
        turn = Gate(name=Gate.RZ, angle_rad=-angle_rad)
        first = (steps.apply(block, None, turn),) if angle_rad else ()
        measure = MeasureRequest(block=steps.block_id(block), basis=MeasureRequest.X)
        return symbols_of((await self.perform(*first, Step(measure=measure)))[-1])

    async def measure_arrivals(
        self, block: BlockName, port: str, bases: Symbols, timeout_s: float
    ) -> Symbols:
        """Measure the photons that arrive at a port, as `measure` does; NoLight if none does."""
        _received, measured = await self.perform(
            steps.receive(block, port, timeout_s), steps.measure(block, bases)
        )
        return bits_of(measured)

    async def click_arrivals(
        self, block: BlockName, port: str, key: bytes, timeout_s: float
    ) -> Clicks:
        """Measure the photons that arrive at a port in bases of a key; NoLight if none does."""
        _received, measured = await self.perform(
            steps.receive(block, port, timeout_s), steps.measure_by_key(block, key)
        )
        return clicks_of(measured)

    async def bell_measure(self, first: BlockName, second: BlockName) -> Symbols:
        """Make Bell measurements on pairs of photons at this host; shape (k,).

        Return 0 Phi+, 1 Psi+, 2 Phi-, 3 Psi- for each pair, 255 where there was no coincidence.
        """
        return (await self.coincidences(first, second)).outcomes

    async def coincidences(self, first: BlockName, second: BlockName) -> Coincidences:
        """Make Bell measurements as `bell_measure` does; also say when, and how many clicks."""
        return coincidences_of(await self.perform(steps.bell_measure(first, second)))

    async def process(self, operations: Sequence[Operation]) -> list[int]:
        """Do operations on single qubits at this host, one after the other.

        Return the outcome of each measurement: 0 or 1, 255 where no detector clicked. If one
        fails, those before it are done, and those behind it are not.
        """
        outcomes = b""
        for order in _orders(steps.steps_of(operations)):
            outcomes += b"".join(feedback.outcomes for feedback in await self.perform(*order))
        assert len(outcomes) == sum(operation.kind in OUTCOMES for operation in operations)
        return list(outcomes)

    async def tell(self, instructions: str) -> None:
        await self.perform(Step(tell=TellRequest(text=instructions)))


def _orders(coming: Iterator[Step]) -> Iterator[tuple[Step, ...]]:
    """Yield as many steps as an order may have, until there are no more."""
    while order := tuple(islice(coming, MAX_STEPS)):
        yield order


async def release(qnic: Qnic, session: int) -> None:
    """Discard a session at its end; a fault here must not hide why it has ended."""
    try:
        await qnic.discard(session)
    except HardwareError as error:
        log.warning("session %016x: %s", session, error)
