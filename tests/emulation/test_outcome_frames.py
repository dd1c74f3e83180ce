"""When a switch's outcomes come to hosts, over copper: no earlier than light of the same moment.

    alice --- 20 km --- q1 --- 50 km --- bob      fibres
                        |
                      5 km of copper
                        |
    alice --- 20 km --- s1 --- 50 km --- bob      copper, by itself as long as the fibres

In stepped time instants are exact. tcpdump sees frames on the hosts' own interfaces.
"""

import re
from pathlib import Path

import numpy as np
import pytest
from loaded import run_qmn
from numpy.typing import NDArray

from wire.leaps import LeapingClock
from wire.pcapng import PcapReader

KM, TO_S1_KM = {"alice": 20.0, "bob": 50.0}, 5.0
M_PER_S = 299_792_458 / 1.468  # of light in a fibre, which is 0.1 % slower here: 2.04e8
PULSES, FRAMES = 8000, 3  # of a block, whose outcomes are 2,944 to a frame
SCRIPT = f"""
import sys

from qmn.scripting import start
from topologies.links.copper_link import CopperLink
from topologies.nodes import ClassicalSwitch, OpticalSwitch, QuantumHost
from topologies.quantum_topo import QuantumTopo

class Uneven(QuantumTopo):
    def build(self):
        self.addSwitch("s1", cls=ClassicalSwitch)
        self.addSwitch("q1", cls=OpticalSwitch, analysers=1, memories=2)
        self.addLink("s1", "q1", cls=CopperLink, length_km={TO_S1_KM})
        for host, km in {KM}.items():
            self.addHost(host, cls=QuantumHost, source=True)
            self.addLink(host, "s1")
            self.addFibers(host, "q1", 1, length_km=km, loss_db_per_km=0)

with start(Uneven, time="stepped", folder=sys.argv[1]) as network:
    for host in {[*KM]}:
        node = network.net.get(host)
        interface = node.defaultIntf().name
        network.captures.begin(host, interface, "ether", "proto", "0x88b5", inside=node.pid)
    network.captures.wait()
    network.swap(count=2 * {PULSES}, block_pairs={PULSES})
"""


def test_outcomes_come_to_hosts_no_earlier_than_light_does(tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(SCRIPT)
    run = tmp_path / "run"
    done = run_qmn("script", str(tmp_path / "script.py"), str(run))
    assert not done.returncode, done.stdout + done.stderr
    line = rf"^(\S+)Z q1-analyser1 bell-measure .*photons={PULSES} "
    found = re.findall(line, (run / "quantum.log").read_text(), re.MULTILINE)
    measured_ns = np.array(found, "datetime64[ns]").astype(np.int64)
    assert measured_ns.size >= 2
    for host, km in KM.items():
        came_ns = arrivals_ns(run, host)[: FRAMES * measured_ns.size].reshape(-1, FRAMES)
        took_s = (came_ns - measured_ns[:, np.newaxis]) / 1e9
        assert took_s.min() >= km * 1e3 / M_PER_S
        assert took_s == pytest.approx((TO_S1_KM + km) * 1e3 / M_PER_S, rel=2e-3)


def arrivals_ns(run: Path, host: str) -> NDArray[np.int64]:
    """Return when frames of outcomes came to a host, in the network's time."""
    with (run / f"{host}.pcap").open("rb") as file:
        capture = PcapReader(file)
        clock = LeapingClock(run).of(capture)
        return np.array([clock(packet.time_ns) for packet in capture.packets()])
