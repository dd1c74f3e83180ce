"""The tunnel of TLS: its packets between their lengths, and the key as OpenSSL itself reads it."""

import io
import subprocess
import time
from pathlib import Path
from select import select
from uuid import UUID

import pytest
from limits import wait_until

from applications.vpn.tls import LENGTH, PORT, Tls, read_frame, session

KEY = bytes(range(32))
LISTENS = f"0100007F:{PORT:04X} 00000000:0000 0A"  # on the loopback, as the kernel writes it


def test_openssl_reads_the_key_out_of_the_file(tmp_path: Path) -> None:
    file = tmp_path / "key.pem"
    file.write_text(session(KEY))
    command = ["openssl", "sess_id", "-in", str(file), "-noout", "-text"]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert f"Resumption PSK: {KEY.hex().upper()}" in text
    assert "TLSv1.3" in text
    assert "TLS_AES_256_GCM_SHA384" in text


def test_a_key_is_as_long_as_one_byte_of_length_tells() -> None:
    """X.690, 8.1.3.4: a content has up to 127 bytes, of which 22 are not the key's."""
    assert session(bytes(105))
    with pytest.raises(ValueError, match="128 bytes"):
        session(bytes(106))


def test_a_key_is_good_for_who_comes_late(tmp_path: Path) -> None:
    """OpenSSL by itself takes none that it has read more than 3 s before."""
    file = tmp_path / "key.pem"
    file.write_text(session(KEY))
    pipe, local = subprocess.PIPE, ("127.0.0.1", "127.0.0.1")
    serving, asking = (
        Tls("tls0", str(file), local, ("192.168.77.1", "192.168.77.2"), 24, begins)._command(
            UUID(int=5)
        )
        for begins in (False, True)
    )
    with subprocess.Popen(serving, stdin=pipe, stdout=pipe) as server:
        try:
            wait_until(lambda: LISTENS in Path("/proc/net/tcp").read_text(), "OpenSSL listens")
            time.sleep(3.5)
            with subprocess.Popen(asking, stdin=pipe, stdout=pipe) as client:
                assert client.stdin is not None
                assert server.stdout is not None
                client.stdin.write(b"late\n")
                client.stdin.flush()
                assert select([server.stdout], [], [], 20)[0], "nothing comes, nor the end"
                assert server.stdout.read(5) == b"late\n"
                client.kill()
        finally:
            server.kill()


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
