"""The configuration of a host's q0: the interface whose packets travel by light."""

from dataclasses import dataclass, field
from typing import Any

from wire.config import Config

INTERFACE = "q0"
# At the stacks: where each host waits for packets of others. Packets on the light of a
# session itself go to the second one.
PACKETS_PORT = 15
RETURNED_PACKETS_PORT = 16
MIN_MTU = 576  # of IPv4
DEFAULT_MTU = 9000  # every packet is read and written by a program: few large ones are cheaper


@dataclass(frozen=True)
class Neighbor:
    host: str
    copper: str  # its address there, by which sessions name it
    address: str  # of its q0
    address6: str  # of IPv6; "": it has none
    source: str = ""  # host that makes the pairs of both; "": the network's


@dataclass(frozen=True)
class IpOverLightConfig(Config):
    host: str
    stack: str  # path of the Unix socket of the host's stack
    address: str  # of q0
    prefix_length: int  # of the network of all q0
    router: str  # address in it that ICMP errors come from: no host has it
    address6: str = ""  # of IPv6; "": there is none
    prefix6_length: int = 64
    router6: str = ""
    neighbors: list[Neighbor] = field(default_factory=list)
    mtu: int = DEFAULT_MTU
    # Of the network: without a packet, then light is given back; that one waits for others' light.
    idle_s: float = 2.0
    patience_s: float = 3.0
    options: dict[str, Any] = field(default_factory=dict)  # of the sessions

    def __post_init__(self) -> None:
        if not MIN_MTU <= self.mtu <= 65_535:
            raise ValueError(f"MTU {self.mtu}: choose {MIN_MTU} to 65535")
