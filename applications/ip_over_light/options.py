"""Options of q0, the interface of hosts whose packets travel by light."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

from applications.ip_over_light.format import DEFAULT_MTU, MIN_MTU
from applications.ip_over_light.interfaces import IpOverLight, start_ip_over_light
from qmn.network.options import NetworkOptions
from qmn.network.programs import NetworkProgram, Start
from qmn.network.topologies import TOPOLOGIES
from qmn.options import check_ranges
from topologies.networks.network import Network
from wire.metadata.vocabulary import FEC_NAMES
from wire.parameters.option import option


@dataclass(frozen=True, kw_only=True)
class Q0Options:
    GROUP: ClassVar[str] = "IP over light"
    q0: bool = option(
        False, "hosts have an interface q0 whose IP packets travel by light (docs/ip-over-light.md)"
    )
    q0_mtu: int = option(
        DEFAULT_MTU,
        f"bytes of a packet on q0 at most ({DEFAULT_MTU})",
        metavar="N",
        range=(MIN_MTU, 65_535),
    )
    q0_fec: str = option("none", "code of what goes over q0 (none)", choices=tuple(FEC_NAMES))
    q0_interleave: bool = option(False, "spread the codewords of what goes over q0")
    q0_frame_bytes: int = option(
        256, "of a frame of what goes over q0 (256)", metavar="N", range=(1, 1 << 16)
    )


def ip_over_light(options: Q0Options) -> IpOverLight | None:
    """Return what q0 is to be like, None if there is to be none; raise BadInput."""
    check_ranges(options)
    if not options.q0:
        return None
    sessions = {
        "fec": options.q0_fec,
        "interleave": options.q0_interleave,
        "frame_bytes": options.q0_frame_bytes,
    }
    return IpOverLight(mtu=options.q0_mtu, sessions=sessions)


def with_both_ways(options: Q0Options, network: NetworkOptions) -> NetworkOptions:
    """Return a network in which alice can receive, too, if q0 is wanted and the network is ours."""
    topology = TOPOLOGIES.get(network.topology)
    fits = options.q0 and topology is not None and "both_ways" in topology.parameters
    return replace(network, both_ways=True) if fits else network


def prepare(options: Q0Options, _hosts: Sequence[str]) -> Start | None:
    """Return what starts q0 on the hosts, None if it is not wanted; raise BadInput."""
    interface = ip_over_light(options)
    if interface is None:
        return None

    def start(network: Network) -> dict[str, str]:
        addresses = start_ip_over_light(network, interface)
        return {f"q0 of {host}": address for host, address in addresses.items()}

    return start


PROGRAM = NetworkProgram(Q0Options, prepare, with_both_ways)
