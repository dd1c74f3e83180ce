"""The shared state of one emulated network: names, tokens, places and programs.

Mininet makes nodes one by one and gives them no way to see the whole. So each node and
each fibre registers here as it is made, and the programs learn the rest from here.
"""

import atexit
import json
import os
import secrets
import shutil
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any

from topologies.system.machines.machine import Machine
from topologies.system.namespaces import are_own, machine_listener
from topologies.system.processes.forks import ForkServer
from topologies.system.processes.owners import RUNTIME_ROOT as RUNTIME_ROOT
from topologies.system.processes.owners import from_words, gone, this_process
from topologies.system.processes.programs import NetworkError, Program
from topologies.timeouts import END_TIMEOUT_S
from wire.config import Cable, Fiber, QuantumSwitch
from wire.dispatcher_service import RUNNER
from wire.network_time import NetworkTime, SteppedTime
from wire.parameters.network import NetworkSettings
from wire.parameters.physics import Device

if TYPE_CHECKING:
    from topologies.system.certificates import CertificateAuthority, GivenCertificates

DISPATCHER = "dispatcher"  # the program, and its socket
FIRST_PORT = 10_000
EPHEMERAL_PORTS = Path("/proc/sys/net/ipv4/ip_local_port_range")  # of connections
ATTEMPTS = 100
TIME = "time"  # the folder of the gate that steps it
CONSOLE = "console"  # the controller's socket
REST_TOKEN = "rest-token"  # noqa: S105 (the name of a file in the private folder)
RECORD = "dispatcher.record"  # what the dispatcher was asked
EVENT_LOG = "quantum.log"  # what happened to the qubits, a line an event
EVENT_CAPTURE = "quantum.pcapng"  # the same for Wireshark and qmn spy
MACHINE_PAGES = RUNTIME_ROOT / "live-pages"  # of all networks, while `qmn live --all` shows them
LIVE_PAGES = "QMN_LIVE_PAGES"  # in the environment: the folder of a command's live pages


@dataclass
class Runtime:
    """One network: settings given by the caller, and what its nodes have registered."""

    settings: NetworkSettings = field(default_factory=NetworkSettings)
    time_scale: float = 1.0  # seconds here for one second of the network
    stepped: bool = False  # whether time stands while programs run
    watched: bool = False  # whether stepped time never leads the wall, for people
    record: bool = False  # whether the dispatcher records what it is asked, for a replay
    events: bool = True  # whether the dispatcher writes what happens to qubits
    qasm: bool = False  # whether the dispatcher dumps what is done to qubits
    log_folder: Path | None = None  # where logs and records go; default: the private folder
    hosts: list[Any] = field(default_factory=list)  # their nodes
    addresses: dict[str, str] = field(default_factory=dict)  # of the hosts
    fibers: list[Fiber] = field(default_factory=list)
    copper: dict[frozenset[str], float] = field(default_factory=dict)  # delay (s) between two nodes
    bridges: dict[str, Any] = field(default_factory=dict)  # that c0 programs, by name
    management: set[str] = field(default_factory=set)  # interfaces that they have to c0
    cables: list[Cable] = field(default_factory=list)  # of it, those that packets are held back on
    switches: dict[str, QuantumSwitch] = field(default_factory=dict)
    datapath_ids: dict[str, int] = field(default_factory=dict)  # of the quantum switches
    programmed_elsewhere: set[str] = field(default_factory=set)  # by other controllers than c0
    devices: dict[str, Device] = field(default_factory=dict)  # of the hosts
    source: str = ""
    dispatcher: str = ""  # "10.0.0.4:50051"
    programs: list[Program] = field(default_factory=list)
    fork_server: ForkServer | None = None  # which starts most of them
    places: dict[str, Machine] = field(default_factory=dict)  # of hosts that are not here
    from_elsewhere: ExitStack = field(default_factory=ExitStack)  # brings files back from there
    tokens: dict[str, str] = field(default_factory=dict)
    prefix_length: int = 24  # of the hosts' network
    device_keys: dict[str, str] = field(default_factory=dict)  # of the hosts' node agents
    user_namespaces: bool = True  # whether hosts can have them, for all that is known
    time_limited: bool = False  # whether commands in nodes' shells have a deadline
    ending: bool = False  # whether a shell that misses it, or has ended, is not a reason to stop
    metrics_addresses: dict[str, str] = field(default_factory=dict)  # by program: where
    gnmi_addresses: dict[str, str] = field(default_factory=dict)  # by quantum switch: where

    def __post_init__(self) -> None:
        self._hosts_written = 0
        self.time_slots = count()  # of programs
        self._making = Lock()  # what all share is made for the first who asks; hosts ask at once
        self._begun: set[str] = set()  # private files
        self._authority: CertificateAuthority | GivenCertificates | None = None
        self.name = str(this_process())
        self.folder = RUNTIME_ROOT / self.name
        self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        self.time = NetworkTime(self.time_scale, time.time_ns())
        if self.stepped:
            self.time = SteppedTime(1.0, self.time.since_ns, str(self.own_folder(TIME)))
        self.logs = self.log_folder or self.folder
        self.logs.mkdir(mode=0o700, parents=True, exist_ok=True)
        self.token(RUNNER)

    @property
    def machines(self) -> list[Machine]:
        return sorted(set(self.places.values()), key=lambda machine: machine.name)

    @property
    def mtu(self) -> int | None:
        """Return what copper passes at most where some of it is between machines; else None."""
        return min((machine.mtu for machine in self.machines), default=None)

    def token(self, node: str) -> str:
        """Return the secret that names a node to the dispatcher."""
        return self.tokens.setdefault(node, secrets.token_hex(16))

    @contextmanager
    def time_limit(self) -> Iterator[None]:
        """Give commands in nodes' shells a deadline meanwhile."""
        before, self.time_limited = self.time_limited, True
        try:
            yield
        finally:
            self.time_limited = before

    @property
    def own_datapath_ids(self) -> dict[str, int]:
        """Return the datapath IDs of the quantum switches that c0 programs."""
        elsewhere = self.programmed_elsewhere
        return {name: dpid for name, dpid in self.datapath_ids.items() if name not in elsewhere}

    def patience_s(self, least_s: float, messages: int) -> float:
        """Return how long to wait, by the wall, for `messages` messages of the management network.

        Each may wait for the one before it, and TCP longer after each loss.
        """
        way_s = self.time.wall_s(max(self.copper.values(), default=0.0))
        patience_s: float = (least_s + messages * way_s) / (1 - self.settings.control_loss) ** 4
        return patience_s

    def rest_token(self) -> str:
        """Return the secret that HTTP clients of the controller have read from its file."""
        file = self.folder / REST_TOKEN
        with self._making:
            if not file.exists():
                file.touch(mode=0o600)
                file.write_text(secrets.token_hex(16))
        return file.read_text()

    @property
    def tls(self) -> bool:
        """Whether hosts reach the dispatcher by TLS; between machines they always do."""
        return self.settings.tls or bool(self.places)

    def authority(self) -> "CertificateAuthority | GivenCertificates":
        """Return who signs, or has, the certificates of this run's programs."""
        from topologies.system import certificates  # cryptography takes a while to load

        with self._making:
            if self._authority is None:
                folder, theirs = self.folder / "tls", self.settings.tls_from
                self._authority = (
                    certificates.GivenCertificates(folder, Path(theirs))
                    if theirs
                    else certificates.CertificateAuthority(folder, f"qmn run {self.name}")
                )
            return self._authority

    def device_key(self, host: str) -> str:
        """Return the secret that a host's node agent shares with the controller."""
        return self.device_keys.setdefault(host, secrets.token_hex(16))

    def secrets_folder(self) -> str:
        """Return the path of the private folder of what two hosts share, to authenticate by."""
        folder = self.folder / "pair-secrets"
        folder.mkdir(mode=0o700, exist_ok=True)
        return str(folder)

    def hosts_file(self) -> str:
        """Return the path of the file of all hosts that there are now, one for all of them."""
        file = self.folder / "hosts.json"
        with self._making:
            if len(self.addresses) != self._hosts_written:
                self._hosts_written = len(self.addresses)
                unfinished = file.with_suffix(".new")
                unfinished.write_text(json.dumps(self.addresses))
                unfinished.replace(file)
        return str(file)

    def key_folder(self, host: str) -> str:
        """Return the path of the folder for the keys of a host, on its machine; it is private."""
        return str(
            self._keys_in(self.folder / "keys", host)
            if host in self.places
            else self.kept_keys(host)
        )

    def kept_keys(self, host: str) -> Path:
        """Return the folder of this machine for the keys of a host, when the network has ended."""
        folder = self.settings.keys
        return self._keys_in(Path(folder) if folder else self.folder / "keys", host)

    def _keys_in(self, folder: Path, host: str) -> Path:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        (folder / host).mkdir(mode=0o700, exist_ok=True)
        return folder / host

    def share(self, host: str, *files: Path) -> None:
        """Let the machine of a host have private files of the run, by the same paths."""
        if (machine := self.places.get(host)) is not None:
            for file in files:
                machine.put(file, file.read_bytes())

    def clocks_ahead_s(self) -> dict[str, float]:
        """Measure how far the clocks of hosts on other machines are ahead."""
        ahead_s = {machine: machine.clock_offset().offset_s for machine in self.machines}
        return {host: ahead_s[machine] for host, machine in self.places.items()}

    def private_file(self, name: str) -> Path:
        """Return the path of a file beside the logs that only its owner can read.

        It is empty when it is first asked for: an earlier network may have had the same folder.
        """
        file = self.begun_anew(name)
        file.touch(mode=0o600)
        file.chmod(0o600)
        return file

    def begun_anew(self, name: str) -> Path:
        """Return the path of a file beside the logs that is not there when it is first asked for.

        Its program makes it, and may want to write over none.
        """
        file = self.logs / name
        if name not in self._begun:
            self._begun.add(name)
            file.unlink(missing_ok=True)
        return file

    def own_folder(self, name: str) -> Path:
        """Return the part of the private folder that people on a host are shown."""
        folder = self.folder / name
        folder.mkdir(mode=0o700, exist_ok=True)
        return folder

    def written_folder(self, host: str) -> Path:
        """Return the part of the private folder that people on a host can write to.

        Nothing of ours follows links there.
        """
        folder = self.folder / "written" / host
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        return folder

    def socket(self, name: str) -> str:
        """Return the path of a Unix socket (they cross network namespaces)."""
        folder = self.own_folder(name) if name in self.devices else self.folder
        return str(folder / f"{name}.sock")

    def program(self, name: str) -> Program:
        program = Program(name, self.private_file(f"{name}.log"))
        self.programs.append(program)
        return program

    def daemon(self, name: str) -> Program:
        """Return a new program that its starter watches and ends."""
        return Program(name, self.private_file(f"{name}.log"))

    def forks(self) -> ForkServer:
        """Return what forks programs off; the first time, it begins to load what they need."""
        with self._making:
            if self.fork_server is None:
                self.fork_server = ForkServer(self.program("fork-server"))
            return self.fork_server

    def remove(self) -> None:
        """Remove the private folder with its tokens and sockets, and cables that nobody took."""
        if self.fork_server is not None:
            self.fork_server.close()
        for cable in self.cables:
            os.close(cable.a_fd)
            os.close(cable.b_fd)
        self.cables.clear()
        deadline = time.monotonic() + END_TIMEOUT_S
        while self.folder.exists() and time.monotonic() < deadline:
            shutil.rmtree(self.folder, ignore_errors=True)  # what ends just now may make a file


def loopback_listener(addresses: dict[str, str], name: str) -> socket.socket:
    """Return a socket on the machine's loopback for a program, and note its address.

    A program that is started again keeps its address.
    """
    port = addresses.get(name, ":0").rpartition(":")[2]
    listener = machine_listener("127.0.0.1", int(port))
    addresses[name] = f"127.0.0.1:{listener.getsockname()[1]}"
    return listener


def free_port(count: int = 1) -> int:
    """Return the first of `count` unused loopback TCP ports in a row.

    Where it can be, the kernel gives none of them to connections, so that they stay free until
    somebody listens. Raise NetworkError if there are none.
    """
    ephemeral = int(EPHEMERAL_PORTS.read_text().split()[0])
    limit = (ephemeral if ephemeral > FIRST_PORT + ATTEMPTS else 1 << 16) - count
    for _ in range(ATTEMPTS):
        first = FIRST_PORT + secrets.randbelow(limit - FIRST_PORT)
        try:
            with ExitStack() as probes:
                for port in range(first, first + count):
                    probes.enter_context(socket.create_server(("127.0.0.1", port)))
        except OSError:
            continue
        return first
    raise NetworkError(
        f"{ATTEMPTS} TCP ports of 127.0.0.1 from {FIRST_PORT} to {limit} were in use; end what "
        f"uses them, or see {EPHEMERAL_PORTS}"
    )


NONE_RUNS = "no network runs on this machine: start one, for example by `qmn cli sdc`"


def folders_of_running(root: Path | None = None) -> list[Path]:
    """Return the private folders of runs that run now; in own namespaces none other are there."""
    paths = (root or RUNTIME_ROOT).glob("*")
    runs = ((path, from_words(path.name)) for path in paths)
    return sorted(path for path, run in runs if run and (are_own() or run.alive))


def folders_of_gone(root: Path | None = None) -> list[Path]:
    paths = (root or RUNTIME_ROOT).glob("*")
    return sorted(path for path in paths if gone(path.name) and path.is_dir())


_current: Runtime | None = None


def current() -> Runtime:
    """Return the network that nodes are being made for; `mn` begins it by using it."""
    if _current is not None:
        return _current
    for left in folders_of_gone():
        shutil.rmtree(left)
    runtime = begin(Runtime())
    atexit.register(runtime.remove)
    return runtime


def begin(runtime: Runtime) -> Runtime:
    """Let the nodes that are made from now on belong to this network."""
    global _current
    _current = runtime
    return runtime
