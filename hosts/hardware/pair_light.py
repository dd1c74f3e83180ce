"""Light of pairs: compositions of steps that make it, modulate it and find coincidences."""

from collections.abc import Sequence
from contextlib import suppress

from hosts.hardware import steps
from hosts.hardware.operations import BlockName
from hosts.hardware.primitives import Primitives
from hosts.hardware.replies import (
    Coincidences,
    Heralds,
    NoLight,
    NotHere,
    Stored,
    Symbols,
    coincidences_of,
    stored_of,
    symbols_of,
)
from wire.dispatcher_pb2 import (
    AttemptRequest,
    CreateRequest,
    DiscardRequest,
    HeraldRequest,
    Step,
)
from wire.optical import frequency_mhz


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

    async def attempt(self, block: BlockName, port: str, wavelength_pm: int) -> None:
        """Let qubits of the memory attempt to emit into a port, as half of a block to be heralded.

        The block is in the memory when the station has reported it.
        """
        attempt = AttemptRequest(
            block=steps.block_id(block),
            port=port,
            frequency_mhz=frequency_mhz(wavelength_pm),
            cutoff_s=self.cutoff_s,
        )
        await self.perform(Step(attempt=attempt))

    async def herald(
        self, session: int, number: int, count: int, ports: tuple[str, str], timeout_s: float
    ) -> Heralds:
        """Herald at most count pairs of qubits whose light comes to two ports, in this time."""
        request = HeraldRequest(
            session=session, number=number, count=count, ports=ports, timeout_s=timeout_s
        )
        (feedback,) = await self.perform(Step(herald=request))
        return Heralds(symbols_of(feedback), feedback.attempts)

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
