"""The configuration of a host's key manager: whom it serves, its certificates, its links."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from wire.config import CarriedConfig

KEY_DELIVERY_PORT = 8443
# At the stacks: where key managers wait for each other's sessions, by protocol.
KEY_LINK_PORTS: Mapping[str, int] = MappingProxyType(
    {"bb84": 14, "bbm92": 17, "e91": 18, "mdi": 19}
)


@dataclass(frozen=True)
class KeyLink:
    """Another host with which this one keeps keys, and how many."""

    peer: str
    opens: bool  # whether sessions are this end's to open
    low: int = 32  # keys of either direction: with fewer of one, sessions are opened
    high: int = 128  # until both have this number
    pause_s: float = 0.5  # between two sessions at least
    protocol: str = "bb84"
    options: dict[str, Any] = field(default_factory=dict)  # of the sessions

    def __post_init__(self) -> None:
        if not 0 < self.low <= self.high:
            raise ValueError(f"marks of {self.low} and {self.high} keys: 1 to high")


@dataclass(frozen=True)
class KeyManagerConfig(CarriedConfig):
    """One host's key manager (KME) and the applications (SAEs) that may ask it for keys."""

    FILES = "certificate", "private_key", "authority"

    host: str
    address: str
    stack: str  # path of the Unix socket of the host's stack
    keys: str  # path of the folder in which the stack keeps keys
    hosts: dict[str, str]  # with a key manager: name to address
    saes: dict[str, str]  # SAE ID to the host that has its key manager
    certificate: str  # paths of PEM files
    private_key: str
    authority: str  # that has signed the certificates of all
    port: int = KEY_DELIVERY_PORT
    keys_per_s: float = 0.0  # stored keys that one SAE gets in the long run; 0: no limit
    # Whether no key goes out for a host while the last session with it had too many errors.
    withhold: bool = False
    report_to: str = ""  # IPv4 address to which what is for the controller goes; empty: no relays
    device_key: str = ""  # that the host shares with the controller
    links: list[KeyLink] = field(default_factory=list)


def manager_name(host: str) -> str:
    return f"kme-{host}"
