"""A tunnel between two hosts of a network, and a file that moves through it."""

import base64
import os
import secrets
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey

from applications.keys.key_managers import application_name, in_folder
from applications.vpn.format import STRONGSWAN, TLS, WIREGUARD, VpnConfig
from qmn.timeouts import START_TIMEOUT_S
from topologies.networks.network import Network
from topologies.system.certificates import AUTHORITY
from topologies.system.processes.programs import NetworkError, Program, python

INSIDE = ("192.168.77.1", "192.168.77.2")
SOCKETS = Path("/var/run/wireguard")  # where wireguard-go and wg meet, by the interface's name
MOST_NAME = 15  # characters of an interface
HTTP_PORT = 8000
PLUGINS = (
    "random nonce openssl aes sha1 sha2 hmac kdf gcm curve25519 pem "
    "kernel-libipsec kernel-netlink socket-default vici"
)
CHARON = (
    "charon-systemd {{\n"
    f"  load = {PLUGINS}\n"
    "  plugins {{ vici {{ socket = unix://{socket}\n }} }}\n"
    "  filelog {{ log {{ path = /dev/stdout\n default = 1\n flush_line = yes\n }} }}\n"
    "  journal {{ default = -1\n }}\n"
    "}}\n"
)
RECEIVED = "received"

Carry = Callable[[Network, str], Program]
Tell = Callable[[Network, Sequence[str]], list[dict[str, Any]]]


@dataclass(frozen=True)
class RunningTunnel:
    """Its programs: the end that leads, the end that follows, and those that carry packets."""

    programs: Sequence[Program]
    hosts: Sequence[str]


@dataclass(frozen=True)
class MovedFile:
    server: Program
    download: Program
    output: Path


def start_tunnel(
    network: Network,
    hosts: tuple[str, str],
    rotate_s: float,
    lifetime_s: float,
    program: str = WIREGUARD,
) -> RunningTunnel:
    """Start both ends; the first leads. NetworkError if one cannot be.

    Keys change, and grow old, in time of the network.
    """
    carry, tell = MADE_BY[program]
    carriers = [carry(network, host) for host in hosts] if carry else []
    options = tell(network, hosts)
    ends: list[Program] = []
    for number, host in reversed(list(enumerate(hosts))):  # who follows waits for who leads
        config = config_of(network, hosts, number, program, rotate_s, lifetime_s)
        config = replace(config, **options[number])
        file = network.runtime.folder / f"vpn-{host}.json"
        config.write(file)
        network.runtime.share(host, file)
        command = [python(), "-m", "applications.vpn.program", "--config", str(file)]
        end = network.run_on(host, f"vpn-{host}", command)
        with carried_by(network, carriers):
            end.wait_for("ready", START_TIMEOUT_S, network.check)
        ends.insert(0, end)
    return RunningTunnel([*ends, *carriers], hosts)


def config_of(
    network: Network,
    hosts: tuple[str, str],
    number: int,
    program: str,
    rotate_s: float,
    lifetime_s: float,
) -> VpnConfig:
    """Return the configuration of end 0 or 1 of a tunnel, without its program's own options."""
    host, other, runtime = hosts[number], hosts[1 - number], network.runtime
    shown = runtime.own_folder(host)  # by the same path on every machine
    files = in_folder(shown, application_name(host))
    return VpnConfig(
        program=program,
        leads=number == 0,
        address=runtime.addresses[host],
        other=runtime.addresses[other],
        inside=INSIDE[number],
        other_inside=INSIDE[1 - number],
        other_sae=application_name(other),
        certificate=str(files.certificate),
        key_file=str(files.private_key),
        authority=str(shown / AUTHORITY),
        rotate_s=rotate_s,
        lifetime_s=lifetime_s,
        time_scale=runtime.time.scale,
        time_since_ns=runtime.time.since_ns,
    )


@contextmanager
def carried_by(network: Network, programs: Sequence[Program]) -> Iterator[None]:
    """Name what has ended where something failed that needs it: these programs at last.

    Their host or its machine may have ended first.
    """
    try:
        yield
    except NetworkError:
        network.explain()
        require_running(programs)
        raise


def require_running(programs: Sequence[Program]) -> None:
    """Raise NetworkError if one of them has ended."""
    for program in programs:
        if not program.running:
            raise died(program)


def died(program: Program) -> NetworkError:
    """Return that a program has ended before its time, and how."""
    return NetworkError(f"{program.name} died in mid-run: {program.end()}")


def wireguard_words(_network: Network, hosts: Sequence[str]) -> list[dict[str, Any]]:
    """Return the settings of WireGuard's ends: new keys, and interfaces."""
    keys = [X25519PrivateKey.generate() for _ in hosts]
    private = [base64.b64encode(key.private_bytes_raw()).decode() for key in keys]
    public = [base64.b64encode(key.public_key().public_bytes_raw()).decode() for key in keys]
    return [
        {"interface": interface_of(host), "private_key": mine, "peer": theirs}
        for host, mine, theirs in zip(hosts, private, reversed(public), strict=True)
    ]


def tls_words(network: Network, hosts: Sequence[str]) -> list[dict[str, Any]]:
    """Return the settings of the ends of TLS: their interface, and where OpenSSL gets keys."""
    folder = network.runtime.folder
    return [
        {"interface": "tls0", "session_file": str(folder / f"tls-{host}.pem")} for host in hosts
    ]


def strongswan_words(network: Network, hosts: Sequence[str]) -> list[dict[str, Any]]:
    """Return the settings of strongSwan's ends: where charon is, and a new secret of both."""
    secret = secrets.token_hex(32)
    return [{"private_key": secret, "socket": charon_socket(network, host)} for host in hosts]


def charon_socket(network: Network, host: str) -> str:
    return network.runtime.socket(f"charon-{host}")


def start_charon(network: Network, host: str) -> Program:
    file = network.runtime.folder / f"charon-{host}.conf"
    file.touch(mode=0o600)
    file.write_text(CHARON.format(socket=charon_socket(network, host)))
    network.runtime.share(host, file)
    command = ["env", f"STRONGSWAN_CONF={file}", "charon-systemd"]
    return network.run_on(host, f"charon-{host}", command)


def interface_of(host: str) -> str:
    """Return the name of a host's end of the tunnel: sockets of all hosts are in one folder."""
    return f"wg-{host}"[:MOST_NAME]


def start_wireguard(network: Network, host: str) -> Program:
    if host not in network.runtime.places:  # else /run is the network's own
        remove_dead_socket(host)
        if (path := socket_of(host)).exists():
            raise NetworkError(f"{path} exists: another WireGuard uses this name; end it first")
    command = ["env", "LOG_LEVEL=error", "wireguard-go", "-f", interface_of(host)]
    return network.run_on(host, f"wireguard-{host}", command)


def socket_of(host: str) -> Path:
    return SOCKETS / f"{interface_of(host)}.sock"


def remove_dead_socket(host: str) -> None:
    """Remove what a killed wireguard-go has left for a host: a socket at which nobody answers."""
    with socket.socket(socket.AF_UNIX) as asking:
        try:
            asking.connect(str(socket_of(host)))
        except ConnectionRefusedError:
            socket_of(host).unlink(missing_ok=True)
        except FileNotFoundError:
            pass


@contextmanager
def no_dead_sockets(hosts: Sequence[str]) -> Iterator[None]:
    try:
        yield
    finally:
        for host in hosts:
            remove_dead_socket(host)


# The program that carries a host's packets, if that is not the end's own child, and what ends are
# reported beside the rest.
MADE_BY: dict[str, tuple[Carry | None, Tell]] = {
    WIREGUARD: (start_wireguard, wireguard_words),
    STRONGSWAN: (start_charon, strongswan_words),
    TLS: (None, tls_words),
}


def serve_and_download(
    network: Network, tunnel: RunningTunnel, file: Path, folder: Path, mbit_s: float
) -> MovedFile:
    """Let the host that follows serve a file inside the tunnel, and the other download it.

    The rate is in megabit per second of the network.
    """
    loading, serving = tunnel.hosts
    shared = network.runtime.folder / "shared"
    shared.mkdir()
    os.symlink(file, shared / "file")
    network.runtime.share(serving, shared / "file")
    place = ["--bind", INSIDE[1], "--directory", str(shared), str(HTTP_PORT)]
    server = network.run_on(serving, f"http-{serving}", [python(), "-m", "http.server", *place])
    server.wait_for("Serving HTTP", START_TIMEOUT_S, network.check)
    output = folder / RECEIVED
    url = f"http://{INSIDE[1]}:{HTTP_PORT}/file"
    rate = ["--bytes-per-s", str(mbit_s * 1e6 / 8), "--time-scale", str(network.runtime.time.scale)]
    rate += ["--output", str(output)]
    command = [python(), "-m", "applications.vpn.download", *rate, url]
    return MovedFile(server, network.run_on(loading, f"download-{loading}", command), output)
