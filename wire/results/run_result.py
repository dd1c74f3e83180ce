"""The result of a network or a run as result.json keeps it: what is the same of all, and the job.

A network of `qmn cli` or of a script, on which more than one thing is done, leaves a NetworkResult;
a run of `qmn run` a RunResult, with what is of its kind of job alone in `job`. Times and rates are
those of the network if nothing else is said.
"""

import json
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, cast

from wire.parameters.fiber import FiberOptics
from wire.parameters.network import NetworkSettings
from wire.parameters.physics import Device
from wire.results.figures import (
    EveFigures,
    Figures,
    LoadFigures,
    ServiceFigures,
    StoredKeyFigures,
    TunnelFigures,
)
from wire.results.moments import AnyMoment
from wire.results.network_facts import NetworkFacts

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
        """Return it as people read it, if there was one."""
        return f"p50 {self.p50:.2f} ms, p99 {self.p99:.2f} ms, n {self.n}"


@dataclass(frozen=True)
class Sessions:
    """The sessions of a run, as the controller counts them."""

    granted: int = 0
    refused: int = 0
    ids: list[str] = field(default_factory=list)  # of the first that were granted


@dataclass(frozen=True)
class WatchedLight:
    """Seals that are over, on light that nobody used or that programs had watched."""

    seals: int
    given_back: int  # of these, to sessions
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
class ShortestTime:
    """The shortest time of the network in which something happens to light."""

    name: str
    s: float


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
    """What a result of any version says of its run, and what became of it."""

    service: str | None = None  # None: of a network on which more than one thing was done
    topology: str | None = None
    controller: str | None = None
    seed: int | None = None
    parameters: dict[str, Parameter] = field(default_factory=dict)
    delivered: bool | None = None
    error: str | None = None
    job: dict[str, object] = field(default_factory=dict)  # by the names of its parts


@dataclass(kw_only=True)
class NetworkResult:
    """What every network leaves."""

    topology: str | None  # None: a script's own
    mode: str  # native or docker
    controller: str
    seed: int
    parameters: dict[str, Parameter]  # as the command line has them, by name
    error: str | None = None  # that ended it
    captures: list[str] = field(default_factory=list)  # files
    timeline: str = ""  # file, or why there is none
    packets_not_captured: int = 0
    files_ended: list[str] = field(default_factory=list)  # that became too long (--file-gib)
    network: NetworkFacts | None = None  # None: it did not start
    machines: dict[str, MachineFacts] = field(default_factory=dict)
    metrics: dict[str, str] = field(default_factory=dict)  # program to URL
    gnmi: dict[str, str] = field(default_factory=dict)  # quantum switch to address
    time_scale: float | None = None  # seconds here for one of the network; None: it did not start
    time_scale_because: str | None = None
    acausal: EarlyNews | None = None  # what can outrun light most; None: nothing can
    software_share: float | None = None  # of the wait in memory of which it was the largest part
    software_s: float | None = None
    software_share_of_run: float | None = None
    dominated_by_software: bool = False
    shortest_time: ShortestTime | None = None
    software_of_shortest: float | None = None  # software_s as a share of it
    # Whether that is less than `auto` means; None: nothing waited, or no auto.
    time_scale_kept: bool | None = None

    @property
    def settings(self) -> NetworkSettings:
        """Those of the network's programs, of the parameters; what is not told is as always."""
        told = {**self.parameters, "controller": self.controller, "seed": self.seed}
        named = {
            each.name: told[each.name] for each in fields(NetworkSettings) if each.name in told
        }
        as_set = {name: tuple(v) if isinstance(v, list) else v for name, v in named.items()}
        return NetworkSettings(**cast("Any", as_set))

    def write(self, folder: Path) -> None:
        """Write result.json into the folder of the network."""
        (folder / RESULT).write_text(json.dumps(vars(self), indent=2, default=_plain) + "\n")
        (folder / BEGUN).unlink(missing_ok=True)

    def write_begun(self, folder: Path, runner: str) -> None:
        """Write what is known by now; `runner` is the process that will write the result."""
        (folder / BEGUN).write_text(json.dumps([runner, vars(self)], default=_plain))


def _plain(value: Any) -> dict[str, Any]:
    return value.to_dict() if isinstance(value, Device) else vars(value)


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
    """A service of two hosts or more: what both ends have said at the end."""

    asking: ServiceFigures = field(default_factory=Figures)  # of the host that asks
    asked: ServiceFigures = field(default_factory=Figures)  # of the one that is asked
    eve: Figures | EveFigures | None = None  # None: she was not there
    message: Message | None = None  # None: the service carries none


@dataclass(kw_only=True)
class KeysJob:
    """Keys and tunnels that were kept: the numbers, and what happened when."""

    asking: Figures | StoredKeyFigures | TunnelFigures = field(default_factory=Figures)
    moments: list[AnyMoment] = field(default_factory=list)


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
    """Heavy traffic: the numbers that a person is told first, and all of it."""

    asking: Figures | LoadFigures = field(default_factory=Figures)
    load: Load | None = None  # None: the network did not start


Job = ServiceJob | KeysJob | NetqasmJob | LoadJob


@dataclass(kw_only=True)
class RunResult(NetworkResult):
    """What `qmn run` leaves: the same of every job, and the figures of the job in `job`."""

    service: str
    hosts: list[str]  # that take part, the one that asks first
    delivered: bool = False  # every byte is right, or the service was done
    sessions: Sessions = field(default_factory=Sessions)
    pairs_made: int | None = None  # by sources; None: the network did not come to say it
    photons_lost: int | None = None
    photons_lost_waiting: int | None = None  # of these, in delay lines, for the other half
    elapsed_s: float | None = None  # of the job, as the host that asks says it; None: it does not
    emulation: dict[str, float] = field(default_factory=dict)  # elapsed_s and rates by the wall
    path_setup_ms: SetUpTimes = field(default_factory=SetUpTimes)
    packet_in_count: int = 0
    every_fiber: FiberOptics | None = None  # None: fibres are as the topology says
    # Of hosts that are named, and of "every" other; the file has what of them is not ideal.
    devices: dict[str, Device] = field(default_factory=dict)
    events: bool = True  # whether what happened to qubits was written
    backend: str
    exact: bool | None = None  # None: the network did not come to say it
    approximations: list[Approximated] = field(default_factory=list)  # why it is not exact
    watched: WatchedLight | None = None  # None: no light was
    job: Job

    @property
    def asking(self) -> Figures:
        """What the host that asks has said at the end; of NetQASM programs nothing."""
        return Figures() if isinstance(self.job, NetqasmJob) else self.job.asking

    @property
    def message(self) -> Message | None:
        """The bytes that its service has carried; None: it carries none."""
        return self.job.message if isinstance(self.job, ServiceJob) else None
