"""Gates, readings and initialisation that take time and err; closed forms, 5 sigma, seed 1."""

from collections.abc import Awaitable, Callable
from math import exp
from typing import Any

import numpy as np
import pytest
import uvloop
from five_sigma import within

from evidence.laboratory import Laboratory, block_id
from wire.config import DispatcherConfig, Fiber, FiberEnd
from wire.dispatcher_pb2 import CreateRequest, Gate, MeasureRequest
from wire.parameters.physics import BellAnalyser, Device, Gates, Memory

X, ZEROS = MeasureRequest.X, CreateRequest.ZEROS
COUNT = 4_000
ONE_S, TWO_S, INITIAL_S, READOUT_S = 1e-3, 20e-3, 300e-3, 4_000e-3
SLOW = {
    "one_qubit_s": ONE_S,
    "two_qubit_s": TWO_S,
    "initialization_s": INITIAL_S,
    "readout_s": READOUT_S,
}


def at_alice(act: Callable[[Laboratory], Awaitable[None]], t2_s: float = 1.0, **gates: Any) -> None:
    """Let something happen at alice, who has a fibre to bob, without any length."""
    device = Device(memory=Memory(t2_s=t2_s), gates=Gates(**gates), analyser=BellAnalyser("gates"))

    async def inside() -> None:
        fibers = [Fiber(FiberEnd("alice", "alice-q0"), FiberEnd("bob", "bob-q0"), length_km=0.0)]
        tokens, devices = dict.fromkeys(("alice", "bob"), ""), {"alice": device, "bob": device}
        await act(Laboratory(DispatcherConfig("", "", 1, tokens, fibers, [], devices=devices)))

    uvloop.run(inside())


def test_each_operation_is_over_when_its_time_is() -> None:
    reports: list[float] = []

    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")

        async def timed(operation: Awaitable[Any]) -> None:
            began_ns = laboratory.clock.now_ns()
            await operation
            reports.append((laboratory.clock.now_ns() - began_ns) / 1e9)

        await timed(alice.create(2, 0, ZEROS))
        await timed(alice.create(2, 1, ZEROS))
        await timed(alice.apply((0, 0), np.array([0, 1], np.uint8)))
        await timed(alice.apply((0, 0), np.zeros(2, np.uint8)))
        both = [Gate(name=Gate.H), Gate(name=Gate.CX, target=block_id((1, 0)))]
        await timed(alice.apply((0, 0), gates=both))
        await timed(alice.resend((0, 0), np.array([0, 255], np.uint8)))
        await timed(alice.bell_measure((0, 0), (1, 0)))
        await alice.create(2, 2, ZEROS)
        await timed(alice.measure((2, 0)))

    at_alice(act, **SLOW)
    bell_s = ONE_S + TWO_S + READOUT_S
    expected = [INITIAL_S, INITIAL_S, ONE_S, 0, ONE_S + TWO_S, READOUT_S, bell_s, READOUT_S]
    assert reports == pytest.approx(expected, abs=1e-8)


def test_light_is_modulated_and_measured_at_once() -> None:
    async def act(laboratory: Laboratory) -> None:
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        began_ns = laboratory.clock.now_ns()
        alice.asked_ns = bob.asked_ns = began_ns  # for all of it
        await alice.create(10)
        await alice.apply((0, 1), np.ones(10, np.uint8))
        await alice.send({(0, 1): "alice-q0"})
        await bob.receive((0, 1), "bob-q0")
        assert (await bob.measure((0, 1)) != await alice.measure((0, 0))).all()
        assert laboratory.clock.now_ns() - began_ns < 1e6

    at_alice(act, **SLOW, readout_error=0.5)


def test_others_decohere_while_a_gate_lasts() -> None:
    """Both halves wait for it: X and X agree with (1 + e^(-2 t / T2)) / 2."""

    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        for number in (1, 2):
            await alice.create(1, number, ZEROS)
        await alice.create(COUNT)
        for half in (0, 1):
            await alice.store((0, half))
        await alice.apply((1, 0), gates=[Gate(name=Gate.CX, target=block_id((2, 0)))])
        mine, yours = await alice.measure((0, 0), X), await alice.measure((0, 1), X)
        expected = (1 + exp(-2 * TWO_S / 0.05)) / 2
        assert within(int((mine == yours).sum()), COUNT, expected)

    at_alice(act, t2_s=0.05, two_qubit_s=TWO_S)


def test_a_gate_has_its_own_errors_and_no_decoherence_beside() -> None:
    """Gates of a second on both halves: what waits is nothing of them, and all of the other."""

    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(COUNT)
        for half in (0, 1):
            await alice.store((0, half))
        await alice.apply((0, 0), gates=[Gate(name=Gate.H), Gate(name=Gate.H)])
        await alice.store((0, 0))
        mine, yours = await alice.measure((0, 0), X), await alice.measure((0, 1), X)
        expected = (1 + exp(-2 * 0.1 / 0.2)) / 2
        assert within(int((mine == yours).sum()), COUNT, expected)

    at_alice(act, t2_s=0.2, one_qubit_s=0.1)


@pytest.mark.parametrize("error", [0.03, 0.2])
def test_readings_are_flipped_so_often(error: float) -> None:
    """Of Phi+ each bit: Psi+ and Phi- with e (1 - e), Psi- with e^2."""

    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(COUNT, 1, ZEROS)
        assert within(int((await alice.measure((1, 0))).sum()), COUNT, error)
        await alice.create(COUNT)
        reports = np.bincount(await alice.bell_measure((0, 0), (0, 1)), minlength=4)
        each = error * (1 - error)
        for count, expected in zip(reports, [(1 - error) ** 2, each, each, error**2], strict=True):
            assert within(int(count), COUNT, expected)

    at_alice(act, readout_error=error)


def test_what_is_told_wrongly_is_there_as_it_was_found() -> None:
    """Read twice: the readings differ with 2 e (1 - e), and neither error is in the qubit."""
    error = 0.1

    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(COUNT, 1, ZEROS)
        first = await alice.resend((1, 0), np.zeros(COUNT, np.uint8))
        second = await alice.measure((1, 0))
        assert within(int((first != second).sum()), COUNT, 2 * error * (1 - error))

    at_alice(act, readout_error=error)


def test_qubits_are_made_wrongly_so_often() -> None:
    error = 0.07

    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(COUNT, 1, ZEROS)
        assert within(int((await alice.measure((1, 0))).sum()), COUNT, error)

    at_alice(act, initialization_error=error)
