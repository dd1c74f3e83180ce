"""The two bits of each teleported state: nothing is corrected before they are there, or without."""

import asyncio
import io
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from limits import SOON_S
from stacks_scene import Change, accepted, network, requested

from hosts import network_loop
from hosts.middleware.session.values import numbers_of, values
from hosts.service_socket import ServiceSocket
from hosts.stack_socket import QuantumSocketError
from wire.metadata.header import Message
from wire.metadata.values import Topic, Values

COUNT, BLOCK = 6000, 1500
HELD_S = 0.05  # much longer than bob takes to store light and ask for it again


def is_bits(way: str, message: Message) -> bool:
    return way == "forth" and isinstance(message, Values) and message.topic == Topic.CORRECTIONS


def teleported(folder: Path, change: Change, events: io.StringIO) -> list[dict[str, Any]]:
    """Teleport over a network in which somebody may hold and change packets."""

    async def run() -> list[dict[str, Any]]:
        async with network(folder, change=change, events=events):
            return await asyncio.to_thread(
                requested, folder, "teleport", count=COUNT, block_pairs=BLOCK
            )

    return network_loop.run(run())


def touched(events: io.StringIO) -> list[str]:
    """Return what bob has done to his halves, by the dispatcher's own record."""
    lines = (line.split() for line in events.getvalue().splitlines())
    doings = ("recall", "apply", "measure")
    return [kind for _time, node, kind, *_rest in lines if node == "bob" and kind in doings]


def test_nothing_is_done_to_a_half_before_its_bits_are_there(tmp_path: Path) -> None:
    events = io.StringIO()
    held: list[int] = []  # how much bob had done when each block's bits had been held for long

    async def change(way: str, message: Message) -> Message:
        if is_bits(way, message):
            before = len(touched(events))
            await asyncio.sleep(HELD_S)
            assert "store" in events.getvalue()
            held.append(len(touched(events)) - before)
        return message

    alice, _bob = teleported(tmp_path, change, events)
    assert held == [0] * (COUNT // BLOCK)
    assert touched(events) == ["recall", "apply", "measure"] * (COUNT // BLOCK)
    assert (alice["arrived"], alice["fidelity"]) == (COUNT, 1)
    assert alice["waited_ms"] > 1000 * HELD_S


@pytest.mark.parametrize(("flip", "fidelity"), [(1, 1 / 3), (2, 1 / 3), (3, 1 / 3)])
def test_what_is_corrected_by_is_what_the_packet_says(
    tmp_path: Path, flip: int, fidelity: float
) -> None:
    """Other bits are another Pauli operator, which two of the six states do not notice."""

    def change(way: str, message: Message) -> Message:
        if not is_bits(way, message):
            return message
        assert isinstance(message, Values)
        return values(message.session, message.topic, message.block, numbers_of(message) ^ flip, 2)

    alice, _bob = teleported(tmp_path, change, io.StringIO())
    assert abs(alice["fidelity"] - fidelity) < 5 * sqrt(fidelity * (1 - fidelity) / COUNT)


def test_without_the_bits_there_is_nothing_but_noise(tmp_path: Path) -> None:
    def change(way: str, message: Message) -> Message:
        if not is_bits(way, message):
            return message
        assert isinstance(message, Values)
        return replace(message, data=bytes(len(message.data)))

    alice, _bob = teleported(tmp_path, change, io.StringIO())
    assert abs(alice["fidelity"] - 1 / 2) < 5 * sqrt(1 / 4 / COUNT)


def test_if_the_bits_never_come_nothing_is_done_to_the_halves_and_both_ends_are_told(
    tmp_path: Path,
) -> None:
    events = io.StringIO()

    def change(way: str, message: Message) -> Message | None:
        return None if is_bits(way, message) else message

    def asked() -> None:
        with ThreadPoolExecutor(1) as pool, ServiceSocket(tmp_path / "alice.sock") as asking:
            listening: Future[None] = Future()
            bob = pool.submit(accepted, tmp_path, "teleport", listening)
            listening.result(SOON_S)
            asking.settimeout(SOON_S)
            for end in (lambda: list(asking.request("teleport", ("bob", 9))), bob.result):
                with pytest.raises(QuantumSocketError, match="closed"):
                    end()

    async def run() -> None:
        async with network(tmp_path, change=change, events=events):
            await asyncio.to_thread(asked)

    network_loop.run(run())
    assert "store" in events.getvalue()
    assert touched(events) == []


def test_bits_are_as_random_as_the_states_are_hidden(tmp_path: Path) -> None:
    """A reader of the packets learns nothing of any state."""
    seen: list[int] = []

    def change(way: str, message: Message) -> Message:
        if is_bits(way, message):
            assert isinstance(message, Values)
            seen.extend(numbers_of(message).tolist())
        return message

    teleported(tmp_path, change, io.StringIO())
    counts = np.bincount(seen, minlength=4)
    assert counts.sum() == COUNT
    assert (np.abs(counts - COUNT / 4) < 5 * sqrt(COUNT * 3 / 16)).all()
