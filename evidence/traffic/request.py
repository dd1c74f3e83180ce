"""The request of heavy traffic: many sessions of many hosts."""

from dataclasses import dataclass
from pathlib import Path

from applications.ghz.options import LEAST_HOSTS, MOST_HOSTS
from evidence.traffic.plan import MODELS, MOST_SESSIONS
from hosts.middleware.services import named
from qmn.network.options import NetworkOptions
from qmn.requests.run_options import RunOptions
from wire.parameters.option import option
from wire.services import LINES

OWN = "own"
LINE = 3  # hosts of a session of a line


@dataclass(frozen=True, kw_only=True)
class LoadRequest:
    """The traffic, and its network."""

    service: str = option(
        "distribute", "that sessions are of (distribute)", choices=sorted(named())
    )
    count: int = option(
        30,
        "of pairs, states or bits of a session; bytes of sdc (30)",
        metavar="N",
        range=(1, 1 << 20),
    )
    source: str = option(
        "", f"host that makes the pairs; {OWN}: the one that asks (the network's)", metavar="HOST"
    )
    line: int | None = option(
        None,
        f"hosts of each session of {', '.join(sorted(service.name.lower() for service in LINES))}, "
        f"drawn in the order of their links ({LINE})",
        metavar="N",
        range=(LEAST_HOSTS, MOST_HOSTS),
    )
    traffic: str = option("poisson", "model of who asks when (poisson)", choices=tuple(MODELS))
    sessions: int = option(
        100, "that are asked for (100); of a trace at most", metavar="N", range=(1, MOST_SESSIONS)
    )
    rate_per_s: float = option(
        5.0, "sessions that are asked for in a second (5)", metavar="R", range=(1e-6, 1e6)
    )
    holding_s: float = option(
        0.2,
        "mean time that a session holds its light, when it has it (0.2)",
        metavar="S",
        range=(0.0, 600),
    )
    constant: bool = option(False, "holding times are all alike, not exponential")
    deadline_s: float | None = option(
        None,
        "sessions without light so long after their request are given up (none)",
        metavar="S",
        range=(1e-6, 600),
    )
    urgent: float = option(
        0.0,
        "share of the sessions that have priority 1, for a policy that orders by it (0)",
        metavar="SHARE",
        range=(0.0, 1),
    )
    senders: str = option(
        "", "hosts that ask, with commas (all but sources)", flag="--from", metavar="HOSTS"
    )
    receivers: str = option("", "hosts that are asked (the same)", flag="--to", metavar="HOSTS")
    idle: bool = option(False, "choose hosts that are idle for each session")
    on_s: float = option(
        1.0, "mean time that a host asks, of on-off (1)", metavar="S", range=(1e-3, 1e6)
    )
    off_s: float = option(1.0, "mean time that it does not (1)", metavar="S", range=(1e-3, 1e6))
    file: Path | None = option(None, "of a matrix or trace, CSV (docs/traffic.md)", metavar="FILE")
    network: NetworkOptions
    run: RunOptions
