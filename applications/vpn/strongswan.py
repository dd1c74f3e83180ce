"""strongSwan as any program drives it: by VICI, over the socket of a charon of its own.

The key enters IKEv2 as a postquantum preshared key (PPK, RFC 8784), which is mixed into the keys
of the tunnel, and without which neither end goes on. The preshared key of IKE only authenticates.
Packets are carried in user space (kernel-libipsec), in UDP.

An association with a new key is made before the one with the key before is ended, so that packets
pass all the time: two connections take turns, each with a name of its own.
"""

import socket
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any
from uuid import UUID

from vici import Session
from vici.exception import (
    CommandException,
    DeserializationException,
    EventUnknownException,
    SessionException,
)

from applications.timeouts import COMMAND_TIMEOUT_S, INITIATE_PAUSE_S
from applications.vpn.tunnel_commands import TunnelError, command, wait_until_it_works

INTERFACE = "ipsec0"  # which kernel-libipsec makes
NAMES, CHILD = ("qmn-0", "qmn-1"), "inside"
IKE, PPK = "ike", "ppk"  # by which charon knows the secrets
IKE_PROPOSAL = "aes256-sha256-x25519"
ESP_PROPOSAL = "aes256gcm16"
AT_ONCE = -1  # ms: the answer does not wait for the other end
INSTALLED = b"INSTALLED"
REFUSALS = CommandException, SessionException, DeserializationException, EventUnknownException


@dataclass
class StrongSwan:
    socket: str  # path of charon's Unix socket
    secret: str  # by which both ends authenticate; hexadecimal
    address: str  # of this host
    other: str  # of the other one
    inside: str  # this end's address in the tunnel
    other_inside: str
    begins: bool  # whether this end begins handshakes
    _turn: int = field(default=0, init=False)  # whose name the key in use has
    _loaded: bool = field(default=False, init=False)  # whether charon knows that key
    _begun_s: float = field(default=0.0, init=False)  # when the last handshake began

    def set_up(self) -> None:
        """Give this host its address inside; packets for the other end go nowhere else."""
        wait_until_it_works(lambda: command(["ip", "link", "show", INTERFACE]))
        command(["ip", "address", "add", f"{self.inside}/32", "dev", "lo"])
        route = ["ip", "route", "add", f"{self.other_inside}/32", "dev", INTERFACE]
        command([*route, "src", self.inside])
        secret, owners = bytes.fromhex(self.secret), [self.address, self.other]
        self._ask("load-shared", {"id": IKE, "type": "ike", "data": secret, "owners": owners})

    def use(self, key_id: UUID, key: bytes) -> None:
        """This key is for the next association; that with the key before stays."""
        self._forget()
        self._turn = 1 - self._turn
        self._end(self._name)
        ppk = {"id": PPK, "type": "ppk", "data": key, "owners": [str(key_id)]}
        self._ask("load-shared", ppk)
        self._ask("load-conn", {self._name: self._connection(key_id)})
        self._loaded = True
        self._begun_s = 0.0

    def end_former(self) -> None:
        self._end(NAMES[1 - self._turn])

    def close(self) -> None:
        self._forget()
        for name in NAMES:
            self._end(name)

    def handshake_done(self) -> bool:
        """Begin a handshake if none is going on; return whether it went well."""
        if not self.begins or not self._loaded:
            return False
        associations = self._associations(self._name)
        if not associations and time.monotonic() > self._begun_s + INITIATE_PAUSE_S:
            self._begun_s = time.monotonic()
            self._ask("initiate", {"ike": self._name, "child": CHILD, "timeout": AT_ONCE})
        children = [child for each in associations for child in each["child-sas"].values()]
        return any(child["state"] == INSTALLED for child in children)

    @property
    def _name(self) -> str:
        return NAMES[self._turn]

    def _forget(self) -> None:
        if self._loaded:
            self._ask("unload-conn", {"name": self._name})
            self._ask("unload-shared", {"id": PPK})
            self._loaded = False

    def _end(self, name: str) -> None:
        """End its associations, where there are any; the other end may be ending them, too."""
        options = {"ike": name, "force": "yes", "timeout": AT_ONCE}
        try:
            self._ask("terminate", options)
        except TunnelError:
            if self._associations(name):
                raise

    def _associations(self, name: str) -> list[dict[str, Any]]:
        with self._asking("list-sas"):
            replies = list(self._charon.list_sas({"ike": name}))
        return [association for each in replies for association in each.values()]

    def _ask(self, request: str, words: Mapping[str, Any]) -> None:
        """Let charon do something; raise TunnelError if it does not."""
        with self._asking(request):
            self._charon.request(request, words)

    @contextmanager
    def _asking(self, request: str) -> Iterator[None]:
        try:
            yield
        except (OSError, *REFUSALS) as error:
            raise TunnelError(f"charon at {self.socket}, {request}: {error}") from error

    @cached_property
    def _charon(self) -> Session:
        return wait_until_it_works(self._connected)

    def _connected(self) -> Session:
        connection = socket.socket(socket.AF_UNIX)
        connection.settimeout(COMMAND_TIMEOUT_S)
        with self._asking("connect"):
            connection.connect(self.socket)
        return Session(connection)

    def _connection(self, key_id: UUID) -> dict[str, Any]:
        """Return what charon has to know of the other end, in the words of swanctl.conf(5)."""
        return {
            "version": 2,
            "local_addrs": [self.address],
            "remote_addrs": [self.other],
            "proposals": [IKE_PROPOSAL],
            "ppk_id": str(key_id),
            "ppk_required": "yes",
            "local": {"auth": "psk", "id": self.address},
            "remote": {"auth": "psk", "id": self.other},
            "children": {
                CHILD: {
                    "local_ts": [f"{self.inside}/32"],
                    "remote_ts": [f"{self.other_inside}/32"],
                    "esp_proposals": [ESP_PROPOSAL],
                }
            },
        }
