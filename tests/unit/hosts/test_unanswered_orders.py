"""Orders to a dispatcher that takes them and says nothing more."""

# gRPC names the methods.
# ruff: noqa: N802

import asyncio
from collections.abc import AsyncIterator
from typing import Any

import grpc
import pytest
import uvloop
from limits import SOON_S

from hosts.hardware import orders
from hosts.hardware.orders import Orders
from hosts.hardware.replies import HardwareError
from wire.dispatcher_pb2 import ChallengeReply, ChallengeRequest, Order, Outcome, Step, TellRequest
from wire.dispatcher_pb2_grpc import (
    DispatcherServicer,
    DispatcherStub,
    add_DispatcherServicer_to_server,
)

PATIENCE_S = 0.2
TELL = Step(tell=TellRequest(text="unheard"))
ANSWERED = Step(tell=TellRequest(text="heard"))


class SilentDispatcher(DispatcherServicer):
    """Answers those orders alone that say that they are heard."""

    def __init__(self) -> None:
        self.cancelled: asyncio.Queue[int] = asyncio.Queue()

    async def Challenge(self, _request: ChallengeRequest, _context: Any) -> ChallengeReply:
        return ChallengeReply(nonce=bytes(16))

    async def Perform(self, coming: AsyncIterator[Order], _context: Any) -> AsyncIterator[Outcome]:
        async for order in coming:
            if order.cancel:
                self.cancelled.put_nowait(order.number)
            elif order.steps[0].tell.text == "heard":
                yield Outcome(number=order.number)


def test_what_the_dispatcher_does_not_answer_is_given_up_and_cancelled(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(orders, "DISPATCHER_TIMEOUT_S", PATIENCE_S)

    async def run() -> None:
        server, dispatcher = grpc.aio.server(), SilentDispatcher()
        add_DispatcherServicer_to_server(dispatcher, server)  # type: ignore[no-untyped-call]
        port = server.add_insecure_port("127.0.0.1:0")
        await server.start()
        async with asyncio.timeout(SOON_S), grpc.aio.insecure_channel(f"127.0.0.1:{port}") as c:
            given = Orders(DispatcherStub(c), "token")  # type: ignore[no-untyped-call]
            earlier = asyncio.create_task(given.perform(TELL))
            await asyncio.sleep(0)
            assert await given.perform(ANSWERED) == []
            later = asyncio.create_task(given.perform(TELL))
            for number, task in ((1, earlier), (3, later)):
                with pytest.raises(HardwareError, match=r"no answer in 0\.2 s"):
                    await task
                assert await dispatcher.cancelled.get() == number
            await given.close()
        await server.stop(None)

    uvloop.run(run())


def test_what_nobody_waits_for_any_more_is_cancelled_at_once() -> None:
    """The limit of the answer is far away then."""

    async def run() -> None:
        server, dispatcher = grpc.aio.server(), SilentDispatcher()
        add_DispatcherServicer_to_server(dispatcher, server)  # type: ignore[no-untyped-call]
        port = server.add_insecure_port("127.0.0.1:0")
        await server.start()
        async with asyncio.timeout(SOON_S), grpc.aio.insecure_channel(f"127.0.0.1:{port}") as c:
            given = Orders(DispatcherStub(c), "token")  # type: ignore[no-untyped-call]
            left, stays = (asyncio.create_task(given.perform(TELL)) for _ in range(2))
            await asyncio.sleep(0)
            assert await given.perform(ANSWERED) == []
            left.cancel()
            assert await dispatcher.cancelled.get() == 1
            assert await given.perform(ANSWERED) == []
            assert dispatcher.cancelled.empty()
            assert not stays.done()
            stays.cancel()
            assert await dispatcher.cancelled.get() == 2
            await given.close()
        await server.stop(None)

    uvloop.run(run())


class ForgetfulDispatcher(SilentDispatcher):
    """Does not even answer who asks for its challenge."""

    async def Challenge(self, _request: ChallengeRequest, _context: Any) -> ChallengeReply:
        await asyncio.sleep(SOON_S)
        return ChallengeReply()


def test_a_dispatcher_that_gives_no_challenge_is_told_to_be_silent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(orders, "DISPATCHER_TIMEOUT_S", PATIENCE_S)

    async def run() -> None:
        server = grpc.aio.server()
        add_DispatcherServicer_to_server(ForgetfulDispatcher(), server)  # type: ignore[no-untyped-call]
        port = server.add_insecure_port("127.0.0.1:0")
        await server.start()
        async with asyncio.timeout(SOON_S), grpc.aio.insecure_channel(f"127.0.0.1:{port}") as c:
            with pytest.raises(grpc.aio.AioRpcError) as caught:
                await orders.proved(DispatcherStub(c), "token", "Perform")  # type: ignore[no-untyped-call]
            assert orders.problem_of(caught.value) == "no answer in 0.2 s"
        await server.stop(None)

    uvloop.run(run())
