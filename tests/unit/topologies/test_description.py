"""The description of a topology, ours or of another author."""

from typing import Any

import pytest
from mininet.node import Host
from mininet.topo import Topo

from topologies.description.content import content_of
from topologies.description.description import describe
from topologies.links.fiber import FiberLink
from topologies.nodes import ClassicalSwitch, DispatcherHost, OpticalSwitch, QuantumHost
from wire.parameters.physics import BadParameter, Device, Memory, PairSource
from wire.parameters.switch import PathOptics, QuantumSwitch


class OwnHost(QuantumHost):
    """A host of a user's own class."""


class OwnTopo(Topo):  # type: ignore[misc]
    """left -- q1 == right, and what has no light."""

    def build(self, **optics: Any) -> None:
        self.addSwitch("s1", cls=ClassicalSwitch)
        self.addHost("ed", cls=DispatcherHost, ip="10.0.0.4/24")
        self.addHost("plain", cls=Host)
        self.addHost("left", cls=OwnHost, ip="10.0.0.1/24", memory=Memory(t2_s=0.5))
        source = PairSource(fidelity=0.9)
        self.addHost("right", cls=QuantumHost, ip="10.0.0.2/24", source=source)
        self.addSwitch("q1", cls=OpticalSwitch, paths=(PathOptics(1, 2, 0.5),), **optics)
        for name in ("ed", "plain", "left", "right", "q1"):
            self.addLink(name, "s1")
        self.addLink("left", "q1", cls=FiberLink, length_km=3.0, kind="smf")
        self.addLink("q1", "right", cls=FiberLink)


def test_hosts_switches_and_fibres_are_as_the_topology_says() -> None:
    found = describe(content_of(OwnTopo(crosstalk_db=40.0)))
    assert found.hosts == {
        "left": Device(memory=Memory(t2_s=0.5)),
        "right": Device(source=PairSource(fidelity=0.9)),
    }
    assert found.sources == ("right",)
    paths = [PathOptics(1, 2, 0.5)]
    assert found.switches == {"q1": QuantumSwitch("q1", crosstalk_db=40.0, paths=paths)}
    first, second = found.fibers
    assert ({first.a, first.b}, {second.a, second.b}) == ({"left", "q1"}, {"q1", "right"})
    assert first.optics.loss_db == pytest.approx(3.0 * 0.2)  # G.652.D has .2 dB/km
    assert second.optics.length_km == 0.01


def test_a_switch_that_cannot_be_is_refused() -> None:
    with pytest.raises(BadParameter, match="q1: rotation 7: choose 0 to 3"):
        describe(content_of(OwnTopo(rotation=7)))
