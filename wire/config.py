"""The configuration of each program at its start: one JSON file a program.

The runner writes them, readable by root alone, because they hold the node tokens.
"""

import json
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Self

from wire import typed_json
from wire.credentials import Credentials
from wire.features import NodeFeatures
from wire.lldp import PERIOD_S
from wire.network_time import NetworkTime, SteppedTime
from wire.parameters.checks import check_choice
from wire.parameters.fiber import Fiber, FiberEnd
from wire.parameters.network import ControllerSettings, DispatcherSettings
from wire.parameters.option import check_options
from wire.parameters.physics import ANALYSERS, Device
from wire.parameters.switch import PathOptics, QuantumSwitch

__all__ = [
    "DISPATCHER_PORT",
    "AgentConfig",
    "BadConfig",
    "Cable",
    "Config",
    "ControllerConfig",
    "CopperConfig",
    "DispatcherConfig",
    "EntranceConfig",
    "Fiber",
    "FiberEnd",
    "GateConfig",
    "HostConfig",
    "MeasuredConfig",
    "PathOptics",
    "QuantumSwitch",
    "Station",
]

DISPATCHER_PORT = 50051


class BadConfig(ValueError):
    """A configuration file that cannot be used; the message names file and remedy."""


@dataclass(frozen=True)
class Config:
    time_scale: float = field(default=1.0, kw_only=True)  # seconds here for one of the network
    time_since_ns: int = field(default=0, kw_only=True)  # when both clocks agreed
    time_folder: str = field(default="", kw_only=True)  # of the gate that steps time; empty: paced
    time_slot: int = field(default=0, kw_only=True)  # of this program, among all

    @property
    def time(self) -> NetworkTime:
        """Return the time of the network; raise ValueError for a scale out of range."""
        if self.time_folder:
            return SteppedTime(1.0, self.time_since_ns, self.time_folder, self.time_slot)
        return NetworkTime(self.time_scale, self.time_since_ns)

    def write(self, path: Path) -> None:
        """Write the file so that only its owner can read it."""
        path.touch(mode=0o600)
        path.write_text(json.dumps(asdict(self), indent=1))

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read the file; raise BadConfig if it is not one of this kind."""
        try:
            config = typed_json.read(cls, json.loads(path.read_text()), "it")
            _ = config.time
        except (OSError, ValueError, RecursionError) as error:
            raise BadConfig(f"{path} is not a {cls.__name__}: {error}") from error
        return config


@dataclass(frozen=True)
class CarriedConfig(Config):
    """Configuration of a package's program, which may be on another machine with its host."""

    FILES: ClassVar[tuple[str, ...]] = ()  # fields that are paths of files which go there
    key_log: str = field(default="", kw_only=True)  # path of secrets for Wireshark; empty: none


@dataclass(frozen=True)
class MeasuredConfig(Config):
    # The listening socket that the runner has handed over for that; None: it tells nobody.
    metrics_fd: int | None = field(default=None, kw_only=True)


@dataclass(frozen=True)
class DispatcherConfig(MeasuredConfig, DispatcherSettings):
    """The physical network and who may act for which node."""

    listen: str  # "10.0.0.4:50051"
    socket: str  # path of the unix socket
    seed: int
    tokens: dict[str, str]  # token of each node; the runner's own node is "runner"
    fibers: list[Fiber]
    switches: list[QuantumSwitch]
    event_log: str = ""  # path; empty: none
    event_capture: str = ""  # path of the same as a pcapng file; empty: none
    devices: dict[str, Device] = field(default_factory=dict)  # of hosts; ideal if not listed
    max_live_qubits: int = 32_000_000
    record: str = ""  # path of a private record to replay, which must not exist; empty: none
    qasm: str = ""  # path of a dump of what is done to qubits (OpenQASM 2.0); empty: none
    # How long (s) news takes from each node to its neighbours at least; none: no time at all.
    news_s: dict[str, dict[str, float]] = field(default_factory=dict)
    credentials: Credentials | None = None  # hosts come by TLS

    def __post_init__(self) -> None:
        check_options(self)


# Light is granted to hosts by our controller, session by session, by a verdict in the set-up
# message; or the switches are programmed by others, and the light stands.
LIGHT = CONTROLLER, STANDING = "controller", "standing"
ADJUSTED = ".memory"  # of a file beside a stack's socket: fields of its configuration that changed


@dataclass(frozen=True)
class HostConfig(Config):
    """One host's stack: where it is, what it owns, how it reaches the dispatcher."""

    name: str
    address: str  # of its CNIC
    qnics: list[str]  # interface names of its fibres, in order
    dispatcher: str  # "10.0.0.4:50051"
    token: str
    socket: str  # unix socket on which applications reach the stack
    hosts_file: str  # path of a file of all hosts, name to address in JSON, as /etc/hosts has them
    source: str  # name of the host that makes pairs
    seed: int
    report_to: str = ""  # address that the node agent reports to (the subnet's broadcast)
    device_key: str = ""  # that the node agent shares with the controller; empty: no node agent
    # Path of a private folder of all secrets that two hosts each share; empty: there are none.
    pair_secrets: str = ""
    keys: str = ""  # path of the folder for keys that it distributes; empty: it keeps none
    analyser: str = "complete"  # its Bell analyser (wire.parameters.physics.BellAnalyser.kind)
    qnic: str = ""  # "path/to/file.py:ClassName" of its hardware; empty: it is simulated
    qnic_parameters: dict[str, Any] = field(default_factory=dict)  # keywords of that class
    features: int = Device().features.value  # what its device can do (wire.features.Feature)
    memory_qubits: int = Device().memory.capacity
    light: str = CONTROLLER  # who grants it
    multi_photon: float = 0.0  # how likely a pulse of its source has several photons
    intensities: list[float] = field(default_factory=lambda: [1.0])  # means: signal, then decoys
    pair_rate_hz: int = 50_000_000  # that every source of the network can make
    t1_s: float = Device().memory.t1_s
    t2_s: float = Device().memory.t2_s
    depolarizing_s: float = Device().memory.depolarizing_s
    # Interfaces that are channels of a fibre, and their frequencies; of all others light of any
    # colour passes.
    channels_mhz: dict[str, int] = field(default_factory=dict)
    cutoff_s: float = Device().memory.cutoff_s
    compensates: bool = False  # whether its device has a compensator
    announcement_period_s: float = PERIOD_S  # of its fibres, as soon as the controller has found it
    credentials: Credentials | None = None  # the dispatcher is reached by TLS

    def __post_init__(self) -> None:
        check_choice("light", self.light, LIGHT)
        check_choice("analyser", self.analyser, ANALYSERS)
        _ = self.node_features

    @cached_property
    def hosts(self) -> dict[str, str]:
        """The addresses of all hosts by name, read when somebody asks for one; or raise BadConfig.

        Most hosts of a large network never do.
        """
        try:
            addresses: dict[str, str] = json.loads(Path(self.hosts_file).read_text())
        except (OSError, ValueError) as error:
            raise BadConfig(f"{self.hosts_file}, the file of all hosts: {error}") from error
        return addresses

    @property
    def node_features(self) -> NodeFeatures:
        """Return what the host announces; raise ValueError for what none can be."""
        return NodeFeatures.checked(self.features, self.memory_qubits)


@dataclass(frozen=True)
class AgentConfig(MeasuredConfig):
    """One quantum switch: its bridge on one side, controller and dispatcher on the other."""

    switch: str
    listen: str  # where the bridge connects to: "127.0.0.1:16653", or a path for Unix sockets
    controllers: list[str]  # "127.0.0.1:6653"
    management: str  # path of the bridge's management socket (…/q1.mgmt)
    dispatcher: str  # path of the dispatcher's unix socket
    token: str
    fiber_ports: list[int]  # OpenFlow numbers of the ports that are fibres
    analysers: int = 0  # Bell analysers in the switch
    memories: int = 0  # quantum memories in it
    sources: int = 0  # of pairs in it
    emitters: int = 0  # of its memories, by an inner port each
    parts: Device = field(default_factory=Device)  # what all these are like
    hardware: str = ""  # empty: the simulated switch; or "scpi://192.0.2.7:5025"
    # scpi: OpenFlow port number to the numbers of its [ingress, egress] at the instrument
    hardware_ports: dict[str, list[int]] = field(default_factory=dict)
    needs_copies: bool = False  # light of a session needs its set-up on the switch's own copper
    programs: str = ""  # path of a Unix socket for ovs-ofctl and the like; empty: none
    credentials: Credentials | None = None  # controllers are reached by TLS
    gnmi: str = ""  # path of a Unix socket at which telemetry is served; empty: nowhere
    gnmi_fd: int | None = None  # a listening TCP socket that leads there

    def listening(self, number: int) -> str:
        """Return where the bridge connects to for a controller, by its number."""
        host, colon, port = self.listen.rpartition(":")
        return f"{host}:{int(port) + number}" if colon else f"{self.listen}{number}"


@dataclass(frozen=True)
class Station:
    """Where a host is on copper, and what it may call itself there."""

    dpid: int
    port: int  # of that switch
    mac: str
    address: str  # IPv4


@dataclass(frozen=True)
class Cable:
    """Copper between two interfaces, each with the file of its TAP in the program `copper`."""

    a: str
    b: str
    a_fd: int
    b_fd: int
    delay_s: float  # of the network
    loss: float = 0.0  # share of the packets that do not arrive
    mbps: float | None = None  # of the network, in each direction; None: no limit
    # Time of the software at each end for a message that arrives (wire.parameters.delays).
    a_software: str = ""
    b_software: str = ""


@dataclass(frozen=True)
class CopperConfig(Config):
    """The configuration of the program that delays packets by the length of their copper."""

    cables: list[Cable]
    simulation: str  # IPv4 address of the dispatcher, whose packets no cable holds back
    seed: int = 1  # of which packets are lost


@dataclass(frozen=True)
class GateConfig(Config):
    """The configuration of the program that steps time."""

    leaps: str  # path of the file that has each leap
    watched: bool = False  # by people: the clock never leads the wall


@dataclass(frozen=True)
class EntranceConfig(Config):
    """Where switches come in to the controller by TLS."""

    listen: list[str]  # "198.18.1.1:6653"
    controller: str  # "127.0.0.1:6653"
    credentials: Credentials
    datapath_ids: dict[str, int]  # of all switches by name
    key_log: str = ""  # path of a file of secrets for Wireshark; empty: none


@dataclass(frozen=True)
class ControllerConfig(MeasuredConfig, ControllerSettings):
    """The configuration of the controller apps; all else they discover."""

    listen: str  # "127.0.0.1:6653"
    framework: str  # "ryu" or "os-ken"
    quantum_switches: dict[str, int] = field(default_factory=dict)  # datapath ids by name
    hold_timeout_s: float = 5.0
    idle_timeout_s: int = 30
    record: str = ""  # path of a JSON-lines file for measurements; empty: none
    address: str = ""  # IPv4, in the hosts' network, that its datagrams to node agents come from
    device_keys: dict[str, str] = field(default_factory=dict)  # of each host
    addresses: dict[str, str] = field(default_factory=dict)  # of these hosts, IPv4
    stations: list[Station] = field(default_factory=list)  # on classical switches
    # Of switches on copper that leads to switches: datapath id and port.
    trunks: list[tuple[int, int]] = field(default_factory=list)
    console: str = ""  # path of the unix socket of the console; empty: none
    # The socket that listens at `rest`, from the runner: it may be of another network namespace.
    rest_fd: int | None = None
    rest_token: str = ""  # that the console's resources there want; empty: nobody has it
    state: str = ""  # path of a private folder for what a restarted one must know; empty: none
    announcement_period_s: float = PERIOD_S  # that hosts wait before they name their fibres again

    def __post_init__(self) -> None:
        check_options(self)
