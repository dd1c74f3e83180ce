"""Sessions over networks of several quantum switches, and the light paths in their bridges."""

import re
import subprocess
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from queue import SimpleQueue
from typing import Any, ClassVar, TypeVar

from limits import wait_until
from loaded import forks
from mininet.topo import Topo

from hosts.client import blocking_session
from hosts.stack_socket import BYTES
from topologies.chain import ChainTopo
from topologies.networks.network import Network, Signals
from topologies.ring import RingTopo
from topologies.system.processes.programs import python
from topologies.system.runs.runtime import Runtime
from wire.controller_lines import read_record
from wire.parameters.network import NetworkSettings
from wire.parameters.physics import BellAnalyser, Device, Gates, PairSource

TIMEOUT_S = 40.0
SERVICE_PORT = 9
IDEAL = Gates()
NOISE = 0.02  # of each fibre of the noisy network
T = TypeVar("T")


class Standing:
    """A network that all tests share, by its name: in a process there is one at a time."""

    def __init__(self) -> None:
        self._stack = ExitStack()
        self._name = ""
        self._shared: Any = None

    def take(self, name: str, starting: Callable[[], AbstractContextManager[T]]) -> T:
        """Return it; start it if it does not stand, and end another."""
        if self._name != name:
            self.end()
            self._shared = self._stack.enter_context(starting())
            self._name = name
        shared: T = self._shared
        return shared

    def spoil(self) -> None:
        """Let nobody share it any more; it ends before the next test."""
        self._name = "spoilt"

    def end(self) -> None:
        """End what stands."""
        self._name, self._shared = "", None
        self._stack.close()


STANDING = Standing()


class TurningRingTopo(RingTopo):
    """A ring whose switches turn light, what they do to pairs being alike both ways round."""

    ROTATIONS: ClassVar = {"q1": 1, "q2": 2, "q3": 2, "q4": 2}

    def build(self, switches: int = 4, fibers: int = 2, **fiber: float) -> None:
        """Lay the ring."""
        super().build(switches, fibers, **fiber)
        for name, rotation in self.ROTATIONS.items():
            self.setNodeInfo(name, {**self.nodeInfo(name), "rotation": rotation})


class Line(ChainTopo):
    """Switches that swap between alice and bob, who make pairs."""

    def build(
        self,
        switches: int = 2,
        fibers: int = 1,
        *,
        fidelity: float = 1.0,
        noise: Gates = IDEAL,
        **fiber: Any,
    ) -> None:
        """Lay it; q2 swaps by gates with this noise."""
        super().build(switches, fibers, **fiber)
        for host in ("alice", "bob"):
            source = Device(source=PairSource(fidelity=fidelity))
            self.setNodeInfo(host, {**self.nodeInfo(host), "device": source})
        for number in range(1, switches + 1):
            parts = {"analysers": 1, "memories": 2, "sources": 1}
            gates = {"gates": noise, "analyser": BellAnalyser(kind="gates")} if number == 2 else {}
            name = f"q{number}"
            self.setNodeInfo(name, {**self.nodeInfo(name), **parts, **gates})


class Crossing(Line):
    """charlie and dave have fibres of their own, all the way, but no analyser."""

    def build(self, switches: int = 2, fibers: int = 2, **line: Any) -> None:
        """Lay it."""
        super().build(switches, fibers, **line)
        self.add_host("dave", "10.0.0.5")
        self.join("dave", "q2", 1)


@contextmanager
def running(topo: Callable[[], Topo], folder: Path, **settings: Any) -> Iterator[Network]:
    """Run a network in this process; one that stands ends."""
    STANDING.end()
    with started(topo, folder, **settings) as network:
        yield network


@contextmanager
def started(
    topo: Callable[[], Topo], folder: Path, time_scale: float = 1.0, **settings: Any
) -> Iterator[Network]:
    """Run a network in this process where no other is."""
    asked, logs = NetworkSettings(**settings), folder / "run"
    runtime = Runtime(asked, log_folder=logs, fork_server=forks(), time_scale=time_scale)
    with Signals() as signals, Network(topo, runtime, signals) as network:
        yield network


@contextmanager
def restarted_agent(network: Network, switch: str) -> Iterator[None]:
    """Kill a switch's agent; start it again at the end, and wait until c0 hears of the switch."""
    agent, heard = network.net.get(switch).program, len(facts(network, "switch"))
    agent.kill()
    yield
    config = network.runtime.folder / f"{switch}-agent.json"
    agent.start([python(), "-m", "qswitch_agent", "--config", str(config)], forks=forks())
    wait_until(lambda: len(facts(network, "switch")) > heard, f"{switch} is here again")


@contextmanager
def captured(network: Network, interface: str) -> Iterator[Path]:
    """Give the capture of a link of a switch, which ends with this."""
    try:
        files = network.capture(interface.partition("-")[0])
        yield next(file for file in files if file.stem == interface)
    finally:
        network.captures.end()


def light_paths(switch: str) -> dict[int, int]:
    """Return the light entries of a bridge: in_port to out_port."""
    command = ["ovs-ofctl", "-O", "OpenFlow14", "--no-names", "dump-flows", switch]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    found = re.findall(r"priority=100,in_port=(\d+) actions=\S*output:(\d+)", done.stdout)
    return {int(in_port): int(out_port) for in_port, out_port in found}


def facts(network: Network, event: str) -> list[dict[str, object]]:
    """Return what the controller has recorded of one kind."""
    return [fact for fact in read_record(network.runtime.logs) if fact["event"] == event]


def switches_on_the_way(network: Network, interface: str) -> list[str]:
    """Follow the entries of the bridges from a host's fibre on; return the switches passed."""
    far = {}
    for fiber in network.runtime.fibers:
        far[fiber.a.node, fiber.a.port] = fiber.b
        far[fiber.b.node, fiber.b.port] = fiber.a
    end = far[interface.partition("-")[0], interface]
    passed = []
    while end.node in network.runtime.switches:
        passed.append(end.node)
        end = far[end.node, str(light_paths(end.node)[int(end.port)])]
    return [*passed, end.node]


def served(
    network: Network, service: str, opener: str, *hosts: str, **options: Any
) -> dict[str, Any]:
    """Ask the first of these hosts for a service while all take part; return what opener learns."""
    stacks, taking_part = network.runtime.socket, (opener, *hosts)
    options["limit_s"] = TIMEOUT_S
    with blocking_session(stacks, service, taking_part, SERVICE_PORT, **options) as asked:
        asked.results()
        asked.end()
        return asked.summary


class Session:
    """A session between two hosts that carries bytes."""

    def __init__(
        self, network: Network, sender: str, receiver: str, port: int = 7, **options: Any
    ) -> None:
        stacks, ends = network.runtime.socket, (sender, receiver)
        self._received: SimpleQueue[bytes] = SimpleQueue()
        options |= {"take": self._received.put, "limit_s": None}
        self._opening = blocking_session(stacks, BYTES, ends, port, **options)
        self._closing, self._threads = ExitStack(), ThreadPoolExecutor(1)

    def open(self) -> "Session":
        """Connect; raise QuantumSocketError if that is refused."""
        self._session = self._closing.enter_context(self._opening)
        self._session.results()
        return self

    @property
    def summary(self) -> dict[str, Any]:
        """The use of the session so far."""
        return self._session.summary

    def start(self, data: bytes) -> None:
        """Begin to send."""
        self._sending = self._threads.submit(self._session.sendall, data)

    @property
    def sending(self) -> bool:
        """Whether not all that was started has been sent."""
        return not self._sending.done()

    def finish(self, size: int) -> bytes:
        """Receive a number of bytes and wait until the sender has sent them all."""
        received = bytearray()
        while len(received) < size:
            received += self._received.get(timeout=TIMEOUT_S)
        self._sending.result(TIMEOUT_S)
        return bytes(received)

    def carry(self, data: bytes) -> bytes:
        """Send and receive."""
        self.start(data)
        return self.finish(len(data))

    def end(self) -> None:
        """End the session; return when all bytes are verified."""
        self._session.end()

    def close(self) -> None:
        """Leave the session, which is broken off unless it has ended."""
        self._closing.close()
        self._threads.shutdown()


@contextmanager
def session(
    network: Network, sender: str, receiver: str, port: int = 7, **options: Any
) -> Iterator[Session]:
    """Keep a session open."""
    made = Session(network, sender, receiver, port, **options)
    try:
        yield made.open()
    finally:
        made.close()
