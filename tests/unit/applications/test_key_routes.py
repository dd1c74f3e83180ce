"""A key manager and the controller: messages are taken once, and questions end in time."""

import asyncio
import logging
from dataclasses import replace
from typing import Any

import pytest
from stepping import stepping

from applications.keys.config import KeyManagerConfig
from applications.keys.refusals import Refused
from applications.keys.route_messages import (
    FROM_KEY_MANAGER,
    TO_KEY_MANAGER,
    Hop,
    KeyRoute,
    KeyRouteRequest,
)
from applications.keys.routes import Routes
from applications.timeouts import ROUTE_PAUSE_S, ROUTE_TIMEOUT_S
from hosts import network_loop
from wire.device import Datagram, open_sealed

KEY = "5a" * 16
HOPS = Hop("10.0.0.1"), Hop("10.0.0.2")


def config() -> KeyManagerConfig:
    """Return that of alice's key manager, with what it shares with the controller."""
    return KeyManagerConfig(
        host="alice",
        address="10.0.0.1",
        stack="",
        keys="",
        hosts={},
        saes={},
        certificate="",
        private_key="",
        authority="",
        device_key=KEY,
    )


def test_the_same_datagram_twice_and_older_ones_are_dropped(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.WARNING)
    routes, heard = Routes(config(), tuple), []
    for host, number in (("alice", 7), ("alice", 7), ("alice", 6), ("alice", 8), ("bob", 9)):
        data = Datagram(KeyRoute(5, 1, 1, HOPS), host, number).seal(KEY, TO_KEY_MANAGER)
        caplog.clear()
        routes.datagram_received(data, ("10.0.0.9", 1))
        heard.append("not new, or not ours" not in caplog.text)
    assert heard == [True, False, False, True, False]


def test_a_question_is_given_up_after_its_time_of_the_network_however_long_the_wall_takes() -> None:
    """Nobody answers, and the clock leaps from one repetition to the next."""
    asked_s: list[float] = []

    class Transport(asyncio.DatagramTransport):
        def sendto(self, data: Any, addr: object = None) -> None:
            if isinstance(open_sealed(data, KEY, FROM_KEY_MANAGER).message, KeyRouteRequest):
                asked_s.append(gate.time.now_s())

    async def ask() -> None:
        stepped = replace(
            config(),
            hosts={"bob": "10.0.0.2"},
            time_folder=gate.time.folder,
            time_since_ns=gate.time.since_ns,
        )
        routes = Routes(stepped, tuple)
        routes.connection_made(Transport())
        with pytest.raises(Refused, match="has not answered in 3 s"):
            await routes.ask("bob", 0, "a", "b")

    with stepping() as gate:
        network_loop.run(ask(), gate.time)
        assert gate.time.now_s() == ROUTE_TIMEOUT_S
    assert asked_s == pytest.approx([number * ROUTE_PAUSE_S for number in range(10)])
