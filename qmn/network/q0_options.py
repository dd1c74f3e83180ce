"""Options of q0, the interface of hosts whose packets travel by light."""

from dataclasses import dataclass, replace
from typing import ClassVar

from qmn.network.options import NetworkOptions
from qmn.network.topologies import SIZES
from qmn.options import check_ranges
from topologies.daemons.ip_over_light import IpOverLight
from wire.ip_over_light import DEFAULT_MTU, MIN_MTU
from wire.metadata.vocabulary import FEC_NAMES
from wire.parameters.option import option


@dataclass(frozen=True, kw_only=True)
class Q0Options:
    """What every q0 is like, if there is one."""

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


def with_both_ways(network: NetworkOptions) -> NetworkOptions:
    """Return the options of a network in which alice can receive, too, if it is one of ours."""
    fits = "both_ways" in SIZES.get(network.topology, ())
    return replace(network, both_ways=True) if fits else network
