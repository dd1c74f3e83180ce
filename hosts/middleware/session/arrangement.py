"""Light for a session that this host opens: the paths, and the pair source that belongs to it."""

import asyncio
import math
from collections.abc import Coroutine, Iterator
from dataclasses import dataclass, replace
from random import Random
from typing import Any

from hosts.hardware.replies import HardwareError, Symbols
from hosts.middleware.session.channel import MetadataChannel
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.offers import at_wavelength
from hosts.middleware.session.values import announced
from hosts.network_loop import now_s, retry_pause
from hosts.timeouts import (
    ANSWER_TIMEOUT_S,
    DISCOVERY_TIMEOUT_S,
    DOUBT_S,
    FREEING_TIMEOUT_S,
    LONGEST_RETRY_PAUSE_S,
    RETRY_PAUSE_S,
)
from wire.metadata.blocks import Emission, Emit, Emitted
from wire.metadata.setup import Answer, Setup
from wire.metadata.values import Values
from wire.metadata.vocabulary import MemoryState, Reason, Service
from wire.services import is_relayed


def growing_pauses(asker: str) -> Iterator[float]:
    """Yield pauses in seconds, each half to all of a time that doubles up to the longest.

    Random, so that hosts that were refused together do not ask together again (exponential back-off
    with jitter); by the name of who asks, so that each asker's are its own, and can be had again.
    Long waits end in equal pauses: the longest is the same for all.
    """
    chance = Random(asker)  # noqa: S311
    most_s = RETRY_PAUSE_S
    while True:
        yield most_s * chance.uniform(0.5, 1.0)
        most_s = min(2 * most_s, LONGEST_RETRY_PAUSE_S)


@dataclass
class Light:
    """The light of a host, which its sessions have one after the other."""

    freed_s: float = -math.inf  # when a session last freed it, of the network's clock

    def free(self) -> None:
        """Note that a session which this host took part in is over."""
        self.freed_s = now_s()


class Arrangement:
    """The connections of a session that this host opens: to its peer, and to the pair source."""

    channel: MetadataChannel  # to the peer, once it is open

    def __init__(self, setup: Setup, peer: tuple[str, str], source: str, light: Light) -> None:
        """Prepare it; peer is name and address, source a name."""
        self._setup, self._peer, self.source, self._light = setup, peer, source, light
        self._pairs: MetadataChannel | None = None
        self._source_turn = asyncio.Lock()
        self._questions: set[asyncio.Task[None]] = set()
        self._further: set[MetadataChannel] = set()  # to the peer

    @property
    def peer(self) -> str:
        return self._peer[0]

    async def open(self, timeout_s: float = ANSWER_TIMEOUT_S) -> Answer:
        """Arrange light paths; return what the peer accepts in time, or raise SessionError.

        Fibres that the controller is still discovering are waited for, and so is light of a session
        that this host was in until now: the controller may hear of its end after the next request.
        """
        began_s = now_s()
        deadlines_s = {Reason.UNKNOWN_HOST: began_s + DISCOVERY_TIMEOUT_S}
        if began_s - self._light.freed_s < FREEING_TIMEOUT_S:
            deadlines_s[Reason.BUSY] = began_s + FREEING_TIMEOUT_S
        pauses = growing_pauses(f"{self._setup.session}")
        while True:
            channel = await MetadataChannel.connect(*self._peer)
            try:
                answer = await channel.request(self._setup, timeout_s)
                self._setup = at_wavelength(self._setup, answer)
            except BaseException as error:
                channel.close()
                if not isinstance(error, SessionError):
                    raise
                left_s = deadlines_s.get(error.reason, -math.inf) - now_s()
                if left_s <= 0:
                    raise
                await retry_pause(next(pauses), left_s)
            else:
                self.channel = channel
                return answer

    async def engage_source(self) -> None:
        """Connect to the pair source of the session; raise SessionError if it refuses."""
        self._pairs = await MetadataChannel.connect(self.source, self._setup.source)
        relayed = is_relayed(Service(self._setup.service))
        memory = MemoryState.RELAYED if relayed else self._setup.memory
        await self._pairs.request(replace(self._setup, service=Service.PAIR_SOURCE, memory=memory))

    async def emit(self, block: int, pairs: int) -> None:
        """Have the source make a block of pairs; return when its light has left."""
        assert self._pairs is not None
        rate_hz = self._setup.rate_hz
        async with self._source_turn:  # its answers carry no number
            emit = Emit(self._setup.session, block, pairs, rate_hz)
            await self._pairs.request(emit, ANSWER_TIMEOUT_S + pairs / rate_hz)

    def begin(self, block: int, pairs: int, under_way: int) -> Coroutine[Any, Any, None]:
        """Have the source make a block of pairs; return the wait until its light has left.

        Where several blocks may be under way, the source tells nothing unless it is asked.
        """
        if under_way == 1:
            return self.emit(block, pairs)
        assert self._pairs is not None
        self._pairs.send(Emission(self._setup.session, block, pairs, self._setup.rate_hz))
        return self._left(block, pairs, under_way)

    async def _left(self, block: int, pairs: int, under_way: int) -> None:
        """Ask the source when light is late; wait until all up to this block has left."""
        light_s = pairs / self._setup.rate_hz
        await asyncio.sleep(DOUBT_S + light_s)
        question, timeout_s = Emitted(self._setup.session, block), under_way * light_s
        asking = asyncio.create_task(self._ask_source(question, ANSWER_TIMEOUT_S + timeout_s))
        self._questions.add(asking)
        asking.add_done_callback(self._answered)
        await asyncio.shield(asking)  # who waits no more leaves no answer to others

    def _answered(self, asking: asyncio.Task[None]) -> None:
        self._questions.discard(asking)
        if not asking.cancelled():
            asking.exception()  # nobody may wait for it any more

    async def _ask_source(self, question: Emitted, timeout_s: float) -> None:
        assert self._pairs is not None
        async with self._source_turn:  # its answers carry no number
            await self._pairs.request(question, timeout_s)

    async def announce(self, block: int, pulses: int) -> Symbols:
        """Have the relay tell the Bell state of each pair of pulses; NO_COINCIDENCE for none."""
        assert self._pairs is not None
        rate_hz = self._setup.rate_hz
        async with self._source_turn:  # its answers carry no number
            emit = Emit(self._setup.session, block, pulses, rate_hz)
            await self._pairs.request(emit, ANSWER_TIMEOUT_S + pulses / rate_hz)
            arrived = await self._pairs.receive(Values, ANSWER_TIMEOUT_S)
            reply = await self._pairs.receive(Values, ANSWER_TIMEOUT_S)
            return announced(arrived, reply, block, pulses)

    async def join(self, setup: Setup) -> tuple[MetadataChannel, Answer]:
        """Open a further connection to the peer; return it, and what is answered to its set-up.

        It has a light path of its own, or keeps that of the session up.
        """
        channel = await MetadataChannel.connect(*self._peer)
        self._further.add(channel)
        return channel, await channel.request(setup)

    async def leave(self, channel: MetadataChannel, seen: bool) -> None:
        """Close a further connection; `seen`: and wait until the peer has closed it, too."""
        if seen:
            await channel.end()
        channel.close()
        self._further.discard(channel)

    def leave_all(self) -> None:
        while self._further:
            self._further.pop().close()

    async def give_up(self, error: SessionError | HardwareError) -> None:
        """Tell the peer, if there is a session yet, why it ends."""
        if hasattr(self, "channel"):
            await self.channel.give_up(error)

    def close(self) -> None:
        for asking in self._questions:
            asking.cancel()
        self.leave_all()
        if self._pairs is not None:
            self._pairs.close()
        if hasattr(self, "channel"):
            self.channel.close()
            self._light.free()
