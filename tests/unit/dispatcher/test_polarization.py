"""Turns of polarisation about any axis, against matrices and closed forms; 5 sigma, seed 1."""

from collections.abc import Awaitable, Callable
from typing import Any

import numpy as np
import pytest
import uvloop
from five_sigma import within
from numpy.typing import NDArray

from dispatcher.fiber.turn import SIGNS, TRANSPOSED, Turn, of_vectors, product
from dispatcher.layer.ownership import BlockName
from dispatcher.refusal import Refusal
from evidence.laboratory import Laboratory
from wire.config import DispatcherConfig, Fiber, FiberEnd
from wire.parameters.physics import Detectors, Device, PairSource

COUNT = 100_000
Matrix = NDArray[np.complex128]
X: Matrix = np.array([[0, 1], [1, 0]], np.complex128)
Z: Matrix = np.diag([1, -1]).astype(np.complex128)
PAULIS: list[Matrix] = [np.eye(2, dtype=np.complex128), X, Z, X @ Z]
SIGMAS = [X, 1j * X @ Z, Z]


def matrix(quaternion: NDArray[np.float64]) -> Matrix:
    """Return the operator of a turn."""
    w, *rest = quaternion
    whole: Matrix = w * PAULIS[0] - 1j * sum(c * s for c, s in zip(rest, SIGMAS, strict=True))
    return whole


def quaternions(count: int) -> NDArray[np.float64]:
    """Return some turns."""
    found: NDArray[np.float64] = np.random.default_rng(1).standard_normal((count, 4))
    found /= np.linalg.norm(found, axis=1, keepdims=True)
    return found


def test_quaternions_are_the_operators_that_they_stand_for() -> None:
    one, other = quaternions(2)
    np.testing.assert_allclose(matrix(product(one, other)), matrix(one) @ matrix(other))
    np.testing.assert_allclose(matrix(one * TRANSPOSED), matrix(one).T)
    for pauli, signs in zip(PAULIS, SIGNS, strict=True):
        np.testing.assert_allclose(matrix(one * signs), pauli @ matrix(one) @ pauli.conj().T)
    vector = np.array([0.3, -0.4, 1.2])
    values, states = np.linalg.eigh(sum(v * s for v, s in zip(vector, SIGMAS, strict=True)))
    turned = states @ np.diag(np.exp(-0.5j * values)) @ states.conj().T
    np.testing.assert_allclose(matrix(of_vectors(vector)), turned)


def test_turns_of_different_stretches_are_composed_photon_by_photon() -> None:
    a, b, c, d = quaternions(4)
    early, late = Turn(np.array([0, 5]), np.array([a, b])), Turn(np.array([0, 3]), np.array([c, d]))
    whole = late.after(early)
    stretches = whole.stretch(np.array([0, 3, 4, 5, 9]))
    expected = [product(*each) for each in ((c, a), (d, a), (d, a), (d, b), (d, b))]
    np.testing.assert_allclose(whole.quaternions[stretches], expected)


def between(
    act: Callable[[Laboratory], Awaitable[None]], encoding: str = "polarization", **fiber: Any
) -> None:
    """Let something happen to alice and bob, whom two such fibres join."""

    async def inside() -> None:
        device = Device(PairSource(encoding=encoding), detectors=Detectors(encoding=encoding))
        ends = [[FiberEnd(host, f"{host}-q{i}") for host in ("alice", "bob")] for i in (0, 1)]
        fibers = [Fiber(*way, **{"length_km": 1.0, **fiber}) for way in ends]
        devices = dict.fromkeys(("alice", "bob"), device)
        tokens = dict.fromkeys(devices, "")
        await act(Laboratory(DispatcherConfig("", "", 1, tokens, fibers, [], devices=devices)))

    uvloop.run(inside())


def kept(rms_rad: float) -> float:
    """Return what is left of a Stokes vector on average after n random turns of normal vectors.

    A turn by an angle a about an axis leaves (1 + 2 cos a) / 3 along any other on average, and the
    length of a normal vector of variance v for each component has E cos a = (1 - v) e^(-v / 2).
    """
    pieces = max(int(np.ceil(rms_rad**2)), 1)
    v = rms_rad**2 / (3 * pieces)
    return float(((1 + 2 * (1 - v) * np.exp(-v / 2)) / 3) ** pieces)


FAST = 1e-9  # so that each photon meets a turn of its own


@pytest.mark.parametrize("rms_rad", [0.3, 1.5, 2.5])
def test_birefringence_spoils_all_bases_alike(rms_rad: float) -> None:
    wrong = (1 - kept(rms_rad)) / 2

    async def act(laboratory: Laboratory) -> None:
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        states = (np.arange(COUNT) % 6).astype(np.uint8)  # Z, X and Y
        await alice.prepare(states)
        await alice.send({(0, 0): "alice-q0"})
        await bob.receive((0, 0), "bob-q0")
        bits = await bob.measure((0, 0), bases=states >> np.uint8(1))
        for basis in range(3):
            own = states >> 1 == basis
            errors = int(((bits ^ states) & 1)[own].sum())
            assert within(errors, int(own.sum()), wrong)
        assert not laboratory.layer.exact

    noise: dict[str, Any] = {
        "polarization_drift_rad_per_sqrt_km": rms_rad,
        "polarization_drift_time_s": FAST,
    }
    between(act, **noise)


def test_a_whole_spool_of_standard_fibre_leaves_nothing() -> None:
    assert (1 - kept(3.14 * np.sqrt(10))) / 2 == pytest.approx(0.5, abs=1e-6)


def test_pairs_of_turned_halves_are_werner_pairs() -> None:
    """Each half keeps c: all three correlations are c^2."""
    correlation = kept(0.8) ** 2

    async def act(laboratory: Laboratory) -> None:
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        await alice.create(COUNT)
        await alice.send({(0, 0): "alice-q0", (0, 1): "alice-q1"})
        for half in (0, 1):
            await bob.receive((0, half), f"bob-q{half}")
        found = np.bincount(await bob.bell_measure((0, 0), (0, 1)), minlength=4)
        assert within(int(found[0]), COUNT, (1 + 3 * correlation) / 4)
        assert all(within(int(n), COUNT, (1 - correlation) / 4) for n in found[1:])

    noise: dict[str, Any] = {
        "polarization_drift_rad_per_sqrt_km": 0.8,
        "polarization_drift_time_s": FAST,
    }
    between(act, **noise)


@pytest.mark.parametrize("state", range(4))
def test_turns_of_both_halves_of_a_pair_are_composed(state: int) -> None:
    """(A x B) of a Bell state, against matrices: not the same as two Pauli channels."""
    one, other = quaternions(2)
    phi: Matrix = np.array([1, 0, 0, 1], np.complex128) / np.sqrt(2)
    bell = [np.kron(pauli, PAULIS[0]) @ phi for pauli in PAULIS]
    turned = np.kron(matrix(one), matrix(other)) @ bell[state]
    expected = [float(abs(np.vdot(each, turned)) ** 2) for each in bell]

    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(COUNT)
        await alice.apply((0, 0), np.full(COUNT, state, np.uint8))
        for half, quaternion in enumerate((one, other)):
            (block,) = laboratory.layer.ownership.parts(BlockName(1, 0, half))
            block.pulses.turn = Turn(np.zeros(1, np.int64), quaternion[None])
        found = np.bincount(await alice.bell_measure((0, 0), (0, 1)), minlength=4)
        assert all(within(int(n), COUNT, p) for n, p in zip(found, expected, strict=True))

    between(act)


@pytest.mark.parametrize("encoding", ["polarization", "time-bin"])
def test_each_encoding_sees_its_own_drift(encoding: str) -> None:
    """Phase drift of time bins spoils X and not Z: (1 - e^(-rms^2 / 2)) / 2."""

    async def act(laboratory: Laboratory) -> None:
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        states = (np.arange(COUNT) % 4).astype(np.uint8)
        await alice.prepare(states)
        await alice.send({(0, 0): "alice-q0"})
        await bob.receive((0, 0), "bob-q0")
        wrong = (await bob.measure((0, 0), bases=states >> np.uint8(1)) ^ states) & 1
        z, x = (int(wrong[states >> 1 == basis].sum()) for basis in (0, 1))
        if encoding == "time-bin":
            assert z == 0
            assert within(x, COUNT // 2, (1 - np.exp(-0.5)) / 2)
        else:
            assert all(within(n, COUNT // 2, (1 - kept(0.6)) / 2) for n in (z, x))

    drifts: dict[str, Any] = {f"{kind}_drift_time_s": FAST for kind in ("phase", "polarization")}
    drifts |= {"phase_drift_rad_per_sqrt_km": 1.0, "polarization_drift_rad_per_sqrt_km": 0.6}
    between(act, encoding, **drifts)


def test_detectors_of_another_encoding_are_refused() -> None:
    async def inside() -> None:
        device = Device(PairSource(encoding="time-bin"))
        config = DispatcherConfig("", "", 1, {"alice": ""}, [], [], devices={"alice": device})
        alice = Laboratory(config).host("alice")
        await alice.create(4)
        for act in (alice.measure((0, 0)), alice.bell_measure((0, 0), (0, 1))):
            with pytest.raises(Refusal, match="measures polarization qubits, and these are time"):
                await act

    uvloop.run(inside())
