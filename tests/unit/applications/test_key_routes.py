"""Messages of the controller to a key manager: each is taken once, and from nobody else."""

import logging

import pytest

from applications.keys.config import KeyManagerConfig
from applications.keys.route_messages import TO_KEY_MANAGER, Hop, KeyRoute
from applications.keys.routes import Routes
from wire.device import Datagram

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
