"""The keys of a session that are under way, at either end: several at a time.

Each key has a state machine (hosts.middleware.qkd) and messages of its own, which carry the number
of the session plus how many keys came before. A task for each key takes its messages in their
order, so that errors of one key are corrected while light is made for the next.
"""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field

from hosts.middleware.qkd.alice import Alice
from hosts.middleware.qkd.bob import Bob
from hosts.middleware.qkd.end import State
from hosts.middleware.services.key_distribution.messages import Cutter, failure_of, in_envelopes
from hosts.middleware.services.key_distribution.summary import Progress
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.service import End
from wire.metadata import Envelope, MalformedPacket, Reason, Topic
from wire.qkd import unframe

MAX_UNDER_WAY = 4  # one is sifted, the errors of others are corrected
NUMBERS = 1 << 64

Act = Callable[..., list[bytes]]


@dataclass
class Making:
    """A key in the making: this end of it, and what the other has said of it."""

    keys: Alice | Bob
    heard: asyncio.Queue[bytes] = field(default_factory=asyncio.Queue)
    busy: asyncio.Lock = field(default_factory=asyncio.Lock)  # it takes one step at a time


class KeysUnderWay:
    """Carries what this end says and hears of its keys, each by its number in the session."""

    def __init__(
        self,
        end: End,
        tasks: asyncio.TaskGroup,
        progress: Progress,
        when_done: Callable[[int, Alice | Bob], Awaitable[None]],  # before the end says so
        cutter: Cutter | None = None,
    ) -> None:
        """Take messages from where a cutter is, if some have been read."""
        self._end, self._tasks, self._progress, self._when_done = end, tasks, progress, when_done
        self._cutter = cutter or Cutter()
        self._makings: dict[int, Making] = {}
        self._changed = asyncio.Event()

    @property
    def numbers(self) -> list[int]:
        """Which keys are under way."""
        return list(self._makings)

    @property
    def ends(self) -> list[Alice | Bob]:
        """This end of all keys that are under way."""
        return [making.keys for making in self._makings.values()]

    def end_of(self, number: int) -> Alice | Bob:
        """Return this end of a key; SessionError if it is not under way."""
        if number not in self._makings:
            raise SessionError(Reason.PROTOCOL, f"key {number} is not under way")
        return self._makings[number].keys

    def begin(self, number: int, keys: Alice | Bob) -> None:
        """Have a key made: take messages about it from now on."""
        self._makings[number] = making = Making(keys)
        self._tasks.create_task(self._take(number, making), name=f"key {number}")

    def forget(self, number: int) -> None:
        """Take no more messages about a key."""
        making = self._makings.pop(number)
        making.heard.put_nowait(b"")

    async def step(self, number: int, act: Act, *given: object) -> None:
        """Have this end of a key take a step, beside all else, and say what comes of it.

        Raise SessionError if that is its last, without a key.
        """
        keys = self._makings[number].keys
        async with self._makings[number].busy:
            was = keys.state
            answers = await _to_the_end(asyncio.to_thread(act, *given))
            if keys.state is State.DONE is not was:
                await self._when_done(number, keys)
            self._say(answers)
        self._progress.note(self.ends)
        self.wake()
        if (failed := failure_of(keys, self._end.channel.peer)) is not None:
            raise failed

    def hear(self, envelope: Envelope, begin: Callable[[int], None] | None = None) -> None:
        """Hand on what the other end says; `begin` is called with the number of a new key."""
        if envelope.topic != Topic.KEYS:
            raise SessionError(Reason.PROTOCOL, f"an envelope of topic {envelope.topic}")
        try:
            for data in self._cutter.feed(envelope.content):
                self.hear_message(data, begin)
        except MalformedPacket as error:
            raise SessionError(Reason.PROTOCOL, f"no key: {error}") from error

    def hear_message(self, data: bytes, begin: Callable[[int], None] | None = None) -> None:
        """Hand on one message."""
        number = (unframe(data).session - self._end.setup.session) % NUMBERS
        if number not in self._makings and begin is not None:
            begin(number)
        if number not in self._makings:
            raise SessionError(Reason.PROTOCOL, f"a message about key {number}, not under way")
        self._makings[number].heard.put_nowait(data)

    def give_up(self, text: str) -> None:
        """Tell the other end that keys will not be made, unless it was told."""
        for keys in self.ends:
            self._say(keys.cancel(text))

    def wake(self) -> None:
        """Have those who wait look again."""
        self._changed.set()

    async def until(self, done: Callable[[], bool]) -> None:
        """Wait until something is so; who reads messages has a deadline for each of them."""
        while not done():
            self._changed.clear()
            await self._changed.wait()

    async def _take(self, number: int, making: Making) -> None:
        while data := await making.heard.get():
            await self.step(number, making.keys.receive, data)
            if self._makings.get(number) is not making:
                return

    def _say(self, messages: list[bytes]) -> None:
        for envelope in in_envelopes(self._end.setup.session, messages):
            self._end.channel.send(envelope)


async def _to_the_end(work: Awaitable[list[bytes]]) -> list[bytes]:
    """Return what a thread returns; if nobody waits any more, it is over all the same."""
    going = asyncio.ensure_future(work)
    try:
        return await asyncio.shield(going)
    except asyncio.CancelledError:
        with suppress(asyncio.CancelledError):
            await going
        raise


@asynccontextmanager
async def together() -> AsyncIterator[asyncio.TaskGroup]:
    """Run tasks of which the first to fail ends all; that failure is raised as it is."""
    try:
        async with asyncio.TaskGroup() as tasks:
            yield tasks
    except BaseExceptionGroup as failures:
        raise failures.exceptions[0] from failures
