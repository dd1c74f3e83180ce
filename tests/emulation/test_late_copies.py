"""Copies of set-up messages that come late to a quantum switch, or never: when light is opened.

c0 is as far from a quantum switch as that is from s1: the copy goes there and up to c0, c0's
entries and the barrier's reply there and back. In stepped time figures are exact, as the table of
docs/metadata-at-switch.md has them.
"""

import re
from pathlib import Path

import pytest
from conftest import ROOT
from loaded import run_qmn

from wire.controller_lines import read_record

DELAYS_MS = 0, 1, 5, 20, 100  # of the copper to q1, q2, …
WAYS = 4  # copy, PACKET_IN, entries, barrier's reply
SWITCHING_MS = 1e-4  # of a path, by default
HELD_S = 5.0  # as c0 waits for copies (wire.config.ControllerConfig.hold_timeout_s)
ACKNOWLEDGED_S = 0.2  # within which TCP acknowledges, and what waited for that goes on
SCRIPT = f"""
import sys

from qmn.jobs.transfer import TransferError
from qmn.scripting import start
from topologies.links.copper_link import CopperLink, length_km
from topologies.nodes import ClassicalSwitch, OpticalSwitch, QuantumHost
from topologies.quantum_topo import QuantumTopo

class LateCopies(QuantumTopo):
    def build(self):
        self.addSwitch("s1", cls=ClassicalSwitch)
        self.join("q0", 0, alice=1, charlie=2)
        for number, delay_ms in enumerate({DELAYS_MS}, 1):
            self.join(f"q{{number}}", delay_ms, **{{f"bob{{number}}": 2}})
            self.addFibers("q0", f"q{{number}}", 2)

    def join(self, switch, delay_ms, **hosts):
        self.addSwitch(switch, cls=OpticalSwitch)
        self.addLink("s1", switch, cls=CopperLink, length_km=length_km(delay_ms / 1e3))
        for host, fibers in hosts.items():
            self.addHost(host, cls=QuantumHost, source=host == "charlie")
            self.addLink(host, "s1")
            self.addFibers(host, switch, fibers)

options = {{"metadata_at_switch": "required", "time": "stepped", "folder": sys.argv[1]}}
with start(LateCopies, **options) as network:
    for number in range(1, {len(DELAYS_MS)} + 1):
        network.sleep(1)  # copies for the others have gone the longest way, and are acknowledged
        network.send("alice", f"bob{{number}}", b"late")
    network.net.configLinkStatus("s1", "q1", "down")
    time = network.runtime.time
    began_ns = time.now_ns()
    try:
        network.send("alice", "bob1", b"never")
    except TransferError as error:
        print((time.now_ns() - began_ns) / 1e9, error)
"""


def test_light_is_as_late_as_the_copy_and_refused_by_name_without_one(tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(SCRIPT)
    done = run_qmn("script", str(tmp_path / "script.py"), str(tmp_path / "logs"))
    assert not done.returncode, done.stdout + done.stderr
    facts = read_record(tmp_path / "logs")
    copies = [fact["copies_ms"] for fact in facts if "copies_ms" in fact]
    set_up_ms = [fact["setup_ms"] for fact in facts if fact["event"] == "path_ready"]
    for number, delay_ms in enumerate(DELAYS_MS, 1):
        seen = {"q0": 0.0, f"q{number}": pytest.approx(2 * delay_ms, abs=1e-4)}
        assert copies[number - 1] == seen
    expected_ms = [WAYS * delay_ms + SWITCHING_MS for delay_ms in DELAYS_MS]
    assert set_up_ms == pytest.approx(expected_ms, abs=1e-4)
    refused_s, _space, why = done.stdout.partition(" ")
    assert HELD_S <= float(refused_s) < HELD_S + ACKNOWLEDGED_S
    assert "q1" in why
    page = (ROOT / "docs" / "metadata-at-switch.md").read_text()
    shown = re.findall(r"^\| (\d+) ms \| ([\d.]+) ms \|$", page, re.MULTILINE)
    assert shown == [
        (str(delay), f"{ms:.4f}") for delay, ms in zip(DELAYS_MS, expected_ms, strict=True)
    ]
