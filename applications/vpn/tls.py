"""A tunnel of TLS 1.3 by OpenSSL's own programs, with an external preshared key (RFC 8446, 4.2.11).

    q's packets --TUN--> stdin of `openssl s_client` ==== TLS ====> stdout of s_server --TUN-->

Each key is a connection of its own; its key ID is the identity. There are no certificates: who
lacks the key cannot finish the handshake. X25519 goes into the keys of TLS as well. The packets
stand one behind the other, each after its length; a length of 0 asks for a sign of
life, and is answered by the same.
"""

import base64
import struct
import subprocess
import threading
from ipaddress import ip_address
from pathlib import Path
from typing import IO
from uuid import UUID

from applications.ip_over_light.ip_packet import decode
from applications.ip_over_light.tun import Tun
from applications.timeouts import COMMAND_TIMEOUT_S, TLS_KEY_S
from wire.malformed import MalformedPacket

PORT = 5443
MTU = 1400
LENGTH = struct.Struct("!H")
CIPHER, CIPHER_NUMBER = "TLS_AES_256_GCM_SHA384", b"\x13\x02"
INTEGER, OCTETS, SEQUENCE = 0x02, 0x04, 0x30  # tags of DER
TIMEOUT = 0xA2  # another, of OpenSSL's field [2]
TLS_1_3 = b"\x03\x04"
ARMOUR = "-----{} SSL SESSION PARAMETERS-----\n"
ASKING = LENGTH.pack(0)
WITH_US = ("setpriv", "--pdeathsig", "KILL")  # whatever ends this program ends that one, too


class Tls:
    def __init__(
        self,
        interface: str,
        session_file: str,  # path at which OpenSSL finds the key, while it needs it
        outside: tuple[str, str],  # this host's address, and the other's
        inside: tuple[str, str],
        prefix_length: int,
        begins: bool,  # whether this end connects
    ) -> None:
        self._interface, self._file = interface, Path(session_file)
        self._outside, self._inside = outside, inside
        self._prefix_length, self._begins = prefix_length, begins
        self._process: subprocess.Popen[bytes] | None = None
        self._key_id: UUID | None = None
        self._answered = threading.Event()

    def set_up(self) -> None:
        self._tun = Tun(self._interface, [f"{self._inside[0]}/{self._prefix_length}"], MTU)
        threading.Thread(target=self._send_all, daemon=True, name="sender").start()

    def use(self, key_id: UUID, key: bytes) -> None:
        """End the connection with the key before; this key is for the next one."""
        self.close()
        self._file.touch(mode=0o600)
        self._file.write_text(session(key))
        self._key_id = key_id
        self._start(key_id)

    def end_former(self) -> None:
        """Do nothing: `use` has ended it."""

    def close(self) -> None:
        process, self._process, self._key_id = self._process, None, None
        self._file.unlink(missing_ok=True)
        if process is not None:
            process.kill()
            process.wait(COMMAND_TIMEOUT_S)

    def handshake_done(self) -> bool:
        if not self._begins or self._key_id is None:
            return False
        if self._process is not None and self._process.poll() is not None:  # nobody listened yet
            self._start(self._key_id)
        return self._answered.is_set()

    def _start(self, key_id: UUID) -> None:
        self._answered.clear()
        process = subprocess.Popen(
            self._command(key_id), stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        self._process = process
        threading.Thread(target=self._receive, args=[process], daemon=True).start()
        if self._begins:
            self._send(ASKING)

    def _command(self, key_id: UUID) -> list[str]:
        address, other = self._outside
        way = ["s_client", "-connect", f"{other}:{PORT}", "-bind", address]
        if not self._begins:
            way = ["s_server", "-accept", f"{address}:{PORT}", "-naccept", "1", "-nocert"]
        psk = ["-psk_identity", str(key_id), "-psk_session", str(self._file)]
        return [*WITH_US, "openssl", *way, "-quiet", "-tls1_3", "-ciphersuites", CIPHER, *psk]

    def _send_all(self) -> None:
        """Pass on what the kernel sends; what comes while there is no connection is lost."""
        while True:
            packet = self._tun.read()
            self._send(LENGTH.pack(len(packet)) + packet)

    def _send(self, framed: bytes) -> None:
        process = self._process
        if process is None or process.stdin is None:
            return
        try:
            process.stdin.write(framed)
            process.stdin.flush()
        except BrokenPipeError:
            return  # it has just ended: the packet is lost, as on any network

    def _receive(self, process: "subprocess.Popen[bytes]") -> None:
        """Pass on what one connection brings, until its end."""
        assert process.stdout is not None
        while (framed := read_frame(process.stdout)) is not None:
            if framed:
                self._deliver(framed)
            elif self._begins:
                self._file.unlink(missing_ok=True)
                self._answered.set()
            else:
                self._file.unlink(missing_ok=True)
                self._send(ASKING)

    def _deliver(self, data: bytes) -> None:
        """Let this host receive a packet of the other end's; any other is dropped."""
        try:
            packet = decode(data, MTU)
        except MalformedPacket:
            return
        address, other = (ip_address(each) for each in self._inside)
        if (packet.source, packet.destination) == (other, address):
            self._tun.write(packet.data)


def read_frame(stream: IO[bytes]) -> bytes | None:
    """Return the next packet of a connection, b"" if it is a question, None at its end."""
    header = stream.read(LENGTH.size)
    if len(header) < LENGTH.size:
        return None
    (length,) = LENGTH.unpack(header)
    data = stream.read(length)
    return data if len(data) == length else None


def session(key: bytes) -> str:
    """Return an SSL_SESSION with a preshared key, in PEM, as OpenSSL's -psk_session reads it.

    In a file, nobody sees it among the arguments of programs. Its parts are those of OpenSSL's
    i2d_SSL_SESSION: format 1, version of TLS, cipher suite, no session ID, the key, and how long it
    is good for from when it is read: OpenSSL takes 3 s for one that does not say so.
    """
    parts = [(INTEGER, b"\x01"), (INTEGER, TLS_1_3), (OCTETS, CIPHER_NUMBER), (OCTETS, b"")]
    parts += [(OCTETS, key), (TIMEOUT, _der(INTEGER, TLS_KEY_S.to_bytes(3, "big")))]
    body = _der(SEQUENCE, b"".join(_der(*part) for part in parts))
    text = base64.b64encode(body).decode()
    return f"{ARMOUR.format('BEGIN')}{text}\n{ARMOUR.format('END')}"


def _der(tag: int, content: bytes) -> bytes:
    if len(content) > 0x7F:
        raise ValueError(f"{len(content)} bytes: keys have 64 at most here")
    return bytes((tag, len(content))) + content
