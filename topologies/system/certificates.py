"""Certificates of a run, by an authority of its own or from somebody's folder.

The authority's hold for a day, and their private keys are in the network's private folder, which
goes with it.
"""

import ipaddress
import shutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from topologies.system.processes.programs import NetworkError

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
        by_address = [
            x509.IPAddress(ipaddress.ip_address(each)) for each in (addresses or {}).values()
        ]
        if names:
            alternatives = x509.SubjectAlternativeName([*names, *by_address])
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


class GivenCertificates:
    """Certificates that somebody has made: ca.pem, and NAME.pem and NAME.key of each program."""

    def __init__(self, folder: Path, path: Path) -> None:
        """Take them from a folder that is given into a new one of mode 0700, as they are needed.

        Raise NetworkError, here and wherever one is looked at, for what is missing or wrong.
        """
        self._folder, self._given = folder, path
        self._authority = _certificate(path / AUTHORITY)
        folder.mkdir(mode=0o700)
        self.certificate = folder / AUTHORITY
        shutil.copyfile(path / AUTHORITY, self.certificate)

    def check(self, name: str) -> x509.Certificate:
        """Return the certificate of a name."""
        path, key_path = self._given / f"{name}.pem", self._given / f"{name}.key"
        certificate, key = _certificate(path), _private_key(key_path)
        try:
            certificate.verify_directly_issued_by(self._authority)
        except (InvalidSignature, ValueError, TypeError) as error:
            raise NetworkError(f"{path} is not signed by {self._given / AUTHORITY}") from error
        begin, end = certificate.not_valid_before_utc, certificate.not_valid_after_utc
        if not begin <= datetime.now(UTC) <= end:
            raise NetworkError(f"{path} holds from {begin:%F %T} to {end:%F %T} UTC, not now")
        if key != certificate.public_key():
            raise NetworkError(f"{key_path} is not the key of {path}")
        if name not in _names(certificate):
            raise NetworkError(f"{path} does not name {name!r}, as common name or DNS name")
        return certificate

    def issue(
        self, name: str, addresses: Mapping[str, str] | None = None, also: Iterable[str] = ()
    ) -> CertificateFiles:
        """Return the certificate of a name, which has these addresses and other names, too."""
        certificate, path = self.check(name), self._given / f"{name}.pem"
        lacking = {*also} - _names(certificate)
        lacking |= {*(addresses or {}).values()} - _addresses(certificate)
        if lacking:
            raise NetworkError(f"{path} lacks {', '.join(sorted(lacking))} in its subjectAltName")
        files = CertificateFiles(self._folder / f"{name}.pem", self._folder / f"{name}.key")
        shutil.copyfile(path, files.certificate)
        files.private_key.touch(mode=0o600)
        shutil.copyfile(self._given / f"{name}.key", files.private_key)
        return files


def _certificate(path: Path) -> x509.Certificate:
    """Read a certificate; raise NetworkError if it is not one."""
    try:
        return x509.load_pem_x509_certificate(path.read_bytes())
    except OSError as error:
        raise _missing(path, error) from error
    except ValueError as error:
        raise NetworkError(f"{path} is not a certificate as PEM: {error}") from error


def _private_key(path: Path) -> object:
    """Read a private key; return its public half. Raise NetworkError if it is not one."""
    try:
        return serialization.load_pem_private_key(path.read_bytes(), None).public_key()
    except OSError as error:
        raise _missing(path, error) from error
    except (ValueError, TypeError) as error:  # the latter, if it takes a password
        raise NetworkError(f"{path} is not a private key as PEM: {error}") from error


def _missing(path: Path, error: OSError) -> NetworkError:
    return NetworkError(
        f"cannot read {path}: {error.strerror}; a folder of certificates has {AUTHORITY}, and "
        "NAME.pem and NAME.key of each program (docs/openflow.md)"
    )


def _names(certificate: x509.Certificate) -> set[str]:
    common = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    return {str(each.value) for each in common} | _alternatives(certificate, x509.DNSName)


def _addresses(certificate: x509.Certificate) -> set[str]:
    return _alternatives(certificate, x509.IPAddress)


def _alternatives(
    certificate: x509.Certificate, kind: type[x509.DNSName] | type[x509.IPAddress]
) -> set[str]:
    try:
        extensions = certificate.extensions
        alternatives = extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return set()
    return {str(value) for value in alternatives.get_values_for_type(kind)}
