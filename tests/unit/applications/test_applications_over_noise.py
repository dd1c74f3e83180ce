"""The applications of NetQASM's SDK, as they are, over noisy fibres, against what theory says.

Half of a pair passes two fibres that depolarise with P each: a Werner pair, of which
W = (1 - P)^4 is perfect and the rest fully mixed. Bounds are SIGMAS wide, and each is narrower
than the distance to what perfect pairs give.
"""

from itertools import pairwise, product
from math import pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from netqasm_scene import EXAMPLES, outputs
from test_bundled_applications import ANGLES, TWO, H, X, Z, fidelity, left, qubit

__all__ = ["left"]

W = 0.1
P = 1 - W ** (1 / 4)
SIGMAS = 4
PAULIS = {"I": np.eye(2), "X": X, "Y": X @ Z, "Z": Z}  # Y but for a phase
WERNER = {"I": (1 + 3 * W) / 4, **dict.fromkeys("XYZ", (1 - W) / 4)}


def close(found: Any, expected: float, perfect: float, sigmas: float = SIGMAS) -> None:
    """Hold the mean of numbers from 0 to 1 against theory, and against no noise."""
    found = np.asarray(found, dtype=float)
    # No numbers of this mean vary more than zeros and ones.
    bound = sigmas * sqrt(expected * (1 - expected) / found.size)
    assert bound < abs(expected - perfect)
    assert abs(found.mean() - expected) < bound


@pytest.mark.nightly
def test_a_teleported_state_is_as_good_as_the_pair(
    tmp_path: Path, left: dict[str, list[Any]]
) -> None:
    """(1 + W) / 2, which is (2 F + 1) / 3 of the pair's fidelity (1 + 3 W) / 4."""
    hosts = {"sender": "alice", "receiver": "bob"}
    inputs = [{"sender": {"phi": 0.7, "theta": 1.1}}]
    outputs(
        tmp_path, EXAMPLES / "teleport", hosts, inputs, 25, state_inspection=True, depolarizing=P
    )
    state = qubit(0.7, 1.1)
    close([fidelity(matrix, state) for matrix in left["receiver"]], (1 + W) / 2, 1)


@pytest.mark.nightly
def test_chsh_is_won_as_often_as_noise_lets(tmp_path: Path) -> None:
    """1/2 + W^2 / (2 sqrt 2): light from charlie to either end passes two fibres, and is swapped.

    A pair of two hosts of which one has made it is perfect but for (1 - P)^2: together (1 - P)^4.
    """
    hosts = {"alice": "alice", "bob": "bob", "repeater": "charlie"}
    inputs = [{"alice": {"x": x}, "bob": {"y": y}} for x, y in product((0, 1), repeat=2)]
    rounds = 11
    paths = [(1, 4), (5, 2)]
    folder = EXAMPLES / "chsh"
    results = outputs(tmp_path, folder, hosts, inputs, rounds, paths=paths, depolarizing=P)
    asked = [each for each in inputs for _ in range(rounds)]
    won = [
        (each["alice"]["a"] ^ each["bob"]["b"]) == (given["alice"]["x"] & given["bob"]["y"])
        for given, each in zip(asked, results, strict=True)
    ]
    close(won, 1 / 2 + W / (2 * sqrt(2)), 1 / 2 + 1 / (2 * sqrt(2)))


@pytest.mark.nightly
def test_bb84_finds_the_errors_that_noise_makes(tmp_path: Path) -> None:
    """(1 - W) / 2 of the bits along equal bases, which the program itself draws: without a seed."""
    hosts = {"alice": "alice", "bob": "bob"}
    inputs = [{role: {"num_bits": 60} for role in hosts}]
    results = outputs(tmp_path, EXAMPLES / "bb84", hosts, inputs, rounds=2, depolarizing=P)
    tables = [(each["alice"]["table"], each["bob"]["table"]) for each in results]
    both = [pair for alice, bob in tables for pair in zip(alice, bob, strict=True)]
    close([a[3] != b[3] for a, b in both if a[2]], (1 - W) / 2, 0, sigmas=5)


@pytest.mark.nightly
def test_a_distributed_cnot_flips_what_the_pair_has_wrong(tmp_path: Path) -> None:
    """An X of the pair is one of the target, a Z one of the control."""
    hosts = {"controller": "alice", "target": "bob"}
    angles = {"controller": (0.3, 1.2), "target": (0.9, 0.5)}
    inputs = [{role: {"phi": phi, "theta": theta} for role, (phi, theta) in angles.items()}]
    state = np.eye(4)[[0, 1, 3, 2]] @ np.kron(*(qubit(*each) for each in angles.values()))
    faults = {
        "I": np.eye(4),
        "X": np.kron(np.eye(2), X),
        "Y": np.kron(Z, X),
        "Z": np.kron(Z, np.eye(2)),
    }
    expected = sum(
        WERNER[name] * abs(state.conj() @ fault @ state) ** 2 for name, fault in faults.items()
    )
    folder = EXAMPLES / "dist_cnot"
    results = outputs(tmp_path, folder, hosts, inputs, 25, state_inspection=True, depolarizing=P)
    close([fidelity(each["controller"]["final_state"], state) for each in results], expected, 1)


@pytest.mark.nightly
def test_the_magic_square_is_lost_where_a_pair_is_wrong(tmp_path: Path) -> None:
    """A cell whose observable acts on w pairs is won in (1 + W^w) / 2."""
    hosts = {"player1": "alice", "player2": "bob"}
    cells = list(product(range(3), repeat=2))
    weights = [[1, 2, 1], [2, 2, 2], [1, 2, 1]]  # XI XX IX, -XZ YY -ZX, IZ ZZ ZI
    inputs = [{"player1": {"row": row}, "player2": {"col": col}} for row, col in cells]
    folder, rounds = EXAMPLES / "magic_square", 3
    results = outputs(tmp_path, folder, hosts, inputs, rounds, depolarizing=P)
    won = [
        each["player1"]["row"][col] == each["player2"]["col"][row]
        for (row, col), each in zip([c for c in cells for _ in range(rounds)], results, strict=True)
    ]
    close(won, float(np.mean([(1 + W**w) / 2 for w in np.ravel(weights)])), 1)


@pytest.mark.nightly
def test_blind_grover_errs_by_both_of_its_pairs(tmp_path: Path) -> None:
    """Each of the two qubits is turned to its opposite in (1 - W) / 2."""
    secrets = {"r1": 1, "r2": 0, "theta1": 3 * pi / 4, "theta2": pi / 4}
    inputs = [{"client": {"b0": 1, "b1": 0, **secrets}}]
    results = outputs(tmp_path, EXAMPLES / "blind_grover", TWO, inputs, 16, depolarizing=P)
    found = [(each["client"]["result0"], each["client"]["result1"]) == (1, 0) for each in results]
    close(found, ((1 + W) / 2) ** 2, 1)


@pytest.mark.nightly
def test_a_blind_rotation_is_as_wrong_as_its_cluster(tmp_path: Path) -> None:
    """The cluster's qubits have a Z each in (1 - W) / 2: all 16 cases are added up."""
    phi = [0.4, 1.9, 5.1]
    inputs = [{"client": {"phi": list(phi), "r": [0, 0, 0]}} for _ in range(18)]
    folder = EXAMPLES / "blind_rotation"
    results = outputs(tmp_path, folder, TWO, inputs, state_inspection=True, depolarizing=P)
    assert abs(cluster_fidelity(phi, 1) - 1) < ANGLES**2
    states = [aim(phi, each["client"]["s"], each["client"]["m"][3]) for each in results]
    found = [
        fidelity(each["server"]["output_state"], state)
        for each, state in zip(results, states, strict=True)
    ]
    close(found, cluster_fidelity(phi, W), 1)


def aim(phi: list[float], s: Any, m: int) -> Any:
    """Return Z^m X^s2 Z^s1 (H Rz(phi2)) (H Rz(phi1)) (H Rz(phi0)) |+>."""
    state = np.array([1, 1]) / sqrt(2)
    for angle in phi:
        state = H @ np.diag([1, np.exp(1j * angle)]) @ state
    powers = (Z, s[1]), (X, s[2]), (Z, m)
    for pauli, power in powers:
        state = np.linalg.matrix_power(pauli, power) @ state
    return state


def cluster_fidelity(phi: list[float], w: float) -> float:
    """Return the mean fidelity of what four qubits in a line, measured one by one, are to bring."""
    total = 0.0
    for faults in product((0, 1), repeat=4):
        chance = float(np.prod([(1 - w) / 2 if fault else (1 + w) / 2 for fault in faults]))
        plus = [np.array([1, 1 - 2 * fault]) / sqrt(2) for fault in faults]
        cluster = np.kron(np.kron(plus[0], plus[1]), np.kron(plus[2], plus[3])).reshape([2] * 4)
        for bits in product((0, 1), repeat=4):
            cluster[bits] *= (-1) ** sum(a * b for a, b in pairwise(bits))
        for s in product((0, 1), repeat=3):
            state = cluster.astype(complex)
            for place, outcome in enumerate(s):
                angle = (-1) ** (s[place - 1] if place else 0) * phi[place]
                angle += pi * (s[place - 2] if place > 1 else 0)
                bra = np.array([1, (-1) ** outcome * np.exp(1j * angle)]) / sqrt(2)
                state = np.tensordot(bra, state, axes=(0, 0))
            total += chance * abs(aim(phi, s, 0).conj() @ state) ** 2
    return total


def test_pairs_kept_one_after_the_other_differ_by_noise(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Along Z, where (1 - W) / 2 differ."""
    rounds = 4
    outputs(tmp_path, EXAMPLES / "link_layer_ck", TWO, rounds=rounds, depolarizing=P)
    words = capsys.readouterr().out.split()  # of either end, round by round
    ends = "".join(words[::2]), "".join(words[1::2])
    differ = [one != other for one, other in zip(*ends, strict=True)]
    assert len(differ) == 10 * rounds
    close(differ, (1 - W) / 2, 0)
