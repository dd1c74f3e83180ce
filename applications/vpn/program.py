"""One end of a VPN whose preshared key comes from the host's key manager, and is changed often.

    master                                            slave
    a new key of its key manager (enc_keys)
    the key's id, a line over TCP  --------------->   the same key of its own (dec_keys)
                                   <---------------   uses it, says the id again
    uses it; the tunnel's own protocol holds a handshake

No key older than its lifetime is used: the end whose key is closes the tunnel by itself, also while
it waits for the other end or its key manager, and it opens with the next key. Prints a line of JSON
for whatever changes.

Times are of the network, but for those of the program that makes the tunnel, which has a clock of
its own.
"""

import argparse
import json
import socket
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, TypeVar
from uuid import UUID

from applications.ip_over_light.tun import TunError
from applications.keys.key_client import KeyClient, NoKey
from applications.keys.key_delivery import KeyRequest, decode_key_ids, encode_key_ids
from applications.timeouts import (
    NEXT_KEY_PAUSE_S,
    TUNNEL_HANDSHAKE_S,
    TUNNEL_POLL_S,
    TUNNEL_TIMEOUT_S,
)
from applications.vpn.format import AGREEMENT_PORT, STRONGSWAN, TLS, VpnConfig
from applications.vpn.strongswan import StrongSwan
from applications.vpn.tls import Tls
from applications.vpn.tunnel_commands import Tunnel, TunnelError
from applications.vpn.wireguard import WireGuard
from programs.faults import report_fault
from wire.config import BadConfig
from wire.malformed import MalformedPacket
from wire.network_time import NetworkTime

MAX_LINE = 256
Answer = TypeVar("Answer")


def say(event: str, **fields: Any) -> None:
    print(json.dumps({"event": event, "at": time.time(), **fields}), flush=True)


@dataclass
class KeyInUse:
    """The tunnel, and how old its key is, and the key before where packets may pass with it yet."""

    tunnel: Tunnel
    lifetime_s: float
    time: NetworkTime
    since_s: float | None = None  # None: it is closed
    former_since_s: float | None = None  # None: no packet passes with the key before
    _waiting: ThreadPoolExecutor = field(default_factory=partial(ThreadPoolExecutor, 1), init=False)

    @property
    def now_s(self) -> float:
        return self.time.network_s(time.monotonic())

    def change(self, key_id: UUID, key: bytes) -> None:
        self.tunnel.use(key_id, key)
        self.former_since_s, self.since_s = self.since_s, self.now_s
        say("key", key_ID=str(key_id))
        if self.former_since_s is None:
            say("tunnel_opened")

    def end_former(self) -> None:
        """Let packets pass with the key in use only."""
        self.tunnel.end_former()
        self.former_since_s = None

    def look(self) -> None:
        """Use no key that is too old: close the tunnel if that in use is."""
        if self.since_s is not None and self.now_s - self.since_s > self.lifetime_s:
            self.tunnel.close()
            say("tunnel_closed", key_age_s=round(self.now_s - self.since_s, 3))
            self.since_s = self.former_since_s = None
        elif self.former_since_s is not None and self.now_s - self.former_since_s > self.lifetime_s:
            self.end_former()

    def meanwhile(self, call: Callable[[], Answer]) -> Answer:
        """Return what a call returns that may wait for others; look all the time until it does."""
        answer = self._waiting.submit(call)
        while wait([answer], TUNNEL_POLL_S).not_done:
            self.look()
        return answer.result()


class NoAgreement(Exception):
    """The other end has not taken a key; the text says why."""


def lead(config: VpnConfig, keys: KeyClient, in_use: KeyInUse) -> None:
    """Change the key as often as it should be, for ever."""
    next_s, wanting = in_use.now_s, False
    while True:
        in_use.look()
        if in_use.now_s >= next_s:
            next_s = in_use.now_s + config.rotate_s
            try:
                change(config, keys, in_use)
                wanting = False
            except (NoKey, NoAgreement) as error:
                if not wanting:
                    say("no_key", text=str(error))
                wanting, next_s = True, in_use.now_s + NEXT_KEY_PAUSE_S
        time.sleep(TUNNEL_POLL_S)


def change(config: VpnConfig, keys: KeyClient, in_use: KeyInUse) -> None:
    """Use a new key at both ends, and wait for the handshake that shows that it is the same."""
    (key,) = in_use.meanwhile(partial(keys.get, config.other_sae, KeyRequest(size=256)))
    timeout_s = in_use.time.wall_s(TUNNEL_TIMEOUT_S)
    in_use.meanwhile(partial(agree, config.other, key.key_id, timeout_s))
    in_use.change(key.key_id, key.key)
    begun, longest_s = in_use.now_s, in_use.time.network_s(TUNNEL_HANDSHAKE_S)
    try:
        while not in_use.tunnel.handshake_done():
            in_use.look()
            if in_use.now_s - begun > min(longest_s, in_use.lifetime_s):
                raise NoAgreement("no handshake with the new key")
            time.sleep(TUNNEL_POLL_S)
    finally:
        in_use.end_former()
    say("handshake", key_ID=str(key.key_id), seconds=round(in_use.now_s - begun, 3))


def agree(other: str, key_id: UUID, timeout_s: float) -> None:
    """Tell the other end an id; return when it uses the key, or raise NoAgreement."""
    line = encode_key_ids([key_id]) + b"\n"
    try:
        with socket.create_connection((other, AGREEMENT_PORT), timeout_s) as connection:
            connection.sendall(line)
            if read_line(connection) != line:
                raise NoAgreement("the other end has not taken the key")
    except (OSError, MalformedPacket) as error:
        raise NoAgreement(f"{other} has not taken the key: {error}") from error


def follow(config: VpnConfig, keys: KeyClient, in_use: KeyInUse) -> None:
    """Take the keys whose ids the other end says, for ever."""
    with socket.create_server((config.address, AGREEMENT_PORT)) as door:
        door.settimeout(TUNNEL_POLL_S)
        while True:
            in_use.look()
            try:
                connection, (address, _port) = door.accept()
            except TimeoutError:
                continue
            with connection:
                if address == config.other:
                    take(config, keys, in_use, connection)


def take(config: VpnConfig, keys: KeyClient, in_use: KeyInUse, connection: socket.socket) -> None:
    """Use the key of the id that a connection says; say the id again."""
    connection.settimeout(in_use.time.wall_s(TUNNEL_TIMEOUT_S))
    try:
        line = in_use.meanwhile(partial(read_line, connection))
        (key_id,) = decode_key_ids(line)
        (key,) = in_use.meanwhile(partial(keys.fetch, config.other_sae, [key_id]))
        in_use.change(key.key_id, key.key)
        connection.sendall(line)
    except (OSError, ValueError, NoKey) as error:  # MalformedPacket is a ValueError
        say("no_key", text=str(error))


def read_line(connection: socket.socket) -> bytes:
    """Return one line; raise MalformedPacket for one that is too long or has no end."""
    line = b""
    while not line.endswith(b"\n"):
        part = connection.recv(MAX_LINE + 1 - len(line))
        line += part
        if not part or len(line) > MAX_LINE:
            raise MalformedPacket(f"a line of {len(line)} bytes without an end")
    return line


def tunnel_of(config: VpnConfig) -> Tunnel:
    if config.program == STRONGSWAN:
        return StrongSwan(
            config.socket,
            config.private_key,
            config.address,
            config.other,
            config.inside,
            config.other_inside,
            config.leads,
        )
    if config.program == TLS:
        return Tls(
            config.interface,
            config.session_file,
            (config.address, config.other),
            (config.inside, config.other_inside),
            config.prefix_length,
            config.leads,
        )
    return WireGuard(
        config.interface,
        config.private_key,
        f"{config.inside}/{config.prefix_length}",
        config.peer,
        config.other_inside,
        config.other if config.leads else "",
    )


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m applications.vpn.program", description=__doc__)
    parser.add_argument("--config", type=Path, required=True, help="JSON (applications.vpn.format)")
    arguments = parser.parse_args()
    try:
        config = VpnConfig.read(arguments.config)
        tunnel = tunnel_of(config)
        tunnel.set_up()
        print("ready", flush=True)
        keys = KeyClient(
            config.address, config.port, config.certificate, config.key_file, config.authority
        )
        in_use = KeyInUse(tunnel, config.lifetime_s, config.time)
        (lead if config.leads else follow)(config, keys, in_use)
    except (BadConfig, TunnelError, TunError, OSError) as error:
        return report_fault(f"vpn: {error}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
