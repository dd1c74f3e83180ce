"""Seals that the controller orders, over whole stacks: begun, ended for a session, and alarmed."""

import asyncio
import logging
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import pytest
from limits import SOON_S
from stacks_scene import OWN_ADDRESS, RELAYED, grant, network
from stepping import stands, stepping

from hosts import network_loop
from hosts.middleware.session.session import OpeningSession
from hosts.service_socket import ServiceSocket
from hosts.serving.link_monitors import LinkMonitors
from hosts.stack import Stack
from wire.device import DeviceReport
from wire.metadata.setup import Answer, Setup
from wire.metadata.vocabulary import Handshake, Reason, Service
from wire.monitor_messages import MonitorCommand, PreemptMonitor

SEAL = 0x7070
THERE, BY_EVE = [(1, 2)], [(1, 6), (7, 2)]
ALICE = OWN_ADDRESS["alice"]
# To alice her relay to bob is bob; to bob all that comes by relays is from one address.
AT_ALICE = MonitorCommand(
    1, SEAL, ALICE, RELAYED["bob"], 3000, 1000, 1_000_000, 0.01, 0.25, 1e-6, 0.01
)
AT_BOB = replace(AT_ALICE, opener="127.0.0.1", acceptor=OWN_ADDRESS["bob"])


async def reported(stack: Stack, enough: Callable[[DeviceReport], bool]) -> DeviceReport:
    """Return a host's report as soon as it says something."""
    async with asyncio.timeout(SOON_S):
        while not enough(report := stack.device.report()):
            await asyncio.sleep(0.005)
        return report


async def order(stacks: dict[str, Stack], pairs: int) -> None:
    """Have alice watch her way to bob, as the controller does: bob hears of it first."""
    for name, each in (("bob", AT_BOB), ("alice", AT_ALICE)):
        answer = stacks[name].link_monitors.take(replace(each, pairs=pairs))
        assert answer == Answer(1, Reason.OK)


def test_two_hosts_watch_their_way_without_any_program(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Half 1 crosses two ideal fibres: no pair differs."""

    async def run() -> DeviceReport:
        stacks: dict[str, Stack] = {}
        async with network(tmp_path, paths=THERE, stacks=stacks):
            await order(stacks, 3000)
            again = stacks["alice"].link_monitors.take(replace(AT_ALICE, session=2))
            assert again == Answer(2, Reason.OK)  # and no second session
            await reported(stacks["bob"], lambda report: report.receiving == 1)
            assert all(stacks[name].takes_part(SEAL) for name in ("alice", "bob"))
            report = await reported(stacks["alice"], lambda report: report.monitor == SEAL)
            await reported(stacks["bob"], lambda report: not report.receiving)
            assert not any(stacks[name].takes_part(SEAL) for name in ("alice", "bob"))
            # By now: gRPC complains of a call under way when its server is stopped.
            assert not [each for each in caplog.records if each.levelno >= logging.WARNING]
            return report

    report = network_loop.run(run())
    assert report.monitor_compared >= 3000
    assert report.monitor_errors == report.alarm == 0
    assert report.monitor_tests > 0
    assert report.monitor_end == Reason.OK


def test_an_intruder_on_the_way_is_told_to_the_controller(tmp_path: Path) -> None:
    async def run() -> DeviceReport:
        stacks: dict[str, Stack] = {}
        async with network(tmp_path, paths=BY_EVE, stacks=stacks):
            with ServiceSocket(tmp_path / "eve.sock") as eve:
                eve.settimeout(SOON_S)
                await asyncio.to_thread(eve.intercept, 1.0)
                await order(stacks, 100_000)
                return await reported(stacks["alice"], lambda report: report.monitor == SEAL)

    report = network_loop.run(run())
    assert report.alarm == SEAL
    assert report.monitor_errors > 0
    assert report.monitor_compared < 1000  # 33 on average


def test_a_seal_ends_well_at_both_ends_when_a_session_wants_its_light(tmp_path: Path) -> None:
    async def run() -> DeviceReport:
        stacks: dict[str, Stack] = {}
        async with network(tmp_path, paths=THERE, stacks=stacks):
            await order(stacks, 100_000_000)  # for a quarter of an hour
            await reported(stacks["bob"], lambda report: report.receiving == 1)
            unknown = stacks["alice"].link_monitors.preempt(PreemptMonitor(3, SEAL + 1))
            assert unknown == Answer(3, Reason.UNKNOWN_SESSION)
            answer = stacks["alice"].link_monitors.preempt(PreemptMonitor(4, SEAL))
            assert answer == Answer(4, Reason.OK)
            report = await reported(stacks["alice"], lambda report: report.monitor == SEAL)
            await reported(stacks["bob"], lambda report: not report.receiving)
            return report

    report = network_loop.run(run())
    assert report.monitor_end == Reason.BUSY
    assert report.monitor_compared < 100_000
    assert report.alarm == 0


def link_monitors(asked: list[dict[str, Any]]) -> LinkMonitors:
    """Return those of a host that never opens any."""

    def request(fields: dict[str, Any], _number: int) -> OpeningSession:
        asked.append(fields)
        return cast(OpeningSession, None)

    return LinkMonitors("alice", ALICE, request, cast(Any, None), lambda _seal: False)


def test_an_order_for_another_host_is_refused() -> None:
    asked: list[dict[str, Any]] = []
    answer = link_monitors(asked).take(replace(AT_ALICE, opener="10.9.9.9", acceptor="10.9.9.8"))
    assert answer == Answer(1, Reason.NOT_ALLOWED, f"{ALICE} is at no end of the link monitor")
    assert not asked


def test_an_order_that_cannot_be_is_answered_with_why(tmp_path: Path) -> None:
    async def run() -> Answer:
        stacks: dict[str, Stack] = {}
        async with network(tmp_path, stacks=stacks):
            return stacks["alice"].link_monitors.take(replace(AT_ALICE, fraction=2.0))

    answer = network_loop.run(run())
    assert answer.reason == Reason.UNSUPPORTED
    assert "fraction 2.0: choose 0.001 to 1" in answer.text


def test_a_host_takes_part_in_the_seal_that_was_ordered_once_and_in_no_other() -> None:
    async def run() -> None:
        alices = link_monitors([])
        ordered = replace(AT_BOB, opener="10.0.0.2", acceptor=ALICE)
        assert alices.take(ordered).reason == Reason.OK
        setup = grant(Setup(SEAL, Service["SEAL"], Handshake.FRAMED, "10.0.0.2", 1, 1, 1))
        assert alices.expected(setup, "10.0.0.3") is None
        assert alices.expected(replace(setup, session=SEAL + 1), "10.0.0.2") is None
        assert alices.expected(replace(setup, service=Service["BB84"]), "10.0.0.2") is None
        assert alices.expected(setup, "10.0.0.2") is not None
        assert alices.expected(setup, "10.0.0.2") is None

    network_loop.run(run())


def test_time_makes_no_leap_to_forget_an_order(tmp_path: Path) -> None:
    with stepping() as gate:

        async def run() -> None:
            link_monitors([]).take(replace(AT_BOB, opener="10.0.0.2", acceptor=ALICE))
            loop = asyncio.get_running_loop()
            assert await loop.run_in_executor(None, stands, gate.time)

        network_loop.run(run(), gate.time)
