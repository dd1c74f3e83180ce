"""Certificates of a run: an authority of its own, and what it signs for its programs.

They hold for a day, and their private keys are in the network's private folder, which goes with it.
"""

import ipaddress
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

AUTHORITY = "ca.pem"
LASTING = timedelta(days=1)
SLACK = timedelta(minutes=5)  # of clocks
MOST_NAME = 64  # characters of a common name (RFC 5280)


@dataclass(frozen=True)
class CertificateFiles:
    """Paths of a certificate and its private key, as PEM."""

    certificate: Path
    private_key: Path


class CertificateAuthority:
    """Signs what it is asked to; what it makes is in one folder."""

    def __init__(self, folder: Path, name: str) -> None:
        """Make the authority's own key and certificate, and a folder of mode 0700 for all."""
        folder.mkdir(mode=0o700)
        self._folder = folder
        self._key = ec.generate_private_key(ec.SECP256R1())
        self._name = _subject(name)
        constraints = x509.BasicConstraints(ca=True, path_length=0)
        certificate = (
            self._begun(self._name, self._key.public_key())
            .add_extension(constraints, critical=True)
            .add_extension(_usage(signs=True), critical=True)
            .sign(self._key, hashes.SHA256())
        )
        self.certificate = folder / AUTHORITY
        self.certificate.write_bytes(certificate.public_bytes(serialization.Encoding.PEM))

    def check(self, name: str) -> None:
        """Say nothing: it makes what it is asked for."""

    def issue(
        self, name: str, addresses: Mapping[str, str] | None = None, also: Iterable[str] = ()
    ) -> CertificateFiles:
        """Make a certificate for a name; with addresses (by host name) also for a server there.

        `also` are further names of its owner.
        """
        key = ec.generate_private_key(ec.SECP256R1())
        usages = [ExtendedKeyUsageOID.CLIENT_AUTH]
        builder = self._begun(_subject(name), key.public_key())
        builder = builder.add_extension(x509.BasicConstraints(False, None), critical=True)
        builder = builder.add_extension(_usage(signs=False), critical=True)
        names = [x509.DNSName(host) for host in (*(addresses or {}), *also)]
        if addresses:
            usages.append(ExtendedKeyUsageOID.SERVER_AUTH)
        own = [x509.IPAddress(ipaddress.ip_address(each)) for each in (addresses or {}).values()]
        if names:
            alternatives = x509.SubjectAlternativeName([*names, *own])
            builder = builder.add_extension(alternatives, critical=False)
        builder = builder.add_extension(x509.ExtendedKeyUsage(usages), critical=False)
        files = CertificateFiles(self._folder / f"{name}.pem", self._folder / f"{name}.key")
        certificate = builder.sign(self._key, hashes.SHA256())
        files.certificate.write_bytes(certificate.public_bytes(serialization.Encoding.PEM))
        files.private_key.touch(mode=0o600)
        files.private_key.write_bytes(
            key.private_bytes(
                serialization.Encoding.PEM,
                serialization.PrivateFormat.PKCS8,
                serialization.NoEncryption(),
            )
        )
        return files

    def _begun(self, subject: x509.Name, key: ec.EllipticCurvePublicKey) -> x509.CertificateBuilder:
        now = datetime.now(UTC)
        identifier = x509.SubjectKeyIdentifier.from_public_key(self._key.public_key())
        authority = x509.AuthorityKeyIdentifier.from_issuer_subject_key_identifier(identifier)
        return (
            x509.CertificateBuilder()
            .subject_name(subject)
            .issuer_name(self._name)
            .public_key(key)
            .serial_number(x509.random_serial_number())
            .not_valid_before(now - SLACK)
            .not_valid_after(now + LASTING)
            .add_extension(x509.SubjectKeyIdentifier.from_public_key(key), critical=False)
            .add_extension(authority, critical=False)
        )


def _subject(name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name[:MOST_NAME])])


def _usage(*, signs: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=signs,
        crl_sign=signs,
        encipher_only=False,
        decipher_only=False,
    )
