"""TLS within a run: an authority of its own, and a certificate for each program that takes part.

host  === gRPC, TLS ===  ed         with --tls, and where hosts are on several machines
s1, q1 === OpenFlow, TLS === c0     with --tls
"""

from collections.abc import Iterable, Mapping

from topologies.system.open_vswitch import openvswitch
from topologies.system.runs.runtime import Runtime
from wire.config import EntranceConfig
from wire.credentials import Credentials

KEY_LOGS = "*.keys"  # of OpenFlow, of each key manager, and between machines
KEY_LOG = "openflow.keys"  # file beside the captures, by which Wireshark reads OpenFlow
ENTRANCE = "c0-tls"  # the program
OPERATOR = "operator"  # name in the certificate of who reads telemetry
OPEN_VSWITCH = "open-vswitch"  # name in the certificate of all bridges


def credentials(
    network: Runtime,
    name: str,
    addresses: Mapping[str, str] | None = None,
    also: Iterable[str] = (),
) -> Credentials:
    authority = network.authority()
    files = authority.issue(name, addresses, also)
    return Credentials(str(authority.certificate), str(files.certificate), str(files.private_key))


def entrance(
    network: Runtime, controller: str, port: int, addresses: Mapping[str, str]
) -> EntranceConfig:
    names = {f"{controller}-{switch}": address for switch, address in addresses.items()}
    return EntranceConfig(
        listen=[f"{address}:{port}" for address in addresses.values()],
        controller=f"127.0.0.1:{port}",
        credentials=credentials(network, controller, names),
        datapath_ids={name: int(bridge.dpid, 16) for name, bridge in network.bridges.items()},
        key_log=str(network.private_file(KEY_LOG)),
    )


def certify_operator(network: Runtime) -> None:
    if network.settings.tls and not (network.folder / "tls" / f"{OPERATOR}.pem").exists():
        credentials(network, OPERATOR)


def certify_bridges(network: Runtime) -> None:
    copper = [name for name in network.bridges if name not in network.switches]
    made = credentials(network, OPEN_VSWITCH, also=copper)
    openvswitch.certify(made.authority, made.certificate, made.private_key)
