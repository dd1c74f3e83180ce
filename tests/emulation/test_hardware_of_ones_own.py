"""Hardware that a topology names: a QNIC class of a user's own, and an instrument that switches."""

import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from conftest import ROOT
from mininet.topo import Topo

from qmn.scripting import start
from topologies.links.fiber import FiberLink
from topologies.nodes import ClassicalSwitch, DispatcherHost, OpticalSwitch, QuantumHost

INSTRUMENT = ROOT / "tests" / "unit" / "applications" / "scpi_instrument.py"
COUNTING = '''
"""A QNIC that writes down how many photons it modulates."""

from pathlib import Path

from hosts.hardware.simulated import SimulatedQnic


class CountingQnic(SimulatedQnic):
    def __init__(self, dispatcher, token, ports, file):
        super().__init__(dispatcher, token, ports)
        self._file = Path(file)

    async def perform(self, *order):
        with self._file.open("a") as file:
            for step in order:
                if step.HasField("apply"):
                    print(4 * len(step.apply.dibits), file=file)
        return await super().perform(*order)
'''


class OneSwitch(Topo):  # type: ignore[misc]  # Mininet has no types
    """alice with one fibre to q1, bob and charlie with two, whose hardware is of any kind."""

    def build(self, alice: dict[str, Any] | None = None, q1: dict[str, Any] | None = None) -> None:
        """Lay copper first: q1's port 1 is copper, 2 alice's, 3 and 4 bob's, 5 and 6 charlie's."""
        self.addSwitch("s1", cls=ClassicalSwitch, dpid="1")
        self.addSwitch("q1", cls=OpticalSwitch, dpid="1001", **(q1 or {}))
        self.addHost("alice", cls=QuantumHost, ip="10.0.0.1/24", **(alice or {}))
        self.addHost("bob", cls=QuantumHost, ip="10.0.0.2/24")
        self.addHost("charlie", cls=QuantumHost, ip="10.0.0.3/24", source=True)
        self.addHost("ed", cls=DispatcherHost, ip="10.0.0.4/24")
        for node in ("q1", "alice", "bob", "charlie", "ed"):
            self.addLink(node, "s1")
        for host in ("alice", "bob", "bob", "charlie", "charlie"):
            self.addLink(host, "q1", cls=FiberLink)


def test_a_qnic_of_ones_own_does_what_the_host_does_with_light(tmp_path: Path) -> None:
    (tmp_path / "counting.py").write_text(COUNTING)
    counts = tmp_path / "counts"
    alice = {
        "qnic": f"{tmp_path}/counting.py:CountingQnic",
        "qnic_parameters": {"file": str(counts)},
    }
    with start(lambda: OneSwitch(alice=alice)) as network:
        assert network.send("alice", "bob", bytes(range(256))).data == bytes(range(256))
    # Two bits a pair: 256 bytes are 1024 pairs, of which nothing is lost here.
    assert counts.read_text().splitlines() == ["1024"]


@contextmanager
def instrument() -> Iterator[int]:
    """Run an instrument that switches; its TCP port."""
    command = [sys.executable, str(INSTRUMENT), "--size", "8"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout
            yield int(process.stdout.readline())
        finally:
            process.kill()


def ask(port: int, query: str) -> str:
    """Ask the instrument."""
    with socket.create_connection(("127.0.0.1", port), timeout=10) as connection:
        connection.sendall(f"{query}\n".encode())
        return connection.makefile().readline().strip()


def test_a_switch_that_a_topology_names_is_driven_by_scpi() -> None:
    with instrument() as port:
        numbers = {fiber: [fiber - 1, fiber + 7] for fiber in range(2, 7)}  # ingress, egress
        q1 = {"hardware": f"scpi://127.0.0.1:{port}", "hardware_ports": numbers}
        with start(lambda: OneSwitch(q1=q1)) as network:
            paths = network.trace("alice", "bob")
            added = ask(port, ":test:log?").split("|")[0]
    assert len(paths) == 3
    # Superdense coding (wire/services.py): alice -> bob's second, charlie's first -> alice,
    # charlie's second -> bob's first; ports 2 -> 4, 5 -> 2, 6 -> 3 of q1.
    assert added == "add (@1,4,5),(@11,9,10)"
