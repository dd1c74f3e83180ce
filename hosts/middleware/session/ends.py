"""The parts of a service: the work of its two ends once their light is granted.

    opener                      controller, switches              acceptor
      | Setup(service) ------ held until the paths are up ----------> |
      | <------------------------------------------------ Answer(OK) |
      |   kind.open(end)          messages and light    kind.accept(end)
      |   applications use the rest, if there is any
      | Finish ----------------------------------------------------> |
      | <------------------------------------------------ Answer(OK) |

A service is a file of hosts/middleware/services that ends in a ServiceKind, and an entry in
wire.services. Superdense coding is one of them: what it leaves for the application that opened it
is a way for bytes.
"""

from collections.abc import Awaitable, Callable, Coroutine, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from hosts.middleware.session import protocol
from hosts.middleware.session.arrangement import Arrangement
from hosts.middleware.session.channel import MetadataChannel
from hosts.middleware.session.host_resources import HostResources
from hosts.middleware.session.performing import Performer, expected
from hosts.middleware.session.protocol import Effect, HostSide, Joined, OpenerSide, Side
from hosts.middleware.session.values import Lifetimes
from wire.features import NodeFeatures
from wire.metadata.setup import Answer, Setup
from wire.metadata.values import Values
from wire.metadata.vocabulary import Handshake, Reason, Service
from wire.results.figures import Figures

Tell = Callable[..., Coroutine[Any, Any, None]]
Answerer = Callable[[dict[str, Any]], Awaitable[dict[str, Any]]]
Join = Callable[[MetadataChannel, Setup], Awaitable[None]]
NO_BYTES = 0, bytes(32)


@dataclass(frozen=True)
class Carrier:
    """A way for bytes that a service leaves for the application that opened it."""

    # Returns when the other end holds every byte.
    send: Callable[[bytes], Coroutine[Any, Any, None]]


class Watched(NamedTuple):
    """Findings of a link monitor, as reported to the controller."""

    compared: int  # pairs
    errors: int  # of these, pairs that differed
    tests: int  # that have found nobody
    alarm: bool
    ended: Reason  # OK; BUSY if it has given its light back; or why it failed


@dataclass
class ConnectionEnd(Performer):
    """One end of a session's connection: its light, and the other end.

    It performs protocols (protocol.py).
    """

    setup: Setup
    channel: MetadataChannel  # to the other end
    arrangement: Arrangement | None = field(default=None, kw_only=True)  # if this end opened it

    @property
    def side(self) -> Side:
        return Side(self.setup, tuple(self.qnic.ports), self.channel.peer)

    async def carry_out(self, effect: Effect) -> Any:
        match effect:
            case protocol.Say(messages):
                return self.channel.send(*messages)
            case protocol.Hear(kind, timeout_s, block):
                return await self.channel.receive(kind, timeout_s, block=block)
            case protocol.HearNext(begins, timeout_s, apart):
                return await self.channel.next(timeout_s, begins=begins, apart=apart)
            case protocol.Emit(block, pairs) if self.arrangement is not None:
                return await self.arrangement.emit(block, pairs)
            case protocol.BeginEmit(block, pairs, under_way) if self.arrangement is not None:
                return expected(self.arrangement.begin(block, pairs, under_way))
            case protocol.Join(setup) if self.arrangement is not None:
                return Joined(*await self.arrangement.join(setup))
            case protocol.Leave(connection, seen) if self.arrangement is not None:
                return await self.arrangement.leave(cast(MetadataChannel, connection), seen)
            case protocol.Announce(block, pulses) if self.arrangement is not None:
                return await self.arrangement.announce(block, pulses)
            case _:
                return await super().carry_out(effect)

    def say(self, topic: int, block: int, numbers: ArrayLike, width: int) -> None:
        self.channel.send(self.side.words(topic, block, numbers, width))

    def agree(self) -> None:
        self.channel.send(*self.side.agree().messages)

    async def next_values(self) -> Values | None:
        """Return what the opener tells next; None at the end of the session."""
        return await self.perform(self.side.next_values())


@dataclass
class End(ConnectionEnd):
    """One end of a session of a service: also its application, and what its host has."""

    resources: HostResources
    tell: Tell  # called with fields for the application
    draws: np.random.Generator  # of this host's own choices; they follow from the seed
    summary: Figures = field(default_factory=Figures)  # for the application, at the end
    # Of wire.device.DeviceReport: what the session has used of this host's device so far.
    counts: Callable[[], Mapping[str, int]] = dict

    @property
    def side(self) -> HostSide:
        resources, ports = self.resources, tuple(self.qnic.ports)
        return HostSide(
            self.setup,
            ports,
            self.channel.peer,
            resources.name,
            self.draws,
            resources.node_features,
            resources.lifetimes,
            resources.distinguishable_states,
        )

    async def carry_out(self, effect: Effect) -> Any:
        if not isinstance(effect, protocol.Tell):
            return await super().carry_out(effect)
        if effect.at_the_end:
            self.summary = effect.summary
        return await self.tell(**vars(effect.summary))


@dataclass
class OpenerEnd(End):
    arrangement: Arrangement = field(kw_only=True)
    answer: Answer = field(kw_only=True)  # of the other end, to the set-up
    theirs: NodeFeatures = field(kw_only=True)  # of the other end; nothing where it does not tell
    lifetimes: Lifetimes = field(kw_only=True)  # of its memory, likewise
    is_source: bool = field(kw_only=True)  # this host makes the pairs, and keeps half of each
    sent: tuple[int, bytes] = NO_BYTES  # how many bytes, and their SHA-256: what Finish says
    wanted_back: bool = False  # a session wants this light, says the controller
    watched: "Watched | None" = None  # for the controller

    @property
    def side(self) -> OpenerSide:
        return OpenerSide(
            **vars(super().side),
            other_host=self.arrangement.peer,
            theirs=self.theirs,
            their_lifetimes=self.lifetimes,
            is_source=self.is_source,
        )


@dataclass
class AcceptorEnd(End):
    deliver: Callable[[bytes], Awaitable[None]] = field(kw_only=True)  # bytes to the application
    join: Join | None = None  # serves a further connection of the session

    async def carry_out(self, effect: Effect) -> Any:
        if isinstance(effect, protocol.Deliver):
            return await self.deliver(effect.data)
        return await super().carry_out(effect)


@dataclass(frozen=True)
class ServiceKind:
    """A service: its entry in the vocabulary, its options, what its two ends do."""

    service: Service
    options: type[Any]  # a dataclass; its constructor raises SessionError for what cannot be
    # A service that leaves something to be used returns what answers the application of an end
    # until the opener's application ends the session; its accept returns before Finish, then.
    open: Callable[[OpenerEnd, Any], Awaitable[Answerer | Carrier | None]]
    accept: Callable[[AcceptorEnd], Awaitable[Answerer | None]]
    # The acceptor's reply to a set-up; SessionError if it cannot be served.
    accepts: Callable[[HostResources, Setup], Answer] = lambda _resources, setup: plain_answer(
        setup
    )
    # The opener's own check before anything is sent; SessionError.
    check: Callable[[Setup], None] = lambda _setup: None
    handshakes: tuple[Handshake, ...] = (Handshake.FRAMED,)  # ONE_PAIR: those join a session


def plain_answer(setup: Setup) -> Answer:
    return Answer(setup.session, Reason.OK)
