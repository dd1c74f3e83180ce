"""The client of sessions, which calls the stack of every host that takes part."""

import asyncio
import socket
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from limits import SOON_S
from stacks_scene import live_qubits, network, stacks_in

from hosts import network_loop
from hosts.client import blocking_session, session
from hosts.stack_socket import BYTES, QuantumSocketError, StackEnded
from wire.metadata.vocabulary import Reason

ENDS = ("alice", "bob")
PAIRS = 60
Silent = dict[str, socket.socket]


@pytest.fixture
def silent(tmp_path: Path) -> Iterator[Silent]:
    """Sockets in the place of stacks, which take connections and answer nothing."""
    with ExitStack() as sockets:
        found = {}
        for host in ENDS:
            listener = sockets.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
            listener.bind(str(tmp_path / f"{host}.sock"))
            listener.listen()
            found[host] = listener
        yield found


def test_pairs_of_both_ends_agree_as_phi_plus_does(tmp_path: Path) -> None:
    """Both halves of Phi+ are equal in X and Z, and differ in Y."""

    async def run() -> dict[str, int]:
        options: dict[str, Any] = {"limit_s": SOON_S, "count": PAIRS, "sample": 0.0}
        equal = {}
        async with network(tmp_path):
            stacks = stacks_in(tmp_path)
            async with session(stacks, "distribute", ENDS, 9, **options) as pairs:
                results = await pairs.results()
                assert results[-1]["pairs"] == pairs.opener.summary["pairs"] == PAIRS
                for place, basis in enumerate("XYZ"):
                    numbers = list(range(place, PAIRS, 3))
                    one, other = await pairs.ask(measure=numbers, basis=basis)
                    both = zip(one["outcomes"], other["outcomes"], strict=True)
                    equal[basis] = sum(a == b for a, b in both)
                with pytest.raises(QuantumSocketError, match="choose") as caught:
                    await pairs.ask(measure=[0], basis="W")
                assert caught.value.reason == Reason.UNSUPPORTED
                await pairs.end()
                assert pairs.opener.over
            assert await live_qubits(tmp_path) == 0
        return equal

    assert network_loop.run(run()) == {"X": PAIRS // 3, "Y": 0, "Z": PAIRS // 3}


def test_bytes_arrive_while_others_are_sent(tmp_path: Path) -> None:
    data = bytes(range(256)) * 16
    got = bytearray()

    def carry() -> None:
        options: dict[str, Any] = {"limit_s": SOON_S, "take": got.extend}
        stacks = stacks_in(tmp_path)
        with (
            ThreadPoolExecutor(1) as threads,
            blocking_session(stacks, BYTES, ENDS, 7, **options) as carrying,
        ):
            assert carrying.results() == []
            sending = threads.submit(carrying.sendall, data)
            sending.result(SOON_S)
            carrying.sendall(data)
            carrying.end()
            assert carrying.summary["delivered_bytes"] == len(got) == 2 * len(data)

    _with_network(tmp_path, carry)
    assert bytes(got) == 2 * data


def test_who_leaves_a_session_waits_no_longer_for_those_who_take_part(tmp_path: Path) -> None:
    async def leave() -> None:
        async with network(tmp_path):
            async with asyncio.timeout(SOON_S / 4):
                stacks = stacks_in(tmp_path)
                async with session(stacks, BYTES, ENDS, 7, limit_s=10 * SOON_S) as carrying:
                    await carrying.results()

    network_loop.run(leave())


def test_a_session_that_is_left_is_broken_off_and_another_one_begins(tmp_path: Path) -> None:
    def leave_and_return() -> None:
        stacks = stacks_in(tmp_path)
        for _turn in range(2):
            with blocking_session(stacks, BYTES, ENDS, 7, limit_s=SOON_S) as carrying:
                carrying.results()

    _with_network(tmp_path, leave_and_return)


def test_a_refusal_names_its_reason(tmp_path: Path) -> None:
    def ask() -> None:
        stacks = stacks_in(tmp_path)
        with (
            pytest.raises(QuantumSocketError, match="did you mean rate_hz") as caught,
            blocking_session(stacks, "bb84", ENDS, 9, limit_s=SOON_S, rate=7) as asked,
        ):
            asked.results()
        assert caught.value.reason == Reason.UNSUPPORTED

    _with_network(tmp_path, ask)


def test_a_host_without_a_stack_is_named(tmp_path: Path) -> None:
    with (
        pytest.raises(QuantumSocketError, match=f"no host stack answers at {tmp_path}/bob.sock"),
        blocking_session(stacks_in(tmp_path), BYTES, ENDS, 7, limit_s=SOON_S),
    ):
        pass


def test_a_stack_that_answers_nothing_is_waited_for_until_the_limit(
    tmp_path: Path, silent: Silent
) -> None:
    assert silent
    began = time.monotonic()
    with (
        pytest.raises(TimeoutError),
        blocking_session(stacks_in(tmp_path), BYTES, ENDS, 7, limit_s=0.2),
    ):
        pass
    assert 0.2 <= time.monotonic() - began < SOON_S


def test_a_stack_that_ends_is_named(tmp_path: Path, silent: Silent) -> None:
    async def run() -> None:
        async with session(stacks_in(tmp_path), BYTES, ENDS, 7, limit_s=SOON_S):
            pass

    async def end_it() -> None:
        connection, _address = await asyncio.to_thread(silent["bob"].accept)
        connection.close()

    async def both() -> None:
        await asyncio.gather(run(), end_it())

    with pytest.raises(StackEnded, match="the host's stack has ended"):
        asyncio.run(both())


def _with_network(folder: Path, work: Callable[[], None]) -> None:
    async def run() -> None:
        async with network(folder):
            await asyncio.to_thread(work)
            assert await live_qubits(folder) == 0

    network_loop.run(run())
