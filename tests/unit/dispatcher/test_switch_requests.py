"""Requests to a switch: by whom, and who hears of its condition."""

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import grpc
import pytest
import uvloop
from dispatcher_network import Bench, JumpingClock, configuration, running
from limits import SOON_S

from dispatcher.layer.network import Network
from dispatcher.refusal import Refusal
from wire.dispatcher_pb2 import (
    Connection,
    InjectFaultRequest,
    StatusRequest,
    SwitchStatisticsRequest,
    TunePortRequest,
    WatchSwitchRequest,
)
from wire.parameters.physics import BadParameter
from wire.parameters.switch import PathOptics, QuantumSwitch

Code = grpc.StatusCode
NAN = float("nan")


def play(folder: Path, scene: Callable[[Bench], Awaitable[None]]) -> None:
    """Run a scene on the network."""

    async def run() -> None:
        async with running(configuration(folder), JumpingClock()) as bench:
            await scene(bench)

    uvloop.run(run())


def stuck(in_port: int, out_port: int) -> InjectFaultRequest:
    """Return the request that makes a cross-connect of q1 stuck."""
    return InjectFaultRequest(switch="q1", stuck=Connection(in_port=in_port, out_port=out_port))


def tune(port: int = 1, switch: str = "q1", **values: Any) -> TunePortRequest:
    """Return the request that tunes a port."""
    return TunePortRequest(switch=switch, port=port, **values)


def heat(temperature_c: float, switch: str = "q1") -> InjectFaultRequest:
    """Return the request that sets a temperature."""
    return InjectFaultRequest(switch=switch, temperature_c=temperature_c)


REFUSED = [
    ("alice", "Status", StatusRequest(), Code.PERMISSION_DENIED, "only runner"),
    ("alice", "TunePort", tune(), Code.PERMISSION_DENIED, "alice may not tune a port of q1"),
    ("runner", "TunePort", tune(), Code.PERMISSION_DENIED, "only its own agent"),
    ("q1", "TunePort", tune(switch="q2"), Code.NOT_FOUND, "there is q1"),
    ("q1", "TunePort", tune(9), Code.NOT_FOUND, "port 9 of q1 has no fibre; fibres end in 1, 2"),
    ("q1", "TunePort", tune(frequency_mhz=191_300_000), Code.INVALID_ARGUMENT, "191350000 and"),
    ("q1", "TunePort", tune(frequency_mhz=196_150_000), Code.INVALID_ARGUMENT, "196100000"),
    (
        "q1",
        "TunePort",
        tune(frequency_mhz=193_412_500),
        Code.INVALID_ARGUMENT,
        "tune to 193400000 or 193450000",
    ),
    ("q1", "TunePort", tune(direction=3), Code.INVALID_ARGUMENT, "direction 3 is not known"),
    ("q1", "TunePort", tune(power_dbm=0.1), Code.INVALID_ARGUMENT, "power_dbm 0.1 is not between"),
    ("q1", "TunePort", tune(power_dbm=-20.1), Code.INVALID_ARGUMENT, "-20 and 0"),
    ("q1", "TunePort", tune(power_dbm=NAN), Code.INVALID_ARGUMENT, "power_dbm nan"),
    (
        "alice",
        "SwitchStatistics",
        SwitchStatisticsRequest(switch="q1"),
        Code.PERMISSION_DENIED,
        "alice may not read q1",
    ),
    ("q1", "InjectFault", heat(80), Code.PERMISSION_DENIED, "q1 may not inject faults"),
    ("runner", "InjectFault", heat(80, "q2"), Code.NOT_FOUND, "there is q1"),
    ("runner", "InjectFault", heat(NAN), Code.INVALID_ARGUMENT, "temperature_c nan"),
    ("runner", "InjectFault", heat(301), Code.INVALID_ARGUMENT, "-100 and 300"),
    ("runner", "InjectFault", stuck(1, 9), Code.NOT_FOUND, "port 9 of q1"),
    ("runner", "InjectFault", InjectFaultRequest(switch="q1"), Code.INVALID_ARGUMENT, "no fault"),
    (
        "runner",
        "InjectFault",
        InjectFaultRequest(switch="q1", repair=False),
        Code.INVALID_ARGUMENT,
        "no fault",
    ),
]


@pytest.mark.parametrize(("node", "method", "request_", "code", "text"), REFUSED)
def test_a_refused_request_says_why_and_changes_nothing(
    tmp_path: Path, node: str, method: str, request_: Any, code: grpc.StatusCode, text: str
) -> None:
    async def scene(bench: Bench) -> None:
        clients = {"alice": bench.alice, "q1": bench.switch, "runner": bench.runner}
        before = await bench.runner.statistics()
        with pytest.raises(grpc.aio.AioRpcError) as refusal:
            await clients[node].call(method, request_)
        assert refusal.value.code() is code
        assert text in str(refusal.value.details())
        assert await bench.runner.statistics() == before
        assert not bench.layer.history.count

    play(tmp_path, scene)


@pytest.mark.parametrize("wanted", [(1, 4), (5, 3)])
def test_what_a_stuck_cross_connect_is_in_the_way_of_is_refused(
    tmp_path: Path, wanted: tuple[int, int]
) -> None:
    async def scene(bench: Bench) -> None:
        await bench.switch.connect((2, 4))
        await bench.runner.call("InjectFault", stuck(1, 3))
        for attempt in (bench.switch.connect((2, 5), wanted), bench.switch.connect(wanted)):
            with pytest.raises(Refusal, match="its cross-connect 1 -> 3 is stuck") as refusal:
                await attempt
            assert refusal.value.code is Code.FAILED_PRECONDITION
        with pytest.raises(grpc.aio.AioRpcError, match="1 -> 3 is stuck"):
            await bench.runner.call("InjectFault", stuck(*wanted))
        timeline = bench.layer.network.switches["q1"].timeline
        assert timeline.connections == {1: 3, 2: 4}
        await bench.runner.inject(repair=True)
        await bench.switch.connect(wanted)
        assert timeline.connections == dict([wanted])

    play(tmp_path, scene)


def test_watchers_hear_the_condition_at_once_and_after_each_change(tmp_path: Path) -> None:
    async def scene(bench: Bench) -> None:
        streams = [bench.switch.watch_switch(), bench.runner.watch_switch()]
        for stream in streams:
            first = await stream.read()
            assert (first.temperature_c, first.hot, first.loss_db) == (25.0, False, 0.0)
            assert (first.min_frequency_mhz, first.max_frequency_mhz) == (191_350_000, 196_100_000)
            assert (first.grid_mhz, first.min_power_dbm, first.max_power_dbm) == (50_000, -20, 0)
        await bench.runner.inject(temperature_c=80)
        for stream in streams:
            hot = await stream.read()
            assert (hot.temperature_c, hot.hot, hot.loss_db) == (80.0, True, 3.0)
        await bench.runner.call("InjectFault", stuck(1, 3))
        for stream in streams:
            (connection,) = (await stream.read()).stuck
            assert (connection.in_port, connection.out_port) == (1, 3)
        await bench.runner.inject(repair=True)
        for stream in streams:
            whole = await stream.read()
            assert (whole.temperature_c, whole.hot, list(whole.stuck)) == (25.0, False, [])
            stream.cancel()

    play(tmp_path, scene)


def test_the_condition_names_paths_that_differ_with_what_heat_adds(tmp_path: Path) -> None:
    async def run() -> None:
        switch = QuantumSwitch(
            "q1", insertion_loss_db=1, rotation=2, paths=[PathOptics(1, 3, 2, 3)]
        )
        async with running(configuration(tmp_path, switches=[switch]), JumpingClock()) as bench:
            await bench.runner.inject(temperature_c=80)
            stream = bench.switch.watch_switch()
            condition = await stream.read()
            stream.cancel()
            (path,) = condition.paths
            assert (condition.loss_db, condition.rotation) == (4.0, 2)
            assert (path.in_port, path.out_port, path.loss_db, path.rotation) == (1, 3, 5.0, 3)

    uvloop.run(run())


def test_a_watcher_that_has_gone_is_forgotten(tmp_path: Path) -> None:
    async def scene(bench: Bench) -> None:
        stream = bench.switch.watch_switch()
        await stream.read()
        watchers = bench.switching._watchers["q1"]
        assert len(watchers) == 1
        stream.cancel()
        async with asyncio.timeout(SOON_S):
            while watchers:
                await bench.runner.status()

    play(tmp_path, scene)


def test_a_host_may_not_watch_a_switch(tmp_path: Path) -> None:
    async def scene(bench: Bench) -> None:
        stream = bench.stub.WatchSwitch(
            WatchSwitchRequest(switch="q1"), metadata=bench.bob.metadata, timeout=SOON_S
        )
        with pytest.raises(grpc.aio.AioRpcError, match="bob may not read q1"):
            await stream.read()

    play(tmp_path, scene)


def test_a_path_between_ports_without_fibres_is_refused(tmp_path: Path) -> None:
    switch = QuantumSwitch("q1", paths=[PathOptics(1, 9)])
    with pytest.raises(
        BadParameter, match=r"path 1 -> 9: no fibre ends in port 9; fibres end in 1, 2"
    ):
        Network(configuration(tmp_path).fibers, [switch])
