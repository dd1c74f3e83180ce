"""Which repeaters join two hosts, and what the arbiter makes of a request for a swap."""

from dataclasses import replace

import pytest
from metadata_scene import ALICE, BOB, CHARLIE, FRAMED, arbiter, frame, network, payload_of

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import HostPort, Network
from controller_apps.light.routing import Limits
from controller_apps.sessions.actions import Forward, Keep, OpenPaths, SwapsOrdered
from controller_apps.sessions.chains import find_chain, orders
from controller_apps.succession.kept import decode_session
from wire.device import SwapOrder
from wire.metadata import Reason, Service, Setup, Verdict, decode

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


@pytest.mark.parametrize("repeaters", [1, 3, 16])
def test_the_repeaters_of_a_line_are_found_in_order(repeaters: int) -> None:
    discovered, addresses = line(repeaters)
    assert find_chain(discovered, addresses[0], addresses[-1], Limits()) == tuple(addresses)


def test_more_repeaters_than_a_chain_may_have_are_no_chain() -> None:
    discovered, addresses = line(17)
    assert find_chain(discovered, addresses[0], addresses[-1], Limits()) is None


def test_a_cut_fibre_breaks_the_chain() -> None:
    discovered, addresses = line(2)
    discovered.set_fiber(SwitchPort(2, 1), whole=False)
    assert find_chain(discovered, addresses[0], addresses[-1], Limits()) is None


def test_hosts_that_light_joins_directly_get_a_repeater_all_the_same() -> None:
    assert find_chain(network(), ALICE, BOB, Limits()) == (ALICE, CHARLIE, BOB)


def test_a_host_of_one_fibre_is_no_repeater() -> None:
    assert find_chain(network(), CHARLIE, BOB, Limits()) is None


def asked(setup: Setup, source: str = ALICE) -> tuple[list[object], Setup]:
    actions = arbiter().segment_arrived(1, 1, frame(setup.encode(), source=source), 0.0)
    (sent,) = [action for action in actions if isinstance(action, Forward)]
    message = decode(payload_of(sent.frame))
    assert isinstance(message, Setup)
    return list(actions), message


def test_a_swap_is_granted_at_once_and_its_nodes_are_told_first() -> None:
    actions, answer = asked(SWAP)
    assert answer.verdict == Verdict.GRANTED
    assert actions[0] == SwapsOrdered(7, (ALICE, CHARLIE, BOB))
    assert not any(isinstance(action, OpenPaths) for action in actions)


def test_a_swap_is_kept_and_read_back_though_it_has_no_light_of_its_own() -> None:
    actions, _answer = asked(SWAP)
    (kept,) = [action for action in actions if isinstance(action, Keep)]
    session = decode_session(kept.data, 1.0)
    assert (session.setup, session.paths, session.open) == (SWAP, (), True)


def test_a_swap_that_no_repeater_can_make_is_refused() -> None:
    actions, answer = asked(SWAP, source=CHARLIE)
    assert (answer.verdict, answer.reason) == (Verdict.REFUSED, Reason.NO_PATH)
    assert not any(isinstance(action, SwapsOrdered) for action in actions)


def test_every_node_is_told_its_place_and_the_next_one() -> None:
    told = orders(SwapsOrdered(7, (ALICE, CHARLIE, BOB)), 5)
    assert told == {
        ALICE: SwapOrder(5, 7, 0, CHARLIE),
        CHARLIE: SwapOrder(5, 7, 1, BOB),
        BOB: SwapOrder(5, 7, 2),
    }
