"""One host's stack: joins applications, middleware and hardware.

applications -- Unix socket --> stack -- TCP, quantum metadata --> other stacks
                                  '----- QNIC ------------------> light
"""

import asyncio
import logging
from collections.abc import Awaitable, Callable
from hashlib import blake2b
from typing import Any

from hosts.active_sessions import ActiveSessions
from hosts.applications_port import ApplicationsPort
from hosts.hardware.ports import read_ports
from hosts.hardware.qnic import HardwareError, Qnic
from hosts.incoming import Incoming
from hosts.middleware.device import Device
from hosts.middleware.qkd.keyring import Keyring
from hosts.middleware.services import KINDS, NAMES
from hosts.middleware.services.interception import Interception, InterceptionOptions
from hosts.middleware.services.source import serve_pairs
from hosts.middleware.services.superdense.receiver import ReceivingSession
from hosts.middleware.services.superdense.sender import SendingSession
from hosts.middleware.services.swapping.serving import serve_link
from hosts.middleware.session.abilities import refusal
from hosts.middleware.session.arrangement import Arrangement, Light
from hosts.middleware.session.channel import ANSWER_TIMEOUT_S, MetadataChannel, SessionError
from hosts.middleware.session.host_resources import HostResources
from hosts.middleware.session.options import HANDSHAKES, SessionOptions
from hosts.middleware.session.session import AcceptingSession, OpeningSession, require_source
from hosts.middleware.session.swap_orders import Swaps
from hosts.middleware.verdicts import Verdicts
from wire.config import STANDING, HostConfig
from wire.metadata import FEC_NAMES, Handshake, Reason, Service, Setup, Verdict
from wire.services import Role

log = logging.getLogger("stack")


class Stack:
    """What one host knows: its QNIC, its neighbours, its sessions."""

    def __init__(self, config: HostConfig, qnic: Qnic) -> None:
        self._config = config
        self._qnic = qnic
        self._sessions_made = 0
        self._receiving: dict[int, ReceivingSession] = {}
        self._verdicts = Verdicts(config.device_key, config.light == STANDING)
        self._light = Light()
        self.swaps = Swaps(config.address)
        self._means = HostResources(
            config.name,
            config.seed,
            qnic,
            config.analyser,
            Keyring(config.name, config.pair_secrets, config.keys),
            self.swaps,
            config.abilities,
            config.multi_photon,
        )
        self.active_sessions = ActiveSessions(self.swaps.opens)
        self.device = Device(lambda: read_ports(config.qnics))
        self.applications = ApplicationsPort(
            self.connect, self.request, qnic.watch, self.intercept, self.active_sessions
        )

    def connect(self, options: SessionOptions) -> SendingSession:
        """Prepare a session to a host; raise SessionError if the names are not known."""
        peer = self._peer(options.host)
        setup = Setup(
            session=self._new_session(),
            service=Service.SDC,
            handshake=HANDSHAKES[options.handshake],
            source=self._peer(self._config.source)[1],
            pairs=options.block_pairs,
            frame_bytes=options.frame_bytes,
            rate_hz=options.rate_hz,
            port=options.port,
            fec=FEC_NAMES[options.fec],
            interleave=int(options.interleave),
        )
        setup = self.device.override(setup)
        source = self._config.source
        return self.device.sends(SendingSession(self._qnic, setup, peer, source, self._light))

    def request(self, fields: dict[str, Any]) -> OpeningSession:
        """Prepare a session of a service; raise SessionError for what cannot be asked."""
        name = fields.pop("service", None)
        kind = NAMES.get(name) if isinstance(name, str) else None
        if kind is None:
            text = f"unknown service {name!r}: choose one of {', '.join(sorted(NAMES))}"
            raise SessionError(Reason.UNSUPPORTED, text)
        options = kind.options.from_fields(fields)
        peer = self._peer(options.host)
        source, address = self._peer(options.source or self._config.source)
        is_source = source == self._config.name
        require_source(kind.service, source, is_source, peer[0])
        setup = Setup(
            session=self._new_session(),
            service=kind.service,
            handshake=Handshake.FRAMED,
            source=address,
            pairs=options.block_pairs,
            frame_bytes=1,
            rate_hz=options.rate_hz,
            port=options.port,
            fidelity_ppm=options.fidelity_ppm,
        )
        setup = self.device.override(setup)
        arrangement = Arrangement(setup, peer, source, self._light)
        return OpeningSession(kind, options, self._means, arrangement, setup, is_source)

    def intercept(self, fields: dict[str, Any]) -> Interception:
        """Prepare an interception; raise SessionError for what cannot be asked."""
        options = InterceptionOptions.from_fields(fields)
        return Interception(self._qnic, options, self._config.seed, self._config.name)

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one connection on the quantum-metadata port."""
        channel = MetadataChannel(reader, writer)
        session = 0
        try:
            setup = await channel.receive(Setup, ANSWER_TIMEOUT_S)
            session = setup.session
            setup = self._verdicts.checked(setup, channel.connection)
            await self._handler(setup)(channel, setup)
        except (SessionError, HardwareError) as error:
            log.warning("session %016x with %s: %s", session, channel.peer, error)
            await channel.give_up(error)
        finally:
            channel.close()

    def _handler(self, setup: Setup) -> Callable[[MetadataChannel, Setup], Awaitable[None]]:
        if setup.verdict != Verdict.GRANTED:
            raise self._refusal(setup)
        if setup.service == Service.PAIR_SOURCE:
            return self._emit_pairs
        if setup.service == Service.LINK:
            return self._link
        if setup.service in KINDS:
            return self._accept
        if setup.service != Service.SDC:
            raise SessionError(
                Reason.UNSUPPORTED, f"this host does not offer {Service(setup.service).name}"
            )
        if setup.handshake == Handshake.ONE_PAIR:
            return self._receive_pair
        return self._receive

    def _refusal(self, setup: Setup) -> SessionError:
        """Return what the controller has said."""
        if setup.reason != Reason.NODE_SILENT:
            return refusal(setup, self._config.hosts)
        names = {address: f"{name} ({address})" for name, address in self._config.hosts.items()}
        text = f"{names.get(setup.source, setup.source)} has not answered the controller's order"
        return SessionError(Reason.NODE_SILENT, f"{text} for its chain; is its stack running?")

    async def _emit_pairs(self, channel: MetadataChannel, setup: Setup) -> None:
        with self.active_sessions.engage(setup.session, Role.SOURCE), self.device.serves(setup):
            await serve_pairs(self._qnic, channel, setup, self.device.made)

    async def _receive_pair(self, channel: MetadataChannel, setup: Setup) -> None:
        session = self._receiving.get(setup.session)
        if session is None:
            raise SessionError(Reason.UNKNOWN_SESSION)
        await session.one_pair(channel, setup)

    async def _receive(self, channel: MetadataChannel, setup: Setup) -> None:
        session = ReceivingSession(self._qnic, channel, setup, self._config.analyser)
        with self.active_sessions.engage(setup.session, Role.ACCEPTOR):
            incoming = self.applications.incoming(setup.port, channel.peer)
            self._receiving[setup.session] = session
            self.device.receives(session)
            try:
                await self._deliver(session, incoming)
            finally:
                del self._receiving[setup.session]
                await session.close()

    async def _accept(self, channel: MetadataChannel, setup: Setup) -> None:
        service = Service(setup.service)
        session = AcceptingSession(KINDS[service], self._means, channel, setup)
        with self.active_sessions.engage(setup.session, Role.ACCEPTOR):
            incoming = self.applications.incoming(setup.port, channel.peer, service.name.lower())
            await self._take_part(session, incoming, setup)

    async def _take_part(self, session: AcceptingSession, incoming: Incoming, setup: Setup) -> None:
        try:
            with self.device.serves(setup):
                await session.run(incoming.tell)
                if session.answer is not None:
                    await incoming.ready(session.summary, session.answer)
                await session.finish()
            await incoming.finish(session.summary)
        except BaseException as error:  # whatever it is, the application must hear of it
            await incoming.fail(error)
            raise
        finally:
            await session.close()

    async def _link(self, channel: MetadataChannel, setup: Setup) -> None:
        with self.active_sessions.engage(setup.session, Role.ACCEPTOR), self.device.serves(setup):
            await serve_link(self._means, channel, setup)

    async def _deliver(self, session: ReceivingSession, incoming: Incoming) -> None:
        try:
            await session.run(incoming.deliver)
        except BaseException as error:  # whatever it is, the application must hear of it
            await incoming.fail(error)
            raise
        await incoming.finish(session.statistics)
        session.confirm()

    def _peer(self, host: str) -> tuple[str, str]:
        """Return name and address of a host that is given by either."""
        for name, address in self._config.hosts.items():
            if host in (name, address):
                return name, address
        known = ", ".join(sorted(self._config.hosts))
        raise SessionError(Reason.UNKNOWN_HOST, f"unknown host {host!r}: choose one of {known}")

    def _new_session(self) -> int:
        """Return a session id that no other host makes and that follows from the seed."""
        self._sessions_made += 1
        name = f"{self._config.seed}/{self._config.name}/{self._sessions_made}"
        return int.from_bytes(blake2b(name.encode(), digest_size=8).digest(), "big")
