"""Hosts and the news of what they have made: none comes before light could tell it.

News takes as long as its way: from bob 3 + 4 ms to alice, and from charlie, who is farthest,
3 + 10 ms.
"""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace

import numpy as np
import pytest
import uvloop
from dispatcher_network import configuration
from heralding_scene import FIRST, PORTS, SECOND, attempted

from dispatcher.layer.ownership import BlockName
from dispatcher.refusal import Refusal
from evidence.laboratory import SESSION, START_NS, Laboratory, block_id
from wire.config import DispatcherConfig
from wire.dispatcher_pb2 import BlockId, CreateRequest, StoreRequest
from wire.parameters.physics import BellAnalyser, Device, Emitter, Memory
from wire.parameters.switch import QuantumSwitch

COPPER_S = {"alice": 3e-3, "bob": 4e-3, "charlie": 10e-3}
NEWS_S = {name: {"s1": delay_s} for name, delay_s in COPPER_S.items()} | {"s1": COPPER_S}
BOBS_NS, FARTHEST_NS = 7_000_000, 13_000_000
PAIRS = 8
ZEROS = CreateRequest.ZEROS
Far = Callable[[Laboratory], Awaitable[object]]


@pytest.fixture
def config(tmp_path_factory: pytest.TempPathFactory) -> DispatcherConfig:
    folder = tmp_path_factory.mktemp("made")
    return configuration(folder, news_s=NEWS_S)


async def nothing(_laboratory: Laboratory) -> None:
    """Let bob keep what he has."""


async def measured(laboratory: Laboratory) -> None:
    await laboratory.host("bob").measure((0, 0))


async def taken_apart(laboratory: Laboratory) -> None:
    """Let bob's photons be in a block that he has made."""
    await laboratory.host("bob").gather((5, 0), {(0, 0): np.arange(PAIRS)})


def with_station(config: DispatcherConfig, memory: Memory) -> DispatcherConfig:
    """Return the network with a station in q1, and memories that emit at alice and bob."""
    device = Device(memory=memory, emitter=Emitter("two-click"))
    q1 = QuantumSwitch("q1", analysers=1, analyser=BellAnalyser("linear"))
    return replace(config, devices=dict.fromkeys(PORTS, device), switches=[q1])


async def refusal(action: Awaitable[object]) -> str:
    """Return the reply to a request."""
    try:
        await action
    except Refusal as refused:
        return str(refused)
    return "done"


def heard(config: DispatcherConfig, far: Far, port: str, later_ns: int) -> list[str]:
    """Return the replies to alice about a name and her share, after events far away."""

    async def ask() -> list[str]:
        laboratory = await sent(config, far, port)
        laboratory.clock.time_ns += later_ns
        alice = laboratory.host("alice")
        answers = [await refusal(alice.create(2 * PAIRS, number=1, state=ZEROS))]
        answers.append(await refusal(alice.create(1, state=ZEROS)))
        into = alice.gather((0, 0), {(0, 1): np.arange(2)}, True)
        return [*answers, await refusal(into)]

    return uvloop.run(ask())


async def sent(config: DispatcherConfig, far: Far, port: str) -> Laboratory:
    """Let alice send light by a port, who keeps the other halves of its pairs, and that happen."""
    laboratory = Laboratory(config)
    laboratory.layer.share = 3 * PAIRS
    await laboratory.host("alice").create(PAIRS)
    await laboratory.host("alice").send({(0, 0): port})
    await laboratory.host("bob").receive((0, 0), "bob-q9")
    await far(laboratory)
    return laboratory


@pytest.mark.parametrize("far", [measured, taken_apart])
@pytest.mark.parametrize("later_ns", [0, BOBS_NS // 2, BOBS_NS - 1])
def test_a_maker_cannot_tell_what_becomes_of_its_light_before_news_can_be_here(
    config: DispatcherConfig, far: Far, later_ns: int
) -> None:
    asked = [heard(config, each, "alice-q9", later_ns) for each in (nothing, far)]
    assert asked[0] == asked[1]
    assert "16 that alice has made" in asked[0][0]
    assert all("block 0/0" in answer for answer in asked[0][1:])


@pytest.mark.parametrize("far", [measured, taken_apart])
def test_a_name_and_its_share_are_free_when_news_can_be_here(
    config: DispatcherConfig, far: Far
) -> None:
    asked = heard(config, far, "alice-q9", BOBS_NS)
    assert asked[0] == "done"  # her share has room for 16 beside the 8 halves that she has kept
    assert "its share of 24" in asked[1]  # no name is in her way any more
    asked = heard(config, nothing, "alice-q9", BOBS_NS)
    assert "16 that alice has made" in asked[0]


def test_of_light_that_ends_on_its_way_nobody_hears_before_the_farthest_could_tell(
    config: DispatcherConfig,
) -> None:
    """alice's light comes to q1, which has no path for it, or to bob, who keeps it."""
    for later_ns in (0, FARTHEST_NS - 1_000):
        asked = [heard(config, nothing, port, later_ns) for port in ("alice-q0", "alice-q9")]
        assert asked[0] == asked[1]
        assert "16 that alice has made" in asked[0][0]
    assert heard(config, nothing, "alice-q0", FARTHEST_NS)[0] == "done"


def test_what_is_let_go_at_its_maker_is_free_at_once(config: DispatcherConfig) -> None:
    async def act() -> None:
        laboratory = Laboratory(config)
        alice, makers = laboratory.host("alice"), laboratory.layer.ownership.makers
        for _ in range(3):
            await alice.create(PAIRS)
            await alice.measure((0, 0))
            await alice.discard((0, 1))
            assert (makers.places_of("alice"), makers.blocks_of("alice")) == (0, 0)
            assert makers.parts("alice", BlockName(SESSION, 0, 0)) == 0
        assert laboratory.clock.now_ns() == START_NS

    uvloop.run(act())


def test_a_host_that_attempts_cannot_tell_whether_another_attempts_under_its_name(
    config: DispatcherConfig,
) -> None:
    config = with_station(config, Memory(capacity=10))

    async def ask(alone: bool) -> str:
        laboratory = Laboratory(config)
        await laboratory.connect("q1", {3: FIRST, 4: SECOND})
        if not alone:
            await attempted(laboratory, "alice")
        return await refusal(attempted(laboratory, "bob", block=block_id((0, 0))))

    assert uvloop.run(ask(True)) == uvloop.run(ask(False)) == "done"


def test_a_host_cannot_tell_by_its_memory_what_a_station_heralds_before_news_can_be_here(
    config: DispatcherConfig,
) -> None:
    """Light takes 49 ns from q1 to alice; her memory takes 4."""
    config = with_station(config, Memory(capacity=4))

    async def ask(heralded: bool) -> list[str]:
        laboratory = Laboratory(config)
        await laboratory.connect("q1", {3: FIRST, 4: SECOND})
        clock, stored = laboratory.clock, laboratory.layer.memories._stored
        report, jump = asyncio.Event(), clock.wait_until

        async def wait(time_ns: int) -> None:
            if asyncio.current_task() not in laboratory.table.stations._busy.values():
                await report.wait()
            await jump(time_ns)

        clock.wait_until = wait  # type: ignore[method-assign]
        if heralded:
            work = asyncio.create_task(laboratory.heralded("q1", PORTS, 3, timeout_s=60.0))
        while heralded and "alice" not in stored:
            await asyncio.sleep(0)
        answers = []
        for number in (1, 2, 3):
            request = CreateRequest(session=SESSION, number=number, count=2, state=ZEROS)
            await laboratory.table.handle("alice", "create", request)
            block = BlockId(session=SESSION, number=number)
            keep = laboratory.table.handle("alice", "store", StoreRequest(block=block))
            answers.append(await refusal(keep))
        report.set()
        if heralded:
            await work
            kept = laboratory.layer.ownership.at_node
            assert BlockName(SESSION, 0, 0) not in [each.name for each in kept("alice")]
            assert BlockName(SESSION, 0, 1) in [each.name for each in kept("bob")]
        return answers

    asked = [uvloop.run(ask(heralded)) for heralded in (True, False)]
    assert asked[0] == asked[1]
    assert asked[0][:2] == ["done", "done"]
    assert "2 more qubits with 4 stored exceed the capacity" in asked[0][2]
