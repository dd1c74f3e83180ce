"""The bits of swaps, and the orders of a node in a chain."""

import asyncio

import numpy as np
import pytest
from limits import until

from hosts import network_loop
from hosts.middleware.services.swapping.link import fiber_of, setup_of_link
from hosts.middleware.services.swapping.spans import Bits
from hosts.middleware.session import swap_orders
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.swap_orders import MAX_ORDERS, Swaps
from wire.device import NOBODY, SwapOrder
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Handshake, Service


def bits(seen: list[int], operators: list[int]) -> Bits:
    return Bits(np.array(seen, dtype=bool), np.array(operators, dtype=np.uint8))


def same(one: Bits, other: Bits) -> bool:
    return bool(
        np.array_equal(one.seen, other.seen) and np.array_equal(one.operators, other.operators)
    )


def test_operators_of_two_swaps_multiply_where_both_have_told() -> None:
    joined = bits([1, 1, 0, 1], [3, 1, 0, 2]).joined(bits([1, 0, 1], [2, 0, 1]))
    assert same(joined, bits([1, 0, 0], [1, 0, 0]))


def test_what_an_analyser_does_not_tell_apart_is_not_seen() -> None:
    told = Bits.of_outcomes(np.array([0, 1, 2, 3, 255], dtype=np.uint8), frozenset({1, 3}))
    assert same(told, bits([0, 1, 0, 1, 0], [0, 1, 0, 3, 0]))


def test_the_link_to_the_right_is_the_one_that_comes_from_the_left_there() -> None:
    last = (1 << 64) - 1
    for session in (5, last):
        left, right = SwapOrder(1, session, 1, "10.0.0.2"), SwapOrder(1, session, 2)
        assert left.outgoing == right.incoming
        assert 0 <= left.outgoing <= last


def test_a_link_is_lit_by_its_left_end_unless_a_station_heralds_it() -> None:
    """And asks for no fidelity: that of the chain is of its ends."""
    asked = Setup(5, Service.SWAP, Handshake.FRAMED, "10.0.0.9", 6, 1, 1_000_000, fidelity_ppm=7)
    for station in (NOBODY, "10.0.0.8"):
        order = SwapOrder(5, 11, 1, "10.0.0.3", station=station)
        setup = setup_of_link(order, asked, "10.0.0.2")
        assert setup.source == ("10.0.0.2" if station == NOBODY else station)
        assert (setup.session, setup.service) == (order.outgoing, Service.LINK)
        assert (setup.pairs, setup.rate_hz, setup.fidelity_ppm) == (6, 1_000_000, 0)


@pytest.mark.parametrize("number", [0, 1, 2, 3])
def test_an_order_names_one_of_the_fibres_that_there_are(number: int) -> None:
    ports = ("q0", "q1")
    if number < len(ports):
        assert fiber_of(ports, number) == ports[number]
        return
    with pytest.raises(SessionError, match=rf"fibre {number} .*, this host has 2$"):
        fiber_of(ports, number)


def test_orders_whose_sessions_never_come_make_room_for_others() -> None:
    async def run() -> None:
        swaps = Swaps("10.0.0.1")
        for session in range(MAX_ORDERS + 1):
            swaps.take(SwapOrder(1, session, 1, "10.0.0.2"))
        assert swaps.sessions == frozenset(range(1, MAX_ORDERS + 1))

    network_loop.run(run())


def test_an_order_that_nobody_asks_for_is_dropped_and_one_in_use_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(swap_orders, "UNUSED_S", 0.02)

    async def run() -> None:
        swaps = Swaps("10.0.0.1")
        for session in (5, 6):
            swaps.take(SwapOrder(1, session, 1, "10.0.0.2"))
        await swaps.order(6)
        await until(lambda: 5 not in swaps.sessions)
        await asyncio.sleep(0.1)
        assert swaps.sessions == {6}

    network_loop.run(run())


def test_an_order_that_comes_late_is_waited_for() -> None:
    async def run() -> SwapOrder:
        swaps, order = Swaps("10.0.0.1"), SwapOrder(1, 7, 0, "10.0.0.2")
        waiting = asyncio.create_task(swaps.order(7))
        await asyncio.sleep(0)
        swaps.take(order)
        assert await waiting == order
        return await swaps.order(7)

    assert network_loop.run(run()).right == "10.0.0.2"
