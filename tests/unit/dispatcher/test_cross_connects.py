"""The socket for cross-connects: who may use it for what, and what it makes of rubbish."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, closing
from dataclasses import replace
from pathlib import Path

import grpc
import pytest
import uvloop
from dispatcher_network import Bench, JumpingClock, configuration, running
from limits import SOON_S

from wire import dispatcher_service
from wire.config import QuantumSwitch
from wire.dispatcher_pb2 import Connection, CrossConnectOutcome, CrossConnectRequest

Code = grpc.StatusCode
TOKEN = dispatcher_service.encode(b"token of q1")


def cross_connect(*connections: tuple[int, int], switch: str = "q1") -> CrossConnectRequest:
    """Return the request that sets cross-connects."""
    ports = [Connection(in_port=i, out_port=o) for i, o in connections]
    return CrossConnectRequest(switch=switch, connections=ports)


def play(folder: Path, scene: Callable[[Bench], Awaitable[None]]) -> None:
    """Run a scene on the network."""

    async def run() -> None:
        async with running(configuration(folder), JumpingClock()) as bench:
            await asyncio.wait_for(scene(bench), SOON_S)

    uvloop.run(run())


@asynccontextmanager
async def connection(
    bench: Bench,
) -> AsyncIterator[tuple[asyncio.StreamReader, asyncio.StreamWriter]]:
    """Connect to the socket, and say nothing yet."""
    reader, writer = await asyncio.open_unix_connection(bench.socket)
    with closing(writer):
        yield reader, writer


def paths(bench: Bench) -> dict[int, int]:
    """Return the cross-connects that there are."""
    return bench.layer.network.switches["q1"].timeline.connections


@pytest.mark.parametrize(
    ("node", "request_", "code", "text"),
    [
        ("alice", cross_connect((1, 3)), Code.PERMISSION_DENIED, "its own agent"),
        ("runner", cross_connect((1, 3)), Code.PERMISSION_DENIED, "its own agent"),
        ("eve", cross_connect((1, 3)), Code.UNAUTHENTICATED, "unknown token"),
        ("q1", cross_connect((1, 9)), Code.NOT_FOUND, "port 9 of q1"),
        ("q1", cross_connect((1, 3), switch="q2"), Code.NOT_FOUND, "there is q1"),
        ("q1", cross_connect((1, 3), (1, 4)), Code.INVALID_ARGUMENT, "port 1 is named twice"),
        ("q1", cross_connect((1, 3), (2, 3)), Code.INVALID_ARGUMENT, "share output"),
    ],
)
def test_refused_cross_connects_say_why_and_change_nothing(
    tmp_path: Path, node: str, request_: CrossConnectRequest, code: grpc.StatusCode, text: str
) -> None:
    async def scene(bench: Bench) -> None:
        await bench.switch.connect((2, 4))
        events = bench.layer.history.count
        async with connection(bench) as (reader, writer):
            writer.write(dispatcher_service.encode(f"token of {node}".encode()))
            for _again in range(2):  # it goes on
                writer.write(dispatcher_service.encode(request_.SerializeToString()))
                outcome = CrossConnectOutcome.FromString(await dispatcher_service.read(reader))
                assert outcome.code == code.value[0]
                assert text in outcome.text
        assert paths(bench) == {2: 4}
        assert bench.layer.history.count == events

    play(tmp_path, scene)


def test_the_agent_of_one_switch_cannot_act_on_another(tmp_path: Path) -> None:
    before = configuration(tmp_path)
    tokens = {**before.tokens, "q2": "token of q2"}
    config = replace(before, tokens=tokens, switches=[QuantumSwitch("q1"), QuantumSwitch("q2")])

    async def run() -> None:
        async with running(config, JumpingClock()) as bench:
            await bench.switch.connect((2, 4))
            other = bench._clients["q2"]
            outcome = await other.cross_connect(cross_connect((1, 3)))
            assert outcome.code == Code.PERMISSION_DENIED.value[0]
            assert "q2 may not cross-connect q1" in outcome.text
            for attempt in (other.tune(1, power_dbm=-3), other.statistics()):
                with pytest.raises(grpc.aio.AioRpcError) as refused:
                    await attempt
                assert refused.value.code() is Code.PERMISSION_DENIED
            with pytest.raises(grpc.aio.AioRpcError, match="q2 may not read q1"):
                await other.watch_switch().read()
            assert paths(bench) == {2: 4}
            assert (await bench.switch.statistics()).ports[0].power_dbm == 0
            own = await other.cross_connect(cross_connect(switch="q2"))
            assert own.code == 0

    uvloop.run(run())


@pytest.mark.parametrize(
    "text",
    [
        dispatcher_service.encode(b"\xff"),  # no token: it is not text
        TOKEN + dispatcher_service.encode(b"\xff"),  # no request
        TOKEN + dispatcher_service.LENGTH.pack(dispatcher_service.MAX_LENGTH + 1),
    ],
)
def test_rubbish_ends_its_connection_and_no_other(tmp_path: Path, text: bytes) -> None:
    async def scene(bench: Bench) -> None:
        async with connection(bench) as (reader, writer):
            writer.write(text)
            assert await reader.read() == b""
        await bench.switch.connect((1, 3))
        assert paths(bench) == {1: 3}

    play(tmp_path, scene)


@pytest.mark.parametrize(
    "text", [b"", TOKEN[:3], TOKEN, TOKEN + dispatcher_service.LENGTH.pack(9) + b"\n"]
)
def test_a_connection_that_ends_early_changes_nothing(tmp_path: Path, text: bytes) -> None:
    async def scene(bench: Bench) -> None:
        async with connection(bench) as (reader, writer):
            writer.write(text)
            writer.write_eof()
            assert await reader.read() == b""
        assert paths(bench) == {}

    play(tmp_path, scene)


def test_requests_of_one_connection_are_answered_in_their_order(tmp_path: Path) -> None:
    async def scene(bench: Bench) -> None:
        async with connection(bench) as (reader, writer):
            asked = [cross_connect((1, 3)), cross_connect((1, 9)), cross_connect((2, 4))]
            requests = [dispatcher_service.encode(one.SerializeToString()) for one in asked]
            writer.write(TOKEN + b"".join(requests))
            outcomes = [
                CrossConnectOutcome.FromString(await dispatcher_service.read(reader)) for _ in asked
            ]
        assert [outcome.code for outcome in outcomes] == [0, Code.NOT_FOUND.value[0], 0]
        assert outcomes[0].ready_ns < outcomes[2].ready_ns
        assert paths(bench) == {2: 4}
        kinds = [(event.kind, event.detail) for event in bench.layer.history._events]
        assert kinds == [("open", "1 -> 3"), ("close", "1 -> 3"), ("open", "2 -> 4")]

    play(tmp_path, scene)
