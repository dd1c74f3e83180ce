"""Protocols of services: generators of orders, resumed with what has come of each.

    Say(messages)               to the other end; nothing comes of it
    Hear(kind, timeout_s)       the other end's next message, of this kind; where several hear at a
                                time (MetadataChannel.sort), the next about its block
    HearNext()                  the opener's next message; None at the end of the session
    Do(operation, ...)          what an operation of this host's QNIC returns
    Begin(operation, ...)       a Light, under way; Collect tells what has come of it
    Await(lights), Cancel       which of them are over, as soon as one is; nothing
    Emit, Herald, Announce      by the session's source: nothing, Heralds, and Symbols
    BeginEmit(block, ...)       the same as Emit, under way: a Light
    Tell(summary), Now()        the application; seconds of the network's clock
    Deliver(data)               bytes, to the application
    Join(setup), Leave          a further connection to the other end: Joined; nothing
    Through(connection, steps)  what comes of steps by way of another connection
    Wait(for_what)              what comes by another way, which who began the protocol knows
    Work(function, ...)         what a function returns that takes long
    Beside(steps)               further steps, carried out at the same time
    Until(done)                 whether it is so, in time; steps beside these make it so

No socket, no clock: what decides stands here and in the services, and whoever carries the orders
out (performing.py, ends.py) waits. What goes wrong there is raised where the order was given.
"""

from collections.abc import Awaitable, Callable, Coroutine, Generator, Mapping
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

from hosts.hardware.operations import BlockName
from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import Heralds, Stored
from hosts.middleware.session.errors import SessionError, unexpected
from hosts.middleware.session.values import Lifetimes, Numbers, expect, values
from hosts.timeouts import ANSWER_TIMEOUT_S, GRACE_S, IDLE_TIMEOUT_S, LIGHT_TIMEOUT_S
from wire.features import NodeFeatures
from wire.metadata.blocks import Finish
from wire.metadata.header import Message
from wire.metadata.setup import Answer, Setup
from wire.metadata.values import Topic, Values
from wire.metadata.vocabulary import Reason
from wire.results.figures import Figures

Light = NewType("Light", object)  # under way; only who carries orders out knows what it is

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
    """Wait for what the opener does next, which may be nothing for long; None: it has gone."""

    begins: bool = False  # a block, or is about none; others hear what else there is
    timeout_s: float = IDLE_TIMEOUT_S


@dataclass(frozen=True)
class Do:
    """Have this host's QNIC do something."""

    operation: str  # of hosts.hardware.qnic.Qnic
    arguments: tuple[Any, ...] = ()
    named: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Begin(Do):
    """Have this host's QNIC begin with what takes as long as light needs to come."""


@dataclass(frozen=True)
class Collect:
    """Wait for light that has left, and a grace at most; None if no photon has come."""

    light: Light
    timeout_s: float = inf


@dataclass(frozen=True)
class Await:
    """Wait until one of several is over, but go on in time; which are? A tuple of bool.

    What has come of them is for Collect to tell: those that are not over go on.
    """

    lights: tuple[Light, ...]
    timeout_s: float = inf


@dataclass(frozen=True)
class Cancel:
    """Expect light no longer, whatever comes of it."""

    light: Light


@dataclass(frozen=True)
class Emit:
    """Have the source of the session make a block; its light has left then."""

    block: int
    pairs: int


@dataclass(frozen=True)
class BeginEmit:
    """Have the source of the session begin with a block: a Light, over when that has left.

    The source tells so. Where several blocks may be under way it is asked, if the light is late.
    """

    block: int
    pairs: int
    under_way: int = 1  # blocks at most, with this one


@dataclass(frozen=True)
class Herald:
    """Have the station of the session herald pairs of a block."""

    block: int
    pairs: int


@dataclass(frozen=True)
class Announce:
    """Have the relay of the session tell what it has measured of the light of a block."""

    block: int
    pulses: int


@dataclass(frozen=True)
class Tell:
    """Tell the application what there is."""

    summary: Figures
    at_the_end: bool = True  # it is its summary, too, if nothing comes behind it


@dataclass(frozen=True)
class Deliver:
    """Pass bytes to the application; waits while it does not read."""

    data: bytes


@dataclass(frozen=True)
class Join:
    """Open a further connection to the other end, with this set-up; what it answers is Joined."""

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
class Through:
    """Have steps carried out by way of another connection."""

    connection: "Connection"
    steps: "Steps[Any]"


@dataclass(frozen=True)
class Wait:
    """Wait for what comes by another way than this connection."""

    for_what: Callable[[], Awaitable[Any]]


@dataclass(frozen=True)
class Work:
    """Have worked out what takes long, while others go on."""

    function: Callable[..., Any]
    arguments: tuple[Any, ...]


@dataclass(frozen=True)
class Beside:
    """Have other steps carried out at the same time; the first failure of all ends all.

    They end with those that they are beside (Performer.perform_together).
    """

    steps: "Steps[None]"


@dataclass(frozen=True)
class Until:
    """Wait until something is so, which steps that are carried out at the same time bring about.

    Is it? Not if it takes longer than this.
    """

    done: Callable[[], Any]
    timeout_s: float = inf


Order: TypeAlias = (  # Begin is a Do
    Say
    | Hear
    | HearNext
    | Do
    | Collect
    | Await
    | Cancel
    | Emit
    | BeginEmit
    | Herald
    | Announce
    | Tell
    | Deliver
    | Join
    | Leave
    | Now
    | Through
    | Wait
    | Work
    | Beside
    | Until
)
Steps: TypeAlias = Generator[Order, Any, T]


class Joined(NamedTuple):
    """A further connection of a session, and what the other end has said to its set-up."""

    connection: object
    answer: Answer


class Connection(Protocol):
    """Whoever carries steps out."""

    def perform(self, steps: "Steps[T]") -> Awaitable[T]:
        """Carry out what steps order; return what they do."""


@dataclass(frozen=True)
class Side:
    """One side of a session's connection, as its protocol knows it."""

    setup: Setup
    ports: tuple[str, ...]  # of this host, in order
    peer: str  # the other end

    def block(self, number: int, half: int = 0) -> BlockName:
        return BlockName(self.setup.session, number, half)

    def words(self, topic: int, block: int, numbers: ArrayLike, width: int) -> Values:
        """Return the message of this session that carries numbers of so many bits."""
        return values(self.setup.session, topic, block, numbers, width)

    def say(self, topic: int, block: int, numbers: ArrayLike, width: int) -> Say:
        """Tell the other end numbers of so many bits."""
        return Say((self.words(topic, block, numbers, width),))

    def agree(self) -> Say:
        return Say((Answer(self.setup.session, Reason.OK),))

    def announce(self, number: int, size: int) -> Steps[None]:
        """Say that a block comes; the other end is ready for it then."""
        return request(self.words(Topic.COMING, number, [size], 32))

    def ready(self, number: int, size: int) -> Say:
        """Answer that the other end may begin with a block, whatever else is under way."""
        return self.say(Topic.COMING, number, [size], 32)

    def call(self, number: int, size: int) -> Steps[None]:
        """Say that a block comes, beside others; the other end is ready for it then."""
        yield self.ready(number, size)
        (told,) = (yield from hear(Topic.COMING, number, 1, size)).tolist()
        require_size(told, size)

    def next_values(self, begins: bool = False) -> Steps[Values | None]:
        """Return what the opener tells next; None at the end of the session."""
        message = yield HearNext(begins)
        if isinstance(message, Finish):
            return None
        if not isinstance(message, Values):
            raise unexpected(message, self.peer)
        return message

    def announced(self, most: int) -> Steps[tuple[int, int] | None]:
        """Return number and size of the block that comes next; None at the end of the session."""
        message = yield from self.next_values(begins=True)
        return None if message is None else coming(message, most)

    def expect_light(self, name: BlockName, port: str = "") -> Steps[Light]:
        """Begin to store the photons that will arrive at a port, the first if none is named."""
        return begin(Qnic.receive_into_memory, name, port or self.ports[0], LIGHT_TIMEOUT_S)

    def stored(self, light: Light, photons: int) -> Steps[Stored]:
        """Return what has come of light that is over; nothing if no photon has."""
        found = yield Collect(light, GRACE_S + photons / self.setup.rate_hz)
        if found is None:
            return Stored(np.zeros(photons, dtype=bool), 0)
        require_size(found.arrived.size, photons)
        return found  # type: ignore[no-any-return]


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
    theirs: NodeFeatures  # nothing where the other end does not tell
    their_lifetimes: Lifetimes  # of its memory, likewise
    is_source: bool  # this host makes the pairs, and keeps half of each

    def pairs(self, number: int, count: int) -> Steps[Stored]:
        """Have a block of pairs made for both ends; return what has come of half 0.

        The other end has said that it is ready before any light is made.
        """
        yield from self.announce(number, count)
        if self.is_source:
            return (yield from own_pairs(self, number, count, self.ports[-1]))
        light = yield from self.expect_light(self.block(number))
        yield Emit(number, count)
        return (yield from self.stored(light, count))

    def heralded(self, number: int, count: int) -> Steps[Heralds]:
        """Have pairs heralded with qubits of this host that emit, as many as come; return them.

        The other end's attempt when it has agreed.
        """
        yield from self.announce(number, count)
        return (yield from heralded(self, number, count, self.ports[0]))


def own_pairs(side: Side, number: int, count: int, port: str) -> Steps[Stored]:
    """Make a block of pairs at this host and send half 1 into a port; return what is kept."""
    setup = side.setup
    light = setup.rate_hz, setup.wavelength_pm
    return (yield from do(Qnic.share_pairs, setup.session, number, count, port, *light))


def heralded(side: Side, number: int, count: int, port: str) -> Steps[Heralds]:
    """Let qubits emit into a port, to whom the other end's do; return what the station tells."""
    yield from do(Qnic.attempt, side.block(number), port, side.setup.wavelength_pm)
    return (yield Herald(number, count))  # type: ignore[no-any-return]


def do(
    operation: Callable[Concatenate[Any, P], Coroutine[Any, Any, T]],
    *arguments: P.args,
    **named: P.kwargs,
) -> Steps[T]:
    return (yield Do(operation.__name__, arguments, named))  # type: ignore[no-any-return]


def begin(
    operation: Callable[Concatenate[Any, P], Coroutine[Any, Any, Any]],
    *arguments: P.args,
    **named: P.kwargs,
) -> Steps[Light]:
    """Begin with an operation of Qnic that waits for light."""
    return (yield Begin(operation.__name__, arguments, named))  # type: ignore[no-any-return]


def hear(
    topic: int, block: int, count: int | None, most: int, timeout_s: float = ANSWER_TIMEOUT_S
) -> Steps[Numbers]:
    """Return the numbers that the other end tells next; SessionError if it tells others."""
    return expect((yield Hear(Values, timeout_s, block)), topic, block, count, most)


def request(message: Message, timeout_s: float = ANSWER_TIMEOUT_S) -> Steps[None]:
    """Say something that the other end must accept."""
    yield Say((message,))
    yield Hear(Answer, timeout_s)


def saying(said: Say) -> Steps[None]:
    yield said


def together(one: "Steps[A]", other: "Steps[B]") -> "Steps[tuple[A, B]]":
    """Return what comes of both, which are carried out at the same time."""
    found: list[B] = []
    yield Beside(_into(found, other))
    first = yield from one
    yield Until(lambda: found)
    return first, found[0]


def _into(found: list[A], steps: "Steps[A]") -> Steps[None]:
    found.append((yield from steps))


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
