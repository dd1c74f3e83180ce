"""Steps of protocols carried out in lists: no socket, no event loop, and a clock that is a number.

Each end of a connection is a `Wire`: bytes that have come, and whose they are. The object that the
wire has for a host's hardware decides what that does; an operation that was begun is `Flying`.
Time goes on only when nobody else does.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf
from typing import Any

from hosts.hardware.replies import HardwareError
from hosts.middleware.session import protocol
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.mailbox import Mailbox, Wanted
from hosts.middleware.session.protocol import Joined, Light, Steps
from wire.metadata.decoding import decode, message_length
from wire.metadata.header import HEADER, Message
from wire.metadata.setup import Answer, Setup
from wire.metadata.vocabulary import Reason

WAITING = object()  # instead of an outcome that is not there yet
CLOSED = object()  # instead of a message that will never come
BEGUN = object()  # instead of an outcome of steps that were begun for it
Failure = SessionError | HardwareError


@dataclass(eq=False)
class Flying:
    """An operation under way: over when it has a result, or without one at its time."""

    come: Callable[[], bool]
    outcome: Callable[[], Any]
    until_s: float = inf
    given_up: bool = False  # by who has waited for it
    cancelled: bool = False

    def over(self, now_s: float) -> bool:
        """Tell whether it is."""
        return self.come() or self.given_up or self.cancelled or now_s >= self.until_s

    def collected(self) -> Any:
        """Return its result, None for none."""
        return self.outcome() if self.come() else None


@dataclass(eq=False)
class Wire:
    """One end of a connection."""

    scene: "Scene"
    hardware: Any
    other: "Wire" = field(init=False)
    messages: list[Message] = field(default_factory=list)
    sent: bytearray = field(default_factory=bytearray)  # all that this end has sent
    read: int = 0  # bytes of what the other has sent
    arrives: float = inf  # at most this many have come, until nobody goes on
    ends: float = inf  # the other end is gone after this many
    left: bool = False  # this end has closed it
    mailbox: Mailbox | None = None  # where several hear at a time

    def say(self, *messages: Message) -> None:
        """Send bytes."""
        self.messages += messages
        if self.mailbox is not None:
            for message in messages:
                self.mailbox.receive(message)
        self.sent += b"".join(message.encode() for message in messages)

    def next(self, block: int | None = None, begins: bool = False) -> Any:
        """Return the next message that is for who asks, CLOSED behind the last, or WAITING."""
        if self.mailbox is None:
            return self._next()
        wanted = Wanted(block, begins)
        while not self.mailbox.has(wanted):
            if (message := self._next()) is WAITING:
                return WAITING
            self.mailbox.put(None if message is CLOSED else message)
        return self.mailbox.take(wanted) or CLOSED

    def _next(self) -> Any:
        """Return the next message of all; raise SessionError inside one."""
        most = int(min(len(self.other.sent), self.arrives, self.ends))
        there = bytes(self.other.sent[self.read : most])
        length = message_length(there[: HEADER.size]) if len(there) >= HEADER.size else None
        if length is not None and len(there) >= length:
            self.read += length
            return decode(there[:length])
        gone = most == self.ends or (self.other.left and most == len(self.other.sent))
        if gone and there:
            raise SessionError(Reason.PEER_GONE, "gone inside a message")
        return CLOSED if gone else WAITING

    @property
    def is_held(self) -> bool:
        """Whether bytes are on their way."""
        return self.arrives < len(self.other.sent)

    def perform(self, steps: Steps[Any]) -> Any:
        """Fail: the scene performs."""
        raise AssertionError(steps)


@dataclass(eq=False)
class Going:
    """Steps under way, the innermost last, and what these have ordered."""

    stack: list[tuple[Wire, Steps[Any]]]
    order: Any = None
    since_s: float = 0.0
    over: bool = False
    value: Any = None


@dataclass(eq=False)
class Scene:
    """All steps that are under way."""

    now_s: float = 0.0
    going: list[Going] = field(default_factory=list)
    wires: list[Wire] = field(default_factory=list)
    flying: list[Flying] = field(default_factory=list)
    orders: list[tuple[float, Wire, Any]] = field(default_factory=list)  # all, and when
    # Serves a further connection, of which it is given its own end and the set-up.
    join: Callable[[Wire, Setup], Going] | None = None

    def connection(self, one: Any, other: Any) -> tuple[Wire, Wire]:
        """Return both ends of a connection between hosts that have this hardware."""
        ends = Wire(self, one), Wire(self, other)
        ends[0].other, ends[1].other = ends[1], ends[0]
        self.wires += ends
        return ends

    def begin(self, wire: Wire, steps: Steps[Any]) -> Going:
        """Begin with steps."""
        self.going.append(Going([(wire, steps)]))
        return self.going[-1]

    def run(self, *until: Going) -> None:
        """Go on until these are over; raise what steps fail with, or if nobody can go on."""
        while not all(each.over for each in until):
            moved = [self._go_on(each) for each in list(self.going)]
            self.going = [each for each in self.going if not each.over]
            if any(moved) or all(each.over for each in until):
                continue
            if held := [wire for wire in self.wires if wire.is_held]:
                held[0].arrives = inf
                continue
            later = [when for when in self._deadlines() if when > self.now_s]
            assert later, f"nobody goes on: {[each.order for each in self.going]}"
            self.now_s = min(later)

    def _deadlines(self) -> list[float]:
        waits = [each.since_s + getattr(each.order, "timeout_s", inf) for each in self.going]
        times = [when for when in (*waits, *(each.until_s for each in self.flying)) if when < inf]
        return sorted(times)

    def _go_on(self, going: Going) -> bool:
        moved = False
        while not going.over:
            try:
                outcome = self._outcome(going) if going.order is not None else None
            except (SessionError, HardwareError) as error:
                outcome = error
            if outcome is WAITING:
                return moved
            moved = True
            if outcome is not BEGUN:
                self._resume(going, outcome)
        return moved

    def _resume(self, going: Going, outcome: Any) -> None:
        wire, steps = going.stack[-1]
        try:
            fails = isinstance(outcome, SessionError | HardwareError)
            going.order = steps.throw(outcome) if fails else steps.send(outcome)
            going.since_s = self.now_s
            self.orders.append((self.now_s, wire, going.order))
        except StopIteration as end:
            self._end(going, end.value)
        except (SessionError, HardwareError) as error:
            self._end(going, error)

    def _end(self, going: Going, value: Any) -> None:
        going.stack.pop()
        if going.stack:
            self._resume(going, value)
        elif isinstance(value, SessionError | HardwareError):
            raise value
        else:
            going.over, going.value = True, value

    def _outcome(self, going: Going) -> Any:
        """Return the result of a task's order, or WAITING."""
        (wire, _steps), order = going.stack[-1], going.order
        late = self.now_s >= going.since_s + getattr(order, "timeout_s", inf)
        match order:
            case protocol.Say(messages):
                return wire.say(*messages)
            case protocol.Hear(kind, _timeout_s, block):
                return heard(wire.next(block), kind, late)
            case protocol.HearNext(begins):
                if (message := wire.next(begins=begins)) is WAITING and late:
                    raise SessionError(Reason.NO_ANSWER, "silent")
                return None if message is CLOSED else message
            case protocol.Begin(operation, arguments, named):
                flying = getattr(wire.hardware, operation.__name__)(*arguments, **named)
                self.flying.append(flying)
                return Light(flying)
            case protocol.Do(operation, arguments, named):
                return getattr(wire.hardware, operation.__name__)(*arguments, **named)
            case protocol.BeginEmit(block, pairs):
                return Light(wire.hardware.emit(block, pairs))
            case protocol.Emit(block, pairs):
                wire.hardware.emit(block, pairs)
                return None
            case protocol.Await(lights):
                over = tuple(light.over(self.now_s) for light in lights)  # type: ignore[attr-defined]
                return over if any(over) or late else WAITING
            case protocol.Collect(light):
                light.given_up |= late  # type: ignore[attr-defined]
                return light.collected() if light.over(self.now_s) else WAITING  # type: ignore[attr-defined]
            case protocol.Cancel(light):
                light.cancelled = True  # type: ignore[attr-defined]
                return None
            case protocol.Tell(summary):
                return wire.hardware.reports.append(summary)
            case protocol.Deliver(data):
                return wire.hardware.deliver(data)
            case protocol.Now():
                return self.now_s
            case protocol.Concurrently(steps):
                self.begin(wire, steps)
                return None
            case protocol.WaitUntil(done):
                return bool(done()) if done() or late else WAITING
            case protocol.OnConnection(connection, steps):
                return self._inner(going, connection, steps)
            case protocol.Join(setup):
                return self._inner(going, *self._joined(wire, setup))
            case protocol.Leave(end, seen):
                end.left = True  # type: ignore[attr-defined]
                return None if not seen or end.other.left else WAITING  # type: ignore[attr-defined]
        raise AssertionError(order)

    def _inner(self, going: Going, wire: Any, steps: Steps[Any]) -> Any:
        going.stack.append((wire, steps))
        going.order = None
        self._resume(going, None)
        return BEGUN

    def _joined(self, wire: Wire, setup: Setup) -> tuple[Wire, Steps[Joined]]:
        ours, theirs = self.connection(wire.hardware, wire.other.hardware)
        assert self.join is not None
        read = decode(setup.encode())
        assert isinstance(read, Setup)
        serving = self.join(theirs, read)
        self.begin(theirs, closing(theirs, serving))

        def asked() -> Steps[Joined]:
            return Joined(ours, (yield protocol.Hear(Answer)))

        return ours, asked()


def closing(wire: Wire, serving: Going) -> Steps[None]:
    """Close this end of a connection when it has been served."""
    yield protocol.WaitUntil(lambda: serving.over)
    yield protocol.Leave(wire)


def heard(message: Any, kind: type[Message], late: bool) -> Any:
    """Return the next message, which must be of this kind, or WAITING."""
    if message is CLOSED:
        raise SessionError(Reason.PEER_GONE, "gone")
    if isinstance(message, Answer) and message.reason != Reason.OK:
        raise SessionError(Reason(message.reason), message.text)
    if message is WAITING and late:
        raise SessionError(Reason.NO_ANSWER, "silent")
    if message is not WAITING and not isinstance(message, kind):
        raise SessionError(Reason.PROTOCOL, f"{type(message).__name__}, not {kind.__name__}")
    return message
