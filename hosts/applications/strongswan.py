"""strongSwan as any program drives it: by `swanctl`, over the socket of a charon of its own.

The key enters IKEv2 as a postquantum preshared key (PPK, RFC 8784), which is mixed into the keys
of the tunnel, and without which neither end goes on. The preshared key of IKE only authenticates.
Packets are carried in user space (kernel-libipsec), in UDP.

An association with a new key is made before the one with the key before is ended, so that packets
pass all the time: two connections take turns, each with a name of its own.
"""

import subprocess
from dataclasses import dataclass, field
from pathlib import Path
from uuid import UUID

from hosts.applications.tunnel_commands import TunnelError, command, wait_until_it_works
from hosts.timeouts import COMMAND_TIMEOUT_S, INITIATE_TIMEOUT_S

INTERFACE = "ipsec0"  # which kernel-libipsec makes
NAMES, CHILD = ("qmn-0", "qmn-1"), "inside"
IKE = "aes256-sha256-x25519"
ESP = "aes256gcm16"


@dataclass
class StrongSwan:
    """One end of a tunnel between two hosts."""

    socket: str  # path of charon's Unix socket
    secret: str  # by which both ends authenticate; hexadecimal
    address: str  # of this host
    other: str  # of the other one
    inside: str  # this end's address in the tunnel
    other_inside: str
    begins: bool  # whether this end begins handshakes
    _turn: int = field(default=0, init=False)  # whose name the key in use has
    _in_use: set[str] = field(default_factory=set, init=False)  # names
    _attempt: "subprocess.Popen[bytes] | None" = field(default=None, init=False)

    def set_up(self) -> None:
        """Give this host its address inside; packets for the other end go nowhere else."""
        wait_until_it_works(self._swanctl("--stats"))
        wait_until_it_works(["ip", "link", "show", INTERFACE])
        command(["ip", "address", "add", f"{self.inside}/32", "dev", "lo"])
        route = ["ip", "route", "add", f"{self.other_inside}/32", "dev", INTERFACE]
        command([*route, "src", self.inside])

    def use(self, key_id: UUID, key: bytes) -> None:
        """This key is for the next association; that with the key before stays."""
        self._give_up()
        self._turn = 1 - self._turn
        self._load(self._connection(key_id) + self._secrets(key_id, key))
        self._end(NAMES[self._turn])
        self._in_use.add(NAMES[self._turn])

    def end_former(self) -> None:
        """End the association with the key before."""
        self._end(NAMES[1 - self._turn])

    def close(self) -> None:
        """Forget the connection and its secrets, and end its associations."""
        self._give_up()
        self._load("")
        for name in tuple(self._in_use):
            self._end(name)

    def handshake_done(self) -> bool:
        """Begin a handshake if none is going on; return whether it went well."""
        if not self.begins:
            return False
        if self._attempt is None:
            words = self._swanctl(
                "--initiate", "--child", CHILD, "--timeout", str(INITIATE_TIMEOUT_S)
            )
            self._attempt = subprocess.Popen(
                words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
            )
        status = self._attempt.poll()
        if status is not None:
            self._attempt = None
        return status == 0

    def _give_up(self) -> None:
        """Wait no longer for a handshake with a key that is not in use any more."""
        if self._attempt is not None:
            self._attempt.kill()
            self._attempt.wait(COMMAND_TIMEOUT_S)
            self._attempt = None

    def _load(self, configuration: str) -> None:
        """Let charon know this and nothing else; the file is gone then, as a key may be in it."""
        file = Path(f"{self.socket}.conf")
        file.touch(mode=0o600)
        try:
            file.write_text(configuration)
            command(self._swanctl("--load-all", "--clear", "--noprompt", "--file", str(file)))
        finally:
            file.unlink()

    def _end(self, name: str) -> None:
        try:
            command(self._swanctl("--terminate", "--ike", name, "--force"))
        except TunnelError as error:
            if "no matching" not in str(error):  # there was none
                raise
        self._in_use.discard(name)

    def _swanctl(self, *words: str) -> list[str]:
        return ["swanctl", words[0], "--uri", f"unix://{self.socket}", *words[1:]]

    def _connection(self, key_id: UUID) -> str:
        return f"""connections {{ {NAMES[self._turn]} {{
  version = 2
  local_addrs = {self.address}
  remote_addrs = {self.other}
  proposals = {IKE}
  ppk_id = "{key_id}"
  ppk_required = yes
  local {{
    auth = psk
    id = {self.address}
  }}
  remote {{
    auth = psk
    id = {self.other}
  }}
  children {{ {CHILD} {{
    local_ts = {self.inside}/32
    remote_ts = {self.other_inside}/32
    esp_proposals = {ESP}
  }} }}
}} }}
"""

    def _secrets(self, key_id: UUID, key: bytes) -> str:
        return f"""secrets {{
  ike-1 {{
    id-1 = {self.address}
    id-2 = {self.other}
    secret = 0x{self.secret}
  }}
  ppk-1 {{
    id = "{key_id}"
    secret = 0x{key.hex()}
  }}
}}
"""
