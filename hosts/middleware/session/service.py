"""The parts of a service: the work of its two ends once their light is granted.

    opener                      controller, switches              acceptor
      | Setup(service) ------ held until the paths are up ----------> |
      | <------------------------------------------------ Answer(OK) |
      |   kind.open(end)          messages and light    kind.accept(end)
      |   applications use what is there, if it leaves anything
      | Finish ----------------------------------------------------> |
      | <------------------------------------------------ Answer(OK) |

A service is a file of hosts/middleware/services that ends in a ServiceKind, and an entry in
wire.services. Superdense coding is one of them: what it leaves for the application that opened it
is a way for bytes.
"""

import asyncio
from collections.abc import Awaitable, Callable, Coroutine, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hosts.hardware.qnic import BlockName, Heralds, NoLight, Qnic, Stored
from hosts.middleware.session.arrangement import Arrangement
from hosts.middleware.session.channel import MetadataChannel
from hosts.middleware.session.errors import SessionError, unexpected
from hosts.middleware.session.host_resources import HostResources
from hosts.middleware.session.lifetimes import Lifetimes
from hosts.middleware.session.values import Numbers, expect, values
from hosts.timeouts import ANSWER_TIMEOUT_S, GRACE_S, LIGHT_TIMEOUT_S
from wire.features import Abilities
from wire.metadata import Answer, Finish, Handshake, Reason, Service, Setup, Topic, Values

Tell = Callable[..., Coroutine[Any, Any, None]]
Answerer = Callable[[dict[str, Any]], Awaitable[dict[str, Any]]]
Join = Callable[[MetadataChannel, Setup], Awaitable[None]]
NO_BYTES = 0, bytes(32)


@dataclass(frozen=True)
class Carrier:
    """A way for bytes that a service leaves for the application that opened it."""

    # Returns when the other end holds every byte.
    send: Callable[[bytes], Coroutine[Any, Any, None]]


@dataclass
class ConnectionEnd:
    """One end of a session's connection: its light, and the other end."""

    qnic: Qnic
    setup: Setup
    channel: MetadataChannel  # to the other end

    def block(self, number: int, half: int = 0) -> BlockName:
        """Return the name of photons of this session."""
        return BlockName(self.setup.session, number, half)

    def say(self, topic: int, block: int, numbers: ArrayLike, width: int) -> None:
        """Tell the other end numbers of so many bits."""
        self.channel.send(self.words(topic, block, numbers, width))

    def words(self, topic: int, block: int, numbers: ArrayLike, width: int) -> Values:
        """Return the message of this session that carries numbers of so many bits."""
        return values(self.setup.session, topic, block, numbers, width)

    async def hear(
        self,
        topic: int,
        block: int,
        count: int | None,
        most: int,
        timeout_s: float = ANSWER_TIMEOUT_S,
    ) -> Numbers:
        """Return the numbers that the other end tells next; SessionError if it tells others."""
        return expect(await self.channel.receive(Values, timeout_s), topic, block, count, most)

    def agree(self) -> None:
        """Answer that what was asked last is accepted."""
        self.channel.send(Answer(self.setup.session, Reason.OK))

    async def stored(self, light: asyncio.Task[Stored], photons: int) -> Stored:
        """Return what has come of light that is over; nothing if no photon has."""
        try:
            async with asyncio.timeout(GRACE_S + photons / self.setup.rate_hz):
                found = await light
        except (NoLight, TimeoutError):
            return Stored(np.zeros(photons, dtype=bool), 0)
        finally:
            light.cancel()
        if found.arrived.size != photons:
            raise SessionError(Reason.PROTOCOL, f"{found.arrived.size} photons, not {photons}")
        return found

    def expect_light(self, name: BlockName, port: str = "") -> asyncio.Task[Stored]:
        """Begin to store the photons that will arrive at a port, the first if none is named."""
        light = self.qnic.receive_into_memory(name, port or self.qnic.ports[0], LIGHT_TIMEOUT_S)
        return asyncio.create_task(light, name=f"light of {name}")

    async def next_values(self) -> Values | None:
        """Return what the opener tells next; None at the end of the session."""
        message = await self.channel.next()
        if isinstance(message, Finish):
            return None
        if not isinstance(message, Values):
            raise unexpected(message, self.channel.peer)
        return message

    @staticmethod
    def coming(message: Values, most: int) -> tuple[int, int]:
        """Return number and size of the block that a message announces."""
        (count,) = expect(message, Topic.COMING, message.block, 1, most).tolist()
        if count == 0:
            raise SessionError(Reason.PROTOCOL, f"block {message.block} has no photons")
        return message.block, count


@dataclass
class End(ConnectionEnd):
    """One end of a session of a service: also its application, and what its host has."""

    means: HostResources
    tell: Tell  # called with fields for the application
    draws: np.random.Generator  # of this host's own choices; they follow from the seed
    summary: dict[str, Any] = field(default_factory=dict)  # for the application, at the end
    # Of wire.device.DeviceReport: what the session has used of this host's device so far.
    counts: Callable[[], Mapping[str, int]] = dict


@dataclass
class OpenerEnd(End):
    """The end that asked for the session."""

    arrangement: Arrangement = field(kw_only=True)
    answer: Answer = field(kw_only=True)  # of the other end, to the set-up
    theirs: Abilities = field(kw_only=True)  # of the other end; nothing where it does not tell
    lifetimes: Lifetimes = field(kw_only=True)  # of its memory, likewise
    is_source: bool = field(kw_only=True)  # this host makes the pairs, and keeps half of each
    sent: tuple[int, bytes] = NO_BYTES  # how many bytes, and their SHA-256: what Finish says

    async def pairs(self, number: int, count: int) -> Stored:
        """Have a block of pairs made for both ends; return what has come of half 0.

        The other end has said that it is ready before any light is made.
        """
        await self.channel.request(values(self.setup.session, Topic.COMING, number, [count], 32))
        if self.is_source:
            return await self._own_pairs(number, count)
        light = self.expect_light(self.block(number))
        try:
            await self.arrangement.emit(number, count)
            return await self.stored(light, count)
        finally:
            light.cancel()

    async def heralded(self, number: int, count: int) -> Heralds:
        """Have pairs heralded with qubits of this host that emit, as many as come; return them.

        The other end's attempt when it has agreed.
        """
        name, port = self.block(number), self.qnic.ports[0]
        await self.channel.request(values(self.setup.session, Topic.COMING, number, [count], 32))
        await self.qnic.attempt(name, port, self.setup.wavelength_pm)
        return await self.arrangement.herald(number, count)

    async def _own_pairs(self, number: int, count: int) -> Stored:
        setup, port = self.setup, self.qnic.ports[-1]
        light = setup.rate_hz, setup.wavelength_pm
        return await self.qnic.share_pairs(setup.session, number, count, port, *light)


@dataclass
class AcceptorEnd(End):
    """The end that was asked."""

    deliver: Callable[[bytes], Awaitable[None]] = field(kw_only=True)  # bytes to the application
    join: Join | None = None  # serves a further connection of the session

    async def announced(self, most: int) -> tuple[int, int] | None:
        """Return number and size of the block that comes next; None at the end of the session."""
        message = await self.next_values()
        if message is None:
            return None
        return self.coming(message, most)


@dataclass(frozen=True)
class ServiceKind:
    """A service: its entry in the vocabulary, its options, what its two ends do."""

    service: Service
    options: type[Any]  # a dataclass; its constructor raises SessionError for what cannot be
    # A service that leaves something to be used returns what answers the application of an end
    # until the opener's application ends the session; its accept returns before Finish, then.
    open: Callable[[OpenerEnd, Any], Awaitable[Answerer | Carrier | None]]
    accept: Callable[[AcceptorEnd], Awaitable[Answerer | None]]
    # What the acceptor says to a set-up; raises SessionError for one that cannot be served.
    accepts: Callable[[HostResources, Setup], Answer] = lambda _means, setup: plain_answer(setup)
    # What the opener refuses before anything is sent, by SessionError.
    check: Callable[[Setup], None] = lambda _setup: None
    handshakes: tuple[Handshake, ...] = (Handshake.FRAMED,)  # ONE_PAIR: those join a session


def plain_answer(setup: Setup) -> Answer:
    """Return that a set-up is accepted, with nothing more to say."""
    return Answer(setup.session, Reason.OK)
