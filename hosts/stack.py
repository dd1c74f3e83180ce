"""One host's stack: joins applications, middleware and hardware.

applications -- Unix socket --> stack -- TCP, quantum metadata --> other stacks
                                  '----- QNIC ------------------> light
"""

import asyncio
import json
import logging
from collections.abc import Awaitable, Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import replace
from hashlib import blake2b
from pathlib import Path
from typing import Any

from hosts.hardware.ports import read_ports
from hosts.hardware.qnic import Qnic, release
from hosts.hardware.replies import HardwareError
from hosts.middleware.device import Device
from hosts.middleware.services import kinds, named
from hosts.middleware.services.source import check_source, make_pairs
from hosts.middleware.session.arrangement import Arrangement, Light
from hosts.middleware.session.channel import MetadataChannel
from hosts.middleware.session.ends import ConnectionEnd
from hosts.middleware.session.errors import SessionError, unsupported
from hosts.middleware.session.host_resources import HostResources
from hosts.middleware.session.node_features import refusal
from hosts.middleware.session.offers import check_wavelength
from hosts.middleware.session.options import SessionOptions
from hosts.middleware.session.session import AcceptingSession, OpeningSession, require_source
from hosts.middleware.session.values import Lifetimes
from hosts.serving.active_sessions import ActiveSessions, Verdicts
from hosts.serving.applications_port import ApplicationsPort
from hosts.serving.link_monitors import LinkMonitors
from hosts.serving.processing import (
    Attending,
    Interception,
    Sessions,
    interception,
    processing_unit,
)
from hosts.timeouts import ANSWER_TIMEOUT_S
from wire.config import ADJUSTED, STANDING, HostConfig
from wire.light import Role
from wire.metadata.header import session_number
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Handshake, MemoryState, Reason, Service, Verdict
from wire.optical import ANY_WAVELENGTH
from wire.parameters.checks import remedy
from wire.services import is_heralded

KINDS, NAMED = kinds(), named()  # once for all stacks that are forked
log = logging.getLogger("stack")


class Stack:
    """The stack of one host: its QNIC, its neighbours, its sessions."""

    def __init__(self, config: HostConfig, qnic: Qnic) -> None:
        self._config = config
        self._qnic = qnic
        self._sessions_made = 0
        name = f"{config.seed}/{config.name}"
        self._first_session = int.from_bytes(blake2b(name.encode(), digest_size=4).digest(), "big")
        self._accepting: dict[int, AcceptingSession] = {}
        self._verdicts = Verdicts(config.device_key, config.light == STANDING)
        self._light = Light()
        self._resources = HostResources(
            config.name,
            config.seed,
            qnic,
            config.analyser,
            config.pair_secrets,
            config.keys,
            config.node_features,
            config.multi_photon,
            tuple(config.intensities),
            Lifetimes(config.t1_s, config.t2_s, config.depolarizing_s, config.cutoff_s),
            lambda: config.hosts,
            config.channels_mhz,
        )
        self._cut_off(None)
        self.active_sessions = ActiveSessions()
        self.device = Device(
            lambda: read_ports(config.qnics), cut_off=self._cut_off, compensate=self._compensate
        )
        self.applications = ApplicationsPort(
            self.request, qnic.watch, self.intercept, self._opening
        )
        sessions = Sessions(self.request, self._opening, self.applications.expecting)
        self.unit = processing_unit(config, qnic, sessions, self._new_session)
        self.applications.unit = self.unit
        self.link_monitors = LinkMonitors(
            config.name, config.address, self.request, self._opening, self.device.preempt
        )

    def _cut_off(self, cutoff_us: int | None) -> None:
        """Have the memory drop what is older, by its own default if none is set."""
        config = self._config
        cutoff_s = config.cutoff_s if cutoff_us is None else cutoff_us / 1e6
        self._qnic.cutoff_s = cutoff_s
        lifetimes = Lifetimes(config.t1_s, config.t2_s, config.depolarizing_s, cutoff_s)
        self._resources = replace(self._resources, lifetimes=lifetimes)

    def _resources_now(self) -> HostResources:
        """Take over how the memory was adjusted last; return the resources of a new session."""
        with suppress(FileNotFoundError):
            text = Path(self._config.socket).with_suffix(ADJUSTED).read_text()
            self._config = replace(self._config, **json.loads(text))
            self._cut_off(self.device.settings.cutoff_us)
        return self._resources

    def _compensate(self, every_s: int | None) -> None:
        """Have the compensator look so often, as its device says if nothing is set."""
        if not self._config.compensates:
            text = "no compensator here: give the host's device compensator.retarders, 3 or 4"
            raise unsupported(text)
        self._qnic.compensate(every_s)

    def request(self, fields: dict[str, Any], number: int | None = None) -> OpeningSession:
        """Prepare a session of a service; raise SessionError for what cannot be asked.

        Its number is a new one, unless the controller has chosen it.
        """
        name = fields.pop("service", None)
        kind = NAMED.get(name) if isinstance(name, str) else None
        if kind is None:
            raise unsupported(f"unknown service {name!r}: {remedy(str(name), sorted(NAMED))}")
        options = kind.options.from_fields(fields)
        peer = self._peer(options.host)
        source, address = self._peer(self._source_of(options))
        is_source = source == self._config.name
        heralded = is_heralded(kind.service, self._resources.node_features.features, options.source)
        if not heralded:
            require_source(kind.service, source, is_source, peer[0])
        setup = Setup(
            session=self._new_session() if number is None else number,
            service=kind.service,
            source=address,
            wavelength_pm=ANY_WAVELENGTH,
            memory=MemoryState.HERALDED if heralded else MemoryState.ANY,
            **options.asked(),
        )
        setup = self.device.override(setup)
        arrangement = Arrangement(setup, peer, source, self._light)
        return OpeningSession(kind, options, self._resources_now(), arrangement, setup, is_source)

    def intercept(self, fields: dict[str, Any]) -> Interception:
        """Prepare an interception; raise SessionError for what cannot be asked."""
        resources = self._resources
        return interception(self._config, lambda pm: resources.at(pm).qnic, fields)

    def takes_part(self, session: int) -> bool:
        return session in self.active_sessions.sessions

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        channel = MetadataChannel(reader, writer)
        session = 0
        try:
            setup = await channel.receive(Setup, ANSWER_TIMEOUT_S)
            session = setup.session
            setup = self._verdicts.checked(setup, channel.connection)
            await self._handler(setup, channel)(channel, setup)
        except (SessionError, HardwareError) as error:
            log.warning("session %016x with %s: %s", session, channel.peer, error)
            await channel.give_up(error)
        finally:
            channel.close()

    def _handler(
        self, setup: Setup, channel: MetadataChannel
    ) -> Callable[[MetadataChannel, Setup], Awaitable[None]]:
        if setup.verdict != Verdict.GRANTED:
            raise self._refusal(setup, channel.connection[0])
        if setup.service == Service.PAIR_SOURCE:
            return self._emit_pairs
        kind = KINDS.get(Service(setup.service))
        if kind is None:
            raise unsupported(f"this host does not offer {Service(setup.service).name}")
        joins = setup.handshake == Handshake.ONE_PAIR and Handshake.ONE_PAIR in kind.handshakes
        return self._join if joins else self._accept

    def _refusal(self, setup: Setup, opener: str) -> SessionError:
        if setup.obstacle:
            by_address = {address: name for name, address in self._config.hosts.items()}
            ends = f"from {by_address.get(opener, opener)} to {self._config.name}"
            return SessionError(Reason(setup.reason), f"no light path {ends}: {setup.obstacle}")
        return refusal(setup, self._config.hosts)

    def _engaged(
        self, setup: Setup, channel: MetadataChannel, role: Role
    ) -> AbstractContextManager[None]:
        return self.active_sessions.engage(setup.session, role, channel.connection[0])

    async def _emit_pairs(self, channel: MetadataChannel, setup: Setup) -> None:
        with self._engaged(setup, channel, Role.SOURCE), self.device.serves(setup):
            check_wavelength(setup)
            qnic = self._resources.at(setup.wavelength_pm).qnic
            end = ConnectionEnd(qnic, setup, channel)
            check_source(end.side)
            try:
                states = self._resources.distinguishable_states
                await end.perform(make_pairs(end.side, self.device.made, states))
            finally:
                self._light.free()
                await release(qnic, setup.session)

    @contextmanager
    def _opening(self, session: OpeningSession) -> Iterator[None]:
        number = session.setup.session
        with self.active_sessions.engage(number, Role.OPENER), self.device.opens(session):
            yield

    async def _accept(self, channel: MetadataChannel, setup: Setup) -> None:
        service = Service(setup.service)
        session = AcceptingSession(KINDS[service], self._resources_now(), channel, setup)
        with self._engaged(setup, channel, Role.ACCEPTOR):
            incoming = self._attending(channel, setup)
            with self.device.accepts(session):
                self._accepting[setup.session] = session
                try:
                    await self._take_part(session, incoming)
                finally:
                    del self._accepting[setup.session]
                    await session.close()

    def _attending(self, channel: MetadataChannel, setup: Setup) -> Attending:
        ordered = self.link_monitors.expected(setup, channel.connection[0])
        if ordered is not None:
            return ordered
        service = Service(setup.service).name.lower()
        return self.applications.incoming(setup.port, channel.peer, service)

    async def _take_part(self, session: AcceptingSession, incoming: Attending) -> None:
        try:
            await session.run(incoming)
            if session.answer is not None:
                await incoming.ready(session.summary, session.answer)
            await session.ended()
            self._light.free()  # before the application asks for some itself
            await incoming.finish(session.summary)
        except BaseException as error:  # whatever it is, the application must hear of it
            self._light.free()
            await incoming.fail(error)
            raise
        session.confirm()

    async def _join(self, channel: MetadataChannel, setup: Setup) -> None:
        session = self._accepting.get(setup.session)
        if session is None:
            raise SessionError(Reason.UNKNOWN_SESSION)
        await session.join(channel, setup)

    def _source_of(self, options: SessionOptions) -> str:
        """Return the host that makes the pairs of a session: the one asked for, or everybody's."""
        source = options.source or self._config.source
        if not source:
            text = "no host of this network makes pairs for others: add one with source=True, or "
            raise SessionError(Reason.UNKNOWN_HOST, f"{text}name a host that is to (source)")
        return source

    def _peer(self, host: str) -> tuple[str, str]:
        for name, address in self._config.hosts.items():
            if host in (name, address):
                return name, address
        text = f"unknown host {host!r}: {remedy(host, sorted(self._config.hosts))}"
        raise SessionError(Reason.UNKNOWN_HOST, text)

    def _new_session(self) -> int:
        """Return a number that no other host may open a session of; the seed decides the first."""
        number = session_number(self._config.address, self._first_session + self._sessions_made)
        self._sessions_made += 1
        return number
