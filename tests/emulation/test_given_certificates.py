"""Networks whose programs speak by TLS with certificates that somebody else has made: openssl."""

import shutil
import socket
import ssl
import subprocess
from pathlib import Path

import pytest
from limits import SOON_S

from qmn.scripting import start
from topologies.system.kernel.interfaces import network_of
from topologies.system.processes.programs import NetworkError
from wire.config import DISPATCHER_PORT

ALTERNATIVES = {
    "alice": "DNS:alice",
    "bob": "DNS:bob",
    "charlie": "DNS:charlie",
    "ed": "DNS:ed,IP:10.0.0.4",
    "q1": "DNS:q1,DNS:localhost,IP:127.0.0.1",
    "open-vswitch": "DNS:s1",
    "c0": "DNS:c0,IP:198.18.1.1,IP:198.18.2.1",
}
NEW_KEY = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes")


def openssl(folder: Path, *words: str) -> None:
    subprocess.run(["openssl", *words], cwd=folder, check=True, capture_output=True, timeout=SOON_S)


def authority(folder: Path) -> None:
    folder.mkdir()
    words = "-keyout ca.key -out ca.pem -subj /CN=us"
    openssl(folder, "req", "-x509", *NEW_KEY, *words.split())


def certify(folder: Path, name: str) -> None:
    """Let the authority of a folder sign a new key."""
    words = f"-keyout {name}.key -out {name}.csr -subj /CN={name}"
    names = f"subjectAltName={ALTERNATIVES[name]}"
    openssl(folder, "req", "-new", *NEW_KEY, *words.split(), "-addext", names)
    words = f"-in {name}.csr -CA ca.pem -CAkey ca.key -CAcreateserial -copy_extensions copy"
    openssl(folder, "x509", "-req", *words.split(), "-out", f"{name}.pem")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of certificates for everybody in `sdc`, of an authority of its own."""
    folder = tmp_path_factory.mktemp("made") / "tls"
    authority(folder)
    for name in ALTERNATIVES:
        certify(folder, name)
    return folder


def test_programs_show_the_certificates_that_are_given(made: Path) -> None:
    with start("sdc", tls_from=str(made)) as network:
        assert network.send("alice", "bob", b"hello").data == b"hello"
        context = ssl.create_default_context(cafile=made / "ca.pem")
        context.load_cert_chain(made / "alice.pem", made / "alice.key")
        with network_of(network.net.get("alice")):
            plain = socket.create_connection(("10.0.0.4", DISPATCHER_PORT), 5)
        with context.wrap_socket(plain, server_hostname="10.0.0.4") as connection:
            shown = connection.getpeercert(binary_form=True)
    assert shown == ssl.PEM_cert_to_DER_cert((made / "ed.pem").read_text())


def test_one_that_is_missing_is_named_before_anything_starts(made: Path, tmp_path: Path) -> None:
    """Other faults of one: tests/unit/topologies/test_certificates.py."""
    folder = tmp_path / "tls"
    shutil.copytree(made, folder)
    (folder / "bob.key").unlink()
    missing = pytest.raises(NetworkError, match=r"cannot read .*/bob\.key: No such file")
    with missing, start("sdc", tls_from=str(folder)) as network:
        pytest.fail(f"{network} has started")
