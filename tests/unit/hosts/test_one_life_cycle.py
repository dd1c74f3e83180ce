"""The one life cycle of sessions, whichever service they are of; superdense coding is one."""

import asyncio
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

import pytest
from fault_scene import DATA, SERVICES, SESSIONS, running, session
from limits import SOON_S
from stacks_scene import network

from hosts import network_loop
from hosts.middleware.services import kinds, named
from hosts.service_socket import ServiceSocket
from hosts.stack import Stack
from hosts.stack_socket import QuantumSocketError
from wire.metadata.blocks import Finish
from wire.metadata.header import Message
from wire.services import LIGHT, RETURNS

T = TypeVar("T")
COUNTED = {"sdc": ("pairs_sent", "pairs_received")}


def test_every_service_that_hosts_ask_for_is_a_kind() -> None:
    assert set(kinds()) == set(LIGHT)
    returns = {service.name.lower() for service in RETURNS}  # test_returned_bytes.py
    measured = {"swap"}  # at quantum switches: tests/emulation/test_switch_swaps.py
    assert set(named()) - returns - measured == set(SERVICES) == set(SESSIONS)


@pytest.mark.parametrize("service", SERVICES)
def test_a_session_is_counted_at_both_its_ends_while_it_runs(tmp_path: Path, service: str) -> None:
    seen: dict[str, tuple[int, int]] = {}

    async def scene() -> None:
        stacks: dict[str, Stack] = {}

        def look(way: str, message: Message) -> Message:
            if way == "forth" and isinstance(message, Finish) and not seen:
                for name in ("alice", "bob"):
                    report = stacks[name].device.report()
                    seen[name] = report.sending, report.receiving
            return message

        async with running(tmp_path, service, change=look) as hosts:
            stacks.update(hosts)
            await asyncio.to_thread(session, tmp_path, service)
            for name, count in zip(("alice", "bob"), COUNTED.get(service, ()), strict=False):
                # 256 bytes are 1024 dibits, a pair each: none is lost, no frame repeated
                assert getattr(stacks[name].device.report(), count) == 4 * len(DATA)

    network_loop.run(scene())
    assert seen == {"alice": (1, 0), "bob": (0, 1)}


@pytest.mark.parametrize("service", SERVICES)
def test_a_refused_option_is_named_by_every_service(tmp_path: Path, service: str) -> None:
    def ask() -> str:
        with ServiceSocket(tmp_path / "alice.sock") as alice:
            alice.settimeout(SOON_S)
            with pytest.raises(QuantumSocketError) as caught:
                list(alice.request(service, ("bob", 9), rate=7))
        return str(caught.value)

    assert "a session has no rate: did you mean rate_hz" in _with_network(tmp_path, ask)


def test_bytes_go_through_the_socket_of_services_too(tmp_path: Path) -> None:
    """An application that asks for sdc as for any service hears when it can send."""

    def ask() -> tuple[dict[str, Any], bool]:
        with ThreadPoolExecutor(1) as pool, ServiceSocket(tmp_path / "alice.sock") as alice:
            listening: Future[None] = Future()
            bob = pool.submit(_accepted, tmp_path, listening)
            listening.result(SOON_S)
            alice.settimeout(SOON_S)
            assert list(alice.request("sdc", ("bob", 9))) == []
            assert not alice.over
            alice.shutdown()
            assert bob.result(SOON_S)["bytes"] == 0
            return alice.summary, alice.over

    summary, over = _with_network(tmp_path, ask)
    assert over
    assert (summary["delivered_bytes"], summary["symbols"]) == (0, 4)


def _accepted(folder: Path, listening: "Future[None]") -> dict[str, Any]:
    with ServiceSocket(folder / "bob.sock") as listener:
        listener.settimeout(SOON_S)
        listener.listen(9, "sdc")
        listening.set_result(None)
        connection, _peer = listener.accept()
        with connection:
            list(connection.results())
            return connection.summary


def _with_network(folder: Path, ask: Callable[[], T]) -> T:
    async def run() -> T:
        async with network(folder):
            return await asyncio.to_thread(ask)

    return network_loop.run(run())
