"""Heralded pairs beside closed forms and a simulation in Fock space; 5 standard errors, seed 1."""

import asyncio
from math import exp, expm1
from typing import Any

import numpy as np
import pytest
from five_sigma import within
from heralding_scene import (
    FIRST,
    M_PER_S,
    PORTS,
    PSI,
    SCHEMES,
    SECOND,
    attempted,
    correlations,
    enumerated,
    fidelity,
    heralded,
    in_fock_space,
    scene,
)
from limits import SOON_S

from dispatcher.devices.heralding import KINDS, Arm, single_click, two_click
from dispatcher.layer.news_delays import NewsDelays
from dispatcher.layer.ownership import Block, BlockName
from dispatcher.refusal import Refusal
from evidence.laboratory import SESSION, Laboratory
from wire.dispatcher_pb2 import BellOutcomes, DiscardRequest, MeasureRequest
from wire.parameters.physics import BellAnalyser, Detectors, Device, Emitter, Memory

CASES = [
    (Arm(1.0), Arm(1.0), 0.0, 1.0),
    (Arm(0.3), Arm(0.3), 0.0, 0.9),
    (Arm(0.3), Arm(0.05), 0.002, 0.7),
    (Arm(0.2, 0.1), Arm(0.2, 0.1), 0.01, 0.8),
    (Arm(0.2, 0.1), Arm(0.1, 0.2), 0.01, 0.8),
]


@pytest.mark.parametrize("scheme", list(SCHEMES))
@pytest.mark.parametrize(("first", "second", "dark", "visibility"), CASES)
def test_heralds_are_those_of_a_simulation_in_fock_space(
    scheme: str, first: Arm, second: Arm, dark: float, visibility: float
) -> None:
    arms = first, second
    heralds = SCHEMES[scheme](arms, dark, visibility)
    states = in_fock_space(scheme, arms, dark, visibility)
    for bell_states, state in states.items():
        assert np.trace(state).real == pytest.approx(heralds.probability / 2, rel=1e-12)
        ours = [fidelity(scheme, heralds, visibility, right) for right in (True, False)]
        theirs = [(PSI[bell] @ state @ PSI[bell]).real for bell in (bell_states, bell_states ^ 2)]
        theirs = [each / np.trace(state).real for each in theirs]
        assert ours == pytest.approx(theirs, rel=1e-9, abs=1e-12)
        for kind in ("00", "11"):
            at = int(kind, 2)
            chance = heralds.chances[KINDS.index(kind)] / 2
            assert state[at, at].real == pytest.approx(chance, rel=1e-9, abs=1e-15)


@pytest.mark.parametrize("scheme", list(SCHEMES))
@pytest.mark.parametrize(
    ("first", "second", "dark", "visibility"),
    [
        (Arm(0.9, 0.1), Arm(0.3, 0.4), 0.05, 0.8),
        (Arm(0.3, 0.4), Arm(0.9, 0.1), 0.05, 0.8),
        (Arm(0.5, 0.3), Arm(0.5, 0.1), 0.02, 1.0),
        (Arm(0.5, 0.3), Arm(0.1, 0.3), 0.02, 0.0),
    ],
)
def test_all_chances_of_unlike_hosts_are_those_of_an_enumeration(
    scheme: str, first: Arm, second: Arm, dark: float, visibility: float
) -> None:
    heralds = SCHEMES[scheme]((first, second), dark, visibility)
    expected = enumerated(scheme, (first, second), dark, visibility)
    assert heralds.chances == pytest.approx(expected, rel=1e-12)


def test_the_closed_forms_of_both_schemes() -> None:
    # Barrett and Kok: eta^2 / 2. Single click: 2 alpha eta, and 1 - alpha, of little light.
    assert two_click((Arm(0.3), Arm(0.3)), 0.0, 1.0).probability == pytest.approx(0.045)
    little = single_click((Arm(1e-6, 0.1), Arm(1e-6, 0.1)), 0.0, 1.0)
    assert little.probability == pytest.approx(2 * 0.1 * 1e-6, rel=1e-5)
    assert fidelity("single-click", little, 1.0, True) == pytest.approx(0.9, rel=1e-5)
    drifting = single_click((Arm(1e-6, 1e-9, 0.2), Arm(1e-6, 1e-9, 0.2)), 0.0, 1.0)
    coherence = exp(-0.04)  # of a phase with the variance 2 x 0.2^2
    assert fidelity("single-click", drifting, 1.0, True) == pytest.approx((1 + coherence) / 2)


def test_a_link_makes_p_pairs_in_each_round_trip_to_the_station() -> None:
    """p c / 2L: .045 of 20 km of fibre there and back."""
    device = Device(emitter=Emitter("two-click", efficiency=0.3))

    async def act(laboratory: Laboratory) -> None:
        bell_states, attempts, took_s = await heralded(laboratory, 3000)
        assert bell_states.size == 3000
        assert within(bell_states.size, attempts, 0.045)
        assert within(int(np.count_nonzero(bell_states == 1)), bell_states.size, 0.5)
        assert took_s / attempts == pytest.approx(2 * 10_000 / M_PER_S, rel=1e-3)
        right = await correlations(laboratory, bell_states)
        assert all(found == of for found, of in right.values())

    scene(act, device)


def test_modes_attempt_side_by_side() -> None:
    device = Device(emitter=Emitter("two-click", efficiency=0.3, modes=100))

    async def act(laboratory: Laboratory) -> None:
        _told, attempts, took_s = await heralded(laboratory, 3000)
        assert within(3000, attempts, 0.045)
        assert took_s / attempts == pytest.approx(2 * 10_000 / M_PER_S / 100, rel=1e-2)

    scene(act, device)


def test_the_longer_way_and_the_preparation_pace_attempts() -> None:
    device = Device(emitter=Emitter("two-click", preparation_s=1e-3))

    async def act(laboratory: Laboratory) -> None:
        _told, attempts, took_s = await heralded(laboratory, 1000)
        assert took_s / attempts == pytest.approx(1e-3 + 2 * 15_000 / M_PER_S, rel=1e-3)

    scene(act, device, km=(15.0, 5.0))


def test_fibres_detectors_and_switches_lose_light_of_attempts() -> None:
    device = Device(emitter=Emitter("two-click", efficiency=0.5))
    station = Device(detectors=Detectors(efficiency=0.8), analyser=BellAnalyser("linear"))
    efficiency = 0.5 * 0.8 * 10 ** (-2.0 / 10)  # of 10 km with .2 dB each

    async def act(laboratory: Laboratory) -> None:
        _told, attempts, _took_s = await heralded(laboratory, 3000)
        assert within(3000, attempts, efficiency**2 / 2)
        counted = laboratory.layer.network.switches["q1"].ports
        assert within(counted[1].photons_in, attempts, 0.5 * 10 ** (-2.0 / 10))
        assert counted[FIRST].photons_out == counted[1].photons_in

    scene(act, device, station, loss_db_per_km=0.2)


def test_single_clicks_are_common_and_1_minus_alpha_is_their_fidelity() -> None:
    alpha, efficiency, count = 0.2, 0.01, 60_000
    device = Device(emitter=Emitter("single-click", efficiency, alpha, modes=100))
    state = in_fock_space("single-click", (Arm(efficiency, alpha),) * 2, 0.0, 1.0)[1]
    bright = state[3, 3].real / np.trace(state).real  # both have emitted

    async def act(laboratory: Laboratory) -> None:
        bell_states, attempts, _took_s = await heralded(laboratory, count)
        assert within(count, attempts, 2 * np.trace(state).real)
        right = await correlations(laboratory, bell_states)
        assert within(*right["Z"], 1 - bright)
        assert within(*right["X"], 1 - bright / 2)
        assert within(*right["Y"], 1 - bright / 2)
        assert 1 - bright == pytest.approx(1 - alpha, rel=1e-2)

    scene(act, device)


def test_each_qubit_waits_from_its_own_emission() -> None:
    """With T2 the phase is kept with the mean of exp(-2 t / T2) over all times."""
    t2_s, count, efficiency = 3.0, 3000, 0.3
    device = Device(
        memory=Memory(t1_s=1e6, t2_s=t2_s), emitter=Emitter("two-click", efficiency=efficiency)
    )

    async def act(laboratory: Laboratory) -> None:
        bell_states, _attempts, took_s = await heralded(laboratory, count)
        right = await correlations(laboratory, bell_states)
        assert right["Z"][0] == right["Z"][1]
        # Heralds come evenly in time: both qubits have waited anything up to all of it.
        mean = -expm1(-2 * took_s / t2_s) / (2 * took_s / t2_s)
        assert mean < 0.3
        for basis in "XY":
            assert within(*right[basis], (1 + mean) / 2)

    scene(act, device)


def test_no_more_is_heralded_than_time_allows() -> None:
    device = Device(emitter=Emitter("two-click", efficiency=0.01))

    async def act(laboratory: Laboratory) -> None:
        bell_states, attempts, took_s = await heralded(laboratory, 3000, timeout_s=2.0)
        assert took_s == pytest.approx(2.0, rel=1e-3)
        assert attempts == pytest.approx(2.0 / (2 * 10_000 / M_PER_S), rel=1e-3)
        assert within(bell_states.size, attempts, 0.01**2 / 2)

    scene(act, device)


def test_a_block_ends_with_as_many_attempts_as_its_report_counts() -> None:
    """One in 2 x 10^10 is heralded: a day of 10 km has 9 x 10^8 rounds of 100 at a time."""
    device = Device(emitter=Emitter("two-click", efficiency=1e-5, modes=100))

    async def act(laboratory: Laboratory) -> None:
        bell_states, attempts, _took_s = await heralded(laboratory, 9, timeout_s=86_400.0)
        assert bell_states.size < 9
        assert (1 << 32) - 1 - 100 < attempts < 1 << 32

    scene(act, device)


def test_a_block_without_pairs_goes_on_until_its_first() -> None:
    """Attempts up to a first herald are 1/p in the mean, and their sum varies by sqrt(n)/p."""
    chance, blocks = 0.007**2 / 2, 100  # 15 of them in the minute that the first may take
    device = Device(emitter=Emitter("two-click", efficiency=0.007))

    async def act(laboratory: Laboratory) -> None:
        attempts = 0
        for number in range(blocks):
            found, _took_s = await laboratory.heralded("q1", PORTS, 8, number, timeout_s=0.01)
            assert len(found.outcomes) == 1
            attempts += found.attempts
        assert abs(attempts - blocks / chance) < 5 * blocks**0.5 / chance

    scene(act, device)


def test_a_host_without_qubits_that_emit_does_not_attempt() -> None:
    async def act(laboratory: Laboratory) -> None:
        with pytest.raises(Refusal, match="feature HERALD is needed: alice has no qubits"):
            await attempted(laboratory, "alice")

    scene(act, Device())


def test_a_host_hears_of_a_path_that_is_not_there_when_news_can_be_here() -> None:
    """Copper of alice takes 7 ms to a switch, and q1's, which is farthest, 3 ms from there."""
    device = Device(memory=Memory(capacity=10), emitter=Emitter("two-click"))
    copper_s = {"alice": 7e-3, "bob": 1e-3, "q1": 3e-3}
    news_s = {name: {"s1": delay_s} for name, delay_s in copper_s.items()} | {"s1": copper_s}

    async def act(laboratory: Laboratory) -> None:
        laboratory.layer.news = NewsDelays(news_s)
        await laboratory.connect("q1", {2: SECOND})
        asked_ns = laboratory.clock.now_ns()
        with pytest.raises(Refusal, match="alice-q0 of alice comes out nowhere"):
            await attempted(laboratory, "alice")
        assert laboratory.clock.now_ns() == asked_ns + 10_000_000 + 1

    scene(act, device)


@pytest.mark.parametrize("copper_s", [None, 20e-6, 90e-6])
def test_no_host_finds_a_heralded_pair_before_news_of_it_can_be_there(
    copper_s: float | None,
) -> None:
    """10 km of fibre take 49.02 us; copper that is shorter may bring it sooner, no other."""
    device = Device(memory=Memory(capacity=10), emitter=Emitter("two-click"))
    news_ns = round(min(10_000 / M_PER_S, copper_s or 1.0) * 1e9)

    async def act(laboratory: Laboratory) -> None:
        if copper_s is not None:
            laboratory.layer.news = NewsDelays({"alice": {"q1": copper_s}})
        layer, clock = laboratory.layer, laboratory.clock
        bell_states, jump = asyncio.Event(), clock.wait_until

        async def wait(time_ns: int) -> None:
            if asyncio.current_task() not in laboratory.table.stations._busy.values():
                await bell_states.wait()
            await jump(time_ns)

        clock.wait_until = wait  # type: ignore[method-assign]
        station = asyncio.create_task(heralded(laboratory, 3))
        with layer.history.watching("alice", 0, remembered=False) as watcher:
            async with asyncio.timeout(SOON_S):
                while "alice" not in layer.memories._stored:
                    await asyncio.sleep(0)
            clicked_ns, alice = clock.now_ns(), laboratory.host("alice")
            (block,) = layer.memories._stored["alice"]
            exact_ns = min(10_000 / M_PER_S, copper_s or 1.0) * 1e9
            assert exact_ns - 1 <= block.heard_ns - clicked_ns <= exact_ns + 1e-6
            name, nowhere = BlockName(SESSION, 0, 0), BlockName(SESSION, 99, 0)
            for later_ns in (0, news_ns - 2):
                clock.time_ns = clicked_ns + later_ns
                words = set()
                for each in (name, nowhere):
                    with pytest.raises(Refusal) as refused:
                        layer.ownership.require(each, "alice")
                    words.add(str(refused.value).replace(str(each), ""))
                assert len(words) == 1
                assert not layer.ownership.of_session("alice", SESSION)
            while not watcher.idle:
                assert (await watcher.next()).kind == "attempt"
            clock.time_ns = clicked_ns + news_ns
            bell_states.set()
            assert (await alice.measure((0, 0))).size == 3
            await station
            assert "heralded" in [each.kind for each in await watcher.some()]

    scene(act, device)


def test_a_pair_that_nobody_wants_any_more_when_it_is_heard_of_is_let_go() -> None:
    device = Device(memory=Memory(capacity=10), emitter=Emitter("two-click"))

    async def act(laboratory: Laboratory) -> None:
        request = DiscardRequest(session=SESSION)
        station = asyncio.create_task(heralded(laboratory, 3))
        while "alice" not in laboratory.layer.memories._stored:
            await asyncio.sleep(0)
        await laboratory.table.handle("alice", "discard", request)
        await station
        assert not laboratory.layer.ownership.at_node("alice")
        assert len(laboratory.layer.ownership.at_node("bob")) == 1
        assert laboratory.layer.sabot.live_qubits == 3

    scene(act, device)


def test_a_host_that_fills_its_memory_before_it_hears_of_pairs_has_these_let_go() -> None:
    """Qubits that attempted are in use again: of three places one is taken before three come."""
    device = Device(memory=Memory(capacity=3), emitter=Emitter("two-click"))

    async def act(laboratory: Laboratory) -> None:
        layer, jump, own = laboratory.layer, laboratory.clock.wait_until, list[Block]()

        async def wait(time_ns: int) -> None:
            if asyncio.current_task() in laboratory.table.heralding._news and not own:
                name, now_ns = BlockName(SESSION, 5, 0), layer.clock.now_ns()
                zero = layer.sabot.zeros(1)
                own.append(Block(name, zero, "alice", first_ns=now_ns, last_ns=now_ns))
                layer.memories.store(own[0])
            await jump(time_ns)

        laboratory.clock.wait_until = wait  # type: ignore[method-assign]
        await heralded(laboratory, 3)
        assert [*layer.memories._stored["alice"]] == own
        assert [each.size for each in layer.ownership.at_node("bob")] == [3]

    scene(act, device)


async def unfit(laboratory: Laboratory, alice: dict[str, Any], bob: dict[str, Any]) -> bool:
    """Return whether a station refuses two attempts."""
    with laboratory.table.reports.watching("q1") as reports:
        for host, more in (("alice", alice), ("bob", bob)):
            await attempted(laboratory, host, **more)
        async for report in reports:
            if report.end != BellOutcomes.WAITS:
                assert report.end in (BellOutcomes.UNFIT, BellOutcomes.HERALDED)
                return bool(report.end == BellOutcomes.UNFIT)
    raise AssertionError("q1 has nothing to report")


@pytest.mark.parametrize("cutoffs_s", [(1e-6, 1.0), (1.0, 1e-6), (1.0, 1.0)])
def test_a_link_drops_pairs_by_the_shorter_cut_off_of_its_ends(
    cutoffs_s: tuple[float, float],
) -> None:
    """When they are heralded pairs are as old as light of 10 km: 49 us."""
    device = Device(memory=Memory(capacity=3), emitter=Emitter("two-click"))

    async def act(laboratory: Laboratory) -> None:
        alice, bob = ({"cutoff_s": each} for each in cutoffs_s)
        assert await unfit(laboratory, alice, bob) == (min(cutoffs_s) < 49e-6)

    scene(act, device)


@pytest.mark.parametrize("most", [5, 6])
def test_as_many_pairs_are_attempted_for_as_qubits_may_live(most: int) -> None:
    device = Device(memory=Memory(capacity=3), emitter=Emitter("two-click"))

    async def act(laboratory: Laboratory) -> None:
        laboratory.layer.max_live_qubits = most
        assert await unfit(laboratory, {"count": 3}, {"count": 3}) == (most < 2 * 3)

    scene(act, device)


def test_an_analyser_of_gates_is_no_station() -> None:
    async def act(laboratory: Laboratory) -> None:
        with pytest.raises(Refusal, match="feature INTERFERE is needed: q1-analyser1 has no"):
            await attempted(laboratory, "alice")

    scene(act, Device(emitter=Emitter("two-click")), Device(analyser=BellAnalyser("gates")))


def test_bases_of_measurements_are_as_numbered() -> None:
    assert (MeasureRequest.Z, MeasureRequest.X, MeasureRequest.Y) == (0, 1, 2)
