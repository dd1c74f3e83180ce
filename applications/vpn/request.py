"""The request of a VPN with quantum keys."""

from dataclasses import dataclass
from pathlib import Path

from applications.keys.request import EveSchedule
from applications.vpn.format import PROGRAMS, WIREGUARD
from hosts.middleware.session.options import MAX_COUNT
from qmn.network.options import NetworkOptions
from qmn.requests.run_options import RunOptions
from wire.parameters.option import option

DEFAULT_S = 20.0  # that the default file takes at the rate that is asked for


@dataclass(frozen=True, kw_only=True)
class VpnRequest:
    """The tunnel's kind, how often its key changes, and the file that goes through it."""

    program: str = option(
        WIREGUARD, "what makes the tunnel (wireguard)", flag="--with", choices=PROGRAMS
    )
    sender: str = option("alice", "host that asks for keys (alice)", flag="--from", metavar="HOST")
    receiver: str = option("bob", "that has the file (bob)", flag="--to", metavar="HOST")
    rotate: float = option(2.0, "a new key so often (2)", metavar="S", range=(0.5, 3_600))
    lifetime: float = option(
        5.0,
        "no key is used for longer (5)",
        flag="--key-lifetime",
        metavar="S",
        range=(1.0, 86_400),
    )
    session_bits: int = option(
        12_000,
        "sifted bits of a session that makes keys (12000)",
        metavar="N",
        range=(1, MAX_COUNT),
    )
    mbit_s: float = option(4.0, "at which the file comes (4)", metavar="MBIT", range=(0.1, 1_000))
    file: Path | None = option(
        None,
        f"to move (random bytes that take {DEFAULT_S:g} s)",
        metavar="FILE",
        recorded=False,
    )
    seconds: float = option(
        90.0,
        "until the file has to be there (90)",
        metavar="S",
        range=(1.0, 86_400),
        recorded=False,
    )
    eve: EveSchedule
    network: NetworkOptions
    run: RunOptions
