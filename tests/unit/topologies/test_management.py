"""Copper to the controller is as long as that from its classical switch to the others."""

from collections.abc import Iterator
from typing import Any

import pytest

from topologies.links.copper_link import CopperLink, delay_s
from topologies.links.management import lengths_to
from topologies.system.runs.runtime import Runtime
from wire.config import QuantumSwitch
from wire.parameters.network import NetworkSettings
from wire.parameters.physics import BadParameter

SWITCHES: dict[str, Any] = dict.fromkeys(("q1", "q2", "s1"))


@pytest.fixture
def network() -> Iterator[Runtime]:
    """s1 with copper to q1 and q2, 10 and 30 km long."""
    made = Runtime()
    for name, length_km in (("q1", 10.0), ("q2", 30.0)):
        made.switches[name] = QuantumSwitch(name)
        made.copper[frozenset((name, "s1"))] = delay_s(length_km)
    yield made
    made.remove()


def test_the_controller_is_at_the_classical_switch(network: Runtime) -> None:
    assert lengths_to(SWITCHES, network) == pytest.approx({"q1": 10.0, "q2": 30.0, "s1": 0.0})


def test_one_length_can_be_said_of_all(network: Runtime) -> None:
    network.settings = NetworkSettings(control_km=500.0)
    assert lengths_to(SWITCHES, network) == {"q1": 500.0, "q2": 500.0, "s1": 500.0}


def test_a_switch_without_copper_has_its_controller_beside_it(network: Runtime) -> None:
    assert lengths_to({"q3": None}, network) == {"q3": 0.0}


@pytest.mark.parametrize(
    ("what", "text"),
    [
        ({"length_km": -1}, "length_km -1: choose 0 to 100000"),
        ({"length_km": "far"}, "length_km 'far'"),
        ({"loss": 1.0}, "loss 1.0 is not 0 to below 1"),
    ],
)
def test_copper_that_cannot_be_is_refused(what: dict[str, Any], text: str) -> None:
    class Named:
        def __init__(self, name: str) -> None:
            self.name = name

    with pytest.raises(BadParameter, match=f"copper alice to s1: {text}"):
        CopperLink(Named("alice"), Named("s1"), **what)
