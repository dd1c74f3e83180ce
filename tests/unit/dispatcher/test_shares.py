"""One node's blocks leave room for those of others."""

import io
from dataclasses import replace
from pathlib import Path

import grpc
import pytest
import uvloop
from dispatcher_network import Bench, JumpingClock, block, configuration, running

from dispatcher.build import LEAST_BLOCKS, LEAST_SHARE, equal_share
from dispatcher.layer.history import History
from dispatcher.layer.journal import CausedBy, origin
from dispatcher.layer.ownership import MAX_BLOCKS
from wire.config import QuantumSwitch
from wire.dispatcher_pb2 import CreateRequest, DiscardRequest, Event, MeasureRequest, SendRequest
from wire.events import UNWRITTEN


@pytest.mark.parametrize(
    ("limit", "hosts", "share"),
    [
        (30_000_000, 3, 10_000_000),
        (8_000_000, 20, LEAST_SHARE),  # eight times the largest block of pairs: 8 * 2 * 262,144
        (1_000, 1, 1_000),
        (1_000, 4, 1_000),
    ],
)
def test_each_host_has_a_share(tmp_path: Path, limit: int, hosts: int, share: int) -> None:
    tokens = {**{f"h{number}": "x" for number in range(hosts)}, "q1": "y", "runner": "z"}
    config = replace(
        configuration(tmp_path),
        tokens=tokens,
        max_live_qubits=limit,
        devices={},
        switches=[QuantumSwitch("q1")],
    )
    assert equal_share(config, limit, LEAST_SHARE) == share
    assert equal_share(config, MAX_BLOCKS, LEAST_BLOCKS) == max(100_000 // hosts, LEAST_BLOCKS)
    assert LEAST_SHARE == 8 * 2 * 262_144


def test_who_makes_too_much_is_refused_and_others_are_not(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        share = bench.service.layer.share
        pairs = share // 2
        assert 2 * share <= bench.service.layer.max_live_qubits
        await bench.alice.create(pairs)
        with pytest.raises(grpc.aio.AioRpcError) as caught:
            await bench.alice.create(1, number=1)
        assert caught.value.code() == grpc.StatusCode.RESOURCE_EXHAUSTED
        words = (
            f"2 more qubits with {2 * pairs} that alice has made and that are live exceed its sh"
        )
        assert words in (caught.value.details() or "")
        await bench.bob.create(1, number=1)
        await bench.alice.act(DiscardRequest(block=block(0, 0)))
        await bench.alice.create(1, number=2)
        await bench.alice.act(DiscardRequest(session=7))
        await bench.bob.act(DiscardRequest(session=7))
        assert bench.service.layer.ownership.makers.places_of("alice") == 0
        assert not bench.service.layer.ownership.makers._made
        await bench.alice.create(pairs, number=3)

    async def run() -> None:
        config = replace(configuration(tmp_path), max_live_qubits=2 * LEAST_SHARE)
        async with running(config, JumpingClock()) as bench:
            await act(bench)

    uvloop.run(run())


def test_who_has_many_small_blocks_leaves_some_for_others(tmp_path: Path) -> None:
    async def run() -> None:
        async with running(replace(configuration(tmp_path), devices={}), JumpingClock()) as bench:
            layer = bench.service.layer
            layer.share_of_blocks = 7
            for number in range(3):
                await bench.alice.create(1, number=number)  # pairs: two blocks each
            with pytest.raises(grpc.aio.AioRpcError) as caught:
                await bench.alice.create(1, number=3)
            assert caught.value.code() == grpc.StatusCode.RESOURCE_EXHAUSTED
            assert "7 blocks that alice has made are live, its share" in str(caught.value)
            await bench.bob.create(1)
            await bench.alice.act(DiscardRequest(block=block(0, 0)))
            await bench.alice.create(1, number=3)
            for host in (bench.alice, bench.bob):
                await host.act(DiscardRequest(session=7))
            assert layer.ownership.makers.blocks_of("alice") == 0
            assert not layer.ownership.makers._blocks

    uvloop.run(run())


def test_who_causes_many_events_fills_no_more_than_a_share_of_the_log() -> None:
    log = io.StringIO()
    history = History(10, log, share=3)
    with CausedBy("charlie", "send", SendRequest()):
        for number in range(4):  # what charlie causes at bob counts as charlie's
            history.record(Event(time_ns=number, node="bob", kind="arrive"), Event(node="bob"))
    with CausedBy("bob", "measure", MeasureRequest()):
        history.record(Event(time_ns=9, node="bob", kind="measure"))
    kinds = [line.split()[1:3] for line in log.getvalue().splitlines()]
    assert [words[0] for words in kinds] == ["bob", "bob", "bob", "dispatcher", "bob"]
    assert kinds[3][1] == UNWRITTEN
    assert "more than 3 events caused by charlie" in log.getvalue()
    assert history.count == 9


def test_what_has_caused_something_names_its_block() -> None:
    with CausedBy("charlie", "create", CreateRequest(session=10, number=3)):
        assert origin() == "charlie: create block 3 of session 000000000000000a"
    with CausedBy("bob", "measure", MeasureRequest(block={"session": 10, "number": 3, "half": 1})):
        assert origin() == "bob: measure block 3/1 of session 000000000000000a"
    assert origin() == ""


def test_a_name_that_another_has_taken_first_is_there_for_its_owner(tmp_path: Path) -> None:
    """bob, who has guessed the number of a session of charlie and alice, takes its first block."""
    pairs = 2_000  # equal by chance with probability 2^-2000

    async def run() -> None:
        async with running(replace(configuration(tmp_path), devices={}), JumpingClock()) as bench:
            await bench.bob.create(pairs)
            await bench.charlie.create(pairs)
            with pytest.raises(grpc.aio.AioRpcError, match=r"block 0/0 .* exists"):
                await bench.charlie.create(pairs)
            made = bench.service.layer.ownership.makers.places_of
            assert (made("bob"), made("charlie")) == (2 * pairs, 2 * pairs)
            theirs, own = (
                await bench.bob.measure(block(0, 0)),
                await bench.charlie.measure(block(0, 0)),
            )
            assert theirs.outcomes != own.outcomes  # nobody draws what another has drawn
            assert made("charlie") == pairs
            other = await bench.charlie.measure(block(0, 1))
            assert other.outcomes == own.outcomes  # halves of a Bell pair agree

    uvloop.run(run())


def test_light_of_another_does_not_mix_with_what_waits_under_its_name(tmp_path: Path) -> None:
    name, pairs = block(0, 0), 2_000

    async def run() -> None:
        async with running(replace(configuration(tmp_path), devices={}), JumpingClock()) as bench:
            for sender, port, way in (
                (bench.charlie, "charlie-q0", (1, 4)),
                (bench.alice, "alice-q0", (3, 4)),
            ):
                await sender.create(pairs)
                await bench.switch.connect(way)
                await sender.send((name, port))
            received = await bench.bob.receive(name, "bob-q0")
            assert received.photons == pairs
            mine, theirs = await bench.bob.measure(name), await bench.charlie.measure(block(0, 1))
            assert mine.outcomes == theirs.outcomes  # halves of charlie's pairs, which came first
            made = bench.service.layer.ownership.makers.places_of
            assert (made("charlie"), made("alice")) == (0, pairs)

    uvloop.run(run())
