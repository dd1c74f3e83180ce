"""A policy: who may open which service to whom, and settings of devices (see reading.py)."""

from collections.abc import Iterable
from dataclasses import dataclass, field

from controller_apps.policy.schedules import IN_TURN, PARALLEL, UNPURIFIED, Purification, Queue
from wire.device import DeviceSettings

MAX_WATCHES = 256
BLOCK_PAIRS = 1024
BLOCKS_PER_S = 10  # at least: a link monitor gives its light back between two blocks
# The host's own ranges (applications.sealing) and no more than a watch may take.
RANGES: dict[str, tuple[float, float]] = {
    "every_s": (0.2, 86_400.0),
    "pairs": (1, 10_000_000),
    "rate_hz": (100, 1_000_000_000),
    "whole_error": (1e-6, 0.2),
    "fraction": (0.001, 1.0),
    "false_alarm": (1e-15, 0.1),
    "missed": (1e-15, 0.1),
}


@dataclass(frozen=True)
class Watch:
    """Two hosts whose way is watched while it is idle; the first makes the pairs."""

    between: tuple[str, str]
    over: frozenset[str] = frozenset()  # switches whose fibre is to be on the way; empty: any way
    every_s: float = 10.0  # of the network, from the end of one monitor to the next
    pairs: int = 2000  # to compare
    rate_hz: int = 100_000
    whole_error: float = 0.01  # part of the pairs that differ without an intruder, at most
    fraction: float = 0.25  # of the photons that an intruder to be found measures
    false_alarm: float = 1e-6  # of a test, at most
    missed: float = 0.01  # that a test takes such an intruder for nobody, at most

    def __str__(self) -> str:
        way = f" over {'-'.join(sorted(self.over))}" if self.over else ""
        return f"{self.between[0]} to {self.between[1]}{way}"

    @property
    def block_pairs(self) -> int:
        return max(1, min(BLOCK_PAIRS, self.pairs, self.rate_hz // BLOCKS_PER_S))


ALARMS = TELL, CLOSE = "tell", "close"
WHO = {"from": "sender", "to": "receiver", "source": "source"}  # in a file, and here


@dataclass(frozen=True)
class Host:
    """A host as rules see it."""

    name: str
    address: str


@dataclass(frozen=True)
class SessionRequest:
    service: str
    sender: Host
    receiver: Host
    source: Host
    rate_hz: int
    block_pairs: int
    frame_bytes: int


@dataclass(frozen=True)
class Rule:
    """One rule; "*" fits every host, a limit of None none."""

    action: str
    service: str = "*"
    sender: str = "*"
    receiver: str = "*"
    source: str = "*"
    max_sessions: int | None = None
    max_rate_hz: int | None = None
    max_block_pairs: int | None = None
    min_frame_bytes: int | None = None
    max_frame_bytes: int | None = None

    def fits(self, request: SessionRequest) -> bool:
        return self.service in ("*", request.service) and all(
            getattr(self, who) in ("*", host.name, host.address)
            for who in WHO.values()
            for host in [getattr(request, who)]
        )

    def excess(self, request: SessionRequest) -> str:
        requested = {
            "max_rate_hz": request.rate_hz,
            "max_block_pairs": request.block_pairs,
            "max_frame_bytes": request.frame_bytes,
        }
        for name, value in requested.items():
            limit = getattr(self, name)
            if limit is not None and value > limit:
                return f"{name} is {limit}, asked for is {value}"
        least = self.min_frame_bytes
        if least is not None and request.frame_bytes < least:
            return f"min_frame_bytes is {least}, asked for is {request.frame_bytes}"
        return ""


@dataclass(frozen=True)
class Tap:
    """A host that is put on the fibres between two others, all by their names."""

    between: tuple[str, str]
    by: str

    def __str__(self) -> str:
        return f"tap between {' and '.join(self.between)}"


@dataclass(frozen=True)
class Trusted:
    """A host that may know keys that it relays: of two others, or of all."""

    host: str  # "*": every host
    between: frozenset[str] = frozenset()  # empty: any two

    def covers(self, host: str, ends: frozenset[str]) -> bool:
        return self.host in ("*", host) and self.between in (frozenset(), ends)


@dataclass(frozen=True)
class Filter:
    """Protection against hosts that pose as others."""

    addresses: bool = True  # switches drop what is not from the addresses of the host at the port
    handshakes: bool = True  # a set-up needs a connection that both ends have opened
    sequences: bool = True  # a FIN or RST counts only where its connection is
    announcements: bool = True  # LLDP in the name of a host needs that host's seal
    numbers: bool = True  # a session has a number of its opener, not of another host


@dataclass(frozen=True)
class Reporting:
    period_s: float = 1.0
    lost_share: float = 1.0  # of the pairs that were sent; 1: never
    symbol_error_share: float = 1.0  # of the symbols that were received; 1: never


@dataclass(frozen=True)
class Policy:
    default: str = "allow"
    rules: tuple[Rule, ...] = ()
    devices: dict[str, DeviceSettings] = field(default_factory=dict)  # overrides, by host name
    reporting: Reporting = Reporting()
    taps: tuple[Tap, ...] = ()
    schedule: str = PARALLEL  # of chains of switches
    purification: Purification = UNPURIFIED  # in them
    filter: Filter = Filter()
    queue: Queue = IN_TURN  # of those that wait for light
    closed: frozenset[frozenset[str]] = frozenset()  # pairs of switches, by their names
    names_elements: bool = True  # to hosts that are refused light
    trusted: tuple[Trusted, ...] = ()  # with keys of others; without: nobody is
    alarm: str = TELL  # the effect of a link monitor's alarm
    watches: tuple[Watch, ...] = ()  # of light that is idle
    metadata_at_switch: str | None = None  # which networks are laid for; None: as their option says

    def trusts(self, host: str, ends: frozenset[str]) -> bool:
        return any(trusted.covers(host, ends) for trusted in self.trusted)

    def objection(self, request: SessionRequest, open_requests: Iterable[SessionRequest]) -> str:
        """Return why a request is not allowed beside those already granted, "" if it is."""
        rule, name = self._rule(request)
        if rule is None:
            return "" if self.default == "allow" else "no rule allows it, and the default denies"
        if rule.action == "deny":
            return f"{name} denies it"
        excess = rule.excess(request)
        if not excess and rule.max_sessions is not None:
            count = sum(self._rule(other)[0] is rule for other in open_requests)
            if count >= rule.max_sessions:
                excess = f"max_sessions is {rule.max_sessions}, and as many are open"
        return excess and f"{name}: {excess}"

    def _rule(self, request: SessionRequest) -> tuple[Rule | None, str]:
        for number, rule in enumerate(self.rules, 1):
            if rule.fits(request):
                return rule, f"rule {number}"
        return None, ""
