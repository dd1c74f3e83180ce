"""The applications that NetQASM's SDK comes with, as they are, against what theory says of each."""

from itertools import product
from math import pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from documentation import blocks
from netqasm_scene import EXAMPLES, outputs

from applications.netqasm.connection import Connection, get_qubit_state

TWO = {"client": "alice", "server": "bob"}
H = np.array([[1, 1], [1, -1]]) / sqrt(2)
X, Z = np.array([[0, 1], [1, 0]]), np.diag([1, -1])
PLUS = np.array([1, 1]) / sqrt(2)
SIGMAS = 5
ANGLES = 1e-3  # rad: how well the SDK's rotations by n pi / 2^d meet an angle, several together


def qubit(phi: float, theta: float) -> Any:
    """Return the state that the SDK's set_qubit_state says it prepares."""
    return np.array([np.cos(theta / 2), np.exp(1j * phi) * np.sin(theta / 2)])


def fidelity(matrix: Any, state: Any) -> float:
    """Return <state| matrix |state>."""
    return float((state.conj() @ np.array(matrix) @ state).real)


@pytest.fixture
def left(monkeypatch: pytest.MonkeyPatch) -> dict[str, list[Any]]:
    """Return the states of the qubits that programs still have at their ends, by role."""
    seen: dict[str, list[Any]] = {}
    close = Connection.close

    def look(connection: Connection, *arguments: Any, **words: Any) -> None:
        connection.flush()
        states = [get_qubit_state(each) for each in connection.active_qubits]
        seen.setdefault(connection.app_name, []).extend(states)
        close(connection, *arguments, **words)

    monkeypatch.setattr(Connection, "close", look)
    return seen


def test_teleport_brings_the_state_over(tmp_path: Path, left: dict[str, list[Any]]) -> None:
    hosts = {"sender": "alice", "receiver": "bob"}
    angles = [(0.7, 1.1), (2.9, 2.2), (5.0, 0.4)]
    inputs = [{"sender": {"phi": phi, "theta": theta}} for phi, theta in angles]
    results = outputs(
        tmp_path, EXAMPLES / "teleport", hosts, inputs, rounds=3, state_inspection=True
    )
    for round_ in results:
        sent, done = round_["sender"], round_["receiver"]
        assert done == {
            "correction1": "Z" if sent["m1"] else "None",
            "correction2": "X" if sent["m2"] else "None",
        }
    assert len({(each["sender"]["m1"], each["sender"]["m2"]) for each in results}) > 1
    states = [qubit(*each) for each in angles for _ in range(3)]
    for matrix, state in zip(left["receiver"], states, strict=True):
        assert fidelity(matrix, state) > 1 - ANGLES**2


@pytest.mark.nightly
def test_chsh_is_won_more_often_than_without_quantum(tmp_path: Path) -> None:
    """Through a repeater; cos^2(pi/8) = .854, and .75 is the most without."""
    hosts = {"alice": "alice", "bob": "bob", "repeater": "charlie"}
    inputs = [{"alice": {"x": x}, "bob": {"y": y}} for x, y in product((0, 1), repeat=2)]
    rounds = 7
    results = outputs(tmp_path, EXAMPLES / "chsh", hosts, inputs, rounds, paths=[(1, 4), (5, 2)])
    asked = [each for each in inputs for _ in range(rounds)]
    won = [
        (each["alice"]["a"] ^ each["bob"]["b"]) == (given["alice"]["x"] & given["bob"]["y"])
        for given, each in zip(asked, results, strict=True)
    ]
    expected = np.cos(pi / 8) ** 2
    bound = SIGMAS * sqrt(expected * (1 - expected) / len(won))
    assert bound < expected - 1 / 2  # outcomes by chance would fail
    assert abs(np.mean(won) - expected) < bound


@pytest.mark.nightly
def test_bb84_agrees_wherever_the_bases_do(tmp_path: Path) -> None:
    hosts = {"alice": "alice", "bob": "bob"}
    inputs = [{role: {"num_bits": 24} for role in hosts}]
    results = outputs(tmp_path, EXAMPLES / "bb84", hosts, inputs, rounds=3)
    tables = [(each["alice"]["table"], each["bob"]["table"]) for each in results]
    both = [pair for alice, bob in tables for pair in zip(alice, bob, strict=True)]
    same = [(ours, theirs) for ours, theirs in both if ours[2]]
    assert len(same) > 12  # of 72, each by chance: at most 12 come once in 10^8 times
    assert all(ours[3] == theirs[3] for ours, theirs in same)
    assert {each["alice"]["qber"] for each in results} == {0}


def test_a_distributed_cnot_is_one(tmp_path: Path) -> None:
    """The controller looks after the target has ended: the example awaits no text of it."""
    hosts = {"controller": "alice", "target": "bob"}
    angles = {"controller": (0.3, 1.2), "target": (0.9, 0.5)}
    inputs = [{role: {"phi": phi, "theta": theta} for role, (phi, theta) in angles.items()}]
    cnot = np.eye(4)[[0, 1, 3, 2]]
    state = cnot @ np.kron(*(qubit(*each) for each in angles.values()))
    results = outputs(
        tmp_path, EXAMPLES / "dist_cnot", hosts, inputs, rounds=6, state_inspection=True
    )
    for each in results:
        assert fidelity(each["controller"]["final_state"], state) > 1 - ANGLES**2


def test_the_magic_square_is_always_won(tmp_path: Path) -> None:
    hosts = {"player1": "alice", "player2": "bob"}
    cells = list(product(range(3), repeat=2))
    inputs = [{"player1": {"row": row}, "player2": {"col": col}} for row, col in cells]
    results = outputs(tmp_path, EXAMPLES / "magic_square", hosts, inputs)
    for (row, col), each in zip(cells, results, strict=True):
        across, down = each["player1"]["row"], each["player2"]["col"]
        assert sum(across) % 2 == 0
        assert sum(down) % 2 == 1
        assert across[col] == down[row]


def test_blind_grover_finds_what_the_client_has_hidden(tmp_path: Path) -> None:
    """With secrets, of which the server only sees angles that tell nothing."""
    secrets = {"r1": 1, "r2": 0, "theta1": 3 * pi / 4, "theta2": pi / 4}
    tags = list(product((0, 1), repeat=2))
    inputs = [{"client": {"b0": b0, "b1": b1, **secrets}} for b0, b1 in tags]
    results = outputs(tmp_path, EXAMPLES / "blind_grover", TWO, inputs)
    found = [(each["client"]["result0"], each["client"]["result1"]) for each in results]
    assert found == tags


def test_a_blind_rotation_is_what_the_client_asked_for(tmp_path: Path) -> None:
    """Of a linear cluster: Z^m3 X^s2 Z^s1 (H Rz(phi2)) (H Rz(phi1)) (H Rz(phi0)) |+>."""
    asked: dict[str, list[Any]] = {
        "phi": [0.4, 1.9, 5.1],
        "theta": [0.0, 0.5, 1.0, 0.0],
        "r": [0, 1, 1],
    }
    inputs = [{"client": {name: list(value) for name, value in asked.items()}} for _ in range(3)]
    results = outputs(tmp_path, EXAMPLES / "blind_rotation", TWO, inputs, state_inspection=True)
    for each in results:
        client = each["client"]
        state = PLUS
        for phi in asked["phi"]:
            state = H @ np.diag([np.exp(-1j * phi / 2), np.exp(1j * phi / 2)]) @ state
        byproducts = [s ^ r for s, r in zip(client["s"], asked["r"], strict=True)]
        state = np.linalg.matrix_power(Z, byproducts[1]) @ state
        state = np.linalg.matrix_power(X, byproducts[2]) @ state
        state = np.linalg.matrix_power(Z, client["m"][3]) @ state  # of the last qubit's teleport
        assert fidelity(each["server"]["output_state"], state) > 1 - ANGLES**2


def test_pairs_kept_one_after_the_other_agree(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    outputs(tmp_path, EXAMPLES / "link_layer_ck", TWO)
    one, other = capsys.readouterr().out.split()
    assert one == other
    assert len(one) == 10


def differing(printed: str) -> tuple[int, int]:
    """Return of how many pairs the two outcomes differ, and how many there were."""
    reports: dict[str, list[int]] = {"Client": [], "Server": []}
    for line in printed.splitlines():
        role, _, outcome = line.partition(": ")
        reports[role].append(int(outcome))
    ours, theirs = (np.array(each) for each in reports.values())
    return int(np.count_nonzero(ours != theirs)), ours.size


def test_noise_of_the_fibres_is_in_the_outcomes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each half passes two fibres of p = 0.1: outcomes along Y agree with (1 - (1 - p)^4) / 2."""
    p, rounds = 0.1, 13
    outputs(tmp_path, EXAMPLES / "link_layer_md", TWO, rounds=rounds, depolarizing=p)
    differ, pairs = differing(capsys.readouterr().out)
    assert pairs == 10 * rounds
    wrong = (1 - (1 - p) ** 4) / 2
    sigma = sqrt(wrong * (1 - wrong) / pairs)
    assert SIGMAS * sigma < wrong  # without noise this would fail
    assert abs(1 - differ / pairs - wrong) < SIGMAS * sigma


def test_texts_alone_come_through(tmp_path: Path) -> None:
    hosts = {"alice": "alice", "bob": "bob"}
    assert outputs(tmp_path, EXAMPLES / "multiple_files", hosts) == [{"alice": None, "bob": None}]


@pytest.mark.parametrize(("theta", "found"), [(0, {0}), (pi, {1}), (pi / 2, {0, 1})])
def test_a_single_node_measures_what_it_has_prepared(
    tmp_path: Path, theta: float, found: set[int]
) -> None:
    """Of cos |00> + sin |11>, and a Hadamard gate on the first: 0 and 1 there by chance."""
    inputs = [{"alice": {"theta": theta}}]
    results = outputs(tmp_path, EXAMPLES / "single_node", {"alice": "alice"}, inputs, 20)
    assert {each["alice"]["m1"] for each in results} == {0, 1}
    assert {each["alice"]["m2"] for each in results} == found


def test_nobody_looks_where_it_is_not_allowed(tmp_path: Path) -> None:
    from hosts.stack_socket import QuantumSocketError

    with pytest.raises(QuantumSocketError, match="no state can be looked at in this network"):
        outputs(tmp_path, EXAMPLES / "blind_rotation", TWO)


@pytest.mark.parametrize("page", ["differences", "netqasm"])
def test_the_program_of_a_page_measures_equal_halves(tmp_path: Path, page: str) -> None:
    """Halves of Phi+ are alike in Z, and either outcome of ten rounds but with 2^-9."""
    (alice,) = [each for each in blocks(f"docs/{page}.md", "python") if "EPRSocket" in each]
    bob = alice.replace('"bob"', '"ALICE"').replace('"alice"', '"bob"').replace("ALICE", "alice")
    (tmp_path / "pair").mkdir()
    (tmp_path / "pair" / "app_alice.py").write_text(alice)
    (tmp_path / "pair" / "app_bob.py").write_text(bob.replace("create_keep", "recv_keep"))
    results = outputs(tmp_path, tmp_path / "pair", {"alice": "alice", "bob": "bob"}, rounds=10)
    assert all(each["alice"] == each["bob"] for each in results)
    assert len({str(each["alice"]) for each in results}) == 2
