"""Bell analysers of a switch: light of two inputs meets there, and every block has an end."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import uvloop
from dispatcher_network import Bench, JumpingClock, block, configuration, running
from limits import SOON_S

from wire.dispatcher_pb2 import (
    BellOutcomes,
    MeasureRequest,
    SwitchStatisticsReply,
    WatchSwitchRequest,
)
from wire.parameters.physics import BadParameter, BellAnalyser, Detectors, Device, PairSource
from wire.parameters.switch import QuantumSwitch

PAIRS = 2000
FIRST, SECOND = 60_001, 60_002
TO_ANALYSER = (3, FIRST), (4, SECOND)  # of alice's and bob's fibres


class PatientClock(JumpingClock):
    """A clock that jumps over all waits but the long ones: these last until they are over."""

    def __init__(self) -> None:
        super().__init__()
        self.over = asyncio.Event()

    async def wait_until(self, time_ns: int) -> None:
        """Return at once, or when long waits are over."""
        if time_ns - self.time_ns > 1_000_000_000:
            await self.over.wait()
        await super().wait_until(time_ns)


class Scene:
    """The bench, and what q1's agent hears."""

    def __init__(self, bench: Bench, clock: PatientClock) -> None:
        self.bench, self.clock = bench, clock
        request, metadata = WatchSwitchRequest(switch="q1"), bench.switch.metadata
        watch = bench.stub.WatchAnalysers
        self.reports = watch(request, metadata=metadata, timeout=SOON_S)

    async def emit(self, host: Any, port: str, number: int, count: int = PAIRS) -> None:
        """Make pairs, and send halves 1."""
        await host.create(count, number)
        await host.send((block(number, 1), port))

    async def emit_both(self, count: int = PAIRS) -> None:
        """Let both hosts do so; alice's blocks have even numbers."""
        await self.emit(self.bench.alice, "alice-q0", 0, count)
        await self.emit(self.bench.bob, "bob-q0", 1, count)

    async def report(self) -> BellOutcomes:
        """Return the next report."""
        report = await self.reports.read()
        assert isinstance(report, BellOutcomes)
        return report

    async def require_empty(self) -> None:
        """Fail if a qubit is left that is not one of the halves 0."""
        status = await self.bench.runner.status()
        assert status.live_qubits == sum(
            each.register.remaining
            for node in ("alice", "bob")
            for each in self.bench.layer.ownership.at_node(node)
        )
        assert not self.bench.layer.ownership.at_node("q1-analyser1")


def play(folder: Path, act: Callable[[Scene], Awaitable[None]], **switch: Any) -> None:
    """Run a scene on the network whose q1 has one analyser."""

    async def run() -> None:
        clock = PatientClock()
        devices = switch.pop("devices", {})
        q1 = QuantumSwitch("q1", analysers=1, **switch)
        config = replace(configuration(folder), switches=[q1], devices=devices)
        async with running(config, clock) as bench:
            scene = Scene(bench, clock)
            await scene.reports.initial_metadata()
            await bench.switch.connect(*TO_ANALYSER)
            await act(scene)
            await scene.require_empty()
            scene.reports.cancel()

    uvloop.run(run())


async def correlated(scene: Scene, outcomes: np.ndarray[Any, Any], basis: Any) -> float:
    """Measure halves 0 in a basis; return how often they agree with what Phi+ would show.

    bob applies the outcome's Pauli first: its number is the operator.
    """
    seen = outcomes != 255
    await scene.bench.bob.apply(block(1), np.where(seen, outcomes, 0).astype(np.uint8).tobytes())
    one = await scene.bench.alice.measure(block(0), basis)
    other = await scene.bench.bob.measure(block(1), basis)
    a, b = (np.frombuffer(each.outcomes, np.uint8)[seen] for each in (one, other))
    opposite = basis == MeasureRequest.Y
    return float(np.mean((a == b) != opposite))


def agreements(
    folder: Path, basis: MeasureRequest.Basis, fidelity: float = 1.0, **switch: Any
) -> tuple[float, int]:
    """Return how often corrected pairs agree in a basis, and how many pairs that were.

    Both sources make Werner pairs of this fidelity.
    """
    found: list[float] = []

    async def act(scene: Scene) -> None:
        await scene.emit_both()
        report = await scene.report()
        assert (report.port, report.number, report.end) == (FIRST, 1, BellOutcomes.MEASURED)
        outcomes = np.frombuffer(report.outcomes, np.uint8)
        assert outcomes.size == report.photons == PAIRS
        found.append(await correlated(scene, outcomes, basis))
        found.append(int(np.count_nonzero(outcomes != 255)))

    device = Device(source=PairSource(fidelity=fidelity))
    play(folder, act, devices={"alice": device, "bob": device}, **switch)
    return found[0], int(found[1])


@pytest.mark.parametrize("basis", [MeasureRequest.Z, MeasureRequest.X, MeasureRequest.Y])
def test_halves_of_two_sources_swap_at_an_ideal_analyser(tmp_path: Path, basis: Any) -> None:
    assert agreements(tmp_path, basis) == (1, PAIRS)


def test_all_four_outcomes_are_equally_frequent(tmp_path: Path) -> None:
    async def act(scene: Scene) -> None:
        await scene.emit_both()
        counts = np.bincount(np.frombuffer((await scene.report()).outcomes, np.uint8), minlength=4)
        assert counts.sum() == PAIRS
        (counted,) = (await scene.bench.switch.statistics()).analysers
        phi_plus, psi_plus, phi_minus, psi_minus = map(int, counts)
        assert counted == SwitchStatisticsReply.Analyser(
            port=FIRST,
            pulses=PAIRS,
            phi_plus=phi_plus,
            psi_plus=psi_plus,
            phi_minus=phi_minus,
            psi_minus=psi_minus,
        )
        assert (abs(counts - PAIRS / 4) < 5 * np.sqrt(PAIRS * 3 / 16)).all()

    play(tmp_path, act)


def test_noisy_sources_and_linear_optics_swap_as_the_closed_forms_say(tmp_path: Path) -> None:
    # F = F1 F2 + (1 - F1)(1 - F2)/3 of Werner pairs, which agree with (2 F + 1)/3; linear optics
    # tell two of four states.
    one = 0.9
    fidelity = one**2 + (1 - one) ** 2 / 3
    linear = BellAnalyser(kind="linear")
    agreed, seen = agreements(tmp_path, MeasureRequest.Z, one, analyser=linear)
    assert abs(seen - PAIRS / 2) < 5 * np.sqrt(PAIRS / 4)
    expected = (2 * fidelity + 1) / 3
    assert abs(agreed - expected) < 5 * np.sqrt(expected * (1 - expected) / seen)


def test_noise_of_the_analyser_is_of_the_switch(tmp_path: Path) -> None:
    # A visibility of V flips the phase with (1 - V)/2; both detectors click with eta^2.
    agreed, seen = agreements(
        tmp_path,
        MeasureRequest.X,
        analyser=BellAnalyser(visibility=0.8),
        detectors=Detectors(efficiency=0.7),
    )
    assert abs(seen - 0.49 * PAIRS) < 5 * np.sqrt(PAIRS * 0.49 * 0.51)
    assert abs(agreed - 0.9) < 5 * np.sqrt(0.09 / seen)


def test_light_without_a_partner_ends_by_name_and_is_gone(tmp_path: Path) -> None:
    async def act(scene: Scene) -> None:
        await scene.emit(scene.bench.alice, "alice-q0", 0)
        scene.clock.over.set()
        report = await scene.report()
        assert (report.end, report.photons) == (BellOutcomes.NO_PARTNER, PAIRS)
        (counted,) = (await scene.bench.switch.statistics()).analysers
        assert counted == SwitchStatisticsReply.Analyser(port=FIRST, no_partner=1)

    play(tmp_path, act)


def test_light_that_waits_when_its_path_ends_is_gone(tmp_path: Path) -> None:
    async def act(scene: Scene) -> None:
        await scene.emit(scene.bench.bob, "bob-q0", 1)
        await scene.bench.switch.connect(TO_ANALYSER[1])  # the other path alone is not its own
        await scene.bench.switch.connect(TO_ANALYSER[0])
        assert (await scene.report()).end == BellOutcomes.CLOSED

    play(tmp_path, act)


@pytest.mark.parametrize(
    ("counts", "switch"),
    [((PAIRS, PAIRS - 1), {}), ((9, 9), {"detectors": Detectors(encoding="time-bin")})],
)
def test_light_that_does_not_fit_together_is_gone(
    tmp_path: Path, counts: tuple[int, int], switch: dict[str, Any]
) -> None:
    async def act(scene: Scene) -> None:
        await scene.emit(scene.bench.alice, "alice-q0", 0, counts[0])
        await scene.emit(scene.bench.bob, "bob-q0", 1, counts[1])
        assert (await scene.report()).end == BellOutcomes.UNFIT

    play(tmp_path, act, **switch)


def test_parts_without_analysers_have_no_effect_and_are_refused() -> None:
    with pytest.raises(BadParameter, match="without analysers have no effect; give analysers=1"):
        QuantumSwitch("q1", detectors=Detectors(efficiency=0.5)).check()
    with pytest.raises(BadParameter, match="q1 rotates light, and its analysers do not know"):
        QuantumSwitch("q1", analysers=1, rotation=2).check()
