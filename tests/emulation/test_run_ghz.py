"""GHZ states of three hosts over fibres that depolarise."""

from fabric_scene import NOISE, served

from topologies.networks.network import Network


def test_the_fidelity_of_ghz_states_is_that_of_theory(noisy_network: Network) -> None:
    """Each half passes two fibres; all are equal in Z with (1 - p/2)^2, coherent with (1 - p)^2."""
    line = ("alice", "bob", "charlie")
    report = served(noisy_network, "ghz", *line, line=",".join(line), count=20_000)
    p = 1 - (1 - NOISE) ** 2
    expected = ((1 - p / 2) ** 2 + (1 - p) ** 2) / 2
    assert report["states"] >= 20_000
    assert abs(report["fidelity"] - expected) < 5 * report["fidelity_error"] < 0.015
