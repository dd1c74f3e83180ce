"""The physical layer without a network does what the dispatcher's service does."""

import numpy as np
import pytest
import uvloop

from dispatcher.refusal import Refusal
from evidence.laboratory import Laboratory
from wire.config import DispatcherConfig, Fiber, FiberEnd, QuantumSwitch
from wire.dispatcher_pb2 import Step

PAIRS = 1_000
DELAY_NS = 4_902  # of 1 km


def configuration() -> DispatcherConfig:
    """Return alice and bob with a fibre each to q1."""
    ends = [("alice", "alice-q0", "1"), ("bob", "bob-q0", "2")]
    fibers = [
        Fiber(FiberEnd(host, port), FiberEnd("q1", number), length_km=1)
        for host, port, number in ends
    ]
    return DispatcherConfig("", "", 1, {}, fibers, [QuantumSwitch("q1")])


def test_light_crosses_a_switch_and_time_passes() -> None:
    async def scene() -> None:
        laboratory = Laboratory(configuration())
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        await laboratory.connect("q1", {1: 2})
        start_ns = laboratory.clock.now_ns()
        await alice.create(PAIRS)
        await alice.send({(0, 1): "alice-q0"})
        assert laboratory.clock.now_ns() > start_ns + 2 * DELAY_NS
        await bob.receive((0, 1), "bob-q0")
        mine, yours = await alice.measure((0, 0)), await bob.measure((0, 1))
        np.testing.assert_array_equal(mine, yours)
        assert 0 < mine.sum() < PAIRS

    uvloop.run(scene())


def test_without_a_cross_connect_no_light_comes() -> None:
    async def scene() -> None:
        laboratory = Laboratory(configuration())
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        await alice.create(PAIRS)
        await alice.send({(0, 1): "alice-q0"})
        assert await bob.receive((0, 1), "bob-q0") is None

    uvloop.run(scene())


def test_a_host_touches_only_what_it_holds() -> None:
    async def scene() -> None:
        laboratory = Laboratory(configuration())
        await laboratory.host("alice").create(PAIRS)
        with pytest.raises(Refusal, match="is not at bob"):
            await laboratory.host("bob").measure((0, 0))

    uvloop.run(scene())


def test_the_clock_jumps_as_far_as_asked() -> None:
    async def scene() -> None:
        laboratory = Laboratory(configuration())
        start_ns = laboratory.clock.now_ns()
        await laboratory.wait(2.5)
        assert laboratory.clock.now_ns() - start_ns == pytest.approx(2.5e9, abs=1)

    uvloop.run(scene())


def test_the_table_has_a_row_for_each_operation_of_a_step_with_its_message() -> None:
    rows = Laboratory(configuration()).table.rows
    for field in Step.DESCRIPTOR.oneofs_by_name["operation"].fields:
        assert rows[field.name].message.DESCRIPTOR is field.message_type
