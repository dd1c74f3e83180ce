"""The shapes that ship: which node is joined to which by how many fibres."""

from collections import Counter

import pytest
from mininet.topo import Topo

from topologies.chain import ChainTopo
from topologies.leaf_spine import LeafSpineTopo
from topologies.links.fiber import FiberLink
from topologies.repeaters import RepeatersTopo
from topologies.ring import RingTopo
from topologies.sdc import SdcTopo
from topologies.tapped import TappedTopo


def fibers(topo: Topo) -> Counter[str]:
    """Return how many fibres join each two nodes."""
    links = topo.links(withInfo=True)
    return Counter(
        " ".join(sorted((one, other))) for one, other, info in links if info.get("cls") is FiberLink
    )


def test_one_switch_joins_all_hosts() -> None:
    assert fibers(SdcTopo()) == {"alice q1": 1, "bob q1": 2, "charlie q1": 2}


def test_eve_has_two_fibres_of_her_own() -> None:
    assert fibers(TappedTopo()) == {**fibers(SdcTopo()), "eve q1": 2}


def test_a_chain_has_its_sender_and_receiver_at_the_ends() -> None:
    hosts = {"alice q1": 1, "bob q4": 2, "charlie q2": 2}
    assert fibers(ChainTopo(switches=4)) == {**hosts, "q1 q2": 2, "q2 q3": 2, "q3 q4": 2}
    assert fibers(ChainTopo(switches=1)) == fibers(SdcTopo())


def test_a_ring_is_closed() -> None:
    hosts = {"alice q1": 1, "bob q3": 2, "charlie q2": 2}
    joined = {"q1 q2": 3, "q2 q3": 3, "q1 q3": 3}
    assert fibers(RingTopo(switches=3, fibers=3)) == {**hosts, **joined}


def test_every_leaf_is_joined_to_every_spine() -> None:
    hosts = {"alice q1": 1, "bob q2": 2, "charlie q1": 2}
    joined = {"q1 q3": 1, "q1 q4": 1, "q2 q3": 1, "q2 q4": 1}
    assert fibers(LeafSpineTopo(leaves=2, spines=2)) == {**hosts, **joined}


def test_every_two_neighbours_of_a_chain_of_repeaters_have_a_switch_of_their_own() -> None:
    joined = {"alice q1": 1, "q1 r1": 1, "q2 r1": 1, "q2 r2": 1, "q3 r2": 1, "bob q3": 1}
    assert fibers(RepeatersTopo(repeaters=2)) == joined
    assert "charlie" not in RepeatersTopo().hosts()
    for count in (0, 65):
        with pytest.raises(ValueError, match=f"{count} repeaters: choose 1 to 64"):
            RepeatersTopo(repeaters=count)


@pytest.mark.parametrize(
    "topo", [SdcTopo, ChainTopo, RingTopo, LeafSpineTopo, RepeatersTopo, TappedTopo]
)
def test_everything_has_copper_and_a_datapath_id_of_its_own(topo: type[Topo]) -> None:
    built = topo(length_km=3.0)
    copper = {other for pair in built.links() if "s1" in pair for other in pair} - {"s1"}
    assert copper == {*built.hosts(), *built.switches()} - {"s1"}
    dpids = [built.nodeInfo(name)["cls"].dpid_of(name) for name in built.switches()]
    assert len(set(dpids)) == len(dpids)
    lengths = {
        info["length_km"] for *_, info in built.links(withInfo=True) if info["cls"] is FiberLink
    }
    assert lengths == {3.0}


def test_no_fibre_at_all_is_refused() -> None:
    with pytest.raises(ValueError, match="0 fibres between q1 and q2: choose 1 or more"):
        ChainTopo(switches=2, fibers=0)
