"""Pairs that get too old before they are delivered: whole stacks over loopback, seed 1."""

import asyncio
from collections.abc import Awaitable
from pathlib import Path
from typing import Any

import pytest
from stacks_scene import ask, network, requested

from hosts import network_loop
from hosts.stack_socket import QuantumSocketError
from wire.device import DeviceSettings
from wire.metadata.header import Message
from wire.metadata.values import Topic, Values
from wire.parameters.physics import Device, Memory


def test_old_pairs_are_made_again(tmp_path: Path) -> None:
    """Alice's first message about the pairs that she holds comes to bob when his are too old."""
    held: list[Message] = []

    async def hold(message: Message) -> Message:
        await asyncio.sleep(0.6)  # on its way
        return message

    def change(way: str, message: Message) -> Message | Awaitable[Message]:
        report = isinstance(message, Values) and (message.topic, message.block) == (
            Topic.ARRIVED,
            1,
        )
        if way == "forth" and report:
            held.append(message)
            if len(held) == 2:  # the first is of what has come
                return hold(message)
        return message

    devices = {"bob": Device(memory=Memory(cutoff_s=0.5))}
    options: dict[str, Any] = {"count": 60, "sample": 0}
    physics = {"devices": devices, "change": change}
    alice, bob = ask(tmp_path, "distribute", physics=physics, **options)
    assert alice["pairs"] == bob["pairs"] == 60
    assert alice["dropped"] == bob["dropped"] >= 60
    assert alice["shared"] - alice["dropped"] >= 60


def test_nothing_is_dropped_in_time(tmp_path: Path) -> None:
    devices = dict.fromkeys(("alice", "bob"), Device(memory=Memory(cutoff_s=3600.0)))
    physics: dict[str, Any] = {"devices": devices}
    alice, bob = ask(tmp_path, "distribute", physics=physics, count=5, sample=0)
    assert (alice["pairs"], alice["dropped"], bob["dropped"]) == (5, 0, 0)


def test_the_controller_sets_the_cutoff_of_memories(tmp_path: Path) -> None:
    """No message between programs comes within 50 us."""

    async def run() -> str:
        async with network(tmp_path, settings=DeviceSettings(cutoff_us=50)):
            with pytest.raises(QuantumSocketError) as caught:
                await asyncio.to_thread(requested, tmp_path, "distribute", count=5, sample=0)
        return str(caught.value)

    assert "or choose a longer cut-off than 5e-05 s (memory.cutoff_s" in network_loop.run(run())
