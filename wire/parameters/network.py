"""Settings of a network and its programs: each is declared here alone.

A program's configuration has the settings of its class here; the command line and scripts have all
of them as options, with these words, kinds, defaults and ranges.
"""

import os
from dataclasses import dataclass, fields
from importlib.util import find_spec
from math import inf
from typing import Any, ClassVar

from wire.parameters.delays import delay
from wire.parameters.option import CONTROL, SIMULATION, WRITTEN, option

BACKENDS = ("chp", "stim", "dense")
FRAMEWORKS = ("ryu", "os-ken")
# An installed package (setup/release/package.py) can be without Ryu.
FRAMEWORK = FRAMEWORKS["QMN_PYTHON" in os.environ and find_spec("ryu") is None]
OPENFLOW_PORT = 6653
MOST_KM = 100_000.0  # of copper
LEAST_MBPS, MOST_MBPS = 0.001, 10_000.0
REQUIRED, OBSERVED, OFF = "required", "observed", "off"  # metadata_at_switch
FOR_EACH = "for each message, as 5ms or exponential(1ms)"


@dataclass(frozen=True, kw_only=True)
class EventSettings:
    GROUP: ClassVar[str] = WRITTEN
    history_depth: int = option(
        10_000, "events kept (10000)", metavar="N", range=(0, 10_000_000), recorded=False
    )
    # These have events of their own in log and capture.
    per_qubit: int = option(
        0,
        "also write an event for each of the first N photons of a block (1000)",
        metavar="N",
        const=1000,
        range=(0, 1_000_000),
        recorded=False,
    )
    # Which then ends, and the run goes on: a capture, and the record of the dispatcher.
    file_gib: float = option(
        8.0,
        "most GiB of each capture, and of the record (8); the run goes on without the rest",
        metavar="GIB",
        range=(1e-6, 1e6),
    )

    @property
    def file_bytes(self) -> int:
        """Return what a capture, or the record, has at most."""
        return int(self.file_gib * (1 << 30))


@dataclass(frozen=True, kw_only=True)
class DispatcherSettings(EventSettings):
    GROUP: ClassVar[str] = SIMULATION
    backend: str = option(
        "chp", "simulator of quantum states (chp)", choices=BACKENDS, recorded=False
    )
    # Path of a Sabot server's socket; empty: the dispatcher simulates by itself.
    sabot: str = option(
        "", "simulate in a Sabot server (in ed itself)", metavar="SOCKET", recorded=False
    )
    # Path; empty: nowhere.
    tags: str = option(
        "",
        "write the clicks of each host's detectors as time tags into this new folder",
        group=WRITTEN,
        metavar="DIR",
        recorded=False,
    )
    state_inspection: bool = False  # of states by hosts, as no hardware lets them


@dataclass(frozen=True, kw_only=True)
class ControllerSettings:
    GROUP: ClassVar[str] = CONTROL
    loss_budget_db: float = option(
        30.0, "most loss of a light path (30)", metavar="DB", range=(0.0, 1_000.0)
    )
    contention: str = option(
        "refuse",
        "what happens to a request if its light is in use (refuse)",
        choices=("refuse", "queue"),
    )
    metadata_at_switch: str = option(
        OBSERVED,
        "what copies of set-up messages at quantum switches are for: light waits for them "
        "(required), they are counted (observed), there are none (off)",
        choices=(REQUIRED, OBSERVED, OFF),
    )
    # Path of its file; empty: the shipped one.
    policy: str = option("", "policy, in TOML (allow everything)", metavar="FILE", recorded=False)
    # Empty: nowhere.
    rest: str = option(
        "", "serve the state of c0 at this address, over HTTP", metavar="ADDRESS", recorded=False
    )
    apps: tuple[str, ...] = option(
        (),
        "load one more controller app, such as ryu.app.ofctl_rest (more than once)",
        flag="--app",
        metavar="MODULE",
        recorded=False,
    )


@dataclass(frozen=True, kw_only=True)
class CopperSettings:
    """A user's options of copper, and of the path between controller and switches."""

    GROUP: ClassVar[str] = CONTROL
    controller: str = option(
        FRAMEWORK, f"framework of c0 ({FRAMEWORK})", choices=FRAMEWORKS, recorded=False
    )
    openflow_port: int = option(
        OPENFLOW_PORT, "OpenFlow port of c0 (6653)", metavar="PORT", range=(1, 65_535)
    )
    copper_km: float | None = option(
        None,
        "length of every copper cable (that of the fibres between the same places)",
        metavar="KM",
        range=(0.0, MOST_KM),
    )
    copper_mbps: float | None = option(
        None,
        "Mbit/s of every copper cable, in each direction; packets queue (no limit)",
        metavar="MBPS",
        range=(LEAST_MBPS, MOST_MBPS),
    )
    controller_delay: str = option(
        "", f"delay of c0's software {FOR_EACH} (none)", metavar="DELAY", parse=delay
    )
    host_delay: str = option(
        "", f"delay of every host's software {FOR_EACH} (none)", metavar="DELAY", parse=delay
    )
    switch_agent_delay: str = option(
        "", f"delay of every quantum switch's agent {FOR_EACH} (none)", metavar="DELAY", parse=delay
    )
    control_km: float | None = option(
        None,
        "length of the copper between c0 and every switch (as other copper)",
        metavar="KM",
        range=(0.0, MOST_KM),
    )
    control_loss: float = option(
        0.0,
        "share of the packets between c0 and every switch that are lost (0)",
        metavar="P",
        range=(0.0, 0.9),
    )
    tls: bool = option(False, "TLS for OpenFlow and gRPC of hosts, with certificates at both ends")
    # Path of a folder of PEM files; empty: the run makes them.
    tls_from: str = option(
        "", "the same with your own certificates (docs/openflow.md)", metavar="FOLDER"
    )


@dataclass(frozen=True, kw_only=True)
class ServedSettings:
    """A user's options on servers of a network."""

    GROUP: ClassVar[str] = WRITTEN
    metrics: bool = option(False, "metrics for Prometheus (docs/metrics.md)", recorded=False)
    gnmi: bool = option(
        False, "telemetry of quantum switches by gNMI (docs/telemetry.md)", recorded=False
    )


@dataclass(frozen=True, kw_only=True)
class KeySettings:
    """A user's options on keys, of networks over which they may be distributed."""

    GROUP: ClassVar[str] = WRITTEN
    # Path of a folder; empty: keys go with the network.
    keys: str = option(
        "",
        "keep the keys that hosts make here, a new folder (they go with the network)",
        metavar="DIR",
        recorded=False,
    )


@dataclass(frozen=True, kw_only=True)
class NetworkSettings(
    ControllerSettings, CopperSettings, DispatcherSettings, ServedSettings, KeySettings
):
    """A user's options of a network whose nodes and fibres are described already."""

    GROUP: ClassVar[str] = SIMULATION
    seed: int = option(1, "seed of all quantum randomness (1)", range=(0, inf), recorded=False)


def part(kind: type[Any], settings: NetworkSettings) -> dict[str, Any]:
    return {item.name: getattr(settings, item.name) for item in fields(kind)}
