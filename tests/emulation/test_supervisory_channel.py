"""Packets at a quantum switch: LLDP alone on a fibre, ordinary traffic on its copper."""

import select
import socket
import time
from collections import Counter
from pathlib import Path

from fabric_scene import running
from mininet.node import Node

from topologies.nodes import ClassicalHost
from topologies.sdc import SdcTopo

LISTENING_S = 7.0  # longer than the pause between two announcements
LLDP = 0x88CC


def test_nothing_but_lldp_passes_a_fibre(tmp_path: Path) -> None:
    everything = socket.htons(0x0003)
    with (
        socket.socket(socket.AF_PACKET, socket.SOCK_RAW, everything) as listener,
        running(SdcTopo, tmp_path) as network,
    ):
        fibers = {name for name in network.net.get("q1").intfNames() if name != "lo"}
        fibers -= {"q1-eth1", "q1-c0"}  # copper to s1 and to the controller
        heard: Counter[int] = Counter()
        end = time.monotonic() + LISTENING_S
        while (left := end - time.monotonic()) > 0:
            if select.select([listener], [], [], left)[0]:
                frame, address = listener.recvfrom(2048)
                heard[int.from_bytes(frame[12:14], "big")] += address[0] in fibers
        assert len(fibers) == 5
        assert {kind for kind, count in heard.items() if count} == {LLDP}


class CopperTopo(SdcTopo):
    """A host without light behind the quantum switch."""

    def build(self, **parameters: float) -> None:
        super().build(**parameters)
        self.addHost("dave", cls=ClassicalHost, ip="10.0.0.5/24")
        self.addLink("dave", "q1")


def test_quantum_switch_forwards_its_own_classical_traffic(tmp_path: Path) -> None:
    with running(CopperTopo, tmp_path) as network:
        dave, q1 = network.net.get("dave", "q1")
        assert " 0% packet loss" in dave.cmd("ping -c 3 -i 0.2 -W 2 10.0.0.1")
        learned = [line for line in flows(q1) if "dl_dst=" in line]
        assert len(learned) == 2
        assert all("in_port" in line and " n_packets=0" not in line for line in learned)


def flows(switch: Node) -> list[str]:
    """Return the entries of a switch's learning table."""
    listing: str = switch.cmd(f"ovs-ofctl -O OpenFlow14 dump-flows {switch} table=2")
    return listing.splitlines()
