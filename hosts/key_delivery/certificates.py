"""Mutual TLS of key managers: who calls is who the certificate names, and its authority is ours."""

import ssl
from typing import Any

from wire.key_manager import KeyManagerConfig

LEAST = ssl.TLSVersion.TLSv1_2


def serving(config: KeyManagerConfig) -> ssl.SSLContext:
    """Return what serves with the manager's certificate, to callers that have one."""
    return _own(ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER), config)


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
    """Return the one common name of a peer's certificate, as the ssl module tells it."""
    subject = certificate.get("subject", ())
    names = [str(value) for part in subject for name, value in part if name == "commonName"]
    return names[0] if len(names) == 1 else None
