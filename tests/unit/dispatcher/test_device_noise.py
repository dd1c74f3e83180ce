"""Noise models of one's own for parts of devices, beside closed forms; 5 sigma, seed 1."""

from collections.abc import Awaitable, Callable
from math import exp, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import uvloop
from five_sigma import within
from numpy.typing import NDArray

from dispatcher.layer.device_noise import TO_Z
from evidence.laboratory import SESSION, Laboratory
from wire.config import BadConfig, DispatcherConfig
from wire.dispatcher_pb2 import CreateRequest, Gate, MeasureRequest
from wire.outcomes import BASES, NO_CLICK
from wire.parameters.physics import (
    BadParameter,
    BellAnalyser,
    Detectors,
    Device,
    Gates,
    Memory,
    PairSource,
)

X, ZEROS = MeasureRequest.X, CreateRequest.ZEROS
COUNT = 4_000
Matrix = NDArray[np.float64]
MODEL = """
from dataclasses import dataclass
import numpy as np
from dispatcher.fiber.noise import Effect

@dataclass(frozen=True)
class Sometimes:
    pauli: int = 0
    chance: float = 0.0
    lost: float = 0.0
    only: str = ""

    def effect(self, moment):
        if self.only and self.only != f"{moment.what} {moment.qubits}":
            return Effect()
        paulis = moment.happens("pauli", self.chance) * np.uint8(self.pauli)
        return Effect(lost=moment.happens("loss", self.lost), paulis=paulis)

class Late:
    def effect(self, moment):
        return Effect(delays_ps=np.zeros(moment.photons))

class Wrong:
    def effect(self, moment):
        return Effect(paulis=np.full(moment.photons, 7, np.uint8))
"""
AGEING = str(Path(__file__).parents[3] / "docs" / "noise-models" / "ageing.py") + ":Ageing"


@pytest.fixture
def model(tmp_path: Path) -> str:
    """Return a file with models."""
    (tmp_path / "models.py").write_text(MODEL)
    return f"{tmp_path / 'models.py'}"


def at_alice(act: Callable[[Laboratory], Awaitable[None]], device: Device) -> None:
    """Let something happen at alice."""

    async def inside() -> None:
        config = DispatcherConfig("", "", 1, {"alice": ""}, [], [], devices={"alice": device})
        await act(Laboratory(config))

    uvloop.run(inside())


def sometimes(model: str, **parameters: Any) -> dict[str, Any]:
    """Return the noise of a part."""
    return {"noise": f"{model}:Sometimes", "noise_parameters": parameters}


def test_each_basis_is_turned_onto_z() -> None:
    """U O U^-1 = Z of the observable O of each of BASES."""
    x, y, z = np.array([[0, 1], [1, 0]]), np.array([[0, -1j], [1j, 0]]), np.diag([1, -1])
    observables = {"Z": z, "X": x, "Y": y, "Z+X": (z + x) / sqrt(2), "Z-X": (z - x) / sqrt(2)}
    for name, to_z in zip(BASES, TO_Z, strict=True):
        assert np.allclose(to_z @ observables[name] @ to_z.conj().T, z), name


def test_a_memory_ages_as_its_model_says() -> None:
    """The example: after t, X and X agree with (1 + exp(-(t / T)^2))/2 of one half that waits."""

    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(COUNT)
        await alice.store((0, 0))
        alice.asked_ns = laboratory.clock.now_ns()  # the other half does not wait
        await laboratory.wait(0.03)
        agree = (await alice.measure((0, 0), X)) == (await alice.measure((0, 1), X))
        assert within(int(agree.sum()), COUNT, (1 + exp(-((0.03 / 0.05) ** 2))) / 2)

    memory = Memory(noise=AGEING, noise_parameters={"time_s": 0.05})
    at_alice(act, Device(memory=memory))


def test_a_source_errs_and_is_dark_as_its_model_says(model: str) -> None:
    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(COUNT)
        mine, yours = await alice.measure((0, 0)), await alice.measure((0, 1))
        assert ((mine == NO_CLICK) == (yours == NO_CLICK)).all()  # pairs are made, or not
        made = int((mine != NO_CLICK).sum())
        assert within(made, COUNT, 0.7)
        assert within(int(((mine ^ yours) == 1).sum()), made, 0.2)

    source = PairSource(**sometimes(model, pauli=1, chance=0.2, lost=0.3))
    at_alice(act, Device(source=source))


@pytest.mark.parametrize(("only", "flipped"), [("gate 1", 0.2), ("gate 2", 0.0)])
def test_gates_err_as_their_model_says(model: str, only: str, flipped: float) -> None:
    """X behind S: of one qubit, which is in |0>."""

    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(COUNT, 0, ZEROS)
        await alice.apply((0, 0), gates=[Gate(name=Gate.S)])
        assert within(int((await alice.measure((0, 0))).sum()), COUNT, flipped)

    at_alice(act, Device(gates=Gates(**sometimes(model, pauli=1, chance=0.2, only=only))))


FLIP, PHASE = np.array([[0, 1], [1, 0]]), np.diag([1, -1])
ERRORS = [np.eye(2), FLIP, PHASE, FLIP @ PHASE]  # 0 I, 1 X, 2 Z, 3 XZ


def told_by_gates(pauli: int, of_one: float, of_two: float) -> Matrix:
    """Return how likely a CX, an H and two readings tell each Bell state of Phi+: in matrices.

    The operator follows the H, and the CX on either qubit, each with its chance.
    """
    phi = np.array([1, 0, 0, 1]) / np.sqrt(2)
    state = np.outer(phi, phi)
    error, idle = ERRORS[pauli], ERRORS[0]
    hadamard = np.kron(np.array([[1, 1], [1, -1]]) / np.sqrt(2), idle)
    for gate, chance, both in ((np.eye(4)[[0, 1, 3, 2]], of_two, True), (hadamard, of_one, False)):
        state = gate @ state @ gate.T
        for hit in (np.kron(error, idle), np.kron(idle, error))[: 1 + both]:
            state = (1 - chance) * state + chance * hit @ state @ hit.T
    return np.diag(state).clip(0)  # phase, parity: Phi+, Psi+, Phi-, Psi-


@pytest.mark.parametrize("pauli", [1, 2, 3])
@pytest.mark.parametrize("only", ["gate 1", "gate 2"])
def test_gates_of_a_bell_measurement_err_as_their_model_says(
    model: str, pauli: int, only: str
) -> None:
    """Each behind its gate: X behind the CX does not flip what it would in front of it."""
    chances = (0.2, 0.0) if only == "gate 1" else (0.0, 0.2)
    expected = told_by_gates(pauli, *chances)

    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(COUNT)
        counts = np.bincount(await alice.bell_measure((0, 0), (0, 1)), minlength=4)
        assert all(within(int(n), COUNT, p) for n, p in zip(counts, expected, strict=True))

    gates = Gates(**sometimes(model, pauli=pauli, chance=0.2, only=only))
    at_alice(act, Device(gates=gates, analyser=BellAnalyser("gates")))


def test_who_resends_meets_the_noise_of_its_detectors_too(model: str) -> None:
    """Of |0> measured in Z, .2 is read and sent on as |1>, and .3 is missed: nothing is sent."""

    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.prepare(np.zeros(COUNT, np.uint8))
        report = await alice.resend((0, 0), np.zeros(COUNT, np.uint8))
        assert within(int((report == NO_CLICK).sum()), COUNT, 0.3)
        assert within(int((report == 1).sum()), COUNT, 0.7 * 0.2)
        [sent] = laboratory.layer.ownership.of_session("alice", SESSION)
        np.testing.assert_array_equal(sent.register.present, report != NO_CLICK)
        again = await alice.measure((0, 0))  # which errs again
        there = again != NO_CLICK
        assert within(int((report != again)[there].sum()), int(there.sum()), 0.2)

    detectors = Detectors(**sometimes(model, pauli=1, chance=0.2, lost=0.3))
    at_alice(act, Device(detectors=detectors))


def test_detectors_err_and_miss_as_their_model_says(model: str) -> None:
    """X on Phi+ is read as Psi+, and lost photons are no coincidence."""

    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(COUNT, 0, ZEROS)
        outcomes = await alice.measure((0, 0))
        assert within(int((outcomes == NO_CLICK).sum()), COUNT, 0.25)
        assert within(int((outcomes == 1).sum()), int((outcomes != NO_CLICK).sum()), 0.1)
        await alice.create(COUNT, 1)
        states = await alice.bell_measure((1, 0), (1, 1))
        assert set(states.tolist()) == {0, 1, NO_CLICK}
        assert within(int((states == 1).sum()), int((states != NO_CLICK).sum()), 0.1)

    detectors = Detectors(**sometimes(model, pauli=1, chance=0.1, lost=0.25))
    at_alice(act, Device(detectors=detectors))


def test_no_model_lets_linear_optics_tell_what_these_cannot_tell(model: str) -> None:
    """Z takes Phi+ for Phi-, which linear optics report as Phi+."""

    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(COUNT)
        assert not (await alice.bell_measure((0, 0), (0, 1))).any()

    detectors = Detectors(**sometimes(model, pauli=2, chance=0.5))
    at_alice(act, Device(detectors=detectors, analyser=BellAnalyser("linear")))


@pytest.mark.parametrize(
    ("kind", "words"), [("Late", "delays_ps is of fibres"), ("Wrong", "Pauli 7 is not 0 to 3")]
)
def test_an_answer_that_no_part_can_follow_is_refused(model: str, kind: str, words: str) -> None:
    async def act(laboratory: Laboratory) -> None:
        with pytest.raises(BadConfig, match=words):
            await laboratory.host("alice").create(10)

    at_alice(act, Device(source=PairSource(noise=f"{model}:{kind}")))


def test_a_model_that_is_not_there_is_named_before_anything_runs(model: str) -> None:
    async def nothing(_laboratory: Laboratory) -> None:
        pytest.fail("it runs")

    with pytest.raises(BadConfig, match="has no class Missing"):
        at_alice(nothing, Device(gates=Gates(noise=f"{model}:Missing")))
    with pytest.raises(BadParameter, match=r"give FILE\.py:CLASS"):
        at_alice(nothing, Device(gates=Gates(noise=7)))  # type: ignore[arg-type]
