"""GHZ states of three hosts over fibres that depolarise."""

from pathlib import Path

from fabric_scene import NOISE, served
from loaded import run_qmn

from topologies.networks.network import Network


def test_the_fidelity_of_ghz_states_is_that_of_theory(noisy_network: Network) -> None:
    """Each half passes two fibres; all are equal in Z with (1 - p/2)^2, coherent with (1 - p)^2."""
    line = ("alice", "bob", "charlie")
    told = served(noisy_network, "ghz", *line, line=",".join(line), count=20_000)
    p = 1 - (1 - NOISE) ** 2
    expected = ((1 - p / 2) ** 2 + (1 - p) ** 2) / 2
    assert told["states"] >= 20_000
    assert abs(told["fidelity"] - expected) < 5 * told["fidelity_error"] < 0.015


def test_a_host_that_is_not_there_is_named_before_anything_starts(tmp_path: Path) -> None:
    done = run_qmn("run", "ghz", "--line", "alice,bob,zoe", "--runs", str(tmp_path))
    assert done.returncode != 0
    assert "zoe" in done.stdout + done.stderr
