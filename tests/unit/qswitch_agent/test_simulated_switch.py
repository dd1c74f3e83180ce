"""The simulated switch's driver against a gRPC server that knows CrossConnect alone."""

import asyncio
import time
from collections.abc import AsyncIterator, Coroutine
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import grpc
import pytest

from qswitch_agent.hardware import simulated as hardware
from qswitch_agent.hardware.optics import HardwareFault, HardwareRefusal, SimulatedSwitch
from qswitch_agent.middleware import CrossConnect
from wire.dispatcher_pb2 import CrossConnectReply, CrossConnectRequest
from wire.service import TOKEN_KEY

DEADLINE_S = 5.0


def play(scene: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(scene, DEADLINE_S))


class Dispatcher:
    """Answers as it is told, and keeps what it was asked."""

    def __init__(self) -> None:
        self.requests: list[CrossConnectRequest] = []
        self.tokens: list[Any] = []
        self.code: grpc.StatusCode | None = None
        self.switching_s = 0.0
        self.answering = asyncio.Event()
        self.answering.set()

    async def cross_connect(self, request: Any, context: Any) -> CrossConnectReply:
        self.requests.append(request)
        self.tokens.append(dict(context.invocation_metadata())[TOKEN_KEY])
        await self.answering.wait()
        if self.code is not None:
            await context.abort(self.code, "for a reason")
        self.ready_ns = time.time_ns() + int(self.switching_s * 1e9)
        return CrossConnectReply(ready_ns=self.ready_ns)


@asynccontextmanager
async def simulation(socket: Path) -> AsyncIterator[tuple[Dispatcher, Any, SimulatedSwitch]]:
    dispatcher, server = Dispatcher(), grpc.aio.server()
    handler = grpc.unary_unary_rpc_method_handler(
        dispatcher.cross_connect,
        request_deserializer=CrossConnectRequest.FromString,
        response_serializer=CrossConnectReply.SerializeToString,
    )
    server.add_generic_rpc_handlers(
        (grpc.method_handlers_generic_handler("qmn.Dispatcher", {"CrossConnect": handler}),)
    )
    server.add_insecure_port(f"unix:{socket}")
    await server.start()
    switch = SimulatedSwitch("q1", str(socket), "secret")
    yield dispatcher, server, switch
    await switch.close()
    await server.stop(None)


def test_complete_set_and_token_arrive(tmp_path: Path) -> None:
    async def scene() -> None:
        async with simulation(tmp_path / "ed") as (dispatcher, _server, switch):
            await switch.set_cross_connects({CrossConnect(3, 4), CrossConnect(1, 2)})
            await switch.set_cross_connects(())
            first, second = dispatcher.requests
            assert first.switch == "q1"
            assert [(one.in_port, one.out_port) for one in first.connections] == [(1, 2), (3, 4)]
            assert not second.connections
            assert dispatcher.tokens == ["secret", "secret"]

    play(scene())


def test_switching_time_is_waited_for(tmp_path: Path) -> None:
    async def scene() -> None:
        async with simulation(tmp_path / "ed") as (dispatcher, _server, switch):
            dispatcher.switching_s = 0.05
            await switch.set_cross_connects(())
            assert time.time_ns() >= dispatcher.ready_ns

    play(scene())


def test_endless_switching_time_is_a_fault(tmp_path: Path) -> None:
    async def scene() -> None:
        async with simulation(tmp_path / "ed") as (dispatcher, _server, switch):
            dispatcher.switching_s = 60.0
            with pytest.raises(HardwareFault, match=r"q1 needs .* s to switch"):
                await switch.set_cross_connects(())

    play(scene())


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        (grpc.StatusCode.INVALID_ARGUMENT, HardwareRefusal),
        (grpc.StatusCode.NOT_FOUND, HardwareRefusal),
        (grpc.StatusCode.UNAUTHENTICATED, HardwareFault),
        (grpc.StatusCode.PERMISSION_DENIED, HardwareFault),
        (grpc.StatusCode.UNAVAILABLE, HardwareFault),
        (grpc.StatusCode.INTERNAL, HardwareFault),
    ],
)
def test_status_tells_refusal_from_fault(
    tmp_path: Path, code: grpc.StatusCode, expected: type[Exception]
) -> None:
    async def scene() -> None:
        async with simulation(tmp_path / "ed") as (dispatcher, _server, switch):
            dispatcher.code = code
            with pytest.raises(expected, match=f"{code.name}: for a reason"):
                await switch.set_cross_connects(())

    play(scene())


def test_silent_dispatcher_is_a_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hardware, "CALL_DEADLINE_S", 0.05)

    async def scene() -> None:
        async with simulation(tmp_path / "ed") as (dispatcher, _server, switch):
            dispatcher.answering.clear()
            with pytest.raises(HardwareFault, match="DEADLINE_EXCEEDED"):
                await switch.set_cross_connects(())

    play(scene())


def test_absent_dispatcher_is_a_fault(tmp_path: Path) -> None:
    async def scene() -> None:
        switch = SimulatedSwitch("q1", str(tmp_path / "nobody"), "secret")
        with pytest.raises(HardwareFault, match="nobody does not answer"):
            await switch.set_cross_connects(())
        await switch.close()

    play(scene())


def test_watch_ends_with_the_dispatcher(tmp_path: Path) -> None:
    async def scene() -> None:
        async with simulation(tmp_path / "ed") as (_dispatcher, server, switch):
            watching = asyncio.create_task(switch.watch())
            await switch.set_cross_connects(())
            assert not watching.done()
            await server.stop(None)
            with pytest.raises(HardwareFault, match="its connection ended"):
                await watching

    play(scene())
