"""Codes and three symbols over the real components."""

import json
from pathlib import Path
from typing import Any

import pytest
from conftest import qmn, wait_until
from fabric_scene import running, session
from limits import SOON_S
from loaded import run_qmn

from topologies.networks.network import Network
from topologies.sdc import SdcTopo
from wire.metadata.vocabulary import Fec
from wire.outcomes import Pauli
from wire.parameters.physics import BellAnalyser


class LinearTopo(SdcTopo):
    """bob's Bell analyser is linear optics, behind a switch whose every path flips."""

    def build(self, **fiber: Any) -> None:
        """Change what hosts and switch are like."""
        super().build(**fiber)
        self.nodeInfo("bob")["analyser"] = BellAnalyser("linear")
        self.nodeInfo("q1")["rotation"] = Pauli.X


def change(*words: str) -> str:
    """Run `qmn set host`; return what it prints."""
    done = run_qmn("set", "host", *words, timeout_s=SOON_S)
    return done.stdout + done.stderr


def send(network: Network, data: bytes) -> dict[str, Any]:
    """Send from alice to bob; return what the session has used."""
    with session(network, "alice", "bob") as opened:
        assert opened.carry(data) == data
        opened.end()
        return opened.summary


@pytest.mark.nightly
def test_a_noisy_network_delivers_by_an_interleaved_code(tmp_path: Path) -> None:
    message = "A noisy channel can be met by a code. " * 20
    coding = ["--fec", "golay", "--interleave", "--frame-bytes", "16"]
    done = qmn("--message", message, "--depolarizing", "0.02", *coding, runs=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    result = json.loads((tmp_path / "latest" / "result.json").read_text())
    assert (tmp_path / "latest" / "received").read_text() == message
    report = result["job"]["asking"]
    assert (report["fec"], report["interleave"]) == (Fec.GOLAY, 1)
    assert report["corrected_symbols"] > 100
    frames = -(-len(message) // 16)
    assert report["repeated_frames"] < frames  # without a code nearly every try fails
    assert "golay, interleaved, rate 0.5" in done.stdout


@pytest.mark.nightly
def test_linear_optics_carries_eleven_bits_in_seven_pairs_and_codes_too(tmp_path: Path) -> None:
    data = bytes(range(220))
    with running(LinearTopo, tmp_path) as network:
        plain = send(network, data)
        assert (plain["symbols"], plain["bell_pairs"]) == (3, 160 * 7)
        wait_until(lambda: "fec golay" in change("alice", "fec", "golay"), "alice is set")
        assert change("alice", "interleave", "on") == (
            "alice: overridden in new sessions: fec golay, interleave on\n"
        )
        coded = send(network, data)
        assert (coded["fec"], coded["interleave"]) == (Fec.GOLAY, 1)
        code_bits = -(-8 * len(data) // 12) * 23
        assert coded["bell_pairs"] == -(-code_bits // 11) * 7
        assert plain["repeated_frames"] == coded["repeated_frames"] == 0
