"""The tunnel of TLS: its packets between their lengths, and the key as OpenSSL itself reads it."""

import io
import subprocess
from pathlib import Path
from uuid import UUID

import pytest

from hosts.applications.tls import LENGTH, Tls, read_frame, session

KEY = bytes(range(32))


def test_openssl_reads_the_key_out_of_the_file(tmp_path: Path) -> None:
    file = tmp_path / "key.pem"
    file.write_text(session(KEY))
    command = ["openssl", "sess_id", "-in", str(file), "-noout", "-text"]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert f"Resumption PSK: {KEY.hex().upper()}" in said
    assert "TLSv1.3" in said
    assert "TLS_AES_256_GCM_SHA384" in said


@pytest.mark.parametrize("begins", [True, False])
def test_nobody_sees_the_key_among_the_arguments(tmp_path: Path, begins: bool) -> None:
    file = tmp_path / "key.pem"
    ends = ("10.0.0.1", "10.0.0.2"), ("192.168.77.1", "192.168.77.2")
    command = Tls("tls0", str(file), *ends, 24, begins)._command(UUID(int=5))
    assert command[command.index("-psk_session") + 1] == str(file)
    assert "-psk" not in command
    assert command[command.index("-psk_identity") + 1] == str(UUID(int=5))


def test_packets_stand_between_their_lengths() -> None:
    frames = [b"packet", b"", b"x" * 1400]
    stream = io.BytesIO(b"".join(LENGTH.pack(len(each)) + each for each in frames))
    assert [read_frame(stream) for _ in range(4)] == [*frames, None]


@pytest.mark.parametrize("cut", [b"\x00", b"\x00\x05", b"\x00\x05abcd"])
def test_a_connection_that_ends_within_a_packet_ends(cut: bytes) -> None:
    assert read_frame(io.BytesIO(cut)) is None
