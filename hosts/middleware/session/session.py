"""A session of a service at either end: arranged, run, and ended, whatever happens."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import inf
from typing import Any, Protocol

from hosts.hardware.qnic import Qnic, release
from hosts.hardware.replies import HardwareError
from hosts.middleware.session import node_features
from hosts.middleware.session.arrangement import Arrangement
from hosts.middleware.session.channel import MetadataChannel
from hosts.middleware.session.ends import (
    AcceptorEnd,
    Answerer,
    Carrier,
    ConnectionEnd,
    End,
    OpenerEnd,
    ServiceKind,
    Tell,
    Watched,
)
from hosts.middleware.session.errors import SessionError, SilentPeer, unexpected, unsupported
from hosts.middleware.session.host_resources import HostResources
from hosts.middleware.session.offers import at_wavelength, check_light
from hosts.middleware.session.options import SessionOptions, most_in_block
from hosts.middleware.session.values import Lifetimes
from hosts.timeouts import IDLE_TIMEOUT_S, REPORT_TIMEOUT_S
from wire.features import NOTHING, NodeFeatures
from wire.light import Role
from wire.metadata.blocks import Finish
from wire.metadata.setup import Answer, Setup
from wire.metadata.vocabulary import Handshake, MemoryState, Reason, Service
from wire.services import Making, fibers_needed, uses_source

CERTAIN_PPM = 1_000_000


class Application(Protocol):
    """An accepting session's view of its application."""

    async def tell(self, **fields: Any) -> None:
        """Pass it a result."""

    async def deliver(self, data: bytes) -> None:
        """Pass it bytes; waits while it does not read."""


class Session:
    _setup: Setup
    _end: End | None

    @property
    def setup(self) -> Setup:
        return self._setup

    @property
    def summary(self) -> dict[str, Any]:
        return vars(self._end.summary) if self._end else {}

    @property
    def counts(self) -> Mapping[str, int]:
        return self._end.counts() if self._end else {}


class OpeningSession(Session):
    _end: OpenerEnd | None

    def __init__(
        self,
        kind: ServiceKind,
        options: SessionOptions,
        resources: HostResources,
        arrangement: Arrangement,
        setup: Setup,
        is_source: bool,
    ) -> None:
        kind.check(setup)
        self._by = making(setup, is_source)
        require_fibers(setup, Role.OPENER, resources.at(setup.wavelength_pm).qnic, self._by)
        self._kind, self._options, self._resources = kind, options, resources
        self._arrangement, self._setup, self._is_source = arrangement, setup, is_source
        self._end = None
        self._wanted_back = False
        self.answer: Answerer | None = None  # to the application's questions, if it may ask
        self.carrier: Carrier | None = None  # of the application's bytes, if it may send some

    @property
    def watched(self) -> Watched | None:
        return self._end.watched if self._end else None

    def preempt(self) -> None:
        """End soon, if it watches a way: a session wants its light."""
        self._wanted_back = True
        if self._end is not None:
            self._end.wanted_back = True

    async def run(self, tell: Tell) -> None:
        """Arrange light, do what the service does; raise SessionError if it cannot be."""
        answer = await self._arrangement.open()
        self._end = end = await self._arranged(answer, self._arrangement.channel, tell)
        left = await self._kind.open(end, self._options)
        if isinstance(left, Carrier):
            self.carrier = left
        else:
            self.answer = left

    async def give_up(self, error: SessionError | HardwareError) -> None:
        await self._arrangement.give_up(error)

    async def _arranged(self, answer: Answer, channel: MetadataChannel, tell: Tell) -> OpenerEnd:
        """Return this end, once the other's features are known and the source is connected."""
        self._setup = at_wavelength(self._setup, answer)
        self._resources = self._resources.at(self._setup.wavelength_pm)
        theirs, lifetimes = NodeFeatures(NOTHING, 0), Lifetimes(inf, inf, inf, inf)
        if node_features.are_told(self._kind.service):
            connection = ConnectionEnd(self._resources.qnic, self._setup, channel)
            heard = await connection.perform(node_features.hear(connection.side))
            pairs, theirs, lifetimes = heard
            self._setup = replace(self._setup, pairs=pairs)
        if uses_source(self._kind.service, self._by):
            await self._arrangement.engage_source()
        return OpenerEnd(
            self._resources.qnic,
            self._setup,
            channel,
            self._resources,
            tell,
            self._resources.draws(self._setup.session),
            arrangement=self._arrangement,
            answer=answer,
            theirs=theirs,
            lifetimes=lifetimes,
            is_source=self._is_source,
            wanted_back=self._wanted_back,
        )

    async def lost(self) -> None:
        """Wait for the other end, with a deadline; raise SessionError then."""
        channel = self._arrangement.channel
        try:
            message = await channel.next(IDLE_TIMEOUT_S)
        except SilentPeer as error:
            text = f"what a session leaves is kept for {IDLE_TIMEOUT_S:g} s: ask for more in time"
            raise SessionError(Reason.PROTOCOL, text) from error
        raise unexpected(message, channel.peer)

    async def finish(self) -> None:
        """End the session; return when the other end has confirmed success to its application."""
        assert self._end is not None
        finish = Finish(self._setup.session, *self._end.sent)
        await self._arrangement.channel.request(finish, REPORT_TIMEOUT_S)

    async def close(self) -> None:
        self._arrangement.close()
        await release(self._resources.qnic, self._setup.session)


class AcceptingSession(Session):
    _end: AcceptorEnd | None

    def __init__(
        self,
        kind: ServiceKind,
        resources: HostResources,
        channel: MetadataChannel,
        setup: Setup,
    ) -> None:
        check_asked(setup, kind.handshakes)
        resources = resources.at(setup.wavelength_pm)
        accepted = kind.accepts(resources, setup)
        self._accepted = replace(accepted, wavelength_pm=setup.wavelength_pm)
        require_fibers(setup, Role.ACCEPTOR, resources.qnic, making(setup, False))
        self._kind, self._resources, self._channel, self._setup = kind, resources, channel, setup
        self._end = None
        self.answer: Answerer | None = None  # to the application's questions, if it may ask

    @property
    def watched(self) -> None:
        """Nothing: its opener finds who is on the way."""

    async def run(self, application: Application) -> None:
        """Do what the service does; raise SessionError if it fails."""
        has, setup = self._resources, self._setup
        draws, deliver = has.draws(setup.session), application.deliver
        self._end = end = AcceptorEnd(
            has.qnic,
            setup,
            self._channel,
            has,
            application.tell,
            draws,
            deliver=deliver,
        )
        self._channel.send(self._accepted)
        if node_features.are_told(self._kind.service):
            await end.carry_out(node_features.say(end.side))
        self.answer = await self._kind.accept(end)

    async def join(self, channel: MetadataChannel, setup: Setup) -> None:
        if self._end is None or self._end.join is None:
            raise SessionError(Reason.UNKNOWN_SESSION)
        await self._end.join(channel, setup)

    async def ended(self) -> None:
        """Wait until the opener ends the session, if it has not yet."""
        assert self._end is not None
        if self.answer is not None and await self._end.next_values() is not None:
            raise SessionError(Reason.PROTOCOL, "values after all was done")

    def confirm(self) -> None:
        assert self._end is not None
        self._end.agree()

    async def close(self) -> None:
        await release(self._resources.qnic, self._setup.session)


def require_source(service: Service, source: str, is_source: bool, peer: str) -> None:
    """Raise SessionError for a source of pairs that cannot be the one of this service."""
    by = Making.OPENER if is_source else Making.SOURCE
    if uses_source(service, by) and (is_source or source == peer):
        name = service.name.lower()
        text = f"{name} with pairs of {source}, one of its ends: name another host as source"
        raise unsupported(text)


def check_asked(setup: Setup, handshakes: Sequence[Handshake]) -> None:
    """Raise SessionError for a set-up that no service with these handshakes can serve."""
    check_light(setup)
    service = Service(setup.service)
    if setup.handshake not in handshakes:
        text = f"{service.name.lower()} with the handshake "
        text += f"{Handshake(setup.handshake).name}: choose "
        text += " or ".join(handshake.name for handshake in handshakes)
        raise unsupported(text)
    most = most_in_block(service)
    if setup.pairs > most:
        raise unsupported(f"blocks of {setup.pairs} pairs: choose 1 to {most} (block_pairs)")
    if setup.fidelity_ppm > CERTAIN_PPM:
        text = f"a fidelity of {setup.fidelity_ppm} millionths: choose 0 to {CERTAIN_PPM}"
        raise unsupported(text)


def making(setup: Setup, is_source: bool) -> Making:
    if setup.memory == MemoryState.HERALDED:
        return Making.STATION
    return Making.OPENER if is_source else Making.SOURCE


def require_fibers(setup: Setup, role: Role, qnic: Qnic, by: Making = Making.SOURCE) -> None:
    """Raise SessionError if this host has fewer fibres than its role needs."""
    service = Service(setup.service)
    needed, there = fibers_needed(service, role, by), len(qnic.ports)
    if there < needed:
        text = (
            f"{role.value} of {service.name.lower()} needs {needed} fibres, this host has {there}"
        )
        raise unsupported(text)
