"""The result of a network or a run as result.json keeps it: what is the same of all, and the job.

A network of `qmn cli` or of a script, on which more than one thing is done, leaves a NetworkResult;
a run of `qmn run` a RunResult, with what is of its kind of job alone in `job`. Times and rates are
those of the network unless stated otherwise.
"""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from qmn.network.options import NetworkOptions
from qmn.network.time_scale import PACED
from qmn.requests.recording import recorded
from qmn.requests.request import Request
from wire.parameters.fiber import FiberOptics
from wire.parameters.network import NetworkSettings
from wire.parameters.physics import Device
from wire.results.figures import Figures
from wire.results.run_result import (
    BEGUN,
    RESULT,
    SCHEMA,
    Approximated,
    EarlyNews,
    Job,
    MachineFacts,
    Message,
    NetqasmJob,
    NetworkFacts,
    ServiceJob,
    Sessions,
    SetUpTimes,
    SwitchCopies,
    WatchedLight,
)

ABSENT = (None, (), "")  # values of options that a result of a network leaves out
BESIDE = ("topology", "controller", "seed")  # options that a result of a network has beside


@dataclass(kw_only=True)
class NetworkResult:
    """The result of every network."""

    EARLIER: ClassVar = {"schema": 0}

    topology: str | None  # None: a script's own
    mode: str  # native or docker
    controller: str
    seed: int
    parameters: NetworkOptions | Request  # as the file has them: by the names of options
    error: str | None = None  # that ended it
    captures: list[str] = field(default_factory=list)  # files
    timeline: str = ""  # file, or why there is none
    packets_not_captured: int = 0
    files_ended: list[str] = field(default_factory=list)  # that became too long (--file-gib)
    network: NetworkFacts | None = None  # None: it did not start
    machines: dict[str, MachineFacts] = field(default_factory=dict)
    metrics: dict[str, str] = field(default_factory=dict)  # program to URL
    gnmi: dict[str, str] = field(default_factory=dict)  # quantum switch to address
    time: str = PACED  # or stepped
    time_scale: float | None = None  # seconds here for one of the network; None: it did not start
    time_because: str | None = None  # why it is paced by default
    acausal: EarlyNews | None = None  # what can outrun light most; None: nothing can
    schema: int = SCHEMA  # docs/versions.md

    @property
    def settings(self) -> NetworkSettings:
        """Those of the network's programs; values left out are defaults."""
        request = self.parameters
        return request if isinstance(request, NetworkOptions) else request.network

    @property
    def recorded_parameters(self) -> dict[str, Any]:
        """The parameters as the file has them: of a network all options that say something."""
        if not isinstance(self.parameters, NetworkOptions):
            return recorded(self.parameters)
        parameters = {name: v for name, v in asdict(self.parameters).items() if name not in BESIDE}
        return {name: value for name, value in parameters.items() if value not in ABSENT}

    def write(self, folder: Path) -> None:
        """Write result.json into the folder of the network."""
        (folder / RESULT).write_text(json.dumps(self._plain, indent=2, default=_plain) + "\n")
        (folder / BEGUN).unlink(missing_ok=True)

    def write_begun(self, folder: Path, runner: str) -> None:
        """Write what is known by now; `runner` is the process that will write the result."""
        (folder / BEGUN).write_text(json.dumps([runner, self._plain], default=_plain))

    @property
    def _plain(self) -> dict[str, Any]:
        return {**vars(self), "parameters": self.recorded_parameters}


def _plain(value: Any) -> dict[str, Any]:
    return value.to_dict() if isinstance(value, Device) else vars(value)


@dataclass(kw_only=True)
class RunResult(NetworkResult):
    """What `qmn run` leaves: the same of every job, and the figures of the job in `job`."""

    parameters: Request
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
    copies: SwitchCopies | None = None  # None: quantum switches get none
    packet_in_count: int = 0
    every_fiber: FiberOptics | None = None  # None: fibres are as the topology says
    unused_settings: list[str] = field(
        default_factory=list
    )  # HOST.PART.NAME, of preset or topology
    # Of hosts that are named, and of "every" other; the file has what of them is not ideal.
    devices: dict[str, Device] = field(default_factory=dict)
    events: bool = True  # whether what happened to qubits was written
    backend: str
    exact: bool | None = None  # None: the network did not come to say it
    approximations: list[Approximated] = field(default_factory=list)  # why it is not exact
    drawn_for: list[str] = field(default_factory=list)  # why weak pulses were simulated one by one
    watched: WatchedLight | None = None  # None: no light was
    job: Job

    @property
    def asking(self) -> Figures:
        """The last figures of the requesting host; none of NetQASM programs."""
        return Figures() if isinstance(self.job, NetqasmJob) else self.job.asking

    @property
    def message(self) -> Message | None:
        """The bytes that its service has carried; None: it carries none."""
        return self.job.message if isinstance(self.job, ServiceJob) else None
