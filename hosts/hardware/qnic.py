"""The interface of a QNIC to the middleware, whatever hardware stands behind it.

Every operation is composed of steps, which the hardware performs (primitives.py; paper, section
"Host Nodes"). A service composes beside itself the operations that it alone needs.
"""

import logging
import math
from collections.abc import Mapping, Sequence
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from hosts.hardware import steps
from hosts.hardware.block_name import BlockName
from hosts.hardware.primitives import Primitives
from hosts.hardware.replies import (
    Clicks,
    HardwareError,
    NotHere,
    Outcomes,
    Received,
    Stored,
    Symbols,
    bits_of,
    clicks_of,
    coincidences_of,
    stored_of,
)
from wire.analyser_frames import LocalGate
from wire.dispatcher_pb2 import (
    CompensateRequest,
    DiscardRequest,
    Gate,
    Step,
)
from wire.keyed import KeyedChoices

log = logging.getLogger("qnic")

Positions = NDArray[np.integer]
NO_SESSION = 0


class Qnic(Primitives):
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

    def compensate(self, every_s: float | None) -> None:
        """Have the compensator look now, and from then on so often; None: as its device says."""
        self.begin(NO_SESSION, Step(compensate=CompensateRequest(every_s=every_s)))

    async def send(self, block: BlockName, port: str, rate_hz: int, wavelength_pm: int) -> int:
        """Send photons of this host into a port; return when (ns) the first one left.

        Return when the last photon has left.
        """
        (feedback,) = await self.perform(
            steps.send({block: port}, steps.Pulses(rate_hz, wavelength_pm))
        )
        return int(feedback.first_ns)

    async def receive(self, block: BlockName, port: str, timeout_s: float) -> Received:
        """Take the photons that arrive at a port; raise NoLight if none does."""
        (feedback,) = await self.perform(steps.receive(block, port, timeout_s))
        return Received(feedback.photons, feedback.first_ns, feedback.last_ns)

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
        return coincidences_of(await self.perform(steps.bell_measure(first, second))).outcomes

    async def discard(self, session: int) -> None:
        """Discard all photons of a session, also of those still on their way."""
        await self.perform(Step(discard=DiscardRequest(session=session)))

    async def discard_block(self, session: int, number: int) -> None:
        """Discard both halves of a block, as far as they are here."""
        await discard_blocks(self, steps.halves(session, number))


async def discard_blocks(qnic: Qnic, blocks: Sequence[BlockName]) -> None:
    for block in blocks:
        with suppress(NotHere):
            await qnic.perform(steps.discard(block))


async def release(qnic: Qnic, session: int) -> None:
    """Discard a session at its end; a fault here must not hide why it has ended."""
    try:
        await qnic.discard(session)
    except HardwareError as error:
        log.warning("session %016x: %s", session, error)
