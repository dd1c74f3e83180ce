"""A WireGuard tunnel between two hosts of a network, and a file that moves through it."""

import base64
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey

from qmn.jobs.transfer import START_TIMEOUT_S
from topologies.key_managers import KeyManagers, application_name
from topologies.network import Network
from topologies.programs import NetworkError, Program, python
from wire.vpn import VpnConfig

INSIDE = ("192.168.77.1", "192.168.77.2")
PREFIX = 24
SOCKETS = Path("/var/run/wireguard")  # where wireguard-go and wg meet, by the interface's name
MOST_NAME = 15  # characters of an interface
HTTP_PORT = 8000
RECEIVED = "received"


@dataclass(frozen=True)
class RunningTunnel:
    """Its programs: the end that leads, the end that follows, and those that carry packets."""

    programs: Sequence[Program]
    hosts: Sequence[str]


@dataclass(frozen=True)
class MovedFile:
    """A file on its way."""

    server: Program
    download: Program
    output: Path


def start_tunnel(
    network: Network,
    managers: KeyManagers,
    hosts: tuple[str, str],
    rotate_s: float,
    lifetime_s: float,
) -> RunningTunnel:
    """Start both ends; the first leads. NetworkError if one cannot be."""
    keys = [X25519PrivateKey.generate() for _ in hosts]
    carriers = [start_carrier(network, host) for host in hosts]
    ends: list[Program] = []
    for number, host in reversed(list(enumerate(hosts))):  # who follows waits for who leads
        other = 1 - number
        own = managers.files[application_name(host)]
        config = VpnConfig(
            interface=interface_of(host),
            leads=number == 0,
            private_key=base64.b64encode(keys[number].private_bytes_raw()).decode(),
            peer=base64.b64encode(keys[other].public_key().public_bytes_raw()).decode(),
            address=network.runtime.addresses[host],
            other=network.runtime.addresses[hosts[other]],
            inside=f"{INSIDE[number]}/{PREFIX}",
            other_inside=INSIDE[other],
            other_sae=application_name(hosts[other]),
            certificate=str(own.certificate),
            key_file=str(own.private_key),
            authority=str(managers.authority),
            rotate_s=rotate_s,
            lifetime_s=lifetime_s,
        )
        file = network.runtime.folder / f"vpn-{host}.json"
        config.write(file)
        command = [python(), "-m", "hosts.applications.vpn", "--config", str(file)]
        program = network.run_on(host, f"vpn-{host}", command)
        program.wait_for("ready", START_TIMEOUT_S, network.check)
        ends.insert(0, program)
    return RunningTunnel([*ends, *carriers], hosts)


def interface_of(host: str) -> str:
    """Return the name of a host's end of the tunnel: sockets of all hosts are in one folder."""
    return f"wg-{host}"[:MOST_NAME]


def start_carrier(network: Network, host: str) -> Program:
    """Start what carries a host's packets, in user space."""
    name = interface_of(host)
    if (SOCKETS / f"{name}.sock").exists():
        raise NetworkError(
            f"{SOCKETS}/{name}.sock exists: another WireGuard uses this name; end it first"
        )
    command = ["env", "LOG_LEVEL=error", "wireguard-go", "-f", name]
    return network.run_on(host, f"wireguard-{host}", command)


def serve_and_download(
    network: Network, tunnel: RunningTunnel, file: Path, folder: Path, mbit_s: float
) -> MovedFile:
    """Let the host that follows serve a file inside the tunnel, and the other download it."""
    loading, serving = tunnel.hosts
    shared = network.runtime.folder / "shared"
    shared.mkdir()
    os.symlink(file, shared / "file")
    place = ["--bind", INSIDE[1], "--directory", str(shared), str(HTTP_PORT)]
    server = network.run_on(serving, f"http-{serving}", [python(), "-m", "http.server", *place])
    server.wait_for("Serving HTTP", START_TIMEOUT_S, network.check)
    output = folder / RECEIVED
    url = f"http://{INSIDE[1]}:{HTTP_PORT}/file"
    rate = ["--bytes-per-s", str(mbit_s * 1e6 / 8), "--output", str(output)]
    command = [python(), "-m", "hosts.applications.download", *rate, url]
    return MovedFile(server, network.run_on(loading, f"download-{loading}", command), output)
