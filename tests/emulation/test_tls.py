"""Networks whose programs speak by TLS, each certified by the run."""

import socket
import subprocess
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest
from conftest import TSHARK, qmn
from limits import SOON_S
from scapy.layers.inet import IP, TCP
from scapy.utils import rdpcap

from qmn.scripting import start
from topologies.system.kernel.interfaces import network_of
from views.dissection.dissectors import SCRIPT
from wire.config import DISPATCHER_PORT
from wire.parameters.network import OPENFLOW_PORT

HANDSHAKE = 22  # first byte of a record in TLS (RFC 8446, 5.1)
FEATURES_REPLY, BUNDLE_ADD = "6", "34"  # OpenFlow 1.4, 7.1


def kinds(run: Path, file: str, *options: str) -> set[str]:
    """Return which kinds of OpenFlow messages Wireshark sees in a capture."""
    words = ["-r", file, "-X", f"lua_script:{SCRIPT}", *options, "-Y", "openflow_v5"]
    done = subprocess.run(
        [*TSHARK, *words, "-T", "fields", "-e", "openflow_v5.type"],
        capture_output=True,
        cwd=run,
        text=True,
        check=True,
        timeout=SOON_S,
    )
    return {kind for line in done.stdout.split() for kind in line.split(",")}


def firsts(files: Iterable[Path], port: int) -> Iterator[bytes]:
    """Yield the first bytes of each end of each connection with a port."""
    for file in files:
        heard = set()
        for packet in rdpcap(str(file)):
            text = bytes(packet[TCP].payload) if TCP in packet else b""
            if not text or port not in (packet[TCP].sport, packet[TCP].dport):
                continue
            end = packet[IP].src, packet[TCP].sport, packet[TCP].dport
            if end not in heard:
                heard.add(end)
                yield text


@pytest.mark.image
def test_a_run_by_tls_is_read_by_who_has_its_key_log(tmp_path: Path) -> None:
    done = qmn("--message", "hello", "--tls", runs=tmp_path)
    assert done.returncode == 0, done.stderr
    run = tmp_path / "latest"
    assert (run / "received").read_bytes() == b"hello"
    assert (run / "openflow.keys").stat().st_mode & 0o777 == 0o600
    for files, port in [("c0.pcap", OPENFLOW_PORT), ("s1-*.pcap", DISPATCHER_PORT)]:
        lines = list(firsts(run.glob(files), port))
        assert lines
        assert {data[0] for data in lines} == {HANDSHAKE}
    assert kinds(run, "c0.pcap") == set()
    assert {FEATURES_REPLY, BUNDLE_ADD} <= kinds(run, "all.pcapng")
    log = "-o", "tls.keylog_file:openflow.keys"
    assert {FEATURES_REPLY, BUNDLE_ADD} <= kinds(run, "c0.pcap", *log)


def test_who_is_not_certified_speaks_with_nobody(tmp_path: Path) -> None:
    with start("sdc", folder=tmp_path, tls=True, controller="os-ken") as network:
        assert network.send("alice", "bob", b"hello").data == b"hello"
        c0 = network.net.get("c0")
        for address in c0.addresses.values():
            with socket.create_connection((address, OPENFLOW_PORT), 5) as plain:
                plain.settimeout(10)
                plain.sendall(bytes.fromhex("0500000800000001"))  # HELLO
                assert plain.recv(100)[:1] in (b"", b"\x15")  # nothing, or an alert
        with network_of(c0), pytest.raises(ConnectionRefusedError):
            socket.create_connection(("127.0.0.2", OPENFLOW_PORT), 5).close()
        assert network.send("alice", "bob", b"again").data == b"again"
