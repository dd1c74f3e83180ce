"""WireGuard as any program drives it: by `wg` and `ip`, any program may carry the packets.

A preshared key acts at the next handshake only, which WireGuard holds every two minutes. So the
peer is removed and added with the new key by one command: its session ends, and a handshake with
the new key begins.
"""

import base64
from dataclasses import dataclass
from uuid import UUID

from applications.timeouts import KEEPALIVE_S
from applications.vpn.tunnel_commands import TunnelError, command, wait_until_it_works

PORT = 51_820
MTU = 1420
KEY_BYTES = 32


@dataclass(frozen=True)
class WireGuard:
    interface: str
    private_key: str  # base64, X25519
    address: str  # inside, with prefix length
    peer: str  # public key of the other end, base64
    inside: str  # the other end's address inside
    endpoint: str  # its address outside; "": it is learned from its handshake

    def set_up(self) -> None:
        """Give the interface its address and key, once the program that makes it answers."""
        wait_until_it_works(lambda: command(["wg", "show", self.interface]))
        words = ["wg", "set", self.interface, "listen-port", str(PORT), "private-key", "/dev/stdin"]
        command(words, self.private_key.encode())
        command(["ip", "address", "add", self.address, "dev", self.interface])
        command(["ip", "link", "set", self.interface, "mtu", str(MTU), "up"])

    def use(self, _key_id: UUID, key: bytes) -> None:
        if len(key) != KEY_BYTES:
            raise TunnelError(f"a preshared key has {KEY_BYTES} bytes, not {len(key)}")
        reached = []
        if self.endpoint:
            reached = ["endpoint", f"{self.endpoint}:{PORT}"]
            reached += ["persistent-keepalive", str(KEEPALIVE_S)]
        peer = ["peer", self.peer]
        added = ["preshared-key", "/dev/stdin", "allowed-ips", f"{self.inside}/32", *reached]
        change = ["wg", "set", self.interface, *peer, "remove", *peer, *added]
        command(change, base64.b64encode(key))

    def end_former(self) -> None:
        """Do nothing: `use` has ended it."""

    def close(self) -> None:
        command(["wg", "set", self.interface, "peer", self.peer, "remove"])

    def handshake_done(self) -> bool:
        lines = command(["wg", "show", self.interface, "latest-handshakes"]).split()
        return dict(zip(lines[::2], lines[1::2], strict=True)).get(self.peer, "0") != "0"
