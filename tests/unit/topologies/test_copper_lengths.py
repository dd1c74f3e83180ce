"""Copper is as long as the fibres between the same places, unless somebody says otherwise."""

import random
from itertools import combinations
from math import inf
from typing import Any

import pytest
from mininet.topo import Topo

from programs.shortest_paths import shortest
from topologies.chain import ChainTopo
from topologies.leaf_spine import LeafSpineTopo
from topologies.links.copper_lengths import assign_copper_lengths, centre
from topologies.links.copper_link import CopperLink
from topologies.links.fiber import FiberLink
from topologies.nodes import ClassicalSwitch, OpticalSwitch, QuantumHost
from topologies.repeaters import RepeatersTopo
from topologies.ring import RingTopo
from topologies.sdc import SdcTopo


def lengths(topo: Topo) -> dict[str, float]:
    """Return the length of each copper link, by its names in order."""
    return {
        " ".join(sorted((one, other))): info["length_km"]
        for one, other, info in topo.links(withInfo=True)
        if info["cls"] is CopperLink
    }


def test_copper_to_the_only_switch_is_as_long_as_its_fibre() -> None:
    found = lengths(SdcTopo(length_km=20.0))
    assert found == {
        "alice s1": 20.0,
        "bob s1": 20.0,
        "charlie s1": 20.0,
        "ed s1": 0.0,
        "q1 s1": 0.0,
    }


def test_a_classical_switch_is_where_the_farthest_is_nearest() -> None:
    """alice -- q1 -- q2 -- q3 -- bob: at q2, as is charlie's fibre."""
    found = lengths(ChainTopo(switches=3, length_km=10.0))
    assert found["alice s1"] == found["bob s1"] == 20.0
    assert found["charlie s1"] == 10.0
    assert (found["q1 s1"], found["q2 s1"], found["q3 s1"]) == (10.0, 0.0, 10.0)


@pytest.mark.parametrize("topo", [SdcTopo, ChainTopo, RingTopo, LeafSpineTopo, RepeatersTopo])
def test_no_way_by_copper_is_shorter_than_that_of_light(topo: Any) -> None:
    laid = topo(length_km=7.0)
    fibers: dict[str, dict[str, float]] = {}
    for one, other, info in laid.links(withInfo=True):
        if info["cls"] is FiberLink:
            fibers.setdefault(one, {})[other] = fibers.setdefault(other, {})[one] = 7.0
    copper = lengths(laid)
    for one, other in combinations([each for each in fibers if f"{each} s1" in copper], 2):
        assert copper[f"{one} s1"] + copper[f"{other} s1"] >= shortest(fibers, one)[other]


def custom(**copper: Any) -> Topo:
    topo = Topo()
    topo.addSwitch("s1", cls=ClassicalSwitch)
    topo.addSwitch("q1", cls=OpticalSwitch)
    for number, name in enumerate(("alice", "bob"), 1):
        topo.addHost(name, cls=QuantumHost, ip=f"10.0.0.{number}/24")
        topo.addLink(name, "s1", **copper)
        topo.addLink(name, "q1", cls=FiberLink, length_km=5.0 * number)
    return topo


def test_fibres_of_different_lengths_and_several_beside_each_other() -> None:
    topo = custom()
    topo.addLink("bob", "q1", cls=FiberLink, length_km=3.0)
    assign_copper_lengths(topo)
    assert lengths(topo) == {"alice s1": 5.0, "bob s1": 3.0}


def test_a_length_that_somebody_names_stays() -> None:
    topo = custom(cls=CopperLink, length_km=400.0)
    assign_copper_lengths(topo)
    assert lengths(topo) == {"alice s1": 400.0, "bob s1": 400.0}


def test_one_length_can_be_said_of_all_copper() -> None:
    topo = SdcTopo(length_km=20.0)
    assign_copper_lengths(topo, 1.5)
    assert set(lengths(topo).values()) == {1.5}


def test_a_network_without_fibres_has_copper_of_no_length() -> None:
    topo = Topo()
    topo.addSwitch("s1", cls=ClassicalSwitch)
    topo.addHost("a")
    topo.addLink("a", "s1")
    assign_copper_lengths(topo)
    assert lengths(topo) == {"a s1": 0.0}


@pytest.mark.by_day(every=3)
@pytest.mark.parametrize("seed", range(30))
def test_the_centre_is_that_of_looking_at_every_place(seed: int) -> None:
    drawn = random.Random(seed)
    names = [f"n{number}" for number in range(drawn.randint(2, 25))]
    fibers: dict[str, dict[str, float]] = {name: {} for name in names}
    for _ in range(drawn.randint(1, 3 * len(names))):  # some fall apart into several
        one, other = drawn.sample(names, 2)
        fibers[one][other] = fibers[other][one] = drawn.choice([0.1, 0.2, 0.3, 1.0])
    wanted = drawn.sample(names, drawn.randint(1, len(names)))

    def farthest(place: str) -> float:
        reached = shortest(fibers, place)
        return max(reached.get(node, inf) for node in wanted)

    found = centre(fibers, wanted)
    assert found is not None
    assert farthest(found) == min(map(farthest, names))
    assert found == min(name for name in names if farthest(name) == farthest(found))
