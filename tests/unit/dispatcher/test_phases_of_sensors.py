"""Phases that qubits take at hosts, against closed forms."""

from math import cos, pi, sqrt

import numpy as np
import pytest
import uvloop
from five_sigma import within

from dispatcher.refusal import Refusal
from dispatcher.sabot.dense import TooLarge
from evidence.laboratory import Laboratory, block_id
from wire.config import DispatcherConfig
from wire.dispatcher_pb2 import CreateRequest, Gate, MeasureRequest
from wire.parameters.physics import BadParameter, Detectors, Device, Gates, Sensor
from wire.typed_json import read

COUNT = 20_000


def laboratory(**devices: Device) -> Laboratory:
    """Return hosts without fibres."""
    tokens = dict.fromkeys(devices, "")
    return Laboratory(DispatcherConfig("", "", 1, tokens, [], [], devices=devices))


async def plus(hosts: Laboratory, basis: MeasureRequest.Basis) -> float:
    """Return the mean of |+> at alice that took her phase, in a basis."""
    alice = hosts.host("alice")
    await alice.create(COUNT, state=CreateRequest.ZEROS)
    await alice.apply((0, 0), gates=[Gate(name=Gate.H)])
    feedback = await alice.sense((0, 0))
    assert feedback.exact
    found = await alice.measure((0, 0), basis)
    return float(1 - 2 * found.mean())


@pytest.mark.parametrize("phase", [0.0, 0.3, -2.0, pi / 2])
def test_a_qubit_takes_the_phase_of_its_host(phase: float) -> None:
    """|0> + exp(i phase) |1>: cos(phase) in X, sin(phase) = cos(phase - pi/2) in Y."""
    for basis, angle in ((MeasureRequest.X, 0.0), (MeasureRequest.Y, pi / 2)):
        hosts = laboratory(alice=Device(sensor=Sensor(phase)))
        report, expected = uvloop.run(plus(hosts, basis)), cos(phase - angle)
        assert abs(report - expected) <= 5 * sqrt(1 - expected**2 + 1e-12) / sqrt(COUNT)


def test_both_halves_of_a_pair_take_phases_that_add_up() -> None:
    """Phi+ becomes |00> + exp(i (.4 + .4)) |11>: parity cos(.8) in X."""
    hosts = laboratory(alice=Device(sensor=Sensor(0.4)))

    async def parity() -> float:
        alice = hosts.host("alice")
        await alice.create(COUNT)
        for half in (0, 1):
            await alice.sense((0, half))
        found = [await alice.measure((0, half), MeasureRequest.X) for half in (0, 1)]
        return float(1 - 2 * np.bitwise_xor(*found).mean())

    assert abs(uvloop.run(parity()) - cos(0.8)) < 5 * sqrt(1 - cos(0.8) ** 2) / sqrt(COUNT)


def test_a_phase_is_no_gate_and_has_none_of_its_noise() -> None:
    noisy = Gates(kind="any", one_qubit_depolarizing=1.0)
    hosts = laboratory(alice=Device(gates=noisy, sensor=Sensor(0.0)))

    async def parity() -> int:
        alice = hosts.host("alice")
        await alice.create(1000)
        await alice.sense((0, 0))
        found = [await alice.measure((0, half), MeasureRequest.X) for half in (0, 1)]
        return int(np.bitwise_xor(*found).sum())

    assert uvloop.run(parity()) == 0


def test_probes_that_are_made_here_are_read_with_the_errors_of_gates() -> None:
    """A bit read wrongly with r leaves 1 - 2 r of the fringe; detectors count light alone."""
    wrong = Device(gates=Gates(readout_error=0.1), detectors=Detectors(readout_error=0.5))
    hosts = laboratory(alice=wrong)

    async def probe() -> int:
        await hosts.host("alice").prepare(np.full(COUNT, 2, np.uint8))  # |+>
        await hosts.host("alice").sense((0, 0))
        return int((await hosts.host("alice").measure((0, 0), MeasureRequest.X)).sum())

    assert within(uvloop.run(probe()), COUNT, 0.1)


def test_what_is_not_at_the_host_takes_no_phase_of_it() -> None:
    hosts = laboratory(alice=Device(), bob=Device(sensor=Sensor(1.0)))

    async def refused() -> None:
        await hosts.host("alice").create(10)
        with pytest.raises(Refusal, match="not at"):
            await hosts.host("bob").sense((0, 1))
        with pytest.raises(Refusal, match="7"):
            await hosts.host("bob").sense((7, 0))

    uvloop.run(refused())
    assert block_id((0, 1)).half == 1


def test_more_amplitudes_than_there_may_be_are_refused_before_anything_changes() -> None:
    hosts = laboratory(alice=Device(sensor=Sensor(0.3)))

    async def refused() -> None:
        alice = hosts.host("alice")
        await alice.create(2_000_000)
        with pytest.raises(TooLarge, match="use smaller blocks"):
            await alice.sense((0, 0))
        assert (await alice.measure((0, 0), MeasureRequest.X)).size == 2_000_000

    uvloop.run(refused())


def test_a_phase_that_is_no_number_is_refused() -> None:
    with pytest.raises(BadParameter, match="phase_rad nan: choose -1000 to 1000"):
        Device(sensor=Sensor(float("nan"))).check("alice")
    assert read(Device, {"sensor": {"phase_rad": 0.5}}).sensor == Sensor(0.5)
