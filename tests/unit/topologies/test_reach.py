"""A network in which copper or light cannot reach a host is refused, by the parts and a remedy."""

import re
from collections.abc import Callable

import pytest
from mininet.node import Host
from mininet.topo import Topo

from topologies.chain import ChainTopo
from topologies.description.checks import check_reach
from topologies.description.content import content_of
from topologies.leaf_spine import LeafSpineTopo
from topologies.links.fiber import FiberLink
from topologies.mapped import MapTopo
from topologies.nodes import (
    ClassicalHost,
    ClassicalSwitch,
    DispatcherHost,
    OpticalSwitch,
    QuantumHost,
)
from topologies.quantum_topo import QuantumTopo
from topologies.repeaters import RepeatersTopo
from topologies.ring import RingTopo
from topologies.sdc import SdcTopo
from topologies.tapped import TappedTopo
from topologies.tree import TreeTopo
from wire.parameters.physics import BadParameter


class Router(Host):  # type: ignore[misc]  # Mininet has no types
    """A host of a user's own, which may pass packets on."""


def two_hosts(also: Callable[[QuantumTopo], object]) -> Topo:
    """Return h1 and h2 with fibres to q1, and further options."""

    class Own(QuantumTopo):
        def build(self) -> None:
            for name in ("h1", "h2"):
                self.addHost(name, cls=QuantumHost)
            self.addSwitch("q1", cls=OpticalSwitch)
            for name in ("h1", "h2"):
                self.addFibers(name, "q1", 2)
            also(self)

    return Own()


def spelt_out(*left_out: str, fibers_first: bool = False) -> Topo:
    """Return a plain Topo of Mininet, without some of its nodes and links."""
    links = [(name, "s1") for name in ("ed", "h1", "h2")]
    fibers = [(name, "q1") for name in ("h1", "h2")]
    kinds = {"h1": QuantumHost, "h2": QuantumHost, "ed": DispatcherHost}
    switches = {"s1": ClassicalSwitch, "q1": OpticalSwitch}
    topo = Topo()
    for name, kind in kinds.items():
        if name not in left_out:
            topo.addHost(name, cls=kind)
    for name, kind in switches.items():
        topo.addSwitch(name, cls=kind)
    laid = [*fibers, *links] if fibers_first else [*links, *fibers]
    for one, other in laid:
        if not {one, f"{one}-{other}"} & {*left_out}:
            topo.addLink(one, other, **({"cls": FiberLink} if other == "q1" else {}))
    return topo


@pytest.mark.parametrize(
    "made",
    [
        SdcTopo,
        ChainTopo,
        RingTopo,
        LeafSpineTopo,
        RepeatersTopo,
        TreeTopo,
        TappedTopo,
        lambda: MapTopo(map="garr"),
        lambda: two_hosts(lambda topo: None),
        spelt_out,
        Topo,
    ],
)
def test_networks_whose_parts_reach_each_other_are_not_refused(made: Callable[[], Topo]) -> None:
    check_reach(content_of(made()))


def test_a_fibre_from_host_to_host_is_refused() -> None:
    words = r"^fibre h1 to h2: both are hosts; lay it by way of a quantum switch, as addFibers"
    with pytest.raises(BadParameter, match=words):
        check_reach(content_of(two_hosts(lambda topo: topo.addFibers("h1", "h2"))))


def test_copper_from_host_to_host_is_refused_where_it_is_all_that_one_has() -> None:
    words = r'^copper h1 to h2: both are hosts.*join h1 to a switch before.*\("h1", "s1"\)$'
    with pytest.raises(BadParameter, match=words):
        check_reach(content_of(two_hosts(lambda topo: topo.addLink("h1", "h2"))))


def test_further_copper_between_hosts_is_their_own_affair() -> None:
    def also(topo: QuantumTopo) -> None:
        topo.addSwitch("s1", cls=ClassicalSwitch)
        for name in ("h1", "h2"):
            topo.addLink(name, "s1")
        topo.addLink("h1", "h2")

    check_reach(content_of(two_hosts(also)))


def addressed(*addresses: str, last: type = QuantumHost) -> Topo:
    """Return h1, h2, ... with such addresses; the last is of such a class."""

    class Own(QuantumTopo):
        def build(self) -> None:
            self.addSwitch("q1", cls=OpticalSwitch)
            kinds = [*[QuantumHost] * (len(addresses) - 1), last]
            for number, (address, kind) in enumerate(zip(addresses, kinds, strict=True), start=1):
                self.addHost(f"h{number}", cls=kind, ip=address)

    return Own()


@pytest.mark.parametrize("kind", [ClassicalHost, QuantumHost, DispatcherHost])
@pytest.mark.parametrize(
    ("second", "network"),
    [
        ("10.0.1.2/24", "10.0.1.0/24"),
        ("10.0.0.2/8", "10.0.0.0/8"),
        ("192.168.0.2", "192.0.0.0/8"),  # Mininet's own length
    ],
)
def test_hosts_in_several_networks_are_refused_by_them(
    second: str, network: str, kind: type
) -> None:
    words = rf"10\.0\.0\.0/24, and \w+ in {re.escape(network)}: give all hosts an ip in one network"
    with pytest.raises(BadParameter, match=words):
        check_reach(content_of(addressed("10.0.0.1/24", second, last=kind)))


def test_hosts_in_one_network_and_mininets_own_anywhere_are_not_refused() -> None:
    check_reach(content_of(addressed("192.168.7.1/28", "192.168.7.9/28")))
    check_reach(content_of(addressed("10.0.0.1/24", "10.0.0.2/24", "172.16.0.1/24", last=Host)))


def islands(topo: QuantumTopo) -> None:
    """Add h1 to s1, where ed will be, and h2 to s2."""
    for number in (1, 2):
        topo.addSwitch(f"s{number}", cls=ClassicalSwitch)
        topo.addLink(f"h{number}", f"s{number}")


def test_parts_that_no_copper_joins_are_refused_by_name() -> None:
    words = r'^no copper leads from h2 to ed, .*: join the switches, as addLink\("s2", "s1"\)$'
    with pytest.raises(BadParameter, match=words):
        check_reach(content_of(two_hosts(islands)))


def test_a_switch_of_mininets_own_is_refused_with_the_class_that_works() -> None:
    def stock(topo: QuantumTopo) -> None:
        topo.addSwitch("s3")
        topo.addLink("h1", "s3")

    words = (
        r'^no copper leads from h1 to ed, .*: make s3, .* addSwitch\("s3", cls=ClassicalSwitch\)$'
    )
    with pytest.raises(BadParameter, match=words):
        check_reach(content_of(two_hosts(stock)))


@pytest.mark.parametrize("kind", [ClassicalHost, QuantumHost])
def test_a_host_of_ours_joins_no_parts(kind: type) -> None:
    def also(topo: QuantumTopo) -> None:
        islands(topo)
        topo.addHost("h3", cls=kind)
        for number in (1, 2):
            topo.addLink("h3", f"s{number}")

    with pytest.raises(BadParameter, match=r"^no copper leads from h2 to ed"):
        check_reach(content_of(two_hosts(also)))


def test_parts_that_a_router_of_a_users_own_joins_are_not_refused() -> None:
    def also(topo: QuantumTopo) -> None:
        islands(topo)
        topo.addHost("r", cls=Router)
        for number in (1, 2):
            topo.addLink("r", f"s{number}")

    check_reach(content_of(two_hosts(also)))


@pytest.mark.parametrize(
    ("topo", "words"),
    [
        (spelt_out("ed"), "^there is no host that holds the qubits: add one of cls=DispatcherHost"),
        (spelt_out("ed-s1"), r'^ed has no copper: add some, as addLink\("ed", "s1"\)$'),
        (spelt_out("h2-s1", "h2-q1"), r'^h2 has no copper: add some, as addLink\("h2", "s1"\)$'),
        (spelt_out("h2-s1"), "^h2: its first link is a fibre, .*add the copper before"),
        (spelt_out(fibers_first=True), "^h1: its first link is a fibre, .*QuantumTopo"),
    ],
)
def test_what_a_plain_topo_has_left_out_is_named(topo: Topo, words: str) -> None:
    with pytest.raises(BadParameter, match=words):
        check_reach(content_of(topo))


def test_of_many_hosts_some_are_named() -> None:
    def also(topo: QuantumTopo) -> None:
        topo.addSwitch("s1", cls=ClassicalSwitch)
        topo.addSwitch("s2", cls=ClassicalSwitch)
        for number in range(3, 12):
            topo.addHost(f"h{number}", cls=QuantumHost)
            topo.addLink(f"h{number}", "s2")

    with pytest.raises(BadParameter, match="from h3, h4, h5, h6, h7, 4 more to ed"):
        check_reach(content_of(two_hosts(also)))
