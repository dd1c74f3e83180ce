"""Light of pairs: compositions of steps that make it, modulate it and find coincidences.

The hardware behind a QNIC, which performs steps (wire/dispatcher.proto).

A driver for real equipment has these methods, and inherits all others from Qnic. Blocks of k
photons are named as on the wire: (session, number, half).
"""

from abc import ABC, abstractmethod
from collections.abc import AsyncIterator, Sequence
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from hosts.hardware import steps
from hosts.hardware.operations import BlockName
from hosts.hardware.replies import (
    Coincidences,
    NoLight,
    NotHere,
    Stored,
    Symbols,
    coincidences_of,
    stored_of,
)
from wire.dispatcher_pb2 import (
    AttemptRequest,
    CreateRequest,
    DiscardRequest,
    Feedback,
    Step,
)
from wire.optical import frequency_mhz


class Primitives(ABC):
    """The light ports of a host and its source, modulators, memory and detectors."""

    ports: list[str]  # interface names of the fibres, in order
    cutoff_s: float | None = None  # the memory drops older qubits; None: its own, infinity: none

    @abstractmethod
    async def perform(self, *order: Step) -> list[Feedback]:
        """Perform steps one after the other; return the feedback of each.

        Raise NoLight if the first waits for light and none comes, NotHere if a block is elsewhere,
        HardwareError for other failures. The steps before a failure stay done.
        """

    @abstractmethod
    async def perform_repeatedly(self, session: int, number: int, *order: Step) -> list[Feedback]:
        """Perform steps that receive and measure a block of this number, and maybe the next ones.

        The hardware may perform them for the blocks behind it before the call for these.
        """

    @abstractmethod
    def begin(self, session: int, *order: Step) -> None:
        """Perform steps behind those begun before for a session; return at once.

        Raise HardwareError if one of those has failed.
        """

    @abstractmethod
    async def finish(self, session: int) -> None:
        """Wait until all that was begun is over; raise HardwareError if something has failed."""

    @abstractmethod
    def arrivals(self, port: str) -> AsyncIterator[BlockName]:
        """Yield blocks that arrive at a port after this call, where they wait to be received.

        Raise HardwareError if it cannot go on.
        """

    @abstractmethod
    def give_up(self, *blocks: BlockName) -> None:
        """End the wait for light of these blocks by NoLight.

        An operation that has its light goes on to its end.
        """

    @abstractmethod
    async def look(self, block: BlockName, entangled: bool) -> NDArray[np.complex128]:
        """Return the density matrix of a qubit here, perhaps with all it is entangled with.

        Only where states are simulated, and may be looked at; raise HardwareError otherwise.
        """

    @abstractmethod
    def watch(self, session: int, history: bool, follow: bool) -> AsyncIterator[bytes]:
        """Yield what happens at this host (wire.events), of one session or, with 0, of all.

        History: begin with what is remembered. Follow: go on with what happens. Raise
        HardwareError if it cannot go on.
        """

    @abstractmethod
    async def close(self) -> None:
        """Close the hardware."""


class PairLight(Primitives):
    async def emit_pairs(
        self,
        session: int,
        number: int,
        count: int,
        ports: tuple[str, str],
        rate_hz: int,
        wavelength_pm: int,
    ) -> None:
        """Make count Bell pairs Phi+ and send their halves 0 and 1 into two ports.

        Return when the last photon has left.
        """
        await self.perform(*steps.emission(session, number, count, ports, rate_hz, wavelength_pm))

    async def begin_pairs(
        self,
        session: int,
        number: int,
        count: int,
        ports: tuple[str, str],
        rate_hz: int,
        wavelength_pm: int,
    ) -> None:
        emission = steps.emission(session, number, count, ports, rate_hz, wavelength_pm)
        self.begin(session, *emission)

    async def share_pairs(
        self, session: int, number: int, count: int, port: str, rate_hz: int, wavelength_pm: int
    ) -> Stored:
        """Make count Bell pairs Phi+, store their halves 0, and send halves 1 into a port.

        Return what the memory has taken, when the last photon has left.
        """
        create = CreateRequest(session=session, number=number, count=count)
        near, far = steps.halves(session, number)
        _made, stored, sent = await self.perform(
            Step(create=create),
            steps.store(near, self.cutoff_s),
            steps.send({far: port}, rate_hz, wavelength_pm),
        )
        return stored_of(stored.arrived, sent)

    async def attempt(
        self, block: BlockName, port: str, wavelength_pm: int, count: int, timeout_s: float
    ) -> None:
        """Let qubits of the memory attempt to emit into a port, as half of `count` pairs.

        The block is in the memory when the station has reported it: when it has as many, or its
        time is over, which is the longer one of both ends'.
        """
        attempt = AttemptRequest(
            block=steps.block_id(block),
            port=port,
            frequency_mhz=frequency_mhz(wavelength_pm),
            cutoff_s=self.cutoff_s,
            count=count,
            timeout_s=timeout_s,
        )
        await self.perform(Step(attempt=attempt))

    async def modulate(
        self,
        block: BlockName,
        paulis: Symbols,
        port: str,
        rate_hz: int,
        wavelength_pm: int,
        timeout_s: float,
    ) -> int:
        """Apply one Pauli operator (two bits: X, Z) to each photon that arrives; shape (k,).

        The photons leave by the port they came from. Return the time (ns) at which the first
        one left, when the last has. Raise NoLight if none arrives.
        """
        feedbacks = await self.perform(
            steps.receive(block, port, timeout_s),
            steps.apply(block, paulis),
            steps.send({block: port}, rate_hz, wavelength_pm),
        )
        return int(feedbacks[-1].first_ns)

    async def detect_pairs(
        self,
        session: int,
        number: int,
        ports: tuple[str, str],
        timeout_s: float,
        following: bool = False,
    ) -> Coincidences:
        """Make Bell measurements on the halves 0 and 1 that arrive at two ports.

        Raise NoLight if no photon of a half arrives; what arrived of the other stays.
        Following: the caller asks for the blocks behind this one, too, one after the other, each
        with this time-out; the hardware may measure them as they arrive. To end that, cancel the
        wait for one of them, or discard the session.
        """
        detection = steps.detection(steps.halves(session, number), ports, timeout_s)
        if following:
            return coincidences_of(await self.perform_repeatedly(session, number, *detection))
        return coincidences_of(await self.perform(*detection))

    async def detect_arrivals(
        self, blocks: tuple[BlockName, BlockName], ports: tuple[str, str], timeout_s: float
    ) -> Coincidences:
        """Make Bell measurements on two blocks that arrive at two ports, made by two hosts.

        Raise NoLight if no photon of one of them arrives; what arrived of the other is discarded.
        """
        try:
            return coincidences_of(await self.perform(*steps.detection(blocks, ports, timeout_s)))
        except NoLight:
            await self._discard_blocks(blocks)
            raise

    async def discard(self, session: int) -> None:
        """Discard all photons of a session, also of those still on their way."""
        await self.perform(Step(discard=DiscardRequest(session=session)))

    async def discard_block(self, session: int, number: int) -> None:
        """Discard both halves of a block, as far as they are here."""
        await self._discard_blocks(steps.halves(session, number))

    async def _discard_blocks(self, blocks: Sequence[BlockName]) -> None:
        for block in blocks:
            with suppress(NotHere):
                await self.perform(steps.discard(block))
