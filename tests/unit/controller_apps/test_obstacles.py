"""A refusal of light names what is cut or stuck."""

from metadata_scene import rotating

from controller_apps.light.obstacles import Obstacle, obstacles, text_of
from controller_apps.light.optics import SwitchOptics, SwitchPort
from controller_apps.light.paths import HostPort, Network
from controller_apps.light.routing import Leg
from wire.optical import PathOptics

ALICE, BOB = SwitchPort(1, 1), SwitchPort(2, 2)
NEAR, FAR = SwitchPort(1, 10), SwitchPort(2, 20)
LEGS = [Leg(ALICE, BOB)]


def two_switches() -> Network:
    """Return alice - q1 - q2 - bob."""
    network = Network({1, 2}, names={1: "q1", 2: "q2"})
    network.attach(ALICE, HostPort("alice", "10.0.0.1", "alice-q0"))
    network.attach(BOB, HostPort("bob", "10.0.0.2", "bob-q0"))
    network.add_link(NEAR, FAR)
    return network


def test_a_network_where_nothing_is_broken_has_none() -> None:
    assert obstacles(two_switches(), LEGS) == []


def test_what_was_never_there_is_not_broken() -> None:
    network = two_switches()
    network.remove_link(NEAR)
    assert obstacles(network, LEGS) == []


def test_a_cut_fibre_of_a_host_is_named_with_its_host() -> None:
    network = two_switches()
    network.set_fiber(BOB, whole=False)
    assert obstacles(network, LEGS) == [Obstacle("fibre bob-q2 (bob-q0) is cut", "10.0.0.2")]


def test_a_cut_fibre_between_switches_is_named_once_by_both_its_ends() -> None:
    network = two_switches()
    network.set_fiber(NEAR, whole=False)
    network.set_fiber(FAR, whole=False)
    assert obstacles(network, LEGS) == [Obstacle("fibre q1-q2 is cut")]


def test_a_fibre_that_is_laid_elsewhere_is_no_longer_a_cut_one() -> None:
    network = two_switches()
    network.set_fiber(NEAR, whole=False)
    network.set_fiber(NEAR, whole=True)
    network.add_link(SwitchPort(1, 11), FAR)
    network.set_fiber(SwitchPort(1, 11), whole=False)
    assert obstacles(network, LEGS) == [Obstacle("fibre q1-q2 is cut")]


def test_a_stuck_cross_connect_is_named_by_what_it_connects() -> None:
    network = two_switches()
    network.optics.switches[1] = SwitchOptics.reported([PathOptics(1, 7, 0, 0, stuck=True)])
    assert obstacles(network, LEGS) == [Obstacle("cross-connect 1 -> 7 of q1 is stuck")]


def test_a_switch_that_is_away_is_named() -> None:
    network = two_switches()
    network.optics.switches = {1: rotating(0, 100)}
    network.connected.discard(2)
    assert obstacles(network, LEGS) == [Obstacle("q2 is not connected to the controller")]


def test_all_that_is_broken_is_named() -> None:
    network = two_switches()
    for port in (ALICE, FAR, NEAR, BOB):
        network.set_fiber(port, whole=False)
    assert [found.text for found in obstacles(network, LEGS)] == [
        "fibre alice-q1 (alice-q0) is cut",
        "fibre q1-q2 is cut",
        "fibre bob-q2 (bob-q0) is cut",
    ]


def test_of_several_fibres_between_switches_the_ports_are_named() -> None:
    network = two_switches()
    network.add_link(SwitchPort(1, 11), SwitchPort(2, 21))
    network.set_fiber(NEAR, whole=False)
    network.set_fiber(SwitchPort(2, 21), whole=False)
    assert obstacles(network, LEGS) == [Obstacle("fibre q1-q2 (ports 10 and 20) is cut")]


def test_hosts_are_not_told_what_a_policy_closes() -> None:
    network = two_switches()
    network.closed = frozenset({frozenset({"q1", "q2"})})
    found = obstacles(network, LEGS)
    assert [each.text for each in found] == ["the policy closes the fibres between q1 and q2"]
    assert text_of(found, 96) == ""


def test_what_has_no_room_is_counted() -> None:
    found = [Obstacle("a" * 40), Obstacle("b" * 40), Obstacle("c" * 40)]
    assert text_of(found, 124) == f"{'a' * 40}; {'b' * 40}; {'c' * 40}"
    assert text_of(found, 123) == f"{'a' * 40}; {'b' * 40}; 1 more"
    assert text_of(found, 96) == f"{'a' * 40}; {'b' * 40}; 1 more"[:96]
    assert text_of(found, 49) == f"{'a' * 40}; 2 more"
    assert text_of(found, 40) == ""
