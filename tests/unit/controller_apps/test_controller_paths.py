"""Paths through the optical network."""

from collections.abc import Callable

from metadata_scene import ALICE, BOB, CHARLIE, Q1, network

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import (
    Direction,
    Hop,
    HostPort,
    Network,
    directions,
    natural_order,
    switches,
)
from controller_apps.light.routing import Leg, Limits, cheapest_path


def free(_: Direction) -> bool:
    return False


def way(
    net: Network, start: SwitchPort, end: SwitchPort, blocked: Callable[[Direction], bool] = free
) -> tuple[Hop, ...] | None:
    path = cheapest_path(net, Leg(start, end), Limits(blocked))
    return None if path is None else path.hops


def ring() -> Network:
    """Return four switches in a ring 1-2-3-4-1 with a shorter way 1-5-3."""
    net = Network({1, 2, 3, 4, 5})
    for one, other in (((1, 12), (2, 21)), ((2, 23), (3, 32)), ((3, 34), (4, 43)),
                       ((4, 41), (1, 14)), ((1, 15), (5, 51)), ((5, 53), (3, 35))):  # fmt: skip
        net.add_link(SwitchPort(*one), SwitchPort(*other))
    return net


def test_ports_come_in_order_of_their_names() -> None:
    assert network().ports_of(BOB) == [SwitchPort(Q1, 2), SwitchPort(Q1, 3)]
    assert sorted(["a-q10", "a-q2", "a-q1"], key=natural_order) == ["a-q1", "a-q2", "a-q10"]
    assert network().ports_of("10.0.0.9") == []


def test_one_switch_is_one_hop() -> None:
    path = way(network(), SwitchPort(Q1, 4), SwitchPort(Q1, 1))
    assert path == (Hop(Q1, 4, 1),)


def test_light_goes_both_ways_in_one_fibre() -> None:
    there, back = Hop(Q1, 4, 1), Hop(Q1, 1, 4)
    assert not set(directions([there])) & set(directions([back]))


def test_a_path_avoids_what_is_taken() -> None:
    taken = set(directions([Hop(Q1, 4, 1)]))
    net = network()
    assert way(net, SwitchPort(Q1, 4), SwitchPort(Q1, 2), taken.__contains__) is None
    assert way(net, SwitchPort(Q1, 5), SwitchPort(Q1, 1), taken.__contains__) is None
    assert way(net, SwitchPort(Q1, 1), SwitchPort(Q1, 4), taken.__contains__) is not None


def test_the_shortest_way_over_several_switches() -> None:
    path = way(ring(), SwitchPort(1, 1), SwitchPort(4, 1))
    assert path == (Hop(1, 1, 14), Hop(4, 41, 1))


def test_a_taken_or_missing_link_means_a_detour() -> None:
    net = ring()
    detour = (Hop(1, 1, 12), Hop(2, 21, 23), Hop(3, 32, 1))
    start, end = SwitchPort(1, 1), SwitchPort(3, 1)
    direct = (Hop(1, 1, 15), Hop(5, 51, 53), Hop(3, 35, 1))
    ways = {Direction(1, 12, False), Direction(1, 14, False)}
    assert way(net, start, end, ways.__contains__) == direct
    assert (
        way(net, start, end, {Direction(1, 15, False), Direction(1, 14, False)}.__contains__)
        == detour
    )
    net.connected.discard(5)
    net.connected.discard(4)
    assert way(net, start, end) == detour
    assert switches(detour) == [1, 2, 3]


def test_there_is_no_path_to_itself_or_over_a_switch_that_is_gone() -> None:
    net = network()
    assert way(net, SwitchPort(Q1, 1), SwitchPort(Q1, 1)) is None
    net.connected.clear()
    assert way(net, SwitchPort(Q1, 4), SwitchPort(Q1, 1)) is None


def test_there_is_no_path_over_a_cut_fibre() -> None:
    net = ring()
    start, end = SwitchPort(1, 1), SwitchPort(3, 1)
    by_two = (Hop(1, 1, 12), Hop(2, 21, 23), Hop(3, 32, 1))
    assert way(net, start, end) == by_two
    assert net.set_fiber(SwitchPort(2, 23), whole=False)
    assert not net.set_fiber(SwitchPort(2, 23), whole=False)
    path = way(net, start, end)
    assert path is not None
    assert 2 not in switches(path)
    assert net.set_fiber(SwitchPort(2, 23), whole=True)
    assert 2 not in switches(way(net, start, end) or ())  # until it is heard of again
    net.add_link(SwitchPort(2, 23), SwitchPort(3, 32))
    net.remove_link(SwitchPort(1, 14))
    net.remove_link(SwitchPort(1, 15))
    assert way(net, start, end) == by_two
    net.set_fiber(end, whole=False)
    assert way(net, start, end) is None


def test_a_host_port_is_at_one_place_only() -> None:
    net = network()
    moved = HostPort("alice", ALICE, "alice-q0")
    assert net.attach(SwitchPort(Q1, 9), moved)
    assert net.ports_of(ALICE) == [SwitchPort(Q1, 9)]
    assert not net.attach(SwitchPort(Q1, 9), moved)
    assert net.detach(SwitchPort(Q1, 9))
    assert not net.detach(SwitchPort(Q1, 9))
    assert net.ports_of(ALICE) == []
    assert len(net.ports_of(CHARLIE)) == 2
