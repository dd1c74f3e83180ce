"""Credentials of a program in TLS: what it shows to the others of its run, and knows them by.

The secrets that two hosts each share: files in a private folder, one for two hosts.

Which of the two first needs it draws it: so what there is grows with the pairs that use it.
"""

import os
import secrets
import ssl
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

SECRET_BYTES = 32


@dataclass(frozen=True)
class Credentials:
    """Paths of PEM files: the run's authority, and what it has signed for one node."""

    authority: str
    certificate: str
    private_key: str

    def read(self) -> tuple[bytes, bytes, bytes]:
        """Return authority, certificate and private key; raise OSError."""
        authority, certificate, private_key = (
            Path(path).read_bytes() for path in (self.authority, self.certificate, self.private_key)
        )
        return authority, certificate, private_key

    def client(self) -> ssl.SSLContext:
        """Return the context of who connects: the server has to have the address asked for."""
        return self._loaded(ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT))

    def server(self, key_log: str = "") -> ssl.SSLContext:
        """Return the context of who is connected to, by those alone that the authority has signed.

        Into the file `key_log` go the secrets of its connections, by which Wireshark reads them.
        """
        context = self._loaded(ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER))
        context.verify_mode = ssl.CERT_REQUIRED
        if key_log:
            context.keylog_filename = key_log
        return context

    def _loaded(self, context: ssl.SSLContext) -> ssl.SSLContext:
        context.minimum_version = ssl.TLSVersion.TLSv1_2
        context.load_verify_locations(self.authority)
        context.load_cert_chain(self.certificate, self.private_key)
        return context


def certified_names(certificate: Mapping[str, Any]) -> set[str]:
    subject = {
        value for part in certificate["subject"] for key, value in part if key == "commonName"
    }
    others = certificate.get("subjectAltName", ())
    return subject | {value for kind, value in others if kind == "DNS"}


def secret_file(folder: Path, one: str, other: str) -> Path:
    file = folder / ":".join(sorted((one, other)))
    if not file.exists():
        drawn = file.with_name(f".{file.name}-{os.getpid()}")
        drawn.touch(mode=0o600)
        drawn.write_text(secrets.token_hex(SECRET_BYTES))
        with suppress(FileExistsError):  # the other has drawn it meanwhile
            os.link(drawn, file)
        drawn.unlink()
    return file
