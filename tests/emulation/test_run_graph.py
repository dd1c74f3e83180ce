"""Graph states of three hosts over fibres that depolarise."""

from typing import Any

from fabric_scene import NOISE, served

from topologies.networks.network import Network

KEPT = (1 - NOISE) ** 2  # of a pair, by the two fibres of a link


def report(network: Network, **options: str) -> dict[str, Any]:
    """Return the result at the host that asks."""
    line = ("alice", "bob", "charlie")
    found = served(network, "graph", *line, line=",".join(line), count=20_000, **options)
    assert found["states"] >= 20_000
    return found


def test_the_fidelity_of_a_ring_is_that_of_theory(noisy_network: Network) -> None:
    """The mean of eight stabilisers: each has what is kept of the edges that it touches.

    The edge between alice and charlie is of two links.
    """
    found = report(noisy_network, graph="ring")
    expected = (1 + 2 * KEPT**3 + KEPT**2 + 4 * KEPT**4) / 8
    assert abs(found["fidelity"] - expected) < 5 * found["fidelity_error"] < 0.02


def test_two_settings_bound_the_fidelity_of_a_line(noisy_network: Network) -> None:
    """Both generators of the ends are +1, and that of bob is, with what their edges have kept."""
    found = report(noisy_network, graph="bob-alice,bob-charlie", witness="colours")
    expected = ((1 + KEPT) / 2) ** 2, (1 + KEPT**2) / 2
    assert len(found["passed"]) == 2
    bound = found["fidelity_at_least"]
    assert abs(bound - (sum(expected) - 1)) < 5 * found["fidelity_error"] < 0.02


def test_a_hub_leaves_a_state_of_the_others(noisy_network: Network) -> None:
    """Of a line of three, a pair of the ends: (1 + 3 k^2)/4, as by a swap of two Werner pairs."""
    found = report(noisy_network, hub="bob")
    assert found["edges"] == 1
    expected = (1 + 3 * KEPT**2) / 4
    assert abs(found["fidelity"] - expected) < 5 * found["fidelity_error"] < 0.02
