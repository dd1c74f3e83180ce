"""Every reply says what simulated the block and whether that was exact; limits refuse whole."""

from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import grpc
import pytest
import uvloop
from dispatcher_network import Bench, JumpingClock, block, configuration, running

from dispatcher.approximations import PHASE, approximation
from dispatcher.layer.ownership import BlockName
from wire.dispatcher_pb2 import (
    ApplyRequest,
    CreateRequest,
    DiscardRequest,
    Feedback,
    Gate,
    StoreRequest,
)

ZEROS = CreateRequest.ZEROS
RESOURCE_EXHAUSTED = grpc.StatusCode.RESOURCE_EXHAUSTED


def attempt(folder: Path, action: Callable[[Bench], Awaitable[None]], **changes: Any) -> None:
    """Run an action against a dispatcher."""

    async def run() -> None:
        async with running(configuration(folder, **changes), JumpingClock()) as bench:
            await action(bench)

    uvloop.run(run())


async def every_operation(bench: Bench) -> list[Feedback]:
    """Do one of each to blocks, and return the replies."""
    alice, bob = bench.alice, bench.bob
    replies = [await alice.create(4), await alice.create(4, number=1)]
    replies.append(await alice.apply(block(0), bytes(4)))
    replies.append(await alice.act(StoreRequest(block=block(0))))
    replies.append(await alice.send((block(0), "alice-q9")))
    replies.append(await bob.receive(block(0), "bob-q9"))
    replies.append(await bob.measure(block(0)))
    replies.append(await alice.bell_measure(block(1, 0), block(1, 1)))
    replies.append(await alice.discard(DiscardRequest(block=block(0, 1))))
    replies.append(await alice.discard(DiscardRequest(session=7)))
    return replies


@pytest.mark.parametrize("backend", ["chp", "stim", "dense"])
def test_every_reply_names_the_configured_backend(tmp_path: Path, backend: str) -> None:
    async def action(bench: Bench) -> None:
        replies = await every_operation(bench)
        assert [(reply.backend, reply.exact) for reply in replies] == [(backend, True)] * 10
        status = await bench.runner.status()
        assert (status.backend, status.exact) == (backend, True)

    attempt(tmp_path, action, backend=backend)


def test_an_approximation_shows_in_replies_and_spreads_with_gates(tmp_path: Path) -> None:
    async def action(bench: Bench) -> None:
        alice = bench.alice
        for number in (0, 1, 2):
            await alice.create(4, number, ZEROS)
        (approximated,) = bench.layer.ownership.parts(BlockName(7, 0, 0))
        approximated.pulses.approximations = approximation(PHASE, 0.25)
        assert (await bench.runner.status()).exact  # nothing reported so far
        gate = Gate(name=Gate.CX, target=block(0))
        reply = await alice.act(ApplyRequest(block=block(1), gates=[gate]))
        assert not reply.exact
        assert not (await alice.measure(block(1))).exact
        assert (await alice.measure(block(2))).exact
        status = await bench.runner.status()
        assert not status.exact
        assert [(each.name, each.most) for each in status.approximations] == [(PHASE, 0.25)]

    attempt(tmp_path, action)


def test_a_bell_measurement_is_as_exact_as_both_of_its_blocks(tmp_path: Path) -> None:
    async def action(bench: Bench) -> None:
        await bench.alice.create(4)
        (second,) = bench.layer.ownership.parts(BlockName(7, 0, 1))
        second.pulses.approximations = approximation(PHASE, 0.25)
        assert not (await bench.alice.bell_measure(block(0, 0), block(0, 1))).exact

    attempt(tmp_path, action)


def test_a_request_beyond_what_state_vectors_hold_changes_nothing(tmp_path: Path) -> None:
    async def action(bench: Bench) -> None:
        alice = bench.alice
        for number in range(13):
            await alice.create(2, number, ZEROS)
        links = [Gate(name=Gate.CX, target=block(number)) for number in range(1, 13)]
        gates = [Gate(name=Gate.H), *links[:6], Gate(name=Gate.T), *links[6:]]
        request = ApplyRequest(block=block(0), paulis=bytes((1, 1)), gates=gates)
        before = await bench.runner.status()
        with pytest.raises(grpc.aio.AioRpcError, match=r"13 qubits .* at most 12") as refusal:
            await alice.act(request)
        assert refusal.value.code() == RESOURCE_EXHAUSTED
        assert await bench.runner.status() == before
        for number in range(13):
            reply = await alice.measure(block(number))
            assert (reply.outcomes, reply.backend) == (bytes(2), "chp")

    attempt(tmp_path, action)


def test_a_bell_measurement_beyond_what_state_vectors_hold_changes_nothing(tmp_path: Path) -> None:
    async def action(bench: Bench) -> None:
        alice = bench.alice
        for number in range(13):
            await alice.create(1, number, ZEROS)
        links = [Gate(name=Gate.CX, target=block(number)) for number in range(1, 12)]
        gates = [Gate(name=Gate.T), *links]
        await alice.act(ApplyRequest(block=block(0), gates=gates))
        before = await bench.runner.status()
        with pytest.raises(grpc.aio.AioRpcError, match="13 qubits") as refusal:
            await alice.bell_measure(block(12), block(0))
        assert refusal.value.code() == RESOURCE_EXHAUSTED
        assert await bench.runner.status() == before
        assert (await alice.measure(block(12))).outcomes == bytes(1)

    attempt(tmp_path, action)


def test_a_block_too_large_for_state_vectors_is_not_made(tmp_path: Path) -> None:
    async def action(bench: Bench) -> None:
        before = await bench.runner.status()
        with pytest.raises(grpc.aio.AioRpcError, match="5,200,000 more amplitudes") as refusal:
            await bench.alice.create(1_300_000)
        assert refusal.value.code() == RESOURCE_EXHAUSTED
        assert await bench.runner.status() == before
        await bench.alice.create(4)  # the name is free

    attempt(tmp_path, action, backend="dense")


def test_an_unknown_backend_is_refused_with_the_choices(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="'qutip': choose one of chp, stim, dense"):
        configuration(tmp_path, backend="qutip")


def test_the_event_log_writes_the_angles_of_gates(tmp_path: Path) -> None:
    log = tmp_path / "quantum.log"

    async def action(bench: Bench) -> None:
        await bench.alice.create(1, 0, ZEROS)
        gates = [Gate(name=Gate.RY, angle_rad=0.5), Gate(name=Gate.T_DAG), Gate(name=Gate.H)]
        await bench.alice.act(ApplyRequest(block=block(0), gates=gates))

    attempt(tmp_path, action, event_log=str(log))
    assert "RY(0.5) T_DAG H" in log.read_text()
