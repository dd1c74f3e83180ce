"""Stations in switches, which herald pairs of memories that emit.

alice-q0 --1 q1 (station) 2-- bob-q0             alice-q0 --1 q1 2-- q2 --2 q3 1-- bob-q0
"""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from dataclasses import replace
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
import pytest
import uvloop
from five_sigma import within
from heralding_scene import FIRST, LITTLE, PORTS, SECOND, SINGLE, of_little_light
from limits import SOON_S
from test_published_nodes import BASES

from dispatcher.refusal import Refusal
from dispatcher.timeouts import ANALYSER_WAIT_S, FIRST_HERALD_S, MEMORY_WAIT_S
from evidence.laboratory import JumpingClock, Laboratory
from topologies.catalogue.node_kinds import NV_CENTRE, STATION
from wire.config import DispatcherConfig, Fiber, FiberEnd
from wire.dispatcher_pb2 import (
    AttemptRequest,
    BellOutcomes,
    BlockId,
    DiscardRequest,
    EmitRequest,
    InjectFaultRequest,
    KeepRequest,
)
from wire.outcomes import NO_COINCIDENCE
from wire.parameters.physics import BadParameter, BellAnalyser, Device, Emitter, Memory
from wire.parameters.switch import QuantumSwitch

ONE, TWO, EMITTING_ONE, EMITTING_TWO = 61_001, 61_002, 63_001, 63_002
M_PER_S = 2.04e8  # of light in fibre, as docs/fibers.md has it
Watched = AsyncIterator[BellOutcomes]


def station(name: str, like: Device = STATION) -> QuantumSwitch:
    """Return a switch with a station."""
    return QuantumSwitch(name, analysers=1, analyser=like.analyser, detectors=like.detectors)


def repeater(name: str, device: Device) -> QuantumSwitch:
    """Return a switch with two memories that emit, and an analyser of gates."""
    return QuantumSwitch(
        name,
        analysers=1,
        analyser=BellAnalyser("gates"),
        gates=device.gates,
        memories=2,
        memory=device.memory,
        emitter=device.emitter,
    )


class PatientClock(JumpingClock):
    """A clock that jumps over all waits but those at whose end nobody has met."""

    def __init__(self) -> None:
        super().__init__()
        self.over = asyncio.Event()
        self.longest_s = ANALYSER_WAIT_S

    async def wait_until(self, time_ns: int) -> None:
        """Return at once, or when the longest waits are over."""
        if time_ns - self.time_ns >= self.longest_s * 1e9:
            await self.over.wait()
        await super().wait_until(time_ns)


class Network(NamedTuple):
    """Hosts at the ends of a line of switches."""

    laboratory: Laboratory
    clock: PatientClock
    reports: Mapping[str, Watched]

    async def attempt(self, host: str, number: int, count: int, timeout_s: float = 0.0) -> None:
        """Let a host attempt for pairs."""
        name, port = BlockId(session=1, number=number), f"{host}-q0"
        request = AttemptRequest(block=name, port=port, count=count, timeout_s=timeout_s)
        await self.laboratory.act(host, "attempt", request)

    async def emit(self, port: int, number: int, count: int) -> None:
        """Let a memory of q2 attempt."""
        request = EmitRequest(switch="q2", port=port, session=port, number=number, count=count)
        await self.laboratory.act("q2", "emit", request)

    async def report(self, switch: str, end: "BellOutcomes.End") -> BellOutcomes:
        """Return the next report of a switch that is not of a memory that waits."""
        async for report in self.reports[switch]:
            if report.end != BellOutcomes.WAITS:
                assert report.end == end
                return report
        raise AssertionError(f"no more reports of {switch}")


def play(
    act: Callable[[Network], Awaitable[None]],
    device: Device,
    *switches: QuantumSwitch,
    km: float = 1e-3,
) -> None:
    """Run a scene between alice and bob with such devices."""
    nodes = ["alice", *(each.name for each in switches), "bob"]
    ports = ["alice-q0", *["1", "2"] * len(switches), "bob-q0"]
    ends = [FiberEnd(nodes[(place + 1) // 2], port) for place, port in enumerate(ports)]
    fibers = [Fiber(a, b, length_km=km) for a, b in zip(ends[::2], ends[1::2], strict=True)]
    hosts = {"alice": device, "bob": device}
    tokens = dict.fromkeys(hosts, "")
    config = DispatcherConfig("", "", 1, tokens, fibers, list(switches), devices=hosts)

    async def inside() -> None:
        clock = PatientClock()
        laboratory = Laboratory(config, clock)
        watching = laboratory.table.reports.watching
        watched = {each.name: watching(each.name) for each in switches}
        reports = {name: each.__enter__() for name, each in watched.items()}
        async with asyncio.timeout(SOON_S):
            await act(Network(laboratory, clock, reports))
        await asyncio.sleep(0)
        for each in watched.values():
            each.__exit__(None, None, None)

    uvloop.run(inside())


def test_light_that_a_switch_let_go_while_it_came_is_no_herald() -> None:
    """Two clicks of .3: .045 of the attempts, and of a second the first tenth."""
    closes_s = 0.1

    async def act(network: Network) -> None:
        laboratory, clock = network.laboratory, network.clock
        await laboratory.connect("q1", {1: FIRST, 2: SECOND})
        await laboratory.connect("q2", {2: 1})
        await laboratory.wait(1e-3)
        closes_ns, wait = clock.now_ns() + round(closes_s * 1e9), clock.wait_until

        async def closing(time_ns: int) -> None:
            if time_ns > closes_ns > clock.time_ns:
                clock.time_ns = closes_ns
                await laboratory.connect("q2", {})
            await wait(time_ns)

        clock.wait_until = closing  # type: ignore[method-assign]
        found, _took_s = await laboratory.heralded("q1", PORTS, 3000, timeout_s=1.0)
        assert within(found.photons, found.attempts // 10, 0.045)

    device = Device(emitter=Emitter("two-click", efficiency=0.3))
    play(act, device, station("q1"), QuantumSwitch("q2"), km=5.0)


@pytest.mark.parametrize("basis", BASES)
def test_memories_of_a_switch_are_heralded_with_both_ends_and_swap(basis: Any) -> None:
    """Four emitters of fidelity f are Werner-like: 4 F - 1 = 3 ((4 f - 1) / 3)^4."""
    fidelity, pairs, found = 0.97, 1500, list[int]()
    emitter = Emitter("two-click", LITTLE, fidelity=fidelity, modes=1000)
    device = Device(emitter=emitter, memory=Memory(kind="emissive", capacity=2000))

    async def act(network: Network) -> None:
        laboratory = network.laboratory
        await laboratory.connect("q1", {1: FIRST, 2: SECOND})
        await laboratory.connect("q3", {2: FIRST, 1: SECOND})
        await laboratory.connect("q2", {EMITTING_ONE: 1, EMITTING_TWO: 2})
        # By the input of one station first, of the other behind the switch.
        await network.attempt("alice", 0, pairs)
        for port in (EMITTING_ONE, EMITTING_TWO):
            await network.emit(port, 7, pairs)
        await network.attempt("bob", 1, pairs)
        links = [await network.report(switch, BellOutcomes.HERALDED) for switch in ("q1", "q3")]
        stored = [await network.report("q2", BellOutcomes.STORED) for _memory in range(2)]
        assert sorted(each.port for each in stored) == [ONE, TWO]
        assert all(each.outcomes == bytes(pairs) for each in stored)
        for each in stored:
            named = KeepRequest(
                switch="q2", port=each.port, number=each.number, outcomes=each.outcomes
            )
            await laboratory.act("q2", "keep", named)
        emitting = {EMITTING_ONE: 1, EMITTING_TWO: 2}
        await laboratory.connect("q2", {**emitting, ONE: FIRST, TWO: SECOND})
        swap = await network.report("q2", BellOutcomes.MEASURED)
        assert swap.waited_ns > 0
        states = [np.frombuffer(each.outcomes, np.uint8) for each in (*links, swap)]
        product = np.bitwise_xor.reduce(states)
        names = {"alice": 0, "bob": 1}
        mine, yours = [
            await laboratory.host(host).measure((number, 0), basis)
            for host, number in names.items()
        ]
        # Phi+ is alike in Z and X, and not in Y; X and Z turn two of these each.
        bits, phases = product & 1, product >> 1
        flips = {BASES[0]: bits, BASES[1]: phases, BASES[2]: 1 ^ bits ^ phases}
        found.append(int((mine ^ yours == flips[basis]).sum()))

    ends = [station(name, Device(analyser=BellAnalyser("linear"))) for name in ("q1", "q3")]
    play(act, device, ends[0], repeater("q2", device), ends[1])
    alike = (1 + ((4 * fidelity - 1) / 3) ** 4) / 2
    assert abs(found[0] / pairs - alike) < 5 * sqrt(alike * (1 - alike) / pairs)


def test_a_link_that_heralds_nothing_is_swapped_in_its_turn_as_no_pulse() -> None:
    device = of_little_light(SINGLE, memory=Memory(capacity=20))
    detectors = replace(STATION.detectors, efficiency=1e-12, dark_count_hz=0.0)
    dark = replace(STATION, detectors=detectors)

    async def act(network: Network) -> None:
        laboratory = network.laboratory
        await laboratory.connect("q1", {1: FIRST, 2: SECOND})
        await laboratory.connect("q3", {2: FIRST, 1: SECOND})
        emitting = {EMITTING_ONE: 1, EMITTING_TWO: 2}
        await laboratory.connect("q2", emitting)
        for number in (0, 2):
            network.clock.longest_s = ANALYSER_WAIT_S
            await network.attempt("alice", number, 9)
            for port in (EMITTING_ONE, EMITTING_TWO):
                await network.emit(port, number, 9)
            assert (await network.report("q1", BellOutcomes.HERALDED)).photons == 9
            network.clock.longest_s = FIRST_HERALD_S + 1
            await network.attempt("bob", number + 1, 9)
            report = await network.report("q3", BellOutcomes.HERALDED)
            assert (report.photons, report.attempts > 0) == (0, True)
            stored = [await network.report("q2", BellOutcomes.STORED) for _memory in range(2)]
            assert {each.port: each.outcomes for each in stored} == {
                ONE: bytes(9),
                TWO: bytes([NO_COINCIDENCE]),
            }
            for each in stored:
                named = KeepRequest(
                    switch="q2", port=each.port, number=each.number, outcomes=each.outcomes
                )
                await laboratory.act("q2", "keep", named)
            await laboratory.connect("q2", {**emitting, ONE: FIRST, TWO: SECOND})
            swap = await network.report("q2", BellOutcomes.MEASURED)
            assert (swap.number, swap.photons) == (1 + number // 2, 0)
            assert not laboratory.layer.ownership.at_node("q2-memory1")
            assert not laboratory.layer.ownership.at_node("q2-memory2")

    play(act, device, station("q1"), repeater("q2", device), station("q3", dark))


def test_attempts_that_meet_none_or_do_not_fit_end_by_name() -> None:
    device = of_little_light(SINGLE)
    other = replace(device, emitter=Emitter("two-click"))

    async def act(network: Network) -> None:
        laboratory = network.laboratory
        with pytest.raises(Refusal, match="comes out nowhere"):
            await network.attempt("alice", 0, 1)
        for switch in ("q1", "q2"):
            await laboratory.connect(switch, {1: 2})
        with pytest.raises(Refusal, match="light of alice comes to bob: lead it to a station"):
            await network.attempt("alice", 0, 1)
        await laboratory.connect("q1", {1: FIRST, 2: SECOND})
        await network.attempt("alice", 0, 9)
        await laboratory.connect("q1", {2: SECOND})
        assert (await network.report("q1", BellOutcomes.CLOSED)).photons == 9
        await laboratory.connect("q1", {1: FIRST, 2: SECOND})
        await network.attempt("alice", 0, 9)  # the name is free again
        await laboratory.connect("q2", {EMITTING_ONE: 1})
        await network.emit(EMITTING_ONE, 0, 9)
        await network.report("q1", BellOutcomes.UNFIT)
        await network.attempt("alice", 0, 9)
        fault = InjectFaultRequest(switch="q1", failed=SECOND)
        await laboratory.act("runner", "inject_fault", fault)
        await network.report("q1", BellOutcomes.FAILED)
        for port, text in (
            (EMITTING_ONE, "station of port 60002 of q1 has failed"),
            (EMITTING_TWO + 1, "no memory that emits"),
        ):
            with pytest.raises(Refusal, match=text):
                await network.emit(port, 1, 1)
        with pytest.raises(Refusal, match="count 0 is not between 1 and"):  # no host's attempt
            await network.emit(EMITTING_ONE, 1, 0)
        await laboratory.act("runner", "inject_fault", InjectFaultRequest(switch="q1", repair=True))
        await network.attempt("alice", 0, 9)
        network.clock.over.set()
        await network.report("q1", BellOutcomes.NO_PARTNER)

    play(act, device, station("q1"), repeater("q2", other))


def test_attempts_of_a_session_that_is_discarded_meet_nobody() -> None:
    async def act(network: Network) -> None:
        laboratory = network.laboratory
        await laboratory.connect("q1", {1: FIRST, 2: SECOND})
        await network.attempt("alice", 0, 9)
        await laboratory.act("alice", "discard", DiscardRequest(session=1))
        await network.attempt("bob", 1, 9)
        await network.attempt("alice", 2, 5)
        assert (await network.report("q1", BellOutcomes.HERALDED)).photons == 5

    play(act, of_little_light(SINGLE, memory=Memory(capacity=20)), station("q1"))


def test_pairs_end_with_the_entry_by_which_their_memory_emits() -> None:
    device = of_little_light(SINGLE, memory=Memory(capacity=20))

    async def act(network: Network) -> None:
        laboratory = network.laboratory
        await laboratory.connect("q1", {1: FIRST, 2: SECOND})
        await laboratory.connect("q2", {EMITTING_ONE: 1})
        await network.emit(EMITTING_ONE, 0, 9)
        await network.attempt("alice", 0, 9)
        await network.report("q1", BellOutcomes.HERALDED)
        await network.report("q2", BellOutcomes.STORED)
        assert laboratory.layer.ownership.at_node("q2-memory1")
        await laboratory.connect("q2", {EMITTING_TWO: 1})
        await network.report("q2", BellOutcomes.CLOSED)
        assert not laboratory.layer.ownership.at_node("q2-memory1")
        assert laboratory.layer.ownership.at_node("alice")

    play(act, device, station("q1"), repeater("q2", device))


def test_who_attempts_first_is_reported_to_wait_and_the_partner_is_not() -> None:
    async def act(network: Network) -> None:
        await network.laboratory.connect("q1", {1: FIRST, 2: SECOND})
        for host, number in (("alice", 0), ("bob", 1)):
            await network.attempt(host, number, 3 + number)
        reports = [await anext(network.reports["q1"]) for _report in range(2)]
        ends = [(each.end, each.photons) for each in reports]
        assert ends == [(BellOutcomes.WAITS, 3), (BellOutcomes.HERALDED, 3)]

    play(act, of_little_light(SINGLE, memory=Memory(capacity=20)), station("q1"))


def test_attempts_of_who_discards_nothing_stay() -> None:
    """Both hosts have one session; alice gives hers up while bob attempts."""

    async def act(network: Network) -> None:
        laboratory = network.laboratory
        await laboratory.connect("q1", {1: FIRST, 2: SECOND})
        await network.attempt("bob", 1, 9)
        await laboratory.act("alice", "discard", DiscardRequest(session=1))
        await network.attempt("alice", 0, 5)
        assert (await network.report("q1", BellOutcomes.HERALDED)).photons == 5

    play(act, of_little_light(SINGLE, memory=Memory(capacity=20)), station("q1"))


@pytest.mark.parametrize("limits_s", [(0.01, 0.02), (0.02, 0.01)])
def test_a_station_attempts_as_long_as_either_end_wants(limits_s: tuple[float, float]) -> None:
    """A round takes light there and word back; in each, two of a thousand qubits are heralded."""
    km, pairs = 5.0, 2000
    rounds = max(limits_s) / (2 * km * 1e3 / M_PER_S)

    async def act(network: Network) -> None:
        await network.laboratory.connect("q1", {1: FIRST, 2: SECOND})
        for number, (host, limit_s) in enumerate(zip(PORTS, limits_s, strict=True)):
            await network.attempt(host, number, pairs, limit_s)
        report = await network.report("q1", BellOutcomes.HERALDED)
        assert 0 < report.photons < pairs
        assert abs(report.attempts / 1000 - rounds) <= 1

    play(act, of_little_light(SINGLE, memory=Memory(capacity=pairs)), station("q1"), km=km)


def test_memories_that_emit_hold_pairs_until_a_further_link_can_be_heralded() -> None:
    device = of_little_light(SINGLE, memory=Memory(capacity=20))

    async def act(network: Network) -> None:
        laboratory = network.laboratory
        await laboratory.connect("q1", {1: FIRST, 2: SECOND})
        await laboratory.connect("q2", {EMITTING_ONE: 1})
        await network.emit(EMITTING_ONE, 0, 9)
        await network.attempt("alice", 0, 9)
        await network.report("q2", BellOutcomes.STORED)
        (block,) = laboratory.layer.ownership.at_node("q2-memory1")
        network.clock.over.set()
        await network.report("q2", BellOutcomes.CUT_OFF)
        waited_s = (network.clock.now_ns() - block.last_ns) / 1e9
        assert waited_s == pytest.approx(MEMORY_WAIT_S + FIRST_HERALD_S)

    play(act, device, station("q1"), repeater("q2", device))


def test_memories_without_room_are_not_attempted_with() -> None:
    device = of_little_light(SINGLE, memory=Memory(capacity=10))

    async def act(network: Network) -> None:
        await network.laboratory.connect("q1", {1: FIRST, 2: SECOND})
        for host, number in (("alice", 0), ("bob", 1)):
            await network.attempt(host, number, 11)
        await network.report("q1", BellOutcomes.UNFIT)

    play(act, device, station("q1"))


def test_emitters_that_no_switch_has_are_refused() -> None:
    emitter, memory = Emitter(SINGLE), Memory(kind="emissive")
    with pytest.raises(BadParameter, match="emitter without memories"):
        QuantumSwitch("q1", emitter=emitter).check()
    with pytest.raises(BadParameter, match=r"give an emissive kind an emitter\.scheme"):
        QuantumSwitch("q1", memories=1, memory=memory).check()
    assert repeater("q1", NV_CENTRE).inner_ports.keys() >= {ONE, TWO, EMITTING_ONE, EMITTING_TWO}
