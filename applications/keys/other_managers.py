"""Tells other hosts' key managers, over mutual TLS, what keys were assigned, and hands keys on.

By mutual TLS: who calls is who the certificate names, and its authority is ours.
"""

import ssl
from typing import Any

from tornado.httpclient import HTTPClientError, HTTPRequest
from tornado.simple_httpclient import SimpleAsyncHTTPClient

from applications.keys.config import KeyManagerConfig, manager_name
from applications.keys.key_assignment import ASSIGNMENT_PATH, Assignment
from applications.keys.key_delivery import MAX_REQUEST, decode_refusal
from applications.keys.key_relay import RELAY_PATH
from applications.keys.refusals import BAD_REQUEST, unavailable
from applications.keys.route_messages import MAX_HOPS
from hosts.timeouts import ANSWER_TIMEOUT_S, CONNECT_TIMEOUT_S
from wire.malformed import MalformedPacket

LEAST = ssl.TLSVersion.TLSv1_2


def serving(config: KeyManagerConfig) -> ssl.SSLContext:
    """Return what serves with the manager's certificate, to callers that have one.

    Into its key log go the secrets of its connections, by which Wireshark reads them.
    """
    context = _own(ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER), config)
    if config.key_log:
        context.keylog_filename = config.key_log
    return context


def calling(config: KeyManagerConfig) -> ssl.SSLContext:
    """Return what calls another manager with it, whose address its certificate must have."""
    return _own(ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT), config)


def _own(context: ssl.SSLContext, config: KeyManagerConfig) -> ssl.SSLContext:
    context.minimum_version = LEAST
    context.verify_mode = ssl.CERT_REQUIRED
    context.load_verify_locations(config.authority)
    context.load_cert_chain(config.certificate, config.private_key)
    return context


def named(certificate: dict[str, Any]) -> str | None:
    subject = certificate.get("subject", ())
    names = [str(value) for part in subject for name, value in part if name == "commonName"]
    return names[0] if len(names) == 1 else None


class OtherManagers:
    def __init__(self, config: KeyManagerConfig) -> None:
        """Read the certificates; ssl.SSLError or OSError if they cannot be used."""
        self._config = config
        self._context = calling(config)
        self._client = SimpleAsyncHTTPClient(force_instance=True, max_body_size=MAX_REQUEST)

    async def tell(self, host: str, assignment: Assignment) -> None:
        """Assign keys at a host; raise Refused if it does not take them."""
        await self._post(host, ASSIGNMENT_PATH, assignment.encode(), ANSWER_TIMEOUT_S)

    async def relay(self, host: str, body: bytes) -> None:
        """Hand keys on to a host; raise Refused if they do not come to the end of their route."""
        await self._post(host, RELAY_PATH, body, MAX_HOPS * ANSWER_TIMEOUT_S)

    async def _post(self, host: str, path: str, body: bytes, timeout_s: float) -> None:
        request = HTTPRequest(
            f"https://{self._config.hosts[host]}:{self._config.port}{path}",
            method="POST",
            headers={"Content-Type": "application/json"},
            body=body,
            ssl_options=self._context,
            connect_timeout=CONNECT_TIMEOUT_S,
            request_timeout=timeout_s,
            follow_redirects=False,
        )
        name = manager_name(host)
        try:
            await self._client.fetch(request)
        except HTTPClientError as error:
            raise unavailable(f"{name} has not taken the keys: {_why(error)}") from error
        except (OSError, ssl.SSLError) as error:
            raise unavailable(f"{name} does not answer: {error}") from error

    def close(self) -> None:
        self._client.close()


def _why(error: HTTPClientError) -> str:
    if error.response is None or error.code < BAD_REQUEST:
        return str(error)
    try:
        return decode_refusal(error.response.body)
    except MalformedPacket:
        return str(error)
