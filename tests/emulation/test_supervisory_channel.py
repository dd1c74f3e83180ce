"""Packets at a quantum switch: LLDP alone on a fibre, ordinary traffic on its copper."""

import select
import socket
import time
from collections import Counter
from pathlib import Path

from topologies.network import Network, Signals
from topologies.runtime import Runtime
from topologies.sdc import SdcTopo

LISTENING_S = 7.0  # longer than the pause between two announcements
LLDP = 0x88CC


def test_nothing_but_lldp_passes_a_fibre(tmp_path: Path) -> None:
    everything = socket.htons(0x0003)
    with (
        socket.socket(socket.AF_PACKET, socket.SOCK_RAW, everything) as listener,
        Signals() as signals,
        Network(SdcTopo, Runtime(log_folder=tmp_path), signals) as network,
    ):
        fibers = {name for name in network.net.get("q1").intfNames() if name != "lo"}
        fibers -= {"q1-eth1"}  # copper to s1
        heard: Counter[int] = Counter()
        end = time.monotonic() + LISTENING_S
        while (left := end - time.monotonic()) > 0:
            if select.select([listener], [], [], left)[0]:
                frame, address = listener.recvfrom(2048)
                heard[int.from_bytes(frame[12:14], "big")] += address[0] in fibers
        assert len(fibers) == 5
        assert {kind for kind, count in heard.items() if count} == {LLDP}


def test_quantum_switch_forwards_its_own_classical_traffic(network: Network) -> None:
    alice, q1 = network.net.get("alice", "q1")
    q1.cmd("ip address add 10.0.0.9/24 dev q1")
    try:
        assert " 0% packet loss" in alice.cmd("ping -c 3 -W 2 10.0.0.9")
    finally:
        q1.cmd("ip address del 10.0.0.9/24 dev q1")
    entries = q1.cmd("ovs-ofctl -O OpenFlow14 dump-flows q1")
    assert "priority=1,in_port=LOCAL actions=goto_table:1" in entries
