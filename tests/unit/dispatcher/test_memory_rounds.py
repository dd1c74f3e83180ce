"""Rounds of purification in memories of a switch: as the closed forms say, or nothing is left."""

import math
from pathlib import Path
from typing import Any

import grpc
import numpy as np
import pytest
import uvloop
from dispatcher_network import configuration, running
from test_switch_analysers import PAIRS, PatientClock, Scene
from test_switch_memories import (
    LEADING,
    ONE,
    STORING,
    TWO,
    at,
    emit,
    play,
    require_stored,
    states,
    swapped,
)

from dispatcher.layer import cutoff
from wire.dispatcher_pb2 import BellOutcomes, KeepRequest
from wire.parameters.physics import PairSource
from wire.parameters.switch import QuantumSwitch


def after_dejmps(pairs: np.ndarray[Any, Any]) -> tuple[np.ndarray[Any, Any], float]:
    """Return Bell-diagonal pairs (Phi+, Psi+, Phi-, Psi-) after a round, and the share that agrees.

    Deutsch et al., Phys. Rev. Lett. 77, 2818 (1996), equation 5.
    """
    phi, psi, phi_minus, psi_minus = pairs
    agreed = (phi + psi_minus) ** 2 + (phi_minus + psi) ** 2
    left = np.array(
        [
            phi**2 + psi_minus**2,
            psi**2 + phi_minus**2,
            2 * phi * psi_minus,
            2 * psi * phi_minus,
        ]
    )
    return left / agreed, float(agreed)


def after_bbpssw(fidelity: float) -> tuple[np.ndarray[Any, Any], float]:
    """Return the same of Werner pairs (Bennett et al., Phys. Rev. Lett. 76, 722, equation 7).

    Until the next twirl phase flips are more than the others: of F² + 2 F r + 5 r² these are 2 F r.
    """
    rest = (1 - fidelity) / 3
    left = np.array([fidelity**2 + rest**2, 2 * rest**2, 2 * fidelity * rest, 2 * rest**2])
    return left / left.sum(), float(left.sum())


WERNER = 0.85
WERNER_PAIRS = np.array([WERNER, *[(1 - WERNER) / 3] * 3])


@pytest.mark.parametrize("protocol", [1, 2])
def test_memories_purify_as_the_closed_forms_say(tmp_path: Path, protocol: int) -> None:
    """The source of q1 puts a half of each pair into either memory."""
    found: list[float] = []
    shares, agreed = after_bbpssw(WERNER) if protocol == 1 else after_dejmps(WERNER_PAIRS)

    async def run() -> None:
        clock = PatientClock()
        source = PairSource(fidelity=WERNER)
        q1 = QuantumSwitch("q1", analysers=1, memories=2, sources=1, source=source)
        async with running(configuration(tmp_path, switches=[q1]), clock) as bench:
            scene = Scene(bench, clock)
            await scene.reports.initial_metadata()
            await bench.switch.connect((62_001, ONE), (62_002, TWO))
            await emit(bench, session=8, number=1)
            await bench.transport.landed()
            await require_stored(scene, *sorted((ONE, TWO)))
            bits = [await purified(scene, port, protocol) for port in (ONE, TWO)]
            kept = np.flatnonzero(bits[0] == bits[1])
            found.append(kept.size / bits[0].size)
            named = np.where(bits[0] == bits[1], 0, 255).astype(np.uint8)
            found.extend(np.bincount(await met(scene, named), minlength=4) / kept.size)
            assert await states(scene) == [(0, PAIRS, kept.size, 0, 0)] * 2
            scene.reports.cancel()

    uvloop.run(run())
    pairs = PAIRS // 2
    assert abs(found[0] - agreed) < 5 * math.sqrt(agreed * (1 - agreed) / pairs)
    for share, expected in zip(found[1:], shares, strict=True):
        error = math.sqrt(expected * (1 - expected) / (agreed * pairs))
        assert abs(share - expected) < 5 * error


@pytest.mark.parametrize(("protocol", "blocks"), [(2, 1), (1, 1), (1, 2)])
def test_a_round_that_fails_on_its_way_leaves_no_qubit(
    tmp_path: Path, protocol: int, blocks: int
) -> None:
    """The memory may have one block of its own, or two, and a round needs more to part it."""

    async def act(scene: Scene) -> None:
        layer = scene.bench.layer
        await scene.bench.switch.connect(*STORING)
        await scene.emit_both()
        await require_stored(scene, ONE, TWO)
        layer.share_of_blocks = blocks
        with pytest.raises(grpc.aio.AioRpcError, match="q1-memory1 has made are live, its share"):
            await purified(scene, ONE, protocol)
        report = await scene.report()
        assert (report.port, report.end, report.photons) == (ONE, BellOutcomes.UNFIT, PAIRS)
        assert not at(scene, 1)
        assert await states(scene) == [(0, PAIRS, 0, 0, PAIRS), (PAIRS, PAIRS, 0, 0, 0)]
        await scene.bench.switch.connect((TWO, 4))
        await scene.bench.transport.landed()

    play(tmp_path, act)


async def met(scene: Scene, named: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Let pulses that are named meet at the analyser, which tells the Bell state of each pair."""
    for port in (ONE, TWO):
        request = KeepRequest(switch="q1", port=port, number=1, outcomes=named.tobytes())
        await scene.bench.switch.call("Keep", request)
    await scene.bench.switch.connect(*STORING, *LEADING)
    return await swapped(scene)


# Which errors (1: X, 2: Z, 3: Y) flip a bit in Z behind each third of a turn, I X Z Y: behind S H
# X is Y, Z is X and Y is Z; behind H S_DAG X is Z, Z is Y and Y is X.
FLIPS = np.array([[0, 1, 0, 1], [0, 1, 1, 0], [0, 0, 1, 1]])


def test_each_pulse_is_compared_with_the_next_whatever_third_it_turns_by(tmp_path: Path) -> None:
    """Errors of perfect pairs, drawn for each, make just those bits differ that they flip."""
    random = np.random.default_rng(5)
    thirds, errors = random.integers(0, 3, PAIRS), random.integers(0, 4, PAIRS)
    flipped = FLIPS[thirds, errors]

    async def act(scene: Scene) -> None:
        await scene.bench.switch.connect((62_001, ONE), (62_002, TWO))
        await emit(scene.bench, session=8, number=1)
        await scene.bench.transport.landed()
        await require_stored(scene, *sorted((ONE, TWO)))
        orders = (4 * thirds).astype(np.uint8), (4 * thirds + errors).astype(np.uint8)
        bits = [
            await purified(scene, port, 1, order)
            for port, order in zip((ONE, TWO), orders, strict=True)
        ]
        assert ((bits[0] ^ bits[1]) == flipped[::2] ^ flipped[1::2]).all()
        await met(scene, np.zeros(PAIRS // 2, np.uint8))

    play(tmp_path, act, sources=1)


def test_the_wait_that_a_swap_reports_is_that_before_all_rounds(tmp_path: Path) -> None:
    """Perfect pairs that came at one instant; nothing lasts but the waits and the switch."""
    waits_ns = 3_000_000, 500_000, 7_000

    async def act(scene: Scene) -> None:
        await scene.bench.switch.connect((62_001, ONE), (62_002, TWO))
        await emit(scene.bench, session=8, number=1)
        await scene.bench.transport.landed()
        await require_stored(scene, *sorted((ONE, TWO)))
        halves = [block for memory in (1, 2) for block in at(scene, memory)]
        mean_ns = np.mean([cutoff.came_ns(half).mean() for half in halves])
        scene.clock.time_ns = now_ns = round(mean_ns) + waits_ns[0]
        for size, wait_ns in ((PAIRS, waits_ns[1]), (PAIRS // 2, waits_ns[2])):
            for port in (ONE, TWO):
                await purified(scene, port, 2, np.zeros(size, np.uint8))
            scene.clock.time_ns = now_ns = now_ns + wait_ns
        for port in (ONE, TWO):
            request = KeepRequest(switch="q1", port=port, number=1, outcomes=bytes(PAIRS // 4))
            await scene.bench.switch.call("Keep", request)
        await scene.bench.switch.connect(*STORING, *LEADING)
        report = await scene.report()
        assert (report.end, report.photons) == (BellOutcomes.MEASURED, PAIRS // 4)
        assert report.waited_ns == pytest.approx(sum(waits_ns) + 100, abs=200)

    play(tmp_path, act, sources=1)


async def purified(
    scene: Scene, port: int, protocol: int, order: np.ndarray[Any, Any] | None = None
) -> np.ndarray[Any, Any]:
    """Have a memory do a round on all of its first block."""
    if order is None:
        random = np.random.default_rng(3)  # alike at both ends
        order = random.integers(0, 12 if protocol == 1 else 1, PAIRS, np.uint8)
    method = 2 * protocol + (port == TWO)
    request = KeepRequest(switch="q1", port=port, number=1, outcomes=order.tobytes(), method=method)
    await scene.bench.switch.call("Keep", request)
    report = await scene.report()
    assert (report.port, report.end, report.number) == (port, BellOutcomes.PURIFIED, 1)
    return np.frombuffer(report.outcomes, np.uint8)
