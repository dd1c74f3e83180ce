"""The repeaters that join two hosts, and what the arbiter makes of a request for a swap."""

from dataclasses import replace
from functools import partial

import pytest
from metadata_scene import ALICE, BOB, CHARLIE, FRAMED, arbiter, frame, network, payload_of

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import HostPort, Network
from controller_apps.light.routing import Limits
from controller_apps.policy.schedules import UNPURIFIED, Purification
from controller_apps.sessions.actions import Forward, SwapsOrdered
from controller_apps.sessions.chains import find_chain, orders
from controller_apps.sessions.node_features import is_station
from controller_apps.sessions.sessions import Chain, Stop
from controller_apps.sessions.setups import TURNS
from controller_apps.sessions.terms import UNFILTERED
from wire.device import NOBODY, SwapOrder
from wire.features import EVERYTHING, INTERFERE, MEASURE, NodeFeatures
from wire.metadata.decoding import decode
from wire.metadata.header import HEADER
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Reason, Service, Verdict

SWAP = replace(FRAMED, service=Service.SWAP)


def line(repeaters: int) -> tuple[Network, list[str]]:
    """Return hosts in a line, a switch between neighbours, and their addresses."""
    names = ["alice", *[f"r{number}" for number in range(1, repeaters + 1)], "bob"]
    addresses = [f"10.0.0.{number}" for number in range(1, len(names) + 1)]
    found = Network(set(range(1, len(names))))
    for place, (name, address) in enumerate(zip(names, addresses, strict=True)):
        if place:
            found.attach(SwitchPort(place, 2), HostPort(name, address, f"{name}-q0"))
        if place < len(names) - 1:
            number = 1 if place else 0
            found.attach(SwitchPort(place + 1, 1), HostPort(name, address, f"{name}-q{number}"))
    return found, addresses


def stops(opener: str, *others: str) -> Chain:
    """Return a chain in which light comes to each repeater by its first fibre."""
    *repeaters, acceptor = others
    return (Stop(opener), *(Stop(address, 0, 1) for address in repeaters), Stop(acceptor))


@pytest.mark.parametrize("repeaters", [1, 3, 64])
def test_the_repeaters_of_a_line_are_found_in_order(repeaters: int) -> None:
    discovered, addresses = line(repeaters)
    assert find_chain(discovered, addresses[0], addresses[-1], Limits()) == stops(*addresses)


@pytest.mark.parametrize("repeaters", [1, 2, 64])
def test_a_line_has_a_chain_in_the_other_direction_too(repeaters: int) -> None:
    discovered, addresses = line(repeaters)
    opener, *between, acceptor = reversed(addresses)
    backwards = (Stop(opener), *(Stop(address, 1, 0) for address in between), Stop(acceptor))
    assert find_chain(discovered, opener, acceptor, Limits()) == backwards


def with_stations(discovered: Network, links: int) -> list[str]:
    """Give each link a station with two fibres; return their addresses."""
    addresses = [f"10.0.1.{number}" for number in range(1, links + 1)]
    able = NodeFeatures(MEASURE | INTERFERE, 0)
    for number, address in enumerate(addresses, 1):
        for fiber in (0, 1):
            port = HostPort(f"m{number}", address, f"m{number}-q{fiber}", able)
            discovered.attach(SwitchPort(number, 3 + fiber), port)
    return addresses


def test_each_heralded_link_has_a_station_of_its_own() -> None:
    discovered, hosts = line(2)
    stations = with_stations(discovered, 3)
    herald = partial(is_station, discovered)
    unable = partial(lambda known, address: address in known, stations)
    chain = find_chain(discovered, hosts[0], hosts[-1], Limits(), unable, herald)
    assert chain is not None
    assert [stop.address for stop in chain] == hosts
    assert [stop.station for stop in chain] == [*stations, ""]
    told = orders(SwapsOrdered(7, chain), 5)
    assert [told[host].station for host in hosts] == [*stations, NOBODY]
    discovered.set_fiber(SwitchPort(2, 4), whole=False)  # the second fibre of the second station
    assert find_chain(discovered, hosts[0], hosts[-1], Limits(), unable, herald) is None


def test_a_host_that_makes_pairs_itself_is_no_station() -> None:
    discovered, hosts = line(1)
    assert not is_station(discovered, hosts[1])  # it does not announce its features
    discovered.attach(
        SwitchPort(9, 1), HostPort("x", "10.0.9.9", "x-q0", NodeFeatures(EVERYTHING, 1))
    )
    assert not is_station(discovered, "10.0.9.9")


def test_a_repeater_sends_light_by_another_fibre_than_it_comes_by() -> None:
    """Of the two ways to r1, one takes the fibre by which it would have to send on."""
    discovered, (alice, repeater, bob) = line(1)
    discovered.attach(SwitchPort(2, 3), HostPort("alice", alice, "alice-q1"))
    chain = find_chain(discovered, alice, bob, Limits())
    assert chain == (Stop(alice, 0, 0), Stop(repeater, 0, 1), Stop(bob))
    discovered.set_fiber(SwitchPort(1, 1), whole=False)  # the way that leaves the other fibre
    assert find_chain(discovered, alice, bob, Limits()) is None


def test_more_repeaters_than_a_chain_may_have_are_no_chain() -> None:
    discovered, addresses = line(65)
    assert find_chain(discovered, addresses[0], addresses[-1], Limits()) is None


def test_a_cut_fibre_breaks_the_chain() -> None:
    discovered, addresses = line(2)
    discovered.set_fiber(SwitchPort(2, 1), whole=False)
    assert find_chain(discovered, addresses[0], addresses[-1], Limits()) is None


def test_hosts_that_light_joins_directly_get_a_repeater_all_the_same() -> None:
    assert find_chain(network(), ALICE, BOB, Limits()) == stops(ALICE, CHARLIE, BOB)


def test_a_host_of_one_fibre_is_no_repeater() -> None:
    assert find_chain(network(), CHARLIE, BOB, Limits()) is None


def asked(setup: Setup, source: str = ALICE) -> list[object]:
    return list(arbiter().segment_arrived(1, 1, frame(setup.encode(), source=source), 0.0))


def test_a_swap_waits_for_the_nodes_that_are_told() -> None:
    assert asked(SWAP) == [SwapsOrdered(7, stops(ALICE, CHARLIE, BOB), "parallel", blocks=4)]


def test_a_swap_that_no_repeater_can_make_is_refused() -> None:
    actions = asked(SWAP, source=CHARLIE)
    (sent,) = [action for action in actions if isinstance(action, Forward)]
    answer = decode(payload_of(sent.frame))
    assert isinstance(answer, Setup)
    assert (answer.verdict, answer.reason) == (Verdict.REFUSED, Reason.NO_CHAIN)
    assert not any(isinstance(action, SwapsOrdered) for action in actions)


def test_hosts_take_turns_only_where_they_purify() -> None:
    """Where nothing is purified, turns only make pairs wait: switches do it for who asks."""
    by_plan: dict[Purification, list[object]] = {}
    for plan in (UNPURIFIED, Purification("dejmps", 1)):
        judge = arbiter()
        judge.follow(replace(UNFILTERED, schedule="nested", purification=plan))
        by_plan[plan] = list(judge.segment_arrived(1, 1, frame(SWAP.encode()), 0.0))
    (sent,) = [action for action in by_plan[UNPURIFIED] if isinstance(action, Forward)]
    answer = decode(payload_of(sent.frame))
    assert isinstance(answer, Setup)
    assert (answer.reason, answer.obstacle) == (Reason.NO_CHAIN, TURNS)
    assert any(isinstance(action, SwapsOrdered) for action in by_plan[Purification("dejmps", 1)])


def test_every_node_is_told_its_place_and_the_next_one() -> None:
    told = orders(SwapsOrdered(7, stops(ALICE, CHARLIE, BOB)), 5)
    assert told == {
        ALICE: SwapOrder(5, 7, 0, CHARLIE),
        CHARLIE: SwapOrder(5, 7, 1, BOB, 0, 1),
        BOB: SwapOrder(5, 7, 2),
    }


@pytest.mark.parametrize("repeaters", [1, 16, 64])
def test_every_order_can_be_sent(repeaters: int) -> None:
    chain = stops(*(f"10.0.0.{number}" for number in range(1, repeaters + 3)))
    told = [*orders(SwapsOrdered(7, chain), 5).values()]
    assert [SwapOrder.parse(5, order.encode()[HEADER.size :]) for order in told] == told
