"""The classical network that a topology does not spell out, and has all the same."""

from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest
from mininet.node import Host
from mininet.topo import Topo

from applications.keys.key_managers import CERTIFICATES
from topologies.description.checked_graph import checked
from topologies.description.checks import check_clashes
from topologies.description.content import content_of
from topologies.links.fiber import FiberLink
from topologies.networks.requirements import FIRST_CONTROLLER
from topologies.nodes import (
    ClassicalHost,
    ClassicalSwitch,
    DispatcherHost,
    OpticalSwitch,
    QuantumHost,
)
from topologies.nodes.copper import COPPER
from topologies.nodes.tls import OPERATOR
from topologies.quantum_topo import QuantumTopo
from topologies.system.certificates import AUTHORITY
from topologies.system.runs.node_names import RESERVED
from topologies.system.runs.runtime import CONSOLE, DISPATCHER, EVENT_LOG
from wire.dispatcher_service import RUNNER
from wire.parameters.physics import BadParameter

ROOT = Path(__file__).resolve().parents[3]


class Bare(QuantumTopo):
    """h10 === q1 --- h2, in that order, with nothing of copper."""

    def build(self) -> None:
        self.addHost("h10", cls=QuantumHost, source=True)
        self.addSwitch("q1", cls=OpticalSwitch)
        self.addHost("h2", cls=QuantumHost)
        self.addFibers("h10", "q1", 2, length_km=2.0)
        self.addFibers("h2", "q1")


def copper(topo: Topo) -> dict[str, str]:
    """Return for each node that has copper to a switch that switch."""
    links = topo.links(withInfo=True)
    ends = [(one, other) for one, other, info in links if info["cls"] is not FiberLink]
    return {one if topo.isSwitch(other) else other: other for one, other in ends}


def ports_of(topo: Topo, node: str) -> dict[int, str]:
    """Return what is at the other end of each port."""
    return {port: other for port, (other, _) in topo.ports[node].items()}


def test_a_topology_of_light_alone_gets_copper_and_the_simulator() -> None:
    topo = Bare()
    assert topo.nodeInfo("s1")["cls"] is ClassicalSwitch
    assert topo.nodeInfo("ed")["cls"] is DispatcherHost
    assert copper(topo) == dict.fromkeys(("h10", "h2", "ed", "q1"), "s1")


def test_hosts_have_mininet_s_addresses_in_their_order() -> None:
    topo = Bare()
    assert {name: topo.nodeInfo(name)["ip"] for name in topo.hosts()} == {
        "h10": "10.0.0.1/8",
        "h2": "10.0.0.2/8",
        "ed": "10.0.0.3/8",
    }


def test_a_quantum_switch_with_copper_to_a_host_alone_is_joined_to_the_rest() -> None:
    class Behind(Bare):
        def build(self) -> None:
            super().build()
            self.addHost("dave", cls=ClassicalHost)
            self.addLink("dave", "q1")
            self.addSwitch("s2", cls=ClassicalSwitch)
            self.addSwitch("q2", cls=OpticalSwitch)
            self.addLink("s2", "q2")

    topo = Behind()
    copper = {
        frozenset(ends[:2]) for ends in topo.links(withInfo=True) if ends[2].get("cls") != FiberLink
    }
    assert {frozenset(("dave", "q1")), frozenset(("q1", "s2"))} <= copper
    assert frozenset(("dave", "s2")) not in copper
    assert sum("q2" in ends for ends in copper) == 1


def test_an_address_without_bits_is_of_mininet_s_network() -> None:
    class Named(QuantumTopo):
        def build(self) -> None:
            self.addHost("h1", cls=QuantumHost, ip="10.0.0.1")
            self.addHost("h2", cls=QuantumHost)

    assert Named().nodeInfo("h2")["ip"] == "10.0.0.2/8"


def test_copper_has_the_first_port_also_if_it_comes_last() -> None:
    topo = Bare()
    assert ports_of(topo, "h10") == {0: "s1", 1: "q1", 2: "q1"}
    assert ports_of(topo, "q1") == {1: "s1", 2: "h10", 3: "h10", 4: "h2"}
    for one, other, info in topo.links(withInfo=True):
        ends = {info["node1"]: info["port1"], info["node2"]: info["port2"]}
        assert topo.ports[one][ends[one]] == (other, ends[other])


def test_copper_is_as_long_as_the_fibres_beside_it() -> None:
    topo = Bare()
    lengths = {
        frozenset((one, other)): info["length_km"]
        for one, other, info in topo.links(withInfo=True)
        if info["cls"] is not FiberLink
    }
    assert lengths[frozenset(("h10", "s1"))] + lengths[frozenset(("h2", "s1"))] == 2.01


class Spelt(QuantumTopo):
    """A topology that says nearly all of it: hub and wing of copper, a simulator, an address."""

    def build(self, **_params: Any) -> None:
        self.addSwitch("hub", cls=ClassicalSwitch, dpid="7")
        self.addSwitch("wing", cls=ClassicalSwitch, dpid="8")
        self.addHost("sim", cls=DispatcherHost, ip="192.168.5.2/24")
        self.addHost("h1", cls=QuantumHost)
        self.addHost("plain", cls=Host, ip=None)
        self.addSwitch("q1", cls=OpticalSwitch, dpid="42")
        self.addFibers("h1", "q1")
        self.addLink("h1", "wing", length_km=5.0)
        self.addLink("hub", "wing")


def test_what_is_said_is_left_as_it_is() -> None:
    topo = Spelt()
    assert set(topo.nodes()) == {"hub", "wing", "sim", "h1", "plain", "q1"}
    assert copper(topo) == {
        "h1": "wing",
        "hub": "wing",
        "sim": "hub",
        "plain": "hub",
        "q1": "hub",
    }
    assert ports_of(topo, "h1") == {0: "wing", 1: "q1"}
    assert topo.linkInfo("h1", "wing")["length_km"] == 5.0
    addresses = {name: topo.nodeInfo(name)["ip"] for name in topo.hosts()}
    assert addresses == {"sim": "192.168.5.2/24", "h1": "192.168.5.1/24", "plain": None}
    check_clashes(content_of(topo))


def test_numbers_in_the_names_of_switches_are_their_datapath_ids() -> None:
    assert ClassicalSwitch.dpid_of("s12") == "c"
    assert OpticalSwitch.dpid_of("q12") == "100c"
    assert OpticalSwitch.dpid_of("middle") == ""


def test_a_quantum_switch_and_one_of_copper_of_one_number_do_not_clash() -> None:
    check_clashes(content_of(Bare()))

    class Clash(QuantumTopo):
        def build(self) -> None:
            self.addSwitch("q1", cls=OpticalSwitch)
            self.addSwitch("left1", cls=OpticalSwitch)

    with pytest.raises(BadParameter, match="left1 and q1 have one datapath ID, 1001: give each"):
        check_clashes(content_of(Clash()))


def test_a_name_that_is_needed_for_another_is_refused() -> None:
    class Twice(QuantumTopo):
        def build(self) -> None:
            self.addHost("h1", cls=QuantumHost)
            self.addSwitch("h1", cls=OpticalSwitch)

    with pytest.raises(BadParameter, match="there is a node h1 already"):
        Twice()

    class Taken(QuantumTopo):
        def build(self) -> None:
            self.addHost("ed", cls=QuantumHost)

    with pytest.raises(BadParameter, match="ed is not a DispatcherHost, and there is none: add"):
        Taken()


def test_a_switch_of_mininets_own_class_is_refused_with_what_works() -> None:
    class Stock(QuantumTopo):
        def build(self) -> None:
            self.addSwitch("s1")

    with pytest.raises(BadParameter, match=r"s1 is not .*: give it, and each other .*ClassicalSw"):
        Stock()


@pytest.mark.parametrize(
    "copper",
    [
        [("s1", "s2"), ("s2", "s3"), ("s3", "s1")],
        [("s1", "s2"), ("s1", "s2")],
        [("s1", "q1"), ("q1", "s2"), ("s1", "s2")],  # q1 passes copper's packets on, too
    ],
)
def test_a_loop_of_copper_is_refused(copper: list[tuple[str, str]]) -> None:
    topo = joined(copper)
    with pytest.raises(BadParameter, match=r"copper \w+ to \w+ closes a loop of switches"):
        check_clashes(content_of(topo))
    check_clashes(content_of(joined(copper[:-1])))


def test_a_loop_with_a_spanning_tree_or_through_a_host_is_none() -> None:
    check_clashes(content_of(joined([("s1", "s2"), ("s2", "s3"), ("s3", "s1")], stp=True)))
    check_clashes(content_of(joined([("s1", "h1"), ("h1", "s2"), ("s1", "s2")])))


def joined(copper: list[tuple[str, str]], **params: bool) -> Topo:
    """Return switches of copper, a quantum switch and a host, joined so."""
    topo = Topo()
    for number in (1, 2, 3):
        topo.addSwitch(f"s{number}", cls=ClassicalSwitch, **(params if number == 3 else {}))
    topo.addSwitch("q1", cls=OpticalSwitch)
    topo.addHost("h1", cls=Host)
    for one, other in copper:
        topo.addLink(one, other)
    return topo


@pytest.mark.parametrize("name", ["c0", "tls", "", "h-1", "h.1", "h1\n", "á"])
def test_a_name_that_files_or_interfaces_need_is_refused_wherever_it_is_from(name: str) -> None:
    topo = Topo()
    topo.addHost(name, cls=Host)
    with pytest.raises(BadParameter, match="cannot be a node's name"):
        check_clashes(content_of(topo))


def test_an_interface_has_the_15_letters_that_linux_takes_and_no_more() -> None:
    """IFNAMSIZ of netdevice(7) is 16, with the end: -eth0 leaves 10 for the node."""
    for letters, fits in ((10, True), (11, False)):
        topo = Topo()
        topo.addSwitch("s1", cls=ClassicalSwitch)
        topo.addLink(topo.addHost("a" * letters, cls=Host), "s1")
        with nullcontext() if fits else pytest.raises(BadParameter, match="have 16 letters"):
            check_clashes(content_of(topo))


def test_the_names_that_programs_have_are_no_nodes() -> None:
    names = {FIRST_CONTROLLER, COPPER, DISPATCHER, CONSOLE, RUNNER, OPERATOR, CERTIFICATES}
    assert {*names, Path(EVENT_LOG).stem, Path(AUTHORITY).stem} <= RESERVED


def test_fewer_than_one_fibre_is_refused_and_their_keywords_are_checked() -> None:
    class Few(QuantumTopo):
        def build(self, count: int, **optics: Any) -> None:
            self.addHost("h1", cls=QuantumHost)
            self.addSwitch("q1", cls=OpticalSwitch)
            self.addFibers("h1", "q1", count, **optics)

    with pytest.raises(BadParameter, match="0 fibres between h1 and q1: choose 1 or more"):
        Few(0)
    with pytest.raises(BadParameter, match="'2' fibres between h1 and q1: choose 1 or more"):
        Few("2")
    with pytest.raises(BadParameter, match="fibre h1 to q1 has no lenght_km: did you mean"):
        checked(Few)(1, lenght_km=2)


def test_the_page_of_networks_shows_the_example_as_it_is() -> None:
    page = (ROOT / "docs" / "networks.md").read_text()
    (shown,) = [block.partition("```")[0] for block in page.split("```python\n")[1:]]
    assert shown in (ROOT / "examples" / "my_net.py").read_text()
    topology = shown[shown.index("class ") :].rstrip().splitlines()
    assert len(topology) <= 15
