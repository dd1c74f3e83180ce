"""The parts of the result of a network or a run, as result.json keeps it (qmn.results.run_result).

Times and rates are those of the network by default.
"""

from dataclasses import asdict, dataclass, field
from typing import Any, ClassVar

from wire.config import QuantumSwitch
from wire.parameters.fiber import Fiber
from wire.results.figures import EveFigures, Figures, LoadFigures, StoredKeyFigures, TunnelFigures
from wire.results.service_figures import ServiceFigures
from wire.results.time_series import AnyMoment


@dataclass(frozen=True)
class NetworkFacts:
    """A network as it was built."""

    # Results that do not say it are of networks that could call theirs by one name alone.
    EARLIER: ClassVar = {"copper_switches": ["s1"]}

    addresses: dict[str, str]  # of the hosts
    source: str  # the host that makes pairs
    fibers: list[Fiber]
    switches: list[QuantumSwitch]
    copper: list[list[str]]  # of each link: node and interface at one end, and at the other
    # Where nodes are on a map, from left to right and upwards; empty: on none.
    positions: dict[str, tuple[float, float]] = field(default_factory=dict)
    datapath_ids: dict[str, int] = field(default_factory=dict)  # of switches
    copper_switches: list[str] = field(default_factory=list)  # those of copper alone

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)

    def host_at(self, interface: str) -> str:
        """Return the host that a switch's copper interface leads to, "" if there is none."""
        for node1, name1, node2, name2 in self.copper:
            if interface == name1:
                return node2
            if interface == name2:
                return node1
        return ""


SCHEMA = 2  # version of results; they of lower ones are read (docs/versions.md)
RESULT = "result.json"  # file of a run's folder, written when it has ended
BEGUN = "begun.json"  # there until then, from the start of the network on


Parameter = bool | int | float | str | list[str] | list[float]
Round = dict[str, object]  # by role, what its program has returned: anything that JSON has


@dataclass(frozen=True)
class SetUpTimes:
    """From metadata at the controller to an open light path, in ms; None: there was none."""

    p50: float | None = None
    p99: float | None = None
    n: int = 0

    def __str__(self) -> str:
        return f"median {self.p50:.3g} ms, p99 {self.p99:.3g} ms, n {self.n}"


@dataclass(frozen=True)
class Sessions:
    """The sessions of a run, as the controller counts them."""

    granted: int = 0
    refused: int = 0
    ids: list[str] = field(default_factory=list)  # of the first that were granted


@dataclass(frozen=True)
class SwitchCopies:
    """Set-up messages that quantum switches should have got: one for each of a session's light."""

    in_time: int  # before light was granted
    late: int
    missing: int
    p50_ms: float | None = None  # from the controller's own until it had that of the switch

    def __str__(self) -> str:
        count = self.in_time + self.late + self.missing
        after = "" if self.p50_ms is None else f", median {self.p50_ms:.3g} ms after c0"
        return f"{self.in_time} of {count} in time{after}; late {self.late}, missing {self.missing}"


@dataclass(frozen=True)
class WatchedLight:
    """Link monitors that have ended, on idle light or by request of programs."""

    monitors: int
    preempted: int  # of these, to sessions
    compared: int  # pairs
    errors: int  # of these, pairs that differed
    alarms: int
    closed: list[str]  # the fibres between switches that were closed for them


@dataclass(frozen=True)
class Approximated:
    """An approximation that was in what was reported."""

    name: str
    most: float  # that the probability of an outcome can be wrong by it


@dataclass(frozen=True)
class MachineFacts:
    """A machine beside the first, m1."""

    address: str
    hosts: list[str]
    clock: dict[str, float]  # how far it is ahead (offset_s), and how well that is known (error_s)


@dataclass(frozen=True)
class EarlyNews:
    """News that can come before light could."""

    origin: str
    receiver: str
    early_s: float


@dataclass(frozen=True, kw_only=True)
class Head:
    """The run of a result of any version, and its outcome."""

    service: str | None = None  # None: of a network on which more than one thing was done
    topology: str | None = None
    controller: str | None = None
    seed: int | None = None
    parameters: dict[str, Parameter] = field(default_factory=dict)
    delivered: bool | None = None
    error: str | None = None
    job: dict[str, object] = field(default_factory=dict)  # by the names of its parts


@dataclass(frozen=True)
class Message:
    """The bytes that a service has carried, by file."""

    file: str
    bytes: int
    sha256_sent: str | None = None
    sha256_received: str | None = None

    @property
    def arrived(self) -> bool:
        """Whether every byte has come as it was sent."""
        return self.sha256_received is not None and self.sha256_sent == self.sha256_received


@dataclass(kw_only=True)
class ServiceJob:
    """A service of two hosts or more: the reports of both ends at the end."""

    asking: ServiceFigures = field(default_factory=Figures)  # of the host that asks
    asked: ServiceFigures = field(default_factory=Figures)  # of the one that is asked
    eve: Figures | EveFigures | None = None  # None: she was not there
    message: Message | None = None  # None: the service carries none


@dataclass(kw_only=True)
class KeysJob:
    """Keys and tunnels that were kept: the numbers, and what happened when."""

    asking: Figures | StoredKeyFigures | TunnelFigures = field(default_factory=Figures)
    time_series: list[AnyMoment] = field(default_factory=list)


@dataclass(kw_only=True)
class NetqasmJob:
    """A NetQASM application: what the program of each role has returned, round by round."""

    roles: dict[str, str]  # host of each
    outputs: list[Round] = field(default_factory=list)


@dataclass(frozen=True)
class Shares:
    """The values that a half, 90 % and 99 % do not exceed, and how many there are."""

    p50: float | None
    p90: float | None
    p99: float | None
    n: int


@dataclass(frozen=True)
class AgedFidelity:
    """The fidelity of pairs that were handed over about as long ago."""

    age_s: float
    fidelity: float
    standard_error: float
    pairs: int


@dataclass(frozen=True)
class LoadSession:
    """A session of heavy traffic and what became of it; times since the first could be asked."""

    at_s: float  # as planned
    asked_s: float
    opener: str
    acceptor: str
    others: list[str]
    outcome: str
    reason: str
    text: str
    setup_s: float | None
    ended_s: float
    priority: int
    holding_s: float
    pairs: int | None
    session: str | None


@dataclass(frozen=True)
class LoadWait:
    """A session that waited for light, and who gave back the last of it; hosts by their names."""

    session: str
    opener: str
    acceptor: str
    ready_s: float  # when its light was there, since the first could be asked
    waited_s: float
    after_session: str
    after_opener: str
    after_acceptor: str


# Outcomes of a session of heavy traffic.
ACCEPTED, BLOCKED, LATE, BROKEN = "accepted", "blocked", "late", "broken"


@dataclass(kw_only=True)
class Load:
    """Heavy traffic: what became of the sessions, how long they waited, and what there was."""

    offered: int
    accepted: int
    blocked: dict[str, int]  # by reason
    late: int
    broken: dict[str, int]  # by reason
    forgotten: int  # without an answer: a fault
    setup_s: Shares
    queued: int
    waited_s: Shares  # in the queue
    light_s: float | None  # for which light was held, on average
    span_s: float
    offered_per_s: float | None
    at_a_time: int  # sessions, at most
    carried: float | None  # how many had light at a time on average, in erlang
    pairs: int
    pairs_per_s: float | None  # None: sessions leave none
    fidelity_by_age: list[AgedFidelity]
    fairness: float | None  # Jain's index of the hosts' accepted shares
    sessions: list[LoadSession]
    waits: list[LoadWait] = field(default_factory=list)  # of who then had light, longest first
    controller_ms: float = 0.0  # of a processor for a session
    began_ns: int = 0  # when the first session could be asked for
    fibers: dict[str, float] = field(default_factory=dict)  # share of the time that each was in use


@dataclass(kw_only=True)
class LoadJob:
    """Heavy traffic: the numbers that a person sees first, and all of it."""

    asking: Figures | LoadFigures = field(default_factory=Figures)
    load: Load | None = None  # None: the network did not start


Job = ServiceJob | KeysJob | NetqasmJob | LoadJob
