"""Starts a key manager on hosts of a running network, with certificates for all that ask it."""

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, field, replace
from pathlib import Path

from applications.keys.config import KEY_DELIVERY_PORT, KeyLink, KeyManagerConfig, manager_name
from topologies.networks.network import Network
from topologies.nodes import QuantumHost
from topologies.nodes.addresses import broadcast
from topologies.system.certificates import (
    AUTHORITY,
    CertificateAuthority,
    CertificateFiles,
)
from topologies.system.processes.programs import NetworkError, Program
from topologies.system.runs.launching import launch
from topologies.system.runs.runtime import Runtime
from topologies.timeouts import READY_TIMEOUT_S
from wire.parameters.checks import remedy

MODULE = "applications.keys"
CERTIFICATES = "certificates"  # in the private folder


@dataclass(frozen=True)
class KeyService:
    """The task of key managers; a pair of hosts that keeps keys is (opener, acceptor)."""

    pairs: Sequence[tuple[str, str]] = ()
    link: KeyLink = field(default_factory=lambda: KeyLink(peer="", opens=True))  # of every pair
    saes: Mapping[str, str] = field(default_factory=dict)  # more SAE IDs, to their host
    keys_per_s: float = 0.0  # for one SAE; 0: no limit
    withhold: bool = False
    certificates: Path | None = None  # folder with PEM files; None: they are made


@dataclass(frozen=True)
class KeyManagers:
    """The key managers of a network, and who may ask them."""

    programs: dict[str, Program]  # by host
    urls: dict[str, str]  # by host
    saes: dict[str, str]  # SAE ID to host
    files: dict[str, CertificateFiles]  # of SAEs
    authority: Path


def application_name(host: str) -> str:
    return f"sae-{host}"


def start_key_managers(network: Network, service: KeyService) -> KeyManagers:
    """Start a key manager on every quantum host; each answers when this returns.

    NetworkError if one cannot.
    """
    runtime = network.runtime
    nodes = {node.name: node for node in runtime.hosts if isinstance(node, QuantumHost)}
    addresses = {name: runtime.addresses[name] for name in nodes}
    saes = {application_name(host): host for host in nodes} | dict(service.saes)
    check(service, saes, nodes)
    folder = service.certificates or runtime.folder / CERTIFICATES
    names = {host: manager_name(host) for host in nodes}
    if service.certificates is None:
        files = made(folder, names, addresses, saes)
    else:
        files = given(folder, [*names.values(), *saes])
    urls = {host: f"https://{address}:{KEY_DELIVERY_PORT}" for host, address in addresses.items()}
    programs: dict[str, Program] = {}
    managers = KeyManagers(
        programs, urls, saes, {sae: files[sae] for sae in saes}, folder / AUTHORITY
    )
    opening = {a for a, _b in service.pairs}
    for host in sorted(nodes, key=opening.__contains__):
        if host in opening:  # all that it opens sessions with listen first, as far as that can be
            wait_for_all(network, programs)
        config = config_of(host, service, managers, files[names[host]], runtime)
        programs[host] = launch(runtime, names[host], MODULE, config, nodes[host])
    wait_for_all(network, programs)
    with runtime.time_limit():
        for host, node in nodes.items():
            tell_shell(node, managers, host)
    return managers


def config_of(
    host: str,
    service: KeyService,
    managers: KeyManagers,
    certificate: CertificateFiles,
    runtime: Runtime,
) -> KeyManagerConfig:
    """Return the configuration of a host's manager, which shows this certificate."""
    return KeyManagerConfig(
        host=host,
        address=runtime.addresses[host],
        stack=runtime.socket(host),
        keys=runtime.key_folder(host),
        hosts={name: runtime.addresses[name] for name in managers.urls},
        saes=dict(managers.saes),
        certificate=str(certificate.certificate),
        private_key=str(certificate.private_key),
        authority=str(managers.authority),
        keys_per_s=service.keys_per_s,
        withhold=service.withhold,
        key_log=str(runtime.private_file(f"{manager_name(host)}.keys")),
        report_to=broadcast(runtime.addresses.values(), runtime.prefix_length),
        device_key=runtime.device_key(host),
        links=links_of(host, service),
    )


def wait_for_all(network: Network, programs: Mapping[str, Program]) -> None:
    """Wait until programs answer; NetworkError if one does not."""
    for program in programs.values():
        program.wait_for("ready", READY_TIMEOUT_S, network.check)


def links_of(host: str, service: KeyService) -> list[KeyLink]:
    opened = [replace(service.link, peer=b, opens=True) for a, b in service.pairs if a == host]
    return opened + [
        replace(service.link, peer=a, opens=False) for a, b in service.pairs if b == host
    ]


def check(service: KeyService, saes: Mapping[str, str], hosts: Mapping[str, object]) -> None:
    """Raise NetworkError for what is not such a host, and names that cannot be."""
    unknown = {*saes.values(), *(host for pair in service.pairs for host in pair)} - hosts.keys()
    for name in sorted(unknown):
        raise NetworkError(f"{name} is not a host with a key manager: {remedy(name, hosts)}")
    for sae in service.saes:
        if not sae.isascii() or not sae.replace("-", "").isalnum() or sae.startswith("kme-"):
            raise NetworkError(f"SAE ID {sae!r}: letters, digits and - only, and not kme-...")


def made(
    folder: Path, names: Mapping[str, str], addresses: Mapping[str, str], saes: Mapping[str, str]
) -> dict[str, CertificateFiles]:
    authority = CertificateAuthority(folder, "qmn keys of one network")
    managers = {
        name: authority.issue(name, {host: addresses[host]}) for host, name in names.items()
    }
    return managers | {sae: authority.issue(sae) for sae in saes}


def given(folder: Path, names: Sequence[str]) -> dict[str, CertificateFiles]:
    """Return the files of a folder; NetworkError if one is missing."""
    files = {name: in_folder(folder, name) for name in names}
    needed = [path for file in files.values() for path in (file.certificate, file.private_key)]
    for path in (folder / AUTHORITY, *needed):
        if not path.is_file():
            raise NetworkError(
                f"{path} is missing: a folder of certificates has ca.pem, and "
                f"NAME.pem and NAME.key for each of {', '.join(names)}"
            )
    return files


def in_folder(folder: Path, name: str) -> CertificateFiles:
    return CertificateFiles(folder / f"{name}.pem", folder / f"{name}.key")


def tell_shell(node: QuantumHost, managers: KeyManagers, host: str) -> None:
    """Let commands in a host's shell find its key manager, and prove who they are.

    Certificates and private keys of the host's applications are in the folder that it is shown.
    """
    folder = node.network.own_folder(host)
    authority = folder / AUTHORITY
    copies = [(managers.authority, authority)]
    for sae in (sae for sae, place in managers.saes.items() if place == host):
        copies += zip(astuple(managers.files[sae]), astuple(in_folder(folder, sae)), strict=True)
    for file, shown in copies:
        shutil.copy(file, shown)
    node.network.share(host, *(shown for _given, shown in copies))
    certificate = in_folder(folder, application_name(host))
    variables = {
        "KME": managers.urls[host],
        "SAE_CERT": certificate.certificate,
        "SAE_KEY": certificate.private_key,
        "KME_CA": authority,
    }
    node.cmd("export " + " ".join(f'{name}="{value}"' for name, value in variables.items()))
