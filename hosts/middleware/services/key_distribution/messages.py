"""The messages of key distribution on the connection of a session, at either end.

They travel in envelopes, as a stream that is cut anywhere. What they mean is decided in
hosts.middleware.qkd; here a failure there becomes one that the application is told.
"""

from collections.abc import Awaitable, Callable, Iterator

from hosts.middleware.qkd.alice import Alice
from hosts.middleware.qkd.bob import Bob
from hosts.middleware.qkd.end import State
from hosts.middleware.session.errors import SessionError, unexpected
from hosts.middleware.session.protocol import Hear, Say, Side, Steps, Wait, Work
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
        side: Side,
        keys: Alice | Bob,
        when_done: Callable[[], Awaitable[None]],  # before this end says that it has the key
        cutter: Cutter | None = None,
    ) -> None:
        self._side, self._keys, self._when_done = side, keys, when_done
        self._cutter = cutter or Cutter()
        self._answers = 0  # that nobody has waited for

    def say(self, messages: list[bytes]) -> Steps[None]:
        """Send messages of this end; SessionError if they are its last, without a key."""
        yield self._said(messages)
        failure = self._keys.failure
        if failure is not None:
            words = f"{self._side.peer} has ended it: " if failure.by_peer else ""
            reason = REASONS.get(failure.reason, Reason.PROTOCOL)
            raise SessionError(reason, f"no key: {words}{failure.text}")

    def give_up(self, text: str) -> Say:
        """Tell the other end that there will be no key, unless this end has said so."""
        return self._said(self._keys.cancel(text))

    def hear(self, envelope: Envelope) -> Steps[None]:
        """Take what the other end says and answer it."""
        if envelope.topic != Topic.KEYS:
            raise SessionError(Reason.PROTOCOL, f"an envelope of topic {envelope.topic}")
        try:
            for data in self._cutter.feed(envelope.content):
                yield from self.hear_message(data)
        except MalformedPacket as error:
            yield self.give_up(str(error))
            raise SessionError(Reason.PROTOCOL, f"no key: {error}") from error

    def hear_message(self, data: bytes) -> Steps[None]:
        """Take one message and answer it; correcting errors does not hold the stack up."""
        was = self._keys.state
        answers = yield Work(self._keys.receive, (data,))
        if self._keys.state is State.DONE is not was:
            yield Wait(self._when_done)
        yield from self.say(answers)

    def until(self, done: Callable[[], bool], timeout_s: float = KEYS_TIMEOUT_S) -> Steps[None]:
        """Take messages until something is so; no message may be so late."""
        while not done():
            yield from self._take((yield Hear(Message, timeout_s)))

    def answered(self) -> Steps[None]:
        """Take messages until the other end has accepted what was asked last."""
        yield from self.until(lambda: self._answers > 0)
        self._answers -= 1

    def _take(self, message: Message) -> Steps[None]:
        match message:
            case Envelope():
                yield from self.hear(message)
            case Answer(reason=Reason.OK):
                self._answers += 1
            case _:
                raise unexpected(message, self._side.peer)

    def _said(self, messages: list[bytes]) -> Say:
        return Say(tuple(in_envelopes(self._side.setup.session, messages)))
