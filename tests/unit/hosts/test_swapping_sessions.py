"""Swapped pairs in sessions, and chains that break: nothing is left on any node."""

import asyncio
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from chain_scene import Stacks, chain
from dispatcher_status import held, require_nothing_left
from limits import SOON_S, until
from stacks_scene import OWN_ADDRESS, RELAYED, Change, grant, sealed

from hosts import network_loop
from hosts.middleware.session import swap_orders
from hosts.middleware.session.channel import MetadataChannel
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.values import numbers_of, values
from hosts.service_socket import ServiceSocket
from hosts.stack_socket import QuantumSocketError
from wire.device import SwapOrder
from wire.metadata.header import Message
from wire.metadata.setup import Setup
from wire.metadata.values import Topic, Values
from wire.metadata.vocabulary import Reason, Service, Verdict
from wire.parameters.physics import Device, Memory

PORT = 9


def inside(folder: Path, repeaters: int, scene: Callable[[], None], **options: Any) -> None:
    """Let a scene of applications happen at a chain, after which nothing is left."""

    async def run() -> None:
        async with chain(folder, repeaters, **options) as stacks:
            await asyncio.to_thread(scene)
            await asyncio.to_thread(require_nothing_left, folder, [*stacks])
            if "order" not in options:
                await require_no_orders(stacks)

    network_loop.run(run())


async def require_no_orders(stacks: Stacks) -> None:
    """Fail if a node does not forget what it was ordered, once it has reported the chain's end."""
    await until(lambda: not any(stack.swaps.sessions for stack in stacks.values()))


def at_bob(folder: Path, listening: "Future[None]", sockets: "Future[ServiceSocket]") -> str:
    """Listen at bob; return why it failed, "" if it did not."""
    with ServiceSocket(folder / "bob.sock") as listener:
        listener.settimeout(SOON_S)
        listener.listen(PORT, "swap")
        listening.set_result(None)
        bob, _peer = listener.accept()
        sockets.set_result(bob)
        with bob:
            try:
                while not bob.over:
                    list(bob.results())
            except QuantumSocketError as error:
                return str(error)
    return ""


def asked(
    folder: Path, use: Callable[[ServiceSocket, ServiceSocket], None], **options: Any
) -> list[str]:
    """Ask at alice and use what is delivered; return why it failed at alice and at bob."""
    with ThreadPoolExecutor(1) as pool, ServiceSocket(folder / "alice.sock") as alice:
        listening: Future[None] = Future()
        sockets: Future[ServiceSocket] = Future()
        bob = pool.submit(at_bob, folder, listening, sockets)
        listening.result(SOON_S)
        alice.settimeout(SOON_S)
        why = ""
        try:
            list(alice.request("swap", ("bob", PORT), **options))
            use(alice, sockets.result(SOON_S))
            alice.shutdown()
        except QuantumSocketError as error:
            why = str(error)
        return [why, bob.result(SOON_S)]


def nothing(_alice: ServiceSocket, _bob: ServiceSocket) -> None:
    """Leave the pairs as they are."""


def cutting(topic: int, block: int, way: str) -> Change:
    """Cut every connection on which a message about this comes by."""

    def change(direction: str, message: Message) -> Message | None:
        about = isinstance(message, Values) and (message.topic, message.block) == (topic, block)
        return None if about and direction == way else message

    return change


def test_only_the_pairs_that_are_delivered_are_held_and_by_alice_and_bob_alone(
    tmp_path: Path,
) -> None:
    def use(alice: ServiceSocket, _bob: ServiceSocket) -> None:
        assert alice.summary["pairs"] == 500
        numbers = list(range(500))
        outcomes = alice.ask(measure=numbers, basis="Z")["outcomes"]
        assert {0, 1} == set(outcomes)
        require_nothing_left_at_repeaters(tmp_path)

    inside(tmp_path, 2, lambda: require_success(asked(tmp_path, use, count=500)))


def require_nothing_left_at_repeaters(folder: Path) -> None:
    assert [bool(held(folder, node)) for node in ("r1", "r2", "bob")] == [False, False, True]


def require_success(faults: list[str]) -> None:
    assert faults == ["", ""]


@pytest.mark.parametrize(
    ("topic", "way"),
    [
        (Topic.COMING, "forth"),
        (Topic.CORRECTIONS, "forth"),  # from any repeater to its right neighbour
        (Topic.ARRIVED, "back"),
    ],
)
def test_links_that_break_in_mid_protocol_end_the_session_at_both_ends(
    tmp_path: Path, topic: int, way: str
) -> None:
    def scene() -> None:
        alice, bob = asked(tmp_path, nothing, count=5000, block_pairs=500)
        assert alice
        assert bob

    inside(tmp_path, 3, scene, change=cutting(topic, 3, way))


def renamed(way: str, sent: list[int], become: list[int]) -> Change:
    """Change the message of a swap, from these numbers to others."""

    def change(direction: str, message: Message) -> Message:
        if direction == way and isinstance(message, Values) and message.topic == Topic.SWAPPED:
            numbers = numbers_of(message).tolist()
            if numbers[: len(sent)] == sent:
                numbers[: len(sent)] = become
                return values(message.session, message.topic, message.block, numbers, message.width)
        return message

    return change


@pytest.mark.parametrize(
    ("way", "sent", "become", "words"),
    [
        ("forth", [2], [1], "bits of a swap at place 1, not of"),  # a repeater heard twice
        ("forth", [1], [9], "bits of a swap at place 9, not of [1"),  # of none to the left
    ],
)
def test_swaps_that_cannot_be_end_the_session(
    tmp_path: Path, way: str, sent: list[int], become: list[int], words: str
) -> None:
    def scene() -> None:
        told = asked(tmp_path, nothing, count=500)
        assert all(told)
        assert any(words in text for text in told)

    inside(tmp_path, 3, scene, change=renamed(way, sent, become))


def test_an_application_that_goes_in_mid_protocol_leaves_nothing_on_any_node(
    tmp_path: Path,
) -> None:
    def scene() -> None:
        with ThreadPoolExecutor(1) as pool, ServiceSocket(tmp_path / "alice.sock") as alice:
            listening: Future[None] = Future()
            sockets: Future[ServiceSocket] = Future()
            bob = pool.submit(at_bob, tmp_path, listening, sockets)
            listening.result(SOON_S)
            alice.settimeout(SOON_S)
            next(alice.request("swap", ("bob", PORT), count=1_000_000, block_pairs=500))
            alice.close()
            assert bob.result(SOON_S)

    inside(tmp_path, 2, scene)


def test_a_full_memory_of_a_repeater_is_told_to_the_one_who_asked(tmp_path: Path) -> None:
    def scene() -> None:
        alice, _bob = asked(tmp_path, nothing, count=1000)
        assert "memory" in alice

    devices = {"r1": Device(memory=Memory(capacity=100))}
    inside(tmp_path, 1, scene, devices=devices)


def test_without_orders_from_a_controller_nothing_is_swapped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(swap_orders, "ORDER_TIMEOUT_S", 0.2)

    def scene() -> None:
        alice, bob = asked(tmp_path, nothing, count=100)
        for told in (alice, bob):
            assert f"no controller gave {OWN_ADDRESS['alice']} its place" in told

    inside(tmp_path, 1, scene, order=lambda _stacks, _session: None)


def test_a_repeater_without_an_order_refuses_its_link_and_alice_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(swap_orders, "ORDER_TIMEOUT_S", 0.2)

    def order(stacks: Stacks, session: int) -> None:
        stacks["alice"].swaps.take(SwapOrder(1, session, 0, RELAYED["r1"]))
        stacks["bob"].swaps.take(SwapOrder(1, session, 2))

    def scene() -> None:
        alice, bob = asked(tmp_path, nothing, count=100)
        for told in (alice, bob):
            assert f"no controller gave {OWN_ADDRESS['r1']} its place" in told

    inside(tmp_path, 1, scene, order=order)


def test_a_link_that_nobody_has_ordered_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(swap_orders, "ORDER_TIMEOUT_S", 0.2)

    async def run() -> None:
        async with chain(tmp_path, 1):
            channel = await MetadataChannel.connect("r1", RELAYED["r1"])
            setup = Setup(5, Service.LINK, 1, "127.0.0.11", 100, 1, 1_000_000)
            with pytest.raises(SessionError) as caught:
                await channel.request(grant(setup))
            assert caught.value.reason == Reason.NOT_ARBITRATED
            channel.close()

    network_loop.run(run())


def test_the_acceptor_names_the_node_that_the_controller_has_not_reached(tmp_path: Path) -> None:
    async def run() -> None:
        async with chain(tmp_path, 1):
            channel = await MetadataChannel.connect("bob", OWN_ADDRESS["bob"])
            setup = Setup(5, Service.SWAP, 1, RELAYED["r1"], 100, 1, 1_000_000)
            told = replace(setup, verdict=Verdict.REFUSED, reason=Reason.NODE_SILENT)
            with pytest.raises(SessionError, match=rf"r1 \({RELAYED['r1']}\) has not answered"):
                await channel.request(
                    sealed(told, "bob", (*channel.connection[2:], *channel.connection[:2]))
                )
            channel.close()

    network_loop.run(run())
