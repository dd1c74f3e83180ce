"""The rights of each caller, and that a refused request changes nothing."""

import asyncio
import re
from pathlib import Path
from typing import cast

import grpc
import pytest
from dispatcher_network import (
    START_NS,
    Bench,
    Client,
    block,
)
from limits import SOON_S, until
from requests_scene import MINE, REFUSED, Code, attempt, create, launch, prepare

from wire.dispatcher_pb2 import (
    ApplyRequest,
    CreateRequest,
    DiscardRequest,
    Gate,
    MeasureRequest,
    StatusRequest,
)


@pytest.mark.parametrize("node", sorted({node for node, *_ in REFUSED}))
def test_refused_requests_say_why_and_change_nothing(tmp_path: Path, node: str) -> None:
    async def action(bench: Bench) -> None:
        await prepare(bench)
        before = await bench.runner.status()
        for caller, request, code, message in REFUSED:
            if caller == node:
                client = Client(bench.stub, f"token of {node}")
                print(request)  # the last one is shown if it is not refused
                with pytest.raises(grpc.aio.AioRpcError) as refusal:
                    await client.act(request)
                assert refusal.value.code() == code, (message, request)
                assert re.search(message, str(refusal.value)), (message, request)
                assert await bench.runner.status() == before, request
        # All is as it was: alice's photons are still hers and still Phi+.
        assert (await bench.alice.bell_measure(block(0, 0), block(0, 1))).outcomes == bytes(4)

    attempt(tmp_path, action, max_live_qubits=100)


def test_an_emission_longer_than_switches_remember_is_refused(tmp_path: Path) -> None:
    async def action(bench: Bench) -> None:
        await bench.alice.create(31)
        with pytest.raises(grpc.aio.AioRpcError, match="take 31 s") as refusal:
            await bench.alice.act(launch(MINE, rate_hz=1))
        assert refusal.value.code() == Code.INVALID_ARGUMENT

    attempt(tmp_path, action)


@pytest.mark.parametrize("token", ["", "token of eve", "token of alice "])
def test_a_wrong_token_is_unauthenticated(tmp_path: Path, token: str) -> None:
    async def action(bench: Bench) -> None:
        client = Client(bench.stub, token)
        # Of a stream that has messages the client may hear that it could not write them.
        stream = bench.stub.Perform(iter(()), metadata=client.metadata, timeout=SOON_S)
        for reply in (stream.read(), client.status()):
            with pytest.raises(grpc.aio.AioRpcError) as refusal:
                await reply
            assert refusal.value.code() == Code.UNAUTHENTICATED
        assert (await bench.runner.status()).events == 0

    attempt(tmp_path, action)


def test_a_call_without_a_token_is_unauthenticated(tmp_path: Path) -> None:
    async def action(bench: Bench) -> None:
        with pytest.raises(grpc.aio.AioRpcError, match="no token") as refusal:
            await bench.stub.Status(StatusRequest(), timeout=SOON_S)
        assert refusal.value.code() == Code.UNAUTHENTICATED

    attempt(tmp_path, action)


def test_a_block_that_was_sent_belongs_to_its_receiver_alone(tmp_path: Path) -> None:
    """Its sender cannot find out by asking whether its receiver has measured it."""

    async def action(bench: Bench) -> None:
        await bench.alice.create(4)
        await bench.alice.send((MINE, "alice-q9"))
        await bench.bob.receive(MINE, "bob-q9")
        answers = []
        for _ in range(2):
            with pytest.raises(grpc.aio.AioRpcError) as refusal:
                await bench.alice.measure(MINE)
            answers.append((refusal.value.code(), refusal.value.details()))
            if len(answers) == 1:
                assert (await bench.bob.measure(MINE)).clicks == 4
        assert answers[0] == answers[1]
        assert answers[0][0] == Code.PERMISSION_DENIED
        with pytest.raises(grpc.aio.AioRpcError, match="not at bob") as refusal:
            await bench.bob.measure(MINE)
        assert refusal.value.code() == Code.PERMISSION_DENIED

    attempt(tmp_path, action)


def test_discarding_a_session_takes_what_is_at_the_node_and_its_ports(tmp_path: Path) -> None:
    async def action(bench: Bench) -> None:
        await prepare(bench)
        await bench.bob.act(create(session=8, count=3))
        dropped = await bench.bob.discard(DiscardRequest(session=7))
        assert dropped.photons == 4 + 4 + 4  # both halves of 1, and 4 at the port
        assert (await bench.bob.measure(block(50, session=8))).clicks == 3
        dropped = await bench.bob.discard(DiscardRequest(session=7))
        assert dropped.photons == 0

    attempt(tmp_path, action)


def test_clifford_gates_apply_in_order_after_the_paulis(tmp_path: Path) -> None:
    async def action(bench: Bench) -> None:
        await prepare(bench)
        # X, then H S S H = X again: |0> for all, and with CX nothing is flipped.
        names = (Gate.H, Gate.S, Gate.S, Gate.H)
        request = ApplyRequest(
            block=block(2),
            paulis=bytes((1, 1, 1, 0)),
            gates=[*(Gate(name=name) for name in names), Gate(name=Gate.CX, target=block(0, 1))],
        )
        await bench.alice.act(request)
        assert (await bench.alice.measure(block(2))).outcomes == bytes((0, 0, 0, 1))
        measured = await bench.alice.bell_measure(block(0, 0), block(0, 1))
        assert measured.outcomes == bytes((0, 0, 0, 1))

    attempt(tmp_path, action)


def test_bases_may_differ_from_photon_to_photon(tmp_path: Path) -> None:
    async def action(bench: Bench) -> None:
        await bench.alice.create(300)
        bases = bytes(range(3)) * 100
        ours = await bench.alice.act(MeasureRequest(block=block(0, 0), bases=bases))
        theirs = await bench.alice.act(MeasureRequest(block=block(0, 1), bases=bases))
        agree = [a == b for a, b in zip(ours.outcomes, theirs.outcomes, strict=True)]
        assert agree == [True, True, False] * 100

    attempt(tmp_path, action)


def test_feedback_carries_times_and_clicks(tmp_path: Path) -> None:
    async def action(bench: Bench) -> None:
        await bench.alice.create(11, state=CreateRequest.ZEROS)
        await bench.alice.send((MINE, "alice-q9"))
        received = await bench.bob.receive(MINE, "bob-q9")
        assert (received.first_ns, received.last_ns) == (START_NS + 49, START_NS + 59)
        measured = await bench.bob.measure(MINE)
        assert (measured.first_ns, measured.last_ns) == (received.first_ns, received.last_ns)
        assert (measured.photons, measured.clicks, measured.outcomes) == (11, 11, bytes(11))

    attempt(tmp_path, action)


def test_a_block_as_large_as_allowed_passes(tmp_path: Path) -> None:
    async def action(bench: Bench) -> None:
        await bench.alice.create(4_000_000)
        await bench.alice.apply(MINE, bytes([2]) * 4_000_000)
        measured = await bench.alice.bell_measure(block(0, 0), block(0, 1))
        assert measured.outcomes == bytes([2]) * 4_000_000

    # A share of one in three for alice.
    attempt(tmp_path, action, max_live_qubits=3 * 8_000_000)


def test_a_caller_that_goes_away_leaves_nothing_behind(tmp_path: Path) -> None:
    async def action(bench: Bench) -> None:
        # A caller that is still waiting, so that the other must have been seen to leave.
        leaving, staying = (
            asyncio.ensure_future(bench.bob.receive(MINE, "bob-q9")) for _ in range(2)
        )
        waiting = bench.transport._waiting
        await until(lambda: sum(map(len, waiting.values())) == 2)
        leaving.cancel()
        await until(lambda: sum(map(len, waiting.values())) == 1)
        await bench.alice.create(3)
        await bench.alice.send((MINE, "alice-q9"))
        assert (await staying).photons == 3
        assert not waiting

    attempt(tmp_path, action)


def test_an_unexpected_error_is_reported_to_end_the_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def action(bench: Bench) -> None:
        await bench.alice.create(1)
        monkeypatch.delattr(bench.layer.sabot, "_store")
        with pytest.raises(grpc.aio.AioRpcError) as failure:
            await bench.alice.measure(MINE)
        assert failure.value.code() == Code.UNKNOWN
        (error,) = cast(BaseExceptionGroup, bench.errors.pop()).exceptions  # of orders side by side
        assert isinstance(error, AttributeError)

    attempt(tmp_path, action)


def test_an_unexpected_error_in_flight_is_reported_to_end_the_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def action(bench: Bench) -> None:
        await bench.alice.create(1)
        monkeypatch.delattr(bench.layer.network, "switches")
        await bench.alice.send((MINE, "alice-q9"))
        assert isinstance(bench.errors.pop(), AttributeError)

    attempt(tmp_path, action)
