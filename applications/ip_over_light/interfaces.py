"""Starts q0, the interface whose packets travel by light, on all hosts of a running network."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from ipaddress import IPv4Address, IPv4Network, IPv6Address, IPv6Network
from pathlib import Path
from typing import Any

from applications.ip_over_light import ipv6
from applications.ip_over_light.format import DEFAULT_MTU, INTERFACE, IpOverLightConfig, Neighbor
from topologies.links.fiber import qnics
from topologies.networks.network import Network
from topologies.nodes import QuantumHost
from topologies.nodes.addresses import free_address
from topologies.system.processes.programs import NetworkError
from topologies.system.runs.launching import launch
from topologies.timeouts import READY_TIMEOUT_S
from wire.features import EMIT

MODULE = "applications.ip_over_light"
NETWORK = IPv4Network("10.1.0.0/16")
NETWORK6 = IPv6Network("fd71:6d6e::/64")  # RFC 4193
KERNEL_HAS_IPV6 = Path("/proc/sys/net/ipv6")
ROUTER6 = str(NETWORK6[-1])
BLOCK_PAIRS = 1 << 18  # a batch of packets in one block: each block costs the same work
MOST_HOSTS = 64  # each has all others as neighbours
FIBERS = 2  # that a host needs to receive, or to make pairs


@dataclass(frozen=True)
class IpOverLight:
    mtu: int = DEFAULT_MTU
    idle_s: float = 2.0  # without a packet: then light is given back
    patience_s: float = 3.0  # that a packet waits for light which others have
    sessions: dict[str, Any] = field(default_factory=dict)  # options of theirs


def light_address(address: str) -> str:
    """Return the address of a host's q0: in a network of its own, with the host's own number."""
    mask = int(NETWORK.hostmask)
    return str(IPv4Address(int(NETWORK.network_address) | int(IPv4Address(address)) & mask))


def light_address6(address: str, mtu: int) -> str:
    """Return the IPv6 address of a host's q0, with the host's own number.

    It is "" where packets are too short, and on a kernel without IPv6.
    """
    if mtu < ipv6.MIN_MTU or not KERNEL_HAS_IPV6.exists():
        return ""
    number = int(IPv4Address(address)) & int(NETWORK.hostmask)
    return str(IPv6Address(int(NETWORK6.network_address) | number))


def start_ip_over_light(network: Network, settings: IpOverLight | None = None) -> dict[str, str]:
    """Start q0 on every host that can receive; it is up when this returns.

    Return the addresses by host; raise NetworkError if one cannot start.
    """
    settings, runtime = settings or IpOverLight(), network.runtime
    able = hosts_with_light(network)
    light = {name: light_address(runtime.addresses[name]) for name in able}
    if len(set(light.values())) < len(light):
        raise NetworkError("two hosts have the same number: q0 takes the last 16 bits of each")
    programs = []
    for name, node in able.items():
        config = config_of(name, light, settings, network)
        programs.append(launch(runtime, f"{INTERFACE}-{name}", MODULE, config, node))
    for program in programs:
        program.wait_for("ready", READY_TIMEOUT_S, network.check)
    return light


def hosts_with_light(network: Network) -> dict[str, QuantumHost]:
    """Return the hosts that can receive; NetworkError if they are too few or too many."""
    hosts = [node for node in network.runtime.hosts if isinstance(node, QuantumHost)]
    able = {node.name: node for node in hosts if len(qnics(node)) >= FIBERS}
    if len(able) < 2:
        raise NetworkError(
            f"q0 needs two hosts with {FIBERS} fibres each, and {len(able)} of "
            f"{', '.join(node.name for node in hosts)} have them: take another topology"
        )
    if len(able) > MOST_HOSTS:
        raise NetworkError(f"q0 on {len(able)} hosts: {MOST_HOSTS} at most; take a smaller network")
    return able


def config_of(
    host: str, light: Mapping[str, str], settings: IpOverLight, network: Network
) -> IpOverLightConfig:
    """Return the configuration of a host's q0; `light` has the address of each q0, by host."""
    copper = network.runtime.addresses
    return IpOverLightConfig(
        host=host,
        stack=network.runtime.socket(host),
        address=light[host],
        prefix_length=NETWORK.prefixlen,
        router=free_address(light.values(), NETWORK.prefixlen),
        address6=light_address6(copper[host], settings.mtu),
        prefix6_length=NETWORK6.prefixlen,
        router6=ROUTER6,
        neighbors=[
            Neighbor(
                other,
                copper[other],
                light[other],
                light_address6(copper[other], settings.mtu),
                source_of(network, light, host, other),
            )
            for other in light
            if other != host
        ],
        mtu=settings.mtu,
        idle_s=settings.idle_s,
        patience_s=settings.patience_s,
        options={"block_pairs": BLOCK_PAIRS, **settings.sessions},
    )


def source_of(network: Network, able: Iterable[str], one: str, other: str) -> str:
    """Return the host that makes the pairs of two others: the network's, or else any that can.

    It is "" where there is none: the stacks then say so.
    """
    devices = network.runtime.devices
    sources = [network.runtime.source, *able]
    free = [name for name in sources if name not in (one, other, "")]
    return next((name for name in free if EMIT in devices[name].features), "")
