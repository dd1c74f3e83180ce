"""Certificates of a run that are somebody's own, who gives a folder of them."""

import shutil
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from pathlib import Path

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import serialization
from cryptography.x509.oid import NameOID

from topologies.system.certificates.authority import AUTHORITY, CertificateFiles
from topologies.system.processes.programs import NetworkError


class GivenCertificates:
    """Certificates that somebody has made: ca.pem, and NAME.pem and NAME.key of each program."""

    def __init__(self, folder: Path, given: Path) -> None:
        """Take them from a folder that is given into a new one of mode 0700, as they are needed.

        Raise NetworkError, here and wherever one is looked at, for what is missing or wrong.
        """
        self._folder, self._given = folder, given
        self._authority = _certificate(given / AUTHORITY)
        folder.mkdir(mode=0o700)
        self.certificate = folder / AUTHORITY
        shutil.copyfile(given / AUTHORITY, self.certificate)

    def check(self, name: str) -> None:
        self._checked(name)

    def _checked(self, name: str) -> x509.Certificate:
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
        certificate, path = self._checked(name), self._given / f"{name}.pem"
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
        found = extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return set()
    return {str(each) for each in found.get_values_for_type(kind)}
