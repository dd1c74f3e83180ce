"""The messages of key distribution on the connection of a session, at either end.

They travel in envelopes, as a stream that is cut anywhere. Their meaning is decided in
hosts.middleware.qkd; here its failures become errors for the application.
"""

from collections.abc import Iterator

from hosts.middleware.qkd.alice import Alice
from hosts.middleware.qkd.bob import Bob
from hosts.middleware.session.errors import SessionError
from wire.metadata.values import Envelope, Topic
from wire.metadata.vocabulary import Reason
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
    for data in messages:
        for start in range(0, len(data), PIECE_BYTES):
            yield Envelope(session, Topic.KEYS, data[start : start + PIECE_BYTES])


def failure_of(keys: Alice | Bob, peer: str) -> SessionError | None:
    """Return the application's error if an end has ended without a key."""
    failure = keys.failure
    if failure is None:
        return None
    words = f"{peer} has ended it: " if failure.by_peer else ""
    reason = REASONS.get(failure.reason, Reason.PROTOCOL)
    return SessionError(reason, f"no key: {words}{failure.text}")
