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
            # Meet at the analyser, by name: it tells which Bell state each pair is in.
            for port in (ONE, TWO):
                named = np.full(bits[0].size, 255, np.uint8)
                named[kept] = 0
                await bench.switch.call(
                    "Keep",
                    KeepRequest(switch="q1", port=port, number=1, outcomes=named.tobytes()),
                )
            await bench.switch.connect(*STORING, *LEADING)
            found.extend(np.bincount(await swapped(scene), minlength=4) / kept.size)
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


async def purified(scene: Scene, port: int, protocol: int) -> np.ndarray[Any, Any]:
    """Have a memory do a round on all of its first block, ordered in two parts."""
    random = np.random.default_rng(3)  # alike at both ends
    order = random.integers(0, 12, PAIRS, np.uint8) if protocol == 1 else np.zeros(PAIRS, np.uint8)
    method = 2 * protocol + (port == TWO)
    for first in (0, PAIRS // 3):
        part = order[first:] if first else order[: PAIRS // 3]
        request = KeepRequest(switch="q1", port=port, number=1, first=first, method=method)
        request.outcomes = part.tobytes()
        await scene.bench.switch.call("Keep", request)
    report = await scene.report()
    assert (report.port, report.end, report.number) == (port, BellOutcomes.PURIFIED, 1)
    return np.frombuffer(report.outcomes, np.uint8)
