"""The keys of a session that are under way, at either end: several at a time.

Each key has a state machine (applications.qkd) and messages of its own, which carry the number
of the session plus how many keys came before. Steps of their own take the messages of each key in
their order, so that errors of one key are corrected while light is made for the next.

The messages of key distribution on the connection of a session, at either end.

They travel in envelopes, as a stream that is cut anywhere. Their meaning is decided in
applications.qkd; here its failures become errors for the application.
"""

from collections import deque
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass, field
from uuid import UUID

from applications.key_distribution.summary import Progress
from applications.qkd.alice import Alice
from applications.qkd.bob import Bob
from applications.qkd.end import State
from applications.qkd.messages import AbortReason, message_length, unframe
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.protocol import Concurrently, Now, Say, Side, Steps, WaitUntil, Work
from wire.malformed import MalformedPacket
from wire.metadata.values import Envelope, Topic
from wire.metadata.vocabulary import Reason

PIECE_BYTES = 60_000  # of an envelope

REASONS = {
    AbortReason.PARAMETERS: Reason.UNSUPPORTED,
    AbortReason.NOISY: Reason.TOO_NOISY,
    AbortReason.TOO_SHORT: Reason.TOO_NOISY,
    AbortReason.LOCAL: Reason.TOO_NOISY,
    AbortReason.NOT_CORRECTED: Reason.WRONG_DIGEST,
    AbortReason.NO_AUTHENTICATION_KEY: Reason.NOT_ALLOWED,
}


class Cutter:
    """Cuts a stream of bytes into messages of applications.qkd.messages."""

    def __init__(self) -> None:
        self._data = bytearray()

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Yield the messages that are whole now; MalformedPacket for what cannot be one."""
        self._data += data
        while (length := message_length(bytes(self._data[:32]))) and length <= len(self._data):
            message = bytes(self._data[:length])
            del self._data[:length]
            yield message


def in_envelopes(session: int, messages: list[bytes]) -> Iterator[Envelope]:
    for data in messages:
        for start in range(0, len(data), PIECE_BYTES):
            yield Envelope(session, Topic.KEYS, data[start : start + PIECE_BYTES])


def failure_of(keys: Alice | Bob, peer: str) -> SessionError | None:
    """Return the application's error if an end has ended without a key."""
    failure = keys.failure
    if failure is None:
        return None
    prefix = f"{peer} has ended it: " if failure.by_peer else ""
    reason = REASONS.get(failure.reason, Reason.PROTOCOL)
    return SessionError(reason, f"no key: {prefix}{failure.text}")


MAX_UNDER_WAY = 4  # one is sifted, the errors of others are corrected
NUMBERS = 1 << 64

Store = Callable[[int, Alice | Bob], Awaitable[list[UUID]]]  # puts a key into this host's store
WhenDone = Callable[[int, Alice | Bob], Steps[None]]  # before this end says that it has the key


@dataclass
class Making:
    """A key in the making: this end of it, and the other's messages about it."""

    keys: Alice | Bob
    heard: deque[bytes] = field(default_factory=deque)
    busy: bool = False  # with a step; it takes one at a time


class KeysUnderWay:
    """Carries what this end says and hears of its keys, each by its number in the session."""

    def __init__(
        self, side: Side, progress: Progress, when_done: WhenDone, cutter: Cutter | None = None
    ) -> None:
        self._side, self._progress, self._when_done = side, progress, when_done
        self._cutter = cutter or Cutter()
        self._makings: dict[int, Making] = {}

    @property
    def numbers(self) -> list[int]:
        return list(self._makings)

    @property
    def ends(self) -> list[Alice | Bob]:
        return [making.keys for making in self._makings.values()]

    def end_of(self, number: int) -> Alice | Bob:
        """Return this end of a key; SessionError if it is not under way."""
        if number not in self._makings:
            raise SessionError(Reason.PROTOCOL, f"key {number} is not under way")
        return self._makings[number].keys

    def begin(self, number: int, keys: Alice | Bob) -> Steps[None]:
        """Have a key made: take messages about it from now on."""
        self._makings[number] = making = Making(keys)
        yield Concurrently(self._take(number, making))

    def forget(self, number: int) -> None:
        del self._makings[number]

    def step(
        self, number: int, act: Callable[..., list[bytes]], *value: object, quick: bool = False
    ) -> Steps[None]:
        """Have this end of a key take a step, beside all else unless it is quick; say what comes.

        Raise SessionError if that is its last, without a key.
        """
        making = self._makings[number]
        yield WaitUntil(lambda: not making.busy)
        making.busy = True
        was = making.keys.state
        answers = act(*value) if quick else (yield Work(act, value))
        if making.keys.state is State.DONE is not was:
            yield from self._when_done(number, making.keys)
        yield self._said(answers)
        self._progress.note(self.ends, (yield Now()))
        making.busy = False
        if (failed := failure_of(making.keys, self._side.peer)) is not None:
            raise failed

    def hear(
        self, envelope: Envelope, begin: Callable[[int], Steps[None]] | None = None
    ) -> Steps[None]:
        """Hand on what the other end says; `begin` begins a new key."""
        if envelope.topic != Topic.KEYS:
            raise SessionError(Reason.PROTOCOL, f"an envelope of topic {envelope.topic}")
        try:
            for data in self._cutter.feed(envelope.content):
                yield from self.hear_message(data, begin)
        except MalformedPacket as error:
            raise SessionError(Reason.PROTOCOL, f"no key: {error}") from error

    def hear_message(
        self, data: bytes, begin: Callable[[int], Steps[None]] | None = None
    ) -> Steps[None]:
        number = (unframe(data).session - self._side.setup.session) % NUMBERS
        if number not in self._makings and begin is not None:
            yield from begin(number)
        if number not in self._makings:
            raise SessionError(Reason.PROTOCOL, f"a message about key {number}, not under way")
        self._makings[number].heard.append(data)

    def give_up(self, text: str) -> list[Say]:
        """Return the messages that cancel keys at the other end, unless they were sent."""
        return [self._said(keys.cancel(text)) for keys in self.ends]

    def _take(self, number: int, making: Making) -> Steps[None]:
        while self._makings.get(number) is making:
            yield WaitUntil(lambda: making.heard or self._makings.get(number) is not making)
            if making.heard:
                keys, data = making.keys, making.heard.popleft()
                yield from self.step(number, keys.receive, data, quick=keys.is_quick(data))

    def _said(self, messages: list[bytes]) -> Say:
        return Say(tuple(in_envelopes(self._side.setup.session, messages)))
