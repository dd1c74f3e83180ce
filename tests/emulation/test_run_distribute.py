"""`qmn run distribute` from outside, over the real components."""

import json
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

from loaded import run_qmn
from scapy.layers.inet import IP, TCP
from scapy.utils import PcapReader

from wire.metadata.decoding import decode
from wire.metadata.header import MAGIC, METADATA_PORT, VERSION
from wire.metadata.setup import SETUP_LENGTH, Setup
from wire.metadata.vocabulary import Service, Verdict

BEGIN = MAGIC.to_bytes(2, "big") + bytes([VERSION, Setup.KIND])


def run(runs: Path, *options: str) -> "subprocess.CompletedProcess[str]":
    """Run it to its end."""
    return run_qmn("run", "distribute", "--without", "report", "--runs", str(runs), *options)


def test_alice_and_bob_hold_purified_pairs_of_charlie(tmp_path: Path) -> None:
    options = ["--count", "1000", "--fidelity", "0.95", "--sample", "0.3"]
    done = run(tmp_path, *options, "--device", "charlie.source.fidelity=0.85")
    assert done.returncode == 0, done.stdout + done.stderr
    result = json.loads((tmp_path / "latest" / "result.json").read_text())
    assert result["delivered"] is True
    alice, bob = result["job"]["asking"], result["job"]["asked"]
    assert alice["pairs"] == bob["pairs"] == 1000
    assert alice["session"] == bob["session"]
    assert alice["rounds"] == bob["rounds"] >= 1
    assert alice["fidelity"] == bob["fidelity"] >= 0.95
    assert alice["pairs_per_s"] > 0
    assert result["path_setup_ms"]["n"] == 1
    printed = re.sub(" +", " ", done.stdout)
    assert "\nresult 1,000 pairs of alice and bob, with fidelity 0.9" in printed
    assert f"\nrounds of purification {alice['rounds']}\n" in printed
    log = (tmp_path / "latest" / "quantum.log").read_text()
    assert " gather " in log
    assert " discard " in log  # of what was delivered, at the end of the session
    granted = [setup for setup in set_ups(result["captures"]) if setup.verdict == Verdict.GRANTED]
    assert {setup.fidelity_ppm for setup in granted} == {950_000}


def set_ups(captures: list[str]) -> Iterator[Setup]:
    """Yield the set-up messages of the service that go to bob."""
    for capture in captures:
        with PcapReader(capture) as packets:
            for packet in packets:
                if TCP not in packet or packet[IP].dst != "10.0.0.2":
                    continue
                payload = bytes(packet[TCP].payload)[:SETUP_LENGTH]
                if packet[TCP].dport != METADATA_PORT or not payload.startswith(BEGIN):
                    continue
                setup = decode(payload)
                assert isinstance(setup, Setup)
                if setup.service == Service.DISTRIBUTE:
                    yield setup
