"""Protocols of services: generators of effects, resumed with the result of each.

How a protocol's steps work
---------------------------
A protocol is the work of one end of a session. It decides: which block is next, which pairs are
sampled, when the session has failed. It never waits, sends, measures or looks at a clock. It
*yields* an effect instead, a frozen dataclass of this module, and is resumed with the result:

    def catch(side: HostSide) -> Steps[int]:
        yield side.agree()                                      # an effect: Say
        bases = yield from hear(Topic.SAMPLE, 1, 8, most=1)     # steps within steps: Hear
        bits = yield from do(Qnic.measure, side.block(1), bases)  # an effect for hardware: Do
        return int((bits == 1).sum())                           # the result of these steps

Two rules follow from that of generators. Steps are composed by `yield from`, and a function that
yields nothing itself does not need to be a generator: `side.say(...)` is an effect, `hear(...)` is
steps. And a failure is raised where the effect was yielded (SessionError of the other end,
HardwareError of this host), so that `try`, `finally` and `with` mean what they mean elsewhere.

A performer (performing.py; ends.py with a connection) runs the loop: send the last result in, take
the next effect out, carry it out, until the generator returns. One effect is under way at a time,
with three exceptions:

- Light. It arrives when it arrives, so an operation that waits for it begins (Begin), gives a
  Light at once, and goes on while other effects are carried out. Collect waits for its result,
  Await for the first of several. Light that nobody collects is given up when the steps end.
- Concurrently starts other steps beside these, in the same task group: several blocks under way, a
  key distilled while light for the next one is sent. They share the session's objects and need no
  lock, because a switch from one to another happens at a `yield` alone. The first failure of any
  ends all; when the steps that perform_together began with return, the others are cancelled.
- WaitUntil is how such steps wait for each other: for a condition over shared objects, which is
  looked at after each effect of any of them.

Several concurrent steps may read from one connection. Each Hear has its kind and its block, and the
mailbox (mailbox.py) keeps each message for its reader; HearNext takes those that begin a block.

Since a protocol is only values in and values out, a test plays it without a network: it feeds
results, compares effects, and needs no mock (tests/unit/hosts/steps_scene.py runs two ends back to
back). tests/unit/test_structure.py holds that no protocol imports a socket, a clock or a thread.

The effects, and what the generator is resumed with
---------------------------------------------------
    Say(messages)               to the other end; None
    Hear(kind, timeout_s)       the other end's next message, of this kind; where several hear at a
                                time (MetadataChannel.sort), the next about its block
    HearNext()                  the opener's next message; None at the end of the session
    Do(operation, ...)          the result of an operation of this host's QNIC
    Begin(operation, ...)       a Light, under way; Collect gives its result
    Await(lights), Cancel       which of them are over, as soon as one is; None
    Emit, Herald, Announce      by the session's source: None, Heralds, and Symbols
    BeginEmit(block, ...)       the same as Emit, under way: a Light
    Tell(summary), Now()        None, to the application; seconds of the network's clock
    Deliver(data)               None; bytes, to the application
    Join(setup), Leave          a further connection to the other end: Joined; None
    OnConnection(connection, steps)  the result of steps on another connection
    Wait(for_what)              the result of an awaitable of the protocol's creator
    Work(function, ...)         the result of a function that takes long
    Concurrently(steps)         None; further steps, carried out at the same time
    WaitUntil(done)             whether the condition holds, in time
"""

from collections.abc import Awaitable, Callable, Collection, Coroutine, Generator, Mapping
from dataclasses import dataclass, field
from math import inf
from typing import (
    Any,
    Concatenate,
    NamedTuple,
    NewType,
    ParamSpec,
    Protocol,
    TypeAlias,
    TypeVar,
)

import numpy as np
from numpy.typing import ArrayLike

from hosts.hardware import pair_light
from hosts.hardware.block_name import BlockName
from hosts.hardware.replies import Stored
from hosts.hardware.steps import Pulses
from hosts.middleware.session.errors import SessionError, unexpected
from hosts.middleware.session.values import Lifetimes, Numbers, expect, values
from hosts.timeouts import (
    ANSWER_TIMEOUT_S,
    GRACE_S,
    IDLE_TIMEOUT_S,
    LIGHT_TIMEOUT_S,
    WHOLE_HZ,
)
from wire.features import NodeFeatures
from wire.metadata.blocks import Finish
from wire.metadata.header import Message
from wire.metadata.setup import Answer, Setup
from wire.metadata.values import Topic, Values
from wire.metadata.vocabulary import MemoryState, Reason
from wire.results.figures import Figures

Light = NewType("Light", object)  # under way; opaque but for the performer

P = ParamSpec("P")
A = TypeVar("A")
B = TypeVar("B")
T = TypeVar("T")


@dataclass(frozen=True)
class Say:
    """Tell the other end."""

    messages: tuple[Message, ...]


@dataclass(frozen=True)
class Hear:
    """Wait for the other end's next message, which must be of this kind."""

    kind: type[Message]
    timeout_s: float = ANSWER_TIMEOUT_S
    block: int | None = None  # that it is about


@dataclass(frozen=True)
class HearNext:
    """Wait for the opener's next message, also for long; None: it has gone."""

    begins: bool = False  # of a block, or about none; other steps hear the rest
    timeout_s: float = IDLE_TIMEOUT_S
    apart: Collection[int] = ()  # blocks of which other steps hear


@dataclass(frozen=True)
class Do:
    """Have this host's QNIC do something."""

    operation: Callable[..., Any]  # of a Qnic, or with one as its first argument
    arguments: tuple[Any, ...] = ()
    named: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Begin(Do):
    """Have this host's QNIC begin an operation that waits for light."""


@dataclass(frozen=True)
class Collect:
    """Wait for light that has left, and a grace at most; None if no photon arrived."""

    light: Light
    timeout_s: float = inf


@dataclass(frozen=True)
class Await:
    """Wait until one of several is over, but go on in time; which are? A tuple of bool.

    Collect gives their results; those that are not over go on.
    """

    lights: tuple[Light, ...]
    timeout_s: float = inf


@dataclass(frozen=True)
class Cancel:
    """Expect light no longer, arrived or not."""

    light: Light


@dataclass(frozen=True)
class Emit:
    """Have the source of the session make a block; its light has left then."""

    block: int
    pairs: int


@dataclass(frozen=True)
class BeginEmit:
    """Have the source of the session begin with a block: a Light, over when that has left.

    The source reports that. If several blocks may be under way it is asked when the light is late.
    """

    block: int
    pairs: int
    under_way: int = 1  # blocks at most, with this one


@dataclass(frozen=True)
class Announce:
    """Have the relay of the session report its measurements of the light of a block."""

    block: int
    pulses: int


@dataclass(frozen=True)
class Tell:
    """Report results to the application."""

    summary: Figures
    at_the_end: bool = True  # it is the summary, too, if no other follows


@dataclass(frozen=True)
class Deliver:
    """Pass bytes to the application; waits while it does not read."""

    data: bytes


@dataclass(frozen=True)
class Join:
    """Open a further connection to the other end, with this set-up; the result is Joined."""

    setup: Setup


@dataclass(frozen=True)
class Leave:
    """Close a further connection; `seen`: over when the other end has closed it, too."""

    connection: object
    seen: bool = False


@dataclass(frozen=True)
class Now:
    """Look at the network's clock."""


@dataclass(frozen=True)
class OnConnection:
    """Carry steps out on another connection."""

    connection: "Connection"
    steps: "Steps[Any]"


@dataclass(frozen=True)
class Wait:
    """Wait for a result that arrives by another way than this connection."""

    for_what: Callable[[], Awaitable[Any]]


@dataclass(frozen=True)
class Work:
    """Compute something long, while others go on."""

    function: Callable[..., Any]
    arguments: tuple[Any, ...]


@dataclass(frozen=True)
class Concurrently:
    """Carry out other steps at the same time; the first failure of all ends all.

    They end with those that started them (Performer.perform_together).
    """

    steps: "Steps[None]"


@dataclass(frozen=True)
class WaitUntil:
    """Wait for a condition that concurrent steps bring about.

    Does it hold? Not if it takes longer than `timeout_s`.
    """

    done: Callable[[], Any]
    timeout_s: float = inf


Effect: TypeAlias = (  # Begin is a Do
    Say
    | Hear
    | HearNext
    | Do
    | Collect
    | Await
    | Cancel
    | Emit
    | BeginEmit
    | Announce
    | Tell
    | Deliver
    | Join
    | Leave
    | Now
    | OnConnection
    | Wait
    | Work
    | Concurrently
    | WaitUntil
)
Steps: TypeAlias = Generator[Effect, Any, T]


class Joined(NamedTuple):
    """A further connection of a session, and the other end's answer to its set-up."""

    connection: object
    answer: Answer


class Connection(Protocol):
    def perform(self, steps: "Steps[T]") -> Awaitable[T]:
        """Carry out steps; return their result."""


@dataclass(frozen=True)
class Side:
    """One side of a session's connection, as its protocol knows it."""

    setup: Setup
    ports: tuple[str, ...]  # of this host, in order
    peer: str  # the other end

    def block(self, number: int, half: int = 0) -> BlockName:
        return BlockName(self.setup.session, number, half)

    def words(self, topic: int, block: int, numbers: ArrayLike, width: int) -> Values:
        """Return the message of this session that carries numbers of `width` bits."""
        return values(self.setup.session, topic, block, numbers, width)

    def say(self, topic: int, block: int, numbers: ArrayLike, width: int) -> Say:
        """Tell the other end numbers of `width` bits."""
        return Say((self.words(topic, block, numbers, width),))

    def agree(self) -> Say:
        return Say((Answer(self.setup.session, Reason.OK),))

    def announce(self, number: int, size: int) -> Steps[None]:
        """Announce a block; the other end is then ready for it."""
        return request(self.words(Topic.COMING, number, [size], 32))

    def ready(self, number: int, size: int) -> Say:
        """Answer that the other end may begin with a block, beside others under way."""
        return self.say(Topic.COMING, number, [size], 32)

    def call(self, number: int, size: int) -> Steps[None]:
        """Announce a block beside others; the other end is then ready for it."""
        yield self.ready(number, size)
        (photons,) = (yield from hear(Topic.COMING, number, 1, size)).tolist()
        require_size(photons, size)

    def next_values(
        self, begins: bool = False, apart: Collection[int] = ()
    ) -> Steps[Values | None]:
        """Return the opener's next numbers; None at the end of the session."""
        heralded = self.setup.memory == MemoryState.HERALDED
        block_s = self.setup.pairs / WHOLE_HZ if heralded else 0.0
        message = yield HearNext(begins, IDLE_TIMEOUT_S + block_s, apart)
        if isinstance(message, Finish):
            return None
        if not isinstance(message, Values):
            raise unexpected(message, self.peer)
        return message

    def announced(self, most: int) -> Steps[tuple[int, int] | None]:
        """Return number and size of the next block; None at the end of the session."""
        message = yield from self.next_values(begins=True)
        return None if message is None else coming(message, most)

    def expect_light(self, name: BlockName) -> Steps[Light]:
        """Begin to store the photons that will arrive at the first port."""
        return begin(pair_light.receive_into_memory, name, self.ports[0], LIGHT_TIMEOUT_S)

    def stored(self, light: Light, photons: int) -> Steps[Stored]:
        """Return the arrivals of light that is over; none if no photon arrived."""
        storage = yield Collect(light, GRACE_S + photons / self.setup.rate_hz)
        if storage is None:
            return Stored(np.zeros(photons, dtype=bool), 0)
        require_size(storage.arrived.size, photons)
        return storage  # type: ignore[no-any-return]


@dataclass(frozen=True)
class HostSide(Side):
    """One side of a session of a service: also what its host has."""

    host: str  # its name
    draws: np.random.Generator  # of this host's own choices; they follow from the seed
    node_features: NodeFeatures
    lifetimes: Lifetimes  # of its memory
    distinguishable_states: frozenset[int]  # by its Bell analyser


@dataclass(frozen=True)
class OpenerSide(HostSide):
    """The side that asked for the session: also what the other has."""

    other_host: str  # its name
    theirs: NodeFeatures  # nothing if the other end does not report them
    their_lifetimes: Lifetimes  # of its memory, likewise
    is_source: bool  # this host makes the pairs, and keeps half of each

    def pairs(self, number: int, count: int) -> Steps[Stored]:
        """Have a block of pairs made for both ends; return the arrivals of half 0.

        No light is made before the other end is ready.
        """
        yield from self.announce(number, count)
        if self.is_source:
            return (yield from own_pairs(self, number, count, self.ports[-1]))
        light = yield from self.expect_light(self.block(number))
        yield Emit(number, count)
        return (yield from self.stored(light, count))


def own_pairs(side: Side, number: int, count: int, port: str) -> Steps[Stored]:
    """Make a block of pairs at this host and send half 1 into a port; return the kept halves."""
    setup = side.setup
    pulses = Pulses(setup.rate_hz, setup.wavelength_pm)
    return (yield from do(pair_light.share_pairs, setup.session, number, count, port, pulses))


def do(
    operation: Callable[Concatenate[Any, P], Coroutine[Any, Any, T]],
    *arguments: P.args,
    **named: P.kwargs,
) -> Steps[T]:
    return (yield Do(operation, arguments, named))  # type: ignore[no-any-return]


def begin(
    operation: Callable[Concatenate[Any, P], Coroutine[Any, Any, Any]],
    *arguments: P.args,
    **named: P.kwargs,
) -> Steps[Light]:
    """Begin with an operation of Qnic that waits for light."""
    return (yield Begin(operation, arguments, named))  # type: ignore[no-any-return]


def hear(
    topic: int, block: int, count: int | None, most: int, timeout_s: float = ANSWER_TIMEOUT_S
) -> Steps[Numbers]:
    """Return the other end's next numbers; SessionError if they are of another kind."""
    return expect((yield Hear(Values, timeout_s, block)), topic, block, count, most)


def request(message: Message, timeout_s: float = ANSWER_TIMEOUT_S) -> Steps[None]:
    """Send a message that the other end must accept."""
    yield Say((message,))
    yield Hear(Answer, timeout_s)


def saying(message: Say) -> Steps[None]:
    yield message


def together(one: "Steps[A]", other: "Steps[B]") -> "Steps[tuple[A, B]]":
    results: list[B] = []
    yield Concurrently(_into(results, other))
    first = yield from one
    yield WaitUntil(lambda: results)
    return first, results[0]


def _into(results: list[A], steps: "Steps[A]") -> Steps[None]:
    results.append((yield from steps))


def coming(message: Values, most: int) -> tuple[int, int]:
    """Return number and size of the block that a message announces."""
    (count,) = expect(message, Topic.COMING, message.block, 1, most).tolist()
    if count == 0:
        raise SessionError(Reason.PROTOCOL, f"block {message.block} has no photons")
    return message.block, count


def require_size(found: int, photons: int) -> None:
    """Raise SessionError unless as many photons came as were announced."""
    if found != photons:
        raise SessionError(Reason.PROTOCOL, f"{found} photons, not {photons}")
