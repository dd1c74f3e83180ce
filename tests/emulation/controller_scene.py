"""The controller as a program between two real bridges: one classical, one quantum."""

import json
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from conftest import open_vswitch
from limits import SOON_S, wait_until
from loaded import forks
from scapy.contrib.lldp import (
    LLDPDUChassisID,
    LLDPDUEndOfLLDPDU,
    LLDPDUManagementAddress,
    LLDPDUPortID,
    LLDPDUTimeToLive,
)
from scapy.layers.inet import IP, TCP
from scapy.layers.l2 import Ether

from topologies.system.processes.programs import python
from topologies.system.runs.runtime import free_port
from wire.config import ControllerConfig
from wire.metadata.decoding import decode
from wire.metadata.header import METADATA_PORT, session_number
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Handshake, Service

CLASSICAL, QUANTUM = "cat-s1", "cat-q1"
DEADLINE_S = SOON_S
HOSTS = {"alice": "10.0.0.1", "bob": "10.0.0.2", "charlie": "10.0.0.3"}
FIBERS = ["alice-q0", "bob-q0", "bob-q1", "charlie-q0", "charlie-q1"]
MACS = {"alice": "02:00:00:00:00:01", "bob": "02:00:00:00:00:02"}
SESSION = session_number(HOSTS["alice"], 1)


def run(*command: str) -> str:
    return subprocess.run(
        command, check=True, capture_output=True, text=True, timeout=SOON_S
    ).stdout


def flows(bridge: str) -> str:
    return run("ovs-ofctl", "-O", "OpenFlow14", "dump-flows", bridge)


class Wire:
    """A veth pair: one end is a port of a bridge, packets go in and come out at the other."""

    def __init__(self, bridge: str, name: str, number: int) -> None:
        self.name, self.outer = f"cat{number}a", f"cat{number}b"
        self.node = name
        run("ip", "link", "add", self.name, "type", "veth", "peer", "name", self.outer)
        for end in (self.name, self.outer):
            Path(f"/proc/sys/net/ipv6/conf/{end}/disable_ipv6").write_text("1")
            run("ip", "link", "set", end, "up")
        run("ovs-vsctl", "add-port", bridge, self.name, "--", "set", "interface", self.name,
            f"ofport_request={number}")  # fmt: skip
        self.socket = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(3))
        self.socket.bind((self.outer, 0))

    def send(self, frame: object) -> None:
        self.socket.send(bytes(frame))  # type: ignore[call-overload]

    def receive(self, wanted: Callable[[Ether], bool]) -> Ether:
        deadline = time.monotonic() + DEADLINE_S
        while (left := deadline - time.monotonic()) > 0:
            self.socket.settimeout(left)
            packet = Ether(self.socket.recv(65535))
            if wanted(packet):
                return packet
        raise AssertionError(f"{self.node} did not get the packet within {DEADLINE_S} s")

    def close(self) -> None:
        self.socket.close()
        run("ip", "link", "del", self.name)


@contextmanager
def two_bridges() -> Iterator[dict[str, Wire]]:
    """Make both bridges and all wires; remove exactly these afterwards."""
    with open_vswitch():
        yield from _two_bridges()


def _two_bridges() -> Iterator[dict[str, Wire]]:
    wires: dict[str, Wire] = {}
    try:
        for bridge, dpid in ((CLASSICAL, 1), (QUANTUM, 2)):
            run("ovs-vsctl", "add-br", bridge, "--", "set", "bridge", bridge,
                "datapath_type=netdev", "protocols=OpenFlow14", "fail_mode=secure",
                f"other-config:datapath-id={dpid:016x}")  # fmt: skip
        for number, name in enumerate(("alice", "bob"), 1):
            wires[name] = Wire(CLASSICAL, name, number)
        for number, name in enumerate(FIBERS, 3):
            wires[name] = Wire(QUANTUM, name, number)
        yield wires
    finally:
        for wire in wires.values():
            wire.close()
        for bridge in (CLASSICAL, QUANTUM):
            run("ovs-vsctl", "--if-exists", "del-br", bridge)


class Controller:
    """The program under test."""

    def __init__(self, framework: str, folder: Path, port: int = 0) -> None:
        self.framework = framework
        self.record_path = folder / "record.jsonl"
        self.port = port or free_port()
        config = ControllerConfig(
            f"127.0.0.1:{self.port}", framework, {"q1": 2}, record=str(self.record_path)
        )
        config.write(folder / "config.json")
        self.log = (folder / "log").open("w+")
        command = [python(), "-m", "controller_apps", "--config", str(folder / "config.json")]
        self.process = forks().begin("c0", [*command, "--framework", framework], self.log)
        assert self.process.stdout.readline() == "ready\n"

    def record(self, event: str) -> list[dict[str, object]]:
        lines = [json.loads(line) for line in self.record_path.read_text().splitlines()]
        return [line for line in lines if line["event"] == event]

    def close(self) -> None:
        self.process.kill()
        self.process.wait(DEADLINE_S)
        self.process.stdout.close()
        self.log.close()

    def log_text(self) -> str:
        return Path(self.log.name).read_text()

    def end(self) -> int:
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(DEADLINE_S)


@contextmanager
def running(framework: str, folder: Path, port: int = 0) -> Iterator[Controller]:
    """Run the program on one of the frameworks, on any port unless one is given."""
    program = Controller(framework, folder, port)
    try:
        yield program
    finally:
        program.close()


def announcement(port: str) -> Ether:
    host = port.partition("-")[0]
    return (
        Ether(dst="01:80:c2:00:00:0e", src="02:00:00:00:01:00")
        / LLDPDUChassisID(subtype=7, id=host)
        / LLDPDUPortID(subtype=7, id=port)
        / LLDPDUTimeToLive(ttl=120)
        / LLDPDUManagementAddress(
            management_address_subtype=1,
            management_address=socket.inet_aton(HOSTS[host]),
            interface_numbering_subtype=1,
        )
        / LLDPDUEndOfLLDPDU()
    )


def between(sender: str, receiver: str, flags: str, sequence: int, payload: bytes = b"") -> Ether:
    tcp = TCP(sport=40000, dport=METADATA_PORT, flags=flags, seq=sequence, ack=1)
    ip = IP(src=HOSTS[sender], dst=HOSTS[receiver])
    return Ether(src=MACS[sender], dst=MACS[receiver]) / ip / tcp / payload


def connect(controller: Controller, quantum_port: int = 0) -> None:
    """Point both bridges at the controller, the quantum one at another port if one is given."""
    for bridge, port in ((CLASSICAL, controller.port), (QUANTUM, quantum_port or controller.port)):
        run("ovs-vsctl", "set-controller", bridge, f"tcp:127.0.0.1:{port}")
    wait_until(lambda: len(controller.record("switch")) == 2, "both switches here")
    wait_until(lambda: "tcp_flags" in flows(CLASSICAL) and "0x88cc" in flows(QUANTUM), "entries")


def discover(controller: Controller, wires: dict[str, Wire]) -> None:
    """Let hosts announce their fibres."""
    for name in FIBERS:
        wires[name].send(announcement(name))
    wait_until(lambda: len(controller.record("fiber")) == len(FIBERS), "fibres discovered")


def set_up(controller: Controller, wires: dict[str, Wire]) -> Setup:
    """Let hosts announce their fibres, send one set-up from alice, return what bob receives."""
    discover(controller, wires)
    wires["bob"].send(Ether(src=MACS["bob"], dst="ff:ff:ff:ff:ff:ff", type=0x9999) / b"here")
    wires["alice"].receive(lambda packet: packet.type == 0x9999)
    # As if bob had answered her SYN: she begins at 100, he at 1.
    accepting = between("bob", "alice", "SA", 0)
    accepting[TCP].sport, accepting[TCP].dport, accepting[TCP].ack = METADATA_PORT, 40000, 100
    wires["bob"].send(accepting)
    wires["alice"].receive(lambda packet: TCP in packet)
    setup = Setup(SESSION, Service.SDC, Handshake.FRAMED, HOSTS["charlie"], 1000, 100, 1_000_000)
    wires["alice"].send(between("alice", "bob", "PA", 100, setup.encode()))
    arrived = wires["bob"].receive(lambda packet: TCP in packet and bool(packet[TCP].payload))
    recomputed = Ether(bytes(arrived))
    del recomputed[IP].chksum, recomputed[TCP].chksum
    assert bytes(recomputed) == bytes(arrived)
    answer = decode(bytes(arrived[TCP].payload))
    assert isinstance(answer, Setup)
    return answer
