"""Models that labs compute by themselves, beside enumerations and sums of their own."""

from itertools import pairwise
from math import exp, factorial
from typing import Any

import pytest

from qmn.labs import catalogue
from qmn.network import custom_topology


def globals_of(lab: str) -> dict[str, Any]:
    """Return what the module of a lab has."""
    found: dict[str, Any] = catalogue.lab(lab).findings.__globals__
    return found


def poisson(mean: float, count: int) -> float:
    return exp(-mean) * mean**count / factorial(count)


@pytest.mark.parametrize("light", [0.001, 0.05, 0.3])
def test_the_visibility_of_a_bright_source_is_that_of_all_ways_to_click(light: float) -> None:
    """Photons of other pairs in the right detector and in the wrong one, and the own partner."""
    own = globals_of("city-fibre")
    right = wrong = 0.0
    for others_right in range(20):
        for others_wrong in range(20):
            for partner, chance in ((1, own["NEAR"]), (0, 1 - own["NEAR"])):
                p = poisson(light, others_right) * poisson(light, others_wrong) * chance
                clicks = bool(others_right + partner), bool(others_wrong)
                right += p * {(True, False): 1.0, (True, True): 0.5}.get(clicks, 0.0)
                wrong += p * {(False, True): 1.0, (True, True): 0.5}.get(clicks, 0.0)
    assert own["visibility"](light) == pytest.approx((right - wrong) / (right + wrong), rel=1e-9)


def test_the_light_of_a_rate_makes_the_published_bound_at_the_brightest() -> None:
    own = globals_of("city-fibre")
    assert own["lower"](5e5) == pytest.approx(0.84, abs=1e-9)
    assert own["light"](2e5) == pytest.approx(0.4 * own["light"](5e5))


def loss_db(topo: Any, ways: list[str]) -> float:
    """Return the loss of a way, in fibres and in the switches between them."""
    fibers = [topo.linkInfo(*ends).get("connectors_db", 0.0) for ends in pairwise(ways)]
    switches = [topo.nodeInfo(name)["insertion_loss_db"] for name in ways if name[0] == "q"]
    return float(sum(fibers) + sum(switches))


@pytest.mark.parametrize(
    ("way", "published"),
    [
        ("q1 alice", 7.25),
        ("q1 avery", 8.51),
        ("q1 q2 bailey", 16.6),
        ("q1 q3 charlie", 17.2),
        ("q1 q2 q3 charlie", 27.5),
        ("q1 q3 q2 bailey", 28.0),
    ],
)
def test_ways_over_the_campus_lose_what_the_paper_says(way: str, published: float) -> None:
    topo = custom_topology.load(f"{catalogue.LABS}/recovery/campus.py:Campus", {})()
    assert loss_db(topo, ["source", *way.split()]) == pytest.approx(published)


def test_light_of_all_channels_makes_the_fidelity_of_the_pair_that_it_is_fitted_to() -> None:
    """F = 0.765 of alice and bailey, by the formula above for what comes to alice of her light."""
    said = catalogue.lab("recovery").runs["wide"].split()
    (mean,) = (float(each.rpartition("=")[2]) for each in said if "mean_pairs" in each)
    comes = 10**-0.725
    others = mean * comes / 2
    visible = comes * exp(-others) / (1 - (1 - comes) * exp(-2 * others))
    assert (1 + 3 * visible) / 4 == pytest.approx(0.765, abs=1e-4)
