"""The acceptor of superdense coding: it receives bytes, as receiver.py says; opener.py's mirror.

Its analyser waits for the light of the next block before there is word of it, as detectors do.
"""

import asyncio

import numpy as np

from hosts.hardware.qnic import Coincidences, NoLight, Symbols
from hosts.middleware.services.superdense.options import arrival_ports
from hosts.middleware.services.superdense.per_pair import cancelled
from hosts.middleware.services.superdense.receiver import (
    Collect,
    Discard,
    Measure,
    Receiver,
    answer_to,
    check_offer,
)
from hosts.middleware.session.blocks import RESERVED
from hosts.middleware.session.channel import MetadataChannel
from hosts.middleware.session.encoding import DISTINGUISHABLE_STATES
from hosts.middleware.session.ends import AcceptorEnd
from hosts.middleware.session.errors import SessionError, unexpected
from hosts.middleware.session.host_resources import HostResources
from hosts.timeouts import (
    ARRIVED_TIMEOUT_S,
    EXPECTED_TIMEOUT_S,
    OUTCOME_TIMEOUT_S,
    PAIR_TIMEOUT_S,
)
from wire.metadata.blocks import Block, Finish
from wire.metadata.setup import Answer, Setup
from wire.metadata.vocabulary import Handshake, Reason

FIRST_BLOCK = 1
Ahead = asyncio.Task[Coincidences | None]


def accepted(resources: HostResources, setup: Setup) -> Answer:
    """Return what is said to a set-up, by what this host's analyser can do; or SessionError."""
    symbols = DISTINGUISHABLE_STATES[resources.analyser]
    check_offer(setup, symbols)
    return answer_to(setup, symbols, setup.rotation)


async def accept_bytes(end: AcceptorEnd) -> None:
    """Receive bytes until the sender has finished; raise SessionError if it does not."""
    acceptor = Acceptor(end)
    try:
        await acceptor.run()
    finally:
        end.summary = acceptor.receiver.statistics
        acceptor.close()


class Acceptor:
    """Carries out what a receiver orders: with this host's Bell analyser."""

    def __init__(self, end: AcceptorEnd) -> None:
        self._end, self._qnic, self._channel, self._setup = end, end.qnic, end.channel, end.setup
        symbols = DISTINGUISHABLE_STATES[end.resources.analyser]
        self.receiver = Receiver(end.setup, symbols, end.channel.peer)
        self._singles: dict[int, asyncio.Task[Symbols]] = {}
        self._expected: tuple[int, Ahead] | None = None  # a block, and its light
        end.counts, end.join = self.receiver.counts, self.one_pair

    async def run(self) -> None:
        """Receive until the sender has finished; raise SessionError if it does not."""
        self._expect(FIRST_BLOCK)
        while True:
            message = await self._channel.next()
            if isinstance(message, Block):
                symbols = await self._carry_out(self.receiver.block(message))
                self._expect(message.block + 1)
                data, report = self.receiver.arrived(symbols)
                if data:
                    await self._end.deliver(data)
                self._channel.send(report)
            elif isinstance(message, Finish):
                self.receiver.finish(message)
                return
            else:
                raise unexpected(message, self._channel.peer)

    def close(self) -> None:
        """Cancel handshakes under way."""
        for task in self._singles.values():
            task.cancel()
        if self._expected is not None:
            self._expected[1].cancel()

    async def one_pair(self, channel: MetadataChannel, setup: Setup) -> None:
        """Serve the handshake of a single pair: accept, wait for its end, measure."""
        answer, order = self.receiver.join(setup, channel.peer)
        single = asyncio.create_task(self._single(channel, answer, order))
        self._singles[setup.block] = single
        await asyncio.wait([single])

    async def _carry_out(self, order: Measure | Discard | Collect) -> Symbols:
        """Do what a block needs; return its symbols."""
        match order:
            case Measure():
                return await self._measure(order)
            case Collect():
                return await self._collect(order.numbers)
            case Discard():
                light = self._taken(order.block)
                if light is not None:
                    await cancelled([light])
                await self._qnic.discard_block(self._setup.session, order.block)
                return np.empty(0, dtype=np.uint8)

    def _expect(self, block: int) -> None:
        """Begin to wait for the light of a block; single pairs have handshakes of their own."""
        if self._setup.handshake == Handshake.FRAMED and block < RESERVED:
            self._expected = block, asyncio.create_task(self._ahead(block))

    async def _ahead(self, block: int) -> Coincidences | None:
        """Return what comes of a block of which nobody has told yet; None: nothing for long."""
        try:
            return await self._light(block, EXPECTED_TIMEOUT_S, following=True)
        except NoLight:
            return None

    async def _measure(self, order: Measure) -> Symbols:
        try:
            found = await self._found(order.block)
        except NoLight:
            await self._qnic.discard_block(self._setup.session, order.block)
            return self.receiver.read(order, None)
        return self.receiver.read(order, found.outcomes)

    async def _found(self, block: int) -> Coincidences:
        """Return what has come of a block, which is here by now or lost: it was sent."""
        light = self._taken(block)
        if light is None:
            return await self._light(block, ARRIVED_TIMEOUT_S)
        await asyncio.wait([light], timeout=OUTCOME_TIMEOUT_S)
        if light.done() and (found := light.result()) is not None:
            return found
        # If light was here, its outcome comes before what is asked now is answered.
        asked = asyncio.create_task(self._light(block, ARRIVED_TIMEOUT_S))
        try:
            await asyncio.wait([light, asked], return_when=asyncio.FIRST_COMPLETED)
            return (light.result() if light.done() else None) or await asked
        finally:
            await cancelled([light, asked])

    def _taken(self, block: int) -> Ahead | None:
        """Return the light of a block if it is expected; nothing is any more then."""
        if self._expected is None:
            return None
        (number, light), self._expected = self._expected, None
        if number != block:
            light.cancel()
            return None
        return light

    async def _light(self, block: int, timeout_s: float, following: bool = False) -> Coincidences:
        ports, session = arrival_ports(self._setup, self._qnic.ports), self._setup.session
        return await self._qnic.detect_pairs(session, block, ports, timeout_s, following)

    async def _single(self, channel: MetadataChannel, answer: Answer, order: Measure) -> Symbols:
        channel.send(answer)
        await channel.next(PAIR_TIMEOUT_S)  # the sender closes when the light has left
        return await self._measure(order)

    async def _collect(self, numbers: range) -> Symbols:
        tasks = [self._singles.pop(number) for number in numbers]
        try:
            async with asyncio.timeout(PAIR_TIMEOUT_S):
                return np.concatenate(await asyncio.gather(*tasks))
        except TimeoutError as error:
            raise SessionError(
                Reason.PROTOCOL,
                f"pairs up to {numbers[-1]} were not over in {PAIR_TIMEOUT_S:g} s",
            ) from error
