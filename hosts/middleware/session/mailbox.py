"""Messages that have come over a connection on which several blocks are under way; no socket.

    put     A1 B1 A2 C1 B2 …    as they come
    take    of A: A1, A2; of B: B1, B2; …

Those about one block keep their order. A reader takes its own messages and leaves the rest, so
that a message about one block never passes for news of another.
"""

from collections import deque
from collections.abc import Collection
from typing import NamedTuple

from hosts.middleware.session.errors import SAME_VERSION, SessionError
from wire.metadata.blocks import Finish
from wire.metadata.header import Message
from wire.metadata.setup import Answer
from wire.metadata.values import Topic, Values
from wire.metadata.vocabulary import Reason

HEARD = Values, Finish, Answer  # what comes while blocks are under way
MAX_KEPT = 4096  # messages that nobody has asked for yet


class Wanted(NamedTuple):
    """Which messages a reader takes."""

    block: int | None = None  # about it; None and 0: whatever they are about
    begins: bool = False  # those that begin a block, or are about none
    apart: Collection[int] = ()  # none about these blocks

    def is_met(self, message: Message) -> bool:
        about = message.block if isinstance(message, Values) else 0
        if self.block:
            return about == self.block
        if about in self.apart:
            return False
        return not self.begins or not about or message.topic == Topic.COMING  # type: ignore[attr-defined]


class Mailbox:
    """Keeps messages until those whom they are for ask."""

    def __init__(self) -> None:
        self._kept: deque[Message] = deque()
        self._announced: set[int] = set()  # blocks, by either end
        self._last: list[Message | None] = []  # behind which nothing comes

    def receive(self, message: Message) -> None:
        """Note what this end says: the other end may speak of a block that it announces."""
        if isinstance(message, Values) and message.topic == Topic.COMING:
            self._announced.add(message.block)

    def put(self, message: Message | None) -> None:
        """Keep what has come; None: the end of the connection.

        Raise SessionError for a block that nobody has announced, for what nobody would ever ask
        for, or if too much is kept.
        """
        if message is None or (isinstance(message, Answer) and message.reason != Reason.OK):
            self._last = [message]
            return
        if not isinstance(message, HEARD):
            text = f"{type(message).__name__} between blocks, where it has no place; {SAME_VERSION}"
            raise SessionError(Reason.PROTOCOL, text)
        self.receive(message)
        if isinstance(message, Values) and message.block not in self._announced | {0}:
            text = f"values of topic {message.topic} and block {message.block}, which nobody has "
            raise SessionError(Reason.PROTOCOL, f"{text}announced; {SAME_VERSION}")
        if len(self._kept) >= MAX_KEPT:
            text = f"{MAX_KEPT} messages that nobody waits for; {SAME_VERSION}"
            raise SessionError(Reason.PROTOCOL, text)
        self._kept.append(message)

    def has(self, wanted: Wanted) -> bool:
        return bool(self._last) or any(map(wanted.is_met, self._kept))

    def take(self, wanted: Wanted) -> Message | None:
        """Return the oldest message that is wanted.

        Where there is nothing, return what the connection has ended with, of which everybody hears.
        """
        for place, message in enumerate(self._kept):
            if wanted.is_met(message):
                del self._kept[place]
                return message
        (last,) = self._last
        return last
