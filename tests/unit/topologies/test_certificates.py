"""Certificates of a run, as a verifier that is not ours judges them, by the rules of browsers."""

import ipaddress
import shutil
import stat
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.x509.verification import PolicyBuilder, Store, VerificationError

from applications.keys.key_managers import given
from topologies.system.certificates import CertificateAuthority, CertificateFiles, GivenCertificates
from topologies.system.processes.programs import NetworkError

ADDRESS = ipaddress.ip_address("10.0.0.1")


def loaded(path: Path) -> x509.Certificate:
    return x509.load_pem_x509_certificate(path.read_bytes())


def verify(authority: Path, files: CertificateFiles, subject: x509.GeneralName) -> None:
    """Raise VerificationError unless this is a server of that name, by that authority."""
    assert isinstance(subject, x509.DNSName | x509.IPAddress)
    store = Store([loaded(authority)])
    PolicyBuilder().store(store).build_server_verifier(subject).verify(
        loaded(files.certificate), []
    )


def test_a_key_managers_certificate_is_good_for_its_host_alone(tmp_path: Path) -> None:
    authority = CertificateAuthority(tmp_path / "certificates", "ours")
    files = authority.issue("kme-alice", {"alice": str(ADDRESS)})
    verify(authority.certificate, files, x509.DNSName("alice"))
    verify(authority.certificate, files, x509.IPAddress(ADDRESS))
    for other in (x509.DNSName("bob"), x509.IPAddress(ipaddress.ip_address("10.0.0.2"))):
        with pytest.raises(VerificationError):
            verify(authority.certificate, files, other)
    stranger = CertificateAuthority(tmp_path / "others", "ours")
    with pytest.raises(VerificationError):
        verify(stranger.certificate, files, x509.DNSName("alice"))


def test_an_applications_certificate_is_no_servers(tmp_path: Path) -> None:
    authority = CertificateAuthority(tmp_path / "certificates", "ours")
    files = authority.issue("sae-alice")
    with pytest.raises(VerificationError):
        verify(authority.certificate, files, x509.DNSName("sae-alice"))
    usage = loaded(files.certificate).extensions.get_extension_for_class(x509.ExtendedKeyUsage)
    assert list(usage.value) == [x509.oid.ExtendedKeyUsageOID.CLIENT_AUTH]


def test_private_keys_are_their_owners(tmp_path: Path) -> None:
    authority = CertificateAuthority(tmp_path / "certificates", "ours")
    files = authority.issue("sae-alice")
    modes = [
        stat.S_IMODE(path.stat().st_mode) for path in (tmp_path / "certificates", files.private_key)
    ]
    assert modes == [0o700, 0o600]


def test_a_folder_of_certificates_that_lacks_one_is_refused_by_name(tmp_path: Path) -> None:
    authority = CertificateAuthority(tmp_path / "certificates", "ours")
    made = authority.issue("sae-alice")
    assert given(tmp_path / "certificates", ["sae-alice"]) == {"sae-alice": made}
    with pytest.raises(NetworkError, match=r"sae-bob.pem is missing"):
        given(tmp_path / "certificates", ["sae-alice", "sae-bob"])


@pytest.mark.parametrize(("begins_h", "ends_h"), [(-2, -1), (1, 2)])
def test_a_given_certificate_that_is_over_or_not_yet_valid_is_refused(
    tmp_path: Path, begins_h: int, ends_h: int
) -> None:
    authority = CertificateAuthority(tmp_path / "made", "ours")
    made = loaded(authority.issue("bob").certificate)
    given_ones = GivenCertificates(tmp_path / "taken", tmp_path / "made")
    given_ones.check("bob")
    now = datetime.now(UTC)
    dated = x509.CertificateBuilder(
        issuer_name=made.issuer,
        subject_name=made.subject,
        public_key=made.public_key(),
        serial_number=made.serial_number,
        not_valid_before=now + timedelta(hours=begins_h),
        not_valid_after=now + timedelta(hours=ends_h),
        extensions=list(made.extensions),
    ).sign(authority._key, hashes.SHA256())
    path = tmp_path / "made" / "bob.pem"
    path.write_bytes(dated.public_bytes(serialization.Encoding.PEM))
    with pytest.raises(NetworkError, match=r"/bob\.pem holds from .* to .* UTC, not now"):
        given_ones.issue("bob")


def lost(folder: Path) -> None:
    (folder / "bob.key").unlink()


def anothers_key(folder: Path) -> None:
    shutil.copy(folder / "alice.key", folder / "bob.key")


def anothers_certificate(folder: Path) -> None:
    for end in ("pem", "key"):
        shutil.copy(folder / f"alice.{end}", folder / f"bob.{end}")


def of_another_authority(folder: Path) -> None:
    files = CertificateAuthority(folder / "other", "theirs").issue("bob")
    shutil.copy(files.certificate, folder)
    shutil.copy(files.private_key, folder)


def no_certificate(folder: Path) -> None:
    (folder / "bob.pem").write_text("what is this?")


@pytest.mark.parametrize(
    ("spoil", "text"),
    [
        (lost, r"cannot read .*/bob\.key: No such file"),
        (anothers_key, r"/bob\.key is not the key of .*/bob\.pem"),
        (anothers_certificate, r"/bob\.pem does not name 'bob'"),
        (of_another_authority, r"/bob\.pem is not signed by .*/ca\.pem"),
        (no_certificate, r"/bob\.pem is not a certificate as PEM"),
    ],
)
def test_a_given_certificate_that_is_missing_or_wrong_is_named(
    tmp_path: Path, spoil: Callable[[Path], None], text: str
) -> None:
    authority = CertificateAuthority(tmp_path / "made", "ours")
    for name in ("alice", "bob"):
        authority.issue(name)
    given_ones = GivenCertificates(tmp_path / "taken", tmp_path / "made")
    given_ones.check("bob")
    spoil(tmp_path / "made")
    with pytest.raises(NetworkError, match=text):
        given_ones.check("bob")


def test_a_given_certificate_that_lacks_an_address_is_named(tmp_path: Path) -> None:
    CertificateAuthority(tmp_path / "made", "ours").issue("ed", {"ed": "10.0.0.3"})
    given_ones = GivenCertificates(tmp_path / "taken", tmp_path / "made")
    assert given_ones.issue("ed", {"ed": "10.0.0.3"}).certificate.exists()
    with pytest.raises(NetworkError, match=r"/ed\.pem lacks 10\.0\.0\.4 in its subjectAltName"):
        given_ones.issue("ed", {"ed": "10.0.0.4"})
