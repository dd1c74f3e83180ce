"""The messages of key distribution on the connection of a session, at either end.

They travel in envelopes, as a stream that is cut anywhere. What they mean is decided in
hosts.middleware.qkd; here a failure there becomes one that the application is told.
"""

import asyncio
from collections.abc import Awaitable, Callable, Iterator

from hosts.middleware.qkd.alice import Alice
from hosts.middleware.qkd.bob import Bob
from hosts.middleware.qkd.end import State
from hosts.middleware.session.errors import SessionError, unexpected
from hosts.middleware.session.service import End
from hosts.timeouts import KEYS_TIMEOUT_S
from wire.metadata import Answer, Envelope, MalformedPacket, Message, Reason, Topic
from wire.qkd import AbortReason, message_length

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
    """Cuts a stream of bytes into messages of wire.qkd."""

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
    """Yield messages as the other end will feed them to its cutter."""
    for data in messages:
        for start in range(0, len(data), PIECE_BYTES):
            yield Envelope(session, Topic.KEYS, data[start : start + PIECE_BYTES])


class KeyMessages:
    """Carries what one end of key distribution says and hears."""

    def __init__(
        self,
        end: End,
        keys: Alice | Bob,
        when_done: Callable[[], Awaitable[None]],  # before this end says that it has the key
        cutter: Cutter | None = None,
    ) -> None:
        self._end, self._keys, self._when_done = end, keys, when_done
        self._cutter = cutter or Cutter()
        self._answers = 0  # that nobody has waited for

    def say(self, messages: list[bytes]) -> None:
        """Send messages of this end; SessionError if they are its last, without a key."""
        for envelope in in_envelopes(self._end.setup.session, messages):
            self._end.channel.send(envelope)
        failure = self._keys.failure
        if failure is not None:
            words = f"{self._end.channel.peer} has ended it: " if failure.by_peer else ""
            reason = REASONS.get(failure.reason, Reason.PROTOCOL)
            raise SessionError(reason, f"no key: {words}{failure.text}")

    def give_up(self, text: str) -> None:
        """Tell the other end that there will be no key, unless this end has said so."""
        for envelope in in_envelopes(self._end.setup.session, self._keys.cancel(text)):
            self._end.channel.send(envelope)

    async def hear(self, envelope: Envelope) -> None:
        """Take what the other end says and answer it."""
        if envelope.topic != Topic.KEYS:
            raise SessionError(Reason.PROTOCOL, f"an envelope of topic {envelope.topic}")
        try:
            for data in self._cutter.feed(envelope.content):
                await self.hear_message(data)
        except MalformedPacket as error:
            self.give_up(str(error))
            raise SessionError(Reason.PROTOCOL, f"no key: {error}") from error

    async def hear_message(self, data: bytes) -> None:
        """Take one message and answer it; correcting errors does not hold the stack up."""
        was = self._keys.state
        answers = await asyncio.to_thread(self._keys.receive, data)
        if self._keys.state is State.DONE is not was:
            await self._when_done()
        self.say(answers)

    async def until(self, done: Callable[[], bool], timeout_s: float = KEYS_TIMEOUT_S) -> None:
        """Take messages until something is so; no message may be so late."""
        while not done():
            await self._take(await self._end.channel.receive(Message, timeout_s))

    async def answered(self) -> None:
        """Take messages until the other end has accepted what was asked last."""
        await self.until(lambda: self._answers > 0)
        self._answers -= 1

    async def _take(self, message: Message) -> None:
        match message:
            case Envelope():
                await self.hear(message)
            case Answer(reason=Reason.OK):
                self._answers += 1
            case _:
                raise unexpected(message, self._end.channel.peer)
