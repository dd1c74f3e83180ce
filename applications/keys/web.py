"""HTTPS of a key manager: the paths of ETSI GS QKD 014, and those of other managers."""

import logging
import socket
from collections.abc import Sequence
from typing import Any
from uuid import UUID

from tornado.httpserver import HTTPServer
from tornado.web import Application, HTTPError, RequestHandler

from applications.keys import key_delivery as bodies
from applications.keys.config import KeyManagerConfig
from applications.keys.delivery import KeyDelivery
from applications.keys.key_assignment import ASSIGNMENT_PATH, MAX_ASSIGNMENT, Assignment
from applications.keys.key_relay import RELAY_PATH
from applications.keys.other_managers import named, serving
from applications.keys.refusals import BAD_REQUEST, UNAUTHORIZED, Refused, unauthorized
from applications.timeouts import CLIENT_IDLE_S
from hosts.timeouts import ANSWER_TIMEOUT_S
from programs.connection_shares import SharedListener
from wire.malformed import MalformedPacket

log = logging.getLogger("key-manager")

MAX_HEADER = 1 << 14


class Handler(RequestHandler):
    """A request of who has a certificate; what is wrong becomes the standard's error."""

    def initialize(self, delivery: KeyDelivery) -> None:
        """Keep what answers; called by Tornado."""
        self.delivery = delivery

    def set_default_headers(self) -> None:
        """Let nobody keep keys; called by Tornado."""
        self.set_header("Content-Type", "application/json")
        self.set_header("Cache-Control", "no-store")
        self.clear_header("Server")

    def compute_etag(self) -> None:
        """Return none: a hash of the answer would tell of keys; called by Tornado."""

    @property
    def caller(self) -> str:
        """The SAE or KME that the caller's certificate names; Refused if it names none."""
        certificate = self.request.get_ssl_certificate()
        name = named(certificate) if isinstance(certificate, dict) else None
        if name is None:
            raise unauthorized()
        return name

    @property
    def query(self) -> dict[str, list[bytes]]:
        return self.request.query_arguments

    def write_error(self, status_code: int, **described: Any) -> None:
        """Answer an error; called by Tornado."""
        error = described.get("exc_info", (None, None, None))[1]
        details: Sequence[Any] = ()
        if isinstance(error, Refused):
            status_code, details = error.status, error.details
        elif isinstance(error, MalformedPacket):
            status_code = BAD_REQUEST
        self.set_status(status_code)
        if status_code == UNAUTHORIZED:
            self.clear_header("Content-Type")
            self.finish()
            return
        has_text = isinstance(error, (Refused, MalformedPacket))
        self.finish(bodies.encode_refusal(str(error) if has_text else self._reason, details))

    def log_exception(self, kind: Any, error: Any, trace: Any) -> None:
        """Say in one line what was refused, and all of what was not foreseen."""
        if isinstance(error, (Refused, MalformedPacket)):
            log.info("%s %s: %s", self.request.method, self.request.path, error)
        else:
            super().log_exception(kind, error, trace)


class StatusHandler(Handler):
    """…/{slave_SAE_ID}/status"""

    async def get(self, slave: str) -> None:
        self.finish(bodies.encode_status(await self.delivery.status(self.caller, slave)))


class GetKeyHandler(Handler):
    """…/{slave_SAE_ID}/enc_keys"""

    async def get(self, slave: str) -> None:
        await self._give(slave, bodies.decode_query(self.query))

    async def post(self, slave: str) -> None:
        await self._give(slave, bodies.decode_request(self.request.body))

    async def _give(self, slave: str, request: bodies.KeyRequest) -> None:
        keys = await self.delivery.get_keys(self.caller, slave, request)
        log.info("%d keys to %s as master of %s", len(keys), self.caller, slave)
        self.finish(bodies.encode_keys(keys))


class GetKeyWithIdsHandler(Handler):
    """…/{master_SAE_ID}/dec_keys"""

    def get(self, master: str) -> None:
        self._give(master, bodies.decode_id_query(self.query))

    def post(self, master: str) -> None:
        self._give(master, bodies.decode_key_ids(self.request.body))

    def _give(self, master: str, ids: Sequence[UUID]) -> None:
        keys = self.delivery.fetch(self.caller, master, ids)
        log.info("%d keys to %s as slave of %s", len(keys), self.caller, master)
        self.finish(bodies.encode_keys(keys))


class AssignmentHandler(Handler):
    """Where other key managers say which keys are for applications here."""

    async def post(self) -> None:
        await self.delivery.accept(self.caller, Assignment.decode(self.request.body))


class RelayHandler(Handler):
    """Where other key managers hand keys on."""

    async def post(self) -> None:
        await self.delivery.accept_relay(self.caller, self.request.body)


class NothingHandler(Handler):
    """Every other path."""

    def prepare(self) -> None:
        """Answer 404; called by Tornado."""
        raise HTTPError(404)


def serve(config: KeyManagerConfig, delivery: KeyDelivery) -> HTTPServer:
    """Return a server that listens; OSError or ssl.SSLError if it cannot."""
    shared = {"delivery": delivery}
    keys = r"/api/v1/keys/([^/]+)"
    paths: list[Any] = [
        (rf"{keys}/status", StatusHandler, shared),
        (rf"{keys}/enc_keys", GetKeyHandler, shared),
        (rf"{keys}/dec_keys", GetKeyWithIdsHandler, shared),
        (ASSIGNMENT_PATH, AssignmentHandler, shared),
        (RELAY_PATH, RelayHandler, shared),
    ]
    server = HTTPServer(
        Application(paths, default_handler_class=NothingHandler, default_handler_args=shared),
        ssl_options=serving(config),
        max_header_size=MAX_HEADER,
        max_body_size=MAX_ASSIGNMENT,
        body_timeout=ANSWER_TIMEOUT_S,
        idle_connection_timeout=CLIENT_IDLE_S,
    )
    server.add_socket(SharedListener(socket.create_server((config.address, config.port))))
    return server
