"""A session of a service at either end: arranged, run, and ended, whatever happens."""

from dataclasses import replace
from typing import Any

from hosts.hardware.qnic import HardwareError, Qnic, release
from hosts.middleware.session import abilities
from hosts.middleware.session.arrangement import Arrangement
from hosts.middleware.session.channel import (
    IDLE_TIMEOUT_S,
    MetadataChannel,
    SessionError,
    SilentPeer,
    unexpected,
)
from hosts.middleware.session.host_resources import HostResources
from hosts.middleware.session.offers import check_light
from hosts.middleware.session.options import MAX_BLOCK_PAIRS
from hosts.middleware.session.service import (
    AcceptorEnd,
    Answerer,
    ConnectionEnd,
    OpenerEnd,
    ServiceKind,
    Tell,
)
from hosts.middleware.session.service_options import ServiceOptions
from wire.features import NOTHING, Abilities
from wire.metadata import Finish, Handshake, Reason, Service, Setup
from wire.services import Role, beams, fibers_needed

NO_DIGEST = bytes(32)
CERTAIN_PPM = 1_000_000


class OpeningSession:
    """A session that this host asks for."""

    def __init__(
        self,
        kind: ServiceKind,
        options: ServiceOptions,
        means: HostResources,
        arrangement: Arrangement,
        setup: Setup,
        is_source: bool,
    ) -> None:
        require_fibers(setup, Role.OPENER, means.qnic, is_source)
        self._kind, self._options, self._means = kind, options, means
        self._arrangement, self._setup, self._is_source = arrangement, setup, is_source
        self.summary: dict[str, Any] = {}
        self.answer: Answerer | None = None  # to the application's questions, if it may ask

    @property
    def setup(self) -> Setup:
        """What is asked for."""
        return self._setup

    async def run(self, tell: Tell) -> None:
        """Arrange light, do what the service does; raise SessionError if it cannot be."""
        await self._arrangement.open()
        channel = self._arrangement.channel
        try:
            end = await self._arranged(channel, tell)
            self.answer = await self._kind.open(end, self._options)
        except (SessionError, HardwareError) as error:
            await channel.give_up(error)
            raise
        self.summary = end.summary

    async def _arranged(self, channel: MetadataChannel, tell: Tell) -> OpenerEnd:
        """Return this end, once it is known what the other can, and the source is there."""
        theirs = Abilities(NOTHING, 0)
        if abilities.are_told(self._kind.service):
            connection = ConnectionEnd(self._means.qnic, self._setup, channel)
            pairs, theirs = await abilities.hear(connection)
            self._setup = replace(self._setup, pairs=pairs)
        light = beams(self._kind.service, self._is_source)
        if any(end.role == Role.SOURCE for beam in light for end in beam):
            await self._arrangement.engage_source()
        return OpenerEnd(
            self._means.qnic,
            self._setup,
            channel,
            self._means,
            tell,
            self._means.draws(self._setup.session),
            arrangement=self._arrangement,
            theirs=theirs,
            is_source=self._is_source,
        )

    async def lost(self) -> None:
        """Wait while the other end is there, but not for ever; raise SessionError then."""
        channel = self._arrangement.channel
        try:
            message = await channel.next(IDLE_TIMEOUT_S)
        except SilentPeer as error:
            text = f"what a session leaves is kept for {IDLE_TIMEOUT_S:g} s: ask for more in time"
            raise SessionError(Reason.PROTOCOL, text) from error
        raise unexpected(message, channel.peer)

    async def finish(self) -> None:
        """End the session at both ends."""
        finish = Finish(self._setup.session, 0, NO_DIGEST)
        await self._arrangement.channel.request(finish)

    async def close(self) -> None:
        """Let go of connections, orders and photons."""
        self._arrangement.close()
        self._means.swaps.forget(self._setup.session)
        await release(self._means.qnic, self._setup.session)


class AcceptingSession:
    """A session that another host has asked for."""

    def __init__(
        self,
        kind: ServiceKind,
        means: HostResources,
        channel: MetadataChannel,
        setup: Setup,
    ) -> None:
        check_asked(setup)
        require_fibers(setup, Role.ACCEPTOR, means.qnic)
        self._kind, self._means, self._channel, self._setup = kind, means, channel, setup
        self._end: AcceptorEnd | None = None
        self.summary: dict[str, Any] = {}
        self.answer: Answerer | None = None  # to the application's questions, if it may ask

    async def run(self, tell: Tell) -> None:
        """Do what the service does; raise SessionError if it fails."""
        means, setup = self._means, self._setup
        draws = means.draws(setup.session)
        end = AcceptorEnd(means.qnic, setup, self._channel, means, tell, draws)
        end.agree()
        if abilities.are_told(self._kind.service):
            abilities.say(end, means.abilities)
        self._end = end
        self.answer = await self._kind.accept(end)
        self.summary = end.summary

    async def finish(self) -> None:
        """Wait until the opener ends the session, if it has not yet, and agree."""
        assert self._end is not None
        if self.answer is not None and await self._end.next_values() is not None:
            raise SessionError(Reason.PROTOCOL, "values after all was done")
        self._end.agree()

    async def close(self) -> None:
        """Let go of photons."""
        await release(self._means.qnic, self._setup.session)


def require_source(service: Service, source: str, is_source: bool, peer: str) -> None:
    """Raise SessionError for a source of pairs that cannot be the one of this service."""
    used = any(end.role == Role.SOURCE for beam in beams(service, is_source) for end in beam)
    if used and (is_source or source == peer):
        name = service.name.lower()
        text = f"{name} with pairs of {source}, one of its ends: name another host as source"
        raise SessionError(Reason.UNSUPPORTED, text)


def check_asked(setup: Setup) -> None:
    """Raise SessionError for a set-up that no service can serve."""
    check_light(setup)
    if setup.handshake != Handshake.FRAMED:
        text = f"{Service(setup.service).name.lower()} with the handshake "
        text += f"{Handshake(setup.handshake).name}: choose FRAMED"
        raise SessionError(Reason.UNSUPPORTED, text)
    if setup.pairs > MAX_BLOCK_PAIRS:
        text = f"blocks of {setup.pairs} pairs: choose 1 to {MAX_BLOCK_PAIRS} (block_pairs)"
        raise SessionError(Reason.UNSUPPORTED, text)
    if setup.fidelity_ppm > CERTAIN_PPM:
        text = f"a fidelity of {setup.fidelity_ppm} millionths: choose 0 to {CERTAIN_PPM}"
        raise SessionError(Reason.UNSUPPORTED, text)


def require_fibers(setup: Setup, role: Role, qnic: Qnic, own_source: bool = False) -> None:
    """Raise SessionError if this host has fewer fibres than its role needs."""
    service = Service(setup.service)
    needed, there = fibers_needed(service, role, own_source), len(qnic.ports)
    if there < needed:
        text = (
            f"{role.value} of {service.name.lower()} needs {needed} fibres, this host has {there}"
        )
        raise SessionError(Reason.UNSUPPORTED, text)
