"""The opener of superdense coding: it sends bytes, as sender.py says.

    alice                      charlie (source)             bob
      | Setup(SDC) -- held by the controller until the paths are up --> |
      | <--------------- Answer (symbols and operators that bob can use) |
      | Setup(PAIR_SOURCE) ------> |                                    |
      | Emission ----------------> | pairs: half 0 to alice, half 1 to bob
      | <-- light, half 0 -------- | -- light, half 1 ----------------> |
      | Pauli operators, then light, half 0 --------------------------> |
      | Block (what it carried) --------------------------------------> |
      | <------------------------------------------ Report (what came)  |

The source answers nothing. If light does not come, it is asked whether it is over (Emitted).

With the handshake per-pair every pair has a Setup(ONE_PAIR) connection of its own, and the
paths stay up only as long as that connection (paper, figure "handshaking").
"""

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from copy import copy

from hosts.hardware.operations import BlockName
from hosts.hardware.qnic import NoLight, Symbols
from hosts.middleware.services.superdense.framing import BLOCKS_UNDER_WAY
from hosts.middleware.services.superdense.options import SEQUENTIAL, SuperdenseOptions, sent_half
from hosts.middleware.services.superdense.per_pair import Agreed, PerPair, cancelled
from hosts.middleware.services.superdense.sender import Light, Sender, Singles
from hosts.middleware.session.ends import Carrier, OpenerEnd
from hosts.network_loop import now_s
from hosts.timeouts import DOUBT_S, GRACE_S, LIGHT_TIMEOUT_S, REPORT_TIMEOUT_S
from wire.metadata.blocks import Report
from wire.results.figures import SenderFigures


async def open_bytes(end: OpenerEnd, options: SuperdenseOptions) -> Carrier:
    """Prepare the sending of bytes; return the way for them."""
    return Carrier(Opener(end, options.handshake == SEQUENTIAL).send)


class Opener:
    """Carries out what a sender orders: with the pairs of a source, and the other end's reports."""

    def __init__(self, end: OpenerEnd, sequential: bool = False) -> None:
        """Raise SessionError if the receiver does not say what its analyser can do.

        Sequential: of handshakes of single pairs, each begins when the one before it is over.
        """
        self._end, self._qnic, self._setup, self._channel = end, end.qnic, end.setup, end.channel
        self._sender = Sender(end.setup, end.answer, end.arrangement.peer, now_s())
        self._per_pair = PerPair(self._shake_hands, self._pair, sequential)
        end.counts, end.summary = self._counts, self._summary()
        end.sent = self._sender.sent

    async def send(self, data: bytes) -> None:
        """Send bytes; return when the other end holds every one of them."""
        self._sender.send(data)
        under_way: deque[asyncio.Task[None]] = deque()
        try:
            while True:
                if (order := self._sender.next_order()) is not None:
                    before = under_way[-1] if under_way else None
                    under_way.append(asyncio.create_task(self._carry_out(order, before)))
                elif under_way:
                    await under_way[0]
                    under_way.popleft()
                    report = await self._channel.receive(Report, REPORT_TIMEOUT_S)
                    self._sender.heard(report, now_s())
                else:
                    break
        finally:
            await cancelled(under_way)
            self._end.summary = self._summary()
        self._end.sent = self._sender.sent

    def _summary(self) -> SenderFigures:
        return copy(self._sender.statistics)

    def _counts(self) -> Mapping[str, int]:
        """Return what was used so far, as the device reports it."""
        statistics = self._sender.statistics
        return {
            "pairs_sent": statistics.bell_pairs,
            "pairs_lost": statistics.lost_pairs,
            "symbol_errors": statistics.symbol_errors,
            "repeated_frames": statistics.repeated_frames,
        }

    async def _carry_out(self, order: Light | Singles, before: asyncio.Task[None] | None) -> None:
        """Make light, and tell the receiver of it; blocks keep their order."""
        if isinstance(order, Singles):
            self._tell(await self._per_pair.send(order))
            return
        async with self._begun(order.block, order.paulis.size) as over:
            try:
                emitted_ns = await self._light_of(order, before, over)
            except NoLight as error:
                self._channel.send(self._sender.dark(str(error)))
            else:
                self._tell(emitted_ns)

    def _tell(self, emitted_ns: int) -> None:
        self._channel.send(self._sender.lit(emitted_ns))

    @asynccontextmanager
    async def _begun(self, block: int, pairs: int) -> AsyncIterator[asyncio.Task[None]]:
        """Have the source make a block meanwhile, and ask it only where its light does not come."""
        self._end.arrangement.begin(block, pairs)
        over = asyncio.create_task(self._over(block, pairs))
        try:
            yield over
        finally:
            await cancelled([over])

    async def _over(self, block: int, pairs: int) -> None:
        """Wait until light has left, as its source says when it is late."""
        light_s = pairs / self._setup.rate_hz
        await asyncio.sleep(DOUBT_S + light_s)
        await self._end.arrangement.emitted(block, BLOCKS_UNDER_WAY * light_s)

    @asynccontextmanager
    async def _emission(self, block: int, pairs: int) -> AsyncIterator[asyncio.Task[None]]:
        """Have the source make a block meanwhile, and wait for its answer in the end."""
        emission = asyncio.create_task(self._end.arrangement.emit(block, pairs))
        try:
            yield emission
            await emission
        finally:
            await cancelled([emission])

    async def _light_of(
        self, order: Light, before: asyncio.Task[None] | None, over: asyncio.Task[None]
    ) -> int:
        """Send a block on that is being made, once the one before it has been sent on."""
        if before is not None:
            await asyncio.shield(before)
        if self._sender.is_called_off(order.block):
            await over
            await self._qnic.discard_block(self._setup.session, order.block)
            raise NoLight(f"block {order.block} is called off")
        return await self._light(order.block, order.paulis, over)

    async def _pair(self, number: int, pauli: Symbols) -> int:
        """Have one pair made, modulate this host's half and send it on."""
        async with self._emission(number, pauli.size) as emission:
            return await self._light(number, pauli, emission)

    async def _light(self, number: int, paulis: Symbols, over: asyncio.Task[None]) -> int:
        """Modulate this host's halves of a block that is being made, and send them on."""
        half = BlockName(self._setup.session, number, sent_half(self._setup))
        rate_hz, wavelength_pm = self._setup.rate_hz, self._setup.wavelength_pm
        port = self._qnic.ports[0]
        light = asyncio.create_task(
            self._qnic.modulate(half, paulis, port, rate_hz, wavelength_pm, LIGHT_TIMEOUT_S)
        )
        try:
            # The light may be on its way again before the source has answered.
            await asyncio.wait([over, light], return_when=asyncio.FIRST_COMPLETED)
            if light.done():
                return await light
            await over
            # The source has answered: word of its light is not faster than that itself.
            await asyncio.wait([light], timeout=GRACE_S + paulis.size / rate_hz)
            if not light.done():
                self._qnic.give_up(half)
            return await light
        except NoLight as error:
            raise NoLight(f"no light from {self._end.arrangement.source} at {port}") from error
        finally:
            light.cancel()

    async def _shake_hands(self, number: int) -> Agreed:
        """Make the handshake of one pair; the path stays up until its connection is closed."""
        channel = await self._end.arrangement.another_channel()
        try:
            answer = await channel.request(self._sender.single(number))
            return Agreed(channel, self._sender.single_encoding(answer))
        except BaseException:
            channel.close()
            raise
