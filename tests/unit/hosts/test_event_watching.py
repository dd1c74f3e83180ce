"""An application on a host sees what happens there, through the stack, and nothing else."""

import asyncio
import json
import os
import signal
import subprocess
import sys
from itertools import islice
from pathlib import Path

import pytest
from forked_python import Forked
from limits import SOON_S
from stacks_scene import network, transfer

from hosts import network_loop
from hosts.quantum_socket import QuantumSocket, QuantumSocketError
from wire.dispatcher_pb2 import Event


def watched(folder: Path, name: str, count: int) -> list[Event]:
    """Return the first events that a host remembers."""
    with QuantumSocket(folder / f"{name}.sock") as quantum_socket:
        quantum_socket.settimeout(10)
        return list(islice(quantum_socket.watch(history=True), count))


def test_a_host_sees_its_own_events_alone(tmp_path: Path) -> None:
    async def run() -> None:
        async with network(tmp_path):
            await asyncio.to_thread(transfer, tmp_path, b"x")
            alice = await asyncio.to_thread(watched, tmp_path, "alice", 4)
            bob = await asyncio.to_thread(watched, tmp_path, "bob", 5)
        assert [event.kind for event in alice] == ["arrive", "receive", "apply", "send"]
        assert {event.node for event in alice} == {"alice"}
        assert {event.node for event in bob} == {"bob"}
        assert bob[-1].kind == "bell-measure"

    network_loop.run(asyncio.wait_for(run(), 30))


def test_without_following_it_ends_behind_what_is_remembered(tmp_path: Path) -> None:
    async def run() -> None:
        async with network(tmp_path):
            await asyncio.to_thread(transfer, tmp_path, b"x")
            lines, text = await asyncio.to_thread(spied, tmp_path, "--history", "--no-follow")
            assert [line.split()[2] for line in lines] == ["arrive", "receive", "apply", "send"]
            assert text == "qmn: 4 events shown, 0 dropped\n"

    network_loop.run(asyncio.wait_for(run(), 30))


def test_neither_history_nor_following_is_refused(tmp_path: Path) -> None:
    _, text = spied(tmp_path, "--no-follow")
    assert text == "qmn: --no-follow on alice: add --history, or there is nothing to show\n"


@pytest.mark.parametrize(
    "fields",
    [{"session": -1}, {"session": 1 << 64}, {"session": "1"}, {"history": 1}, {"follow": 0}],
)
def test_a_request_that_cannot_be_is_refused(tmp_path: Path, fields: dict[str, int]) -> None:
    def refused() -> str:
        with QuantumSocket(tmp_path / "alice.sock") as quantum_socket:
            quantum_socket.settimeout(10)
            with pytest.raises(QuantumSocketError) as caught:
                next(quantum_socket.watch(**fields))  # type: ignore[arg-type]
            return str(caught.value)

    async def run() -> None:
        async with network(tmp_path):
            assert "give a number and two bools" in await asyncio.to_thread(refused)

    network_loop.run(asyncio.wait_for(run(), 30))


def spied(folder: Path, *words: str, lines: int = 0) -> tuple[list[str], str]:
    """Run the verb as on host alice; interrupt it after some lines."""
    with Forked(
        [sys.executable, "-m", "qmn", "spy", *words],
        env={**os.environ, "QMN_STACK": str(folder / "alice.sock")},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as spy:
        assert spy.stdout
        shown = [spy.stdout.readline() for _ in range(lines)]
        if lines:
            spy.send_signal(signal.SIGINT)
        rest, text = spy.communicate(timeout=SOON_S)
        return shown or rest.splitlines(), text


def test_the_verb_on_a_host_shows_what_happens_there(tmp_path: Path) -> None:
    async def run() -> None:
        async with network(tmp_path):
            await asyncio.to_thread(transfer, tmp_path, b"x")
            words = "--history", "--json", "--kind", "apply"
            lines, text = await asyncio.to_thread(spied, tmp_path, *words, lines=1)
            assert json.loads(lines[0])["node"] == "alice"
            assert text == "qmn: 1 events shown, 0 dropped\n"
            _, text = await asyncio.to_thread(spied, tmp_path, "--node", "bob")
            assert (
                text == "qmn: --node bob: a host shows only its own events, here those of alice\n"
            )

    network_loop.run(asyncio.wait_for(run(), 60))
