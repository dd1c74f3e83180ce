"""The tableau against the literature and, on random circuits, against stim."""

from typing import get_args

import numpy as np
import pytest
import stim
from numpy.random import Generator
from numpy.typing import NDArray
from stim import TableauSimulator

from dispatcher.sabot.backend import Bytes, CliffordName
from dispatcher.sabot.draws import PhotonDraws
from dispatcher.sabot.tableau import Tableau

GATES: tuple[CliffordName, ...] = get_args(CliffordName)
TWO_QUBITS = ("CX", "CZ")
PAULIS = "IXZY"  # XZ is Y up to a phase


def bits(*values: int) -> Bytes:
    """Return values as the tableau takes them."""
    return np.array(values, dtype=np.uint8)


def given(*values: int) -> PhotonDraws:
    """Return these bits as what a measurement draws."""
    return PhotonDraws.given(bits(*values))


def canonical(stabilizers: list[str]) -> list[str]:
    """Return the reduced generators of the group that these strings generate."""
    tableau = stim.Tableau.from_stabilizers([stim.PauliString(s) for s in stabilizers])
    return [str(s) for s in tableau.to_stabilizers(canonicalize=True)]


def group_of(tableau: Tableau) -> list[str]:
    """Return the reduced generators of the first member's state."""
    return canonical(str(tableau).split())


def group_of_stim(simulator: TableauSimulator) -> list[str]:
    """Return the reduced generators of the simulator's state."""
    return [str(s) for s in simulator.canonical_stabilizers()]


def symplectic(tableau: Tableau) -> NDArray[np.int64]:
    """Return which row anticommutes with which, shape (2n, 2n)."""
    x, z = tableau._x.astype(int), tableau._z.astype(int)
    anticommuting: NDArray[np.int64] = (x @ z.T + z @ x.T) % 2
    return anticommuting


def assert_partners(tableau: Tableau) -> None:
    """Check that stabilizers commute and that each destabilizer meets its partner alone."""
    count = tableau.qubits
    relation = symplectic(tableau)
    assert not relation[count:, count:].any()
    assert (relation[:count, count:] == np.eye(count, dtype=int)).all()


def draw_gate(random: Generator, qubits: int) -> tuple[CliffordName, list[int]]:
    """Draw a gate and the qubits it acts on."""
    names = [name for name in GATES if qubits > 1 or name not in TWO_QUBITS]
    name = names[random.integers(len(names))]
    return name, random.permutation(qubits)[: 2 if name in TWO_QUBITS else 1].tolist()


def random_gate(random: Generator, tableau: Tableau, simulator: TableauSimulator) -> None:
    """Apply the same random gate to both."""
    name, chosen = draw_gate(random, tableau.qubits)
    tableau.gate(name, *chosen)
    getattr(simulator, name.lower())(*chosen)


def measure_both(
    random: Generator, tableau: Tableau, simulator: TableauSimulator, qubit: int
) -> None:
    """Measure on both; a free outcome is ours, and stim is made to agree."""
    (outcome,), determined = tableau.measure(qubit, PhotonDraws.by(random, 1))
    expected = simulator.peek_z(qubit)
    assert determined == (expected != 0)
    if determined:
        assert outcome == (expected == -1)
    simulator.postselect_z(qubit, desired_value=bool(outcome))


def random_pauli(random: Generator, tableau: Tableau, simulator: TableauSimulator) -> None:
    """Apply the same random Pauli to both."""
    qubit, pauli = int(random.integers(tableau.qubits)), int(random.integers(4))
    tableau.pauli(qubit, bits(pauli))
    simulator.do(stim.CircuitInstruction(PAULIS[pauli], [qubit]))


@pytest.mark.by_day(every=6)
@pytest.mark.parametrize("seed", range(300))
def test_random_circuits_agree_with_stim(seed: int) -> None:
    random = np.random.default_rng(seed)
    qubits = int(random.integers(1, 7))
    tableau, simulator = Tableau(qubits), stim.TableauSimulator()
    simulator.set_num_qubits(qubits)
    for _ in range(40):
        step = random.random()
        if step < 0.65:
            random_gate(random, tableau, simulator)
        elif step < 0.8:
            random_pauli(random, tableau, simulator)
        else:
            measure_both(random, tableau, simulator, int(random.integers(qubits)))
    assert_partners(tableau)
    assert group_of(tableau) == group_of_stim(simulator)


@pytest.mark.by_day(every=5)
@pytest.mark.parametrize("seed", range(100))
def test_discard_leaves_the_state_of_the_others(seed: int) -> None:
    random = np.random.default_rng(seed)
    qubits = int(random.integers(2, 7))
    tableau, simulator = Tableau(qubits), stim.TableauSimulator()
    simulator.set_num_qubits(qubits)
    for _ in range(40):
        random_gate(random, tableau, simulator)
    qubit = int(random.integers(qubits))
    measure_both(random, tableau, simulator, qubit)
    tableau.discard(qubit)
    assert_partners(tableau)
    # Among the reduced generators the measured qubit stands alone as +-Z.
    letters = [s for s in group_of_stim(simulator) if s[qubit + 1] == "_"]
    rest = [s[: qubit + 1] + s[qubit + 2 :] for s in letters]
    assert len(rest) == qubits - 1
    assert group_of(tableau) == canonical(rest)


@pytest.mark.by_day(every=5)
@pytest.mark.parametrize("seed", range(100))
def test_members_of_a_block_are_as_single_runs(seed: int) -> None:
    random = np.random.default_rng(seed)
    qubits, members = 4, 5
    block, singles = Tableau(qubits, members), [Tableau(qubits) for _ in range(members)]
    for _ in range(60):
        step, qubit = random.random(), int(random.integers(qubits))
        draws = random.integers(0, 4, members, dtype=np.uint8)
        if step < 0.6:
            name, chosen = draw_gate(random, qubits)
            for tableau in (block, *singles):
                tableau.gate(name, *chosen)
        elif step < 0.8:
            block.pauli(qubit, draws)
            for single, draw in zip(singles, draws.tolist(), strict=True):
                single.pauli(qubit, bits(draw))
        else:
            draws &= np.uint8(1)
            outcomes, determined = block.measure(qubit, PhotonDraws.given(draws))
            for single, draw, outcome in zip(singles, draws.tolist(), outcomes, strict=True):
                assert single.measure(qubit, given(draw)) == (outcome, determined)
    for member, single in enumerate(singles):
        assert block.stabilizers(member) == str(single)


@pytest.mark.by_day(every=3)
@pytest.mark.parametrize("seed", range(60))
def test_tensor_and_factor_undo_each_other(seed: int) -> None:
    random = np.random.default_rng(seed)
    parts = []
    for size in (1, 2, 3):
        part, simulator = Tableau(size), stim.TableauSimulator()
        for _ in range(30):
            random_gate(random, part, simulator)
            random_pauli(random, part, simulator)
        parts.append(part)
    joint = parts[0].tensor(parts[1]).tensor(parts[2])
    expected = group_of(joint)
    for _ in range(20):  # other generators of the same state, which hide that it is a product
        row, by = (int(index) for index in random.permutation(6)[:2])
        joint._combine(row, by)
    assert_partners(joint)
    factors = joint.factor()
    covered = sorted(qubit for qubits, _ in factors for qubit in qubits)
    assert covered == list(range(6))
    assert len(factors) >= 3
    rebuilt = []
    for qubits, factor in factors:
        assert_partners(factor)
        for stabilizer in str(factor).split():
            letters = ["_"] * 6
            for place, letter in zip(qubits, stabilizer[1:], strict=True):
                letters[place] = letter
            rebuilt.append(stabilizer[0] + "".join(letters))
    assert canonical(rebuilt) == expected


def test_measured_ghz_state_falls_apart() -> None:
    ghz = Tableau(3)
    ghz.h(0)
    ghz.cx(0, 1)
    ghz.cx(1, 2)
    assert len(ghz.factor()) == 1
    ghz.measure(0, given(1))
    assert [qubits for qubits, _ in ghz.factor()] == [[0], [1], [2]]


def test_bell_pair_prints_its_stabilizers() -> None:
    pair = Tableau(2, members=2)
    pair.h(0)
    pair.cx(0, 1)
    pair.pauli(0, bits(0, 1))
    assert str(pair) == "+XX\n+ZZ"
    assert pair.stabilizers(1) == "+XX\n-ZZ"


def test_take_keeps_the_chosen_members() -> None:
    qubit = Tableau(1, members=3)
    qubit.pauli(0, bits(0, 1, 1))
    outcomes, determined = qubit.take(np.array([1, 0])).measure(0, given(0, 0))
    assert outcomes.tolist() == [1, 0]
    assert determined


def test_discarding_an_unmeasured_qubit_is_an_error() -> None:
    qubit = Tableau(1)
    qubit.h(0)
    with pytest.raises(ValueError, match="measure it first"):
        qubit.discard(0)
