"""`qmn netqasm` from outside: applications of NetQASM's SDK, as they are, over real components."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import netqasm.examples.apps
from conftest import ROOT
from scapy.layers.inet import IP, TCP
from scapy.utils import PcapReader

from wire.netqasm.pair_requests import PAIRS_PORT, REQUEST, PairRequest, Use, decode_request

APPS = Path(netqasm.examples.apps.__file__).parent


def run(runs: Path, application: str, *options: str) -> dict[str, Any]:
    """Run an application to its end; return result.json."""
    command = [sys.executable, "-m", "qmn", "netqasm", str(APPS / application)]
    done = subprocess.run(
        [*command, "--runs", str(runs), *options],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=100,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    result: dict[str, Any] = json.loads((runs / "latest" / "result.json").read_text())
    assert result["delivered"] is True
    return result


def asked(captures: list[str]) -> set[PairRequest]:
    """Return what units have asked each other for."""
    found = set()
    for capture in captures:
        with PcapReader(capture) as packets:
            for packet in packets:
                if TCP in packet and packet[TCP].dport == PAIRS_PORT:
                    payload = bytes(packet[TCP].payload)
                    if len(payload) == REQUEST.size:
                        assert packet[IP].dst == "10.0.0.2"
                        found.add(decode_request(payload))
    return found


def test_pairs_are_measured_at_both_ends_of_the_network(tmp_path: Path) -> None:
    """The application measures ten pairs along Y, where the outcomes of Phi+ differ."""
    result = run(tmp_path, "link_layer_md", "--place", "client=alice", "--place", "server=bob")
    told = {}
    for role in ("client", "server"):
        lines = (tmp_path / "latest" / f"netqasm-{role}.log").read_text().splitlines()
        words = f"{role.capitalize()}: "
        told[role] = [int(line[len(words) :]) for line in lines if line.startswith(words)]
    assert len(told["client"]) == 10
    assert [1 - outcome for outcome in told["client"]] == told["server"]
    (request,) = asked(result["captures"])
    assert (request.creator, request.pairs, request.use) == ("alice", 10, Use.MEASURE)
    assert result["path_setup_ms"]["n"] == 1  # light, as the controller grants it
