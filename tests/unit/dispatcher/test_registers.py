"""Registers of qubits: physics checkable on paper, and blocks against single photons."""

from math import pi

import numpy as np
import pytest
from numpy.random import Generator

from dispatcher.sabot.backend import Bytes, GateName
from dispatcher.sabot.backends import BACKENDS
from dispatcher.sabot.dense import TooLarge
from dispatcher.sabot.draws import PhotonDraws
from dispatcher.sabot.gates import CLIFFORDS
from dispatcher.sabot.manager import Sabot
from dispatcher.sabot.registers import WHOLE, Component, Pick, Register, Share, Store
from dispatcher.sabot.tableau import Tableau
from wire.outcomes import NO_CLICK

Z, X, Y = range(3)


def bases(size: int, basis: int) -> Bytes:
    """Return the same basis for all."""
    return np.full(size, basis, dtype=np.uint8)


def draws_for(random: Generator, size: int) -> PhotonDraws:
    """Return the random numbers of a measurement of photons."""
    return PhotonDraws.by(random, size)


def zeros(size: int) -> PhotonDraws:
    """Return draws that are all 0."""
    return PhotonDraws.given(np.zeros(size, dtype=np.uint8))


def agreeing(basis: int, size: int = 1000) -> int:
    """Return how many of the pairs give equal outcomes in this basis."""
    sabot, random = Sabot(Tableau), np.random.default_rng(1)
    first, second = sabot.bell_pairs(size)
    outcomes = [
        sabot.measure(half, bases(size, basis), draws_for(random, size)) for half in (first, second)
    ]
    assert 0.4 * size < outcomes[0].sum() < 0.6 * size  # 6 sigma
    return int((outcomes[0] == outcomes[1]).sum())


@pytest.mark.parametrize("basis", [Z, X])
def test_bell_halves_agree(basis: int) -> None:
    assert agreeing(basis) == 1000


def test_bell_halves_never_agree_in_y() -> None:
    assert agreeing(Y) == 0


def test_each_basis_has_its_own_plus_state() -> None:
    sabot = Sabot(Tableau)
    for basis, gates in ((Z, ""), (X, "H"), (Y, "HS")):
        register = sabot.zeros(2)
        for gate in gates:
            sabot.gate("H" if gate == "H" else "S", register)
        outcome = sabot.measure(
            register, bases(2, basis), PhotonDraws.given(np.ones(2, dtype=np.uint8))
        )
        assert outcome.tolist() == [0, 0]


def test_outcomes_of_different_bases_are_independent() -> None:
    sabot, random, size = Sabot(Tableau), np.random.default_rng(2), 10_000
    first, second = sabot.bell_pairs(size)
    ours = sabot.measure(first, bases(size, Z), draws_for(random, size))
    theirs = sabot.measure(second, bases(size, X), draws_for(random, size))
    assert abs(int((ours == theirs).sum()) - size / 2) < 5 * (size / 4) ** 0.5


def test_each_photon_may_have_its_own_basis() -> None:
    sabot, random, size = Sabot(Tableau), np.random.default_rng(3), 300
    first, second = sabot.bell_pairs(size)
    chosen = random.integers(0, 3, size, dtype=np.uint8)
    ours = sabot.measure(first, chosen, draws_for(random, size))
    theirs = sabot.measure(second, chosen, draws_for(random, size))
    assert ((ours == theirs) == (chosen != Y)).all()


def test_bell_measurement_reads_the_paper_s_encoding() -> None:
    sabot, random = Sabot(Tableau), np.random.default_rng(4)
    first, second = sabot.bell_pairs(4)
    sabot.pauli(first, np.arange(4, dtype=np.uint8))  # I, X, Z, XZ
    draws = draws_for(random, 4), draws_for(random, 4)
    assert sabot.bell_measure(first, second, draws).tolist() == [0, 1, 2, 3]


def test_swapping_leaves_the_outer_photons_entangled() -> None:
    sabot, random, size = Sabot(Tableau), np.random.default_rng(5), 64
    a, b = sabot.bell_pairs(size)
    c, d = sabot.bell_pairs(size)
    outcome = sabot.bell_measure(b, c, (draws_for(random, size), draws_for(random, size)))
    assert set(outcome.tolist()) == {0, 1, 2, 3}
    sabot.pauli(d, outcome)  # the correction that teleportation makes
    result = sabot.bell_measure(a, d, (draws_for(random, size), draws_for(random, size)))
    assert not result.any()
    assert sabot.live_qubits == 0


def test_measuring_one_of_three_entangled_photons_separates_the_others() -> None:
    sabot = Sabot(Tableau)
    a, b = sabot.bell_pairs(2)
    c = sabot.zeros(2)
    sabot.gate("CX", b, c)
    assert set(a.components) == set(b.components) == set(c.components)
    sabot.measure(a, bases(2, Z), PhotonDraws.given(np.array([0, 1], dtype=np.uint8)))
    assert set(b.components) & set(c.components) == set()
    for register in (b, c):
        outcome = sabot.measure(register, bases(2, Z), zeros(2))
        assert outcome.tolist() == [0, 1]


def test_a_lost_control_does_not_flip_its_target() -> None:
    sabot = Sabot(Tableau)
    control, target = sabot.zeros(3), sabot.zeros(3)
    sabot.pauli(control, np.full(3, 1, dtype=np.uint8))
    assert sabot.lose(control, np.array([False, True, False])) == 1
    sabot.gate("CX", control, target)
    outcome = sabot.measure(target, bases(3, Z), zeros(3))
    assert outcome.tolist() == [1, 0, 1]


def test_a_lost_photon_does_not_click() -> None:
    sabot = Sabot(Tableau)
    first, second = sabot.bell_pairs(3)
    sabot.lose(first, np.array([False, True, False]))
    assert sabot.bell_measure(first, second, (zeros(3), zeros(3))).tolist() == [0, NO_CLICK, 0]


def test_parts_of_a_register_are_acted_on_separately() -> None:
    sabot = Sabot(Tableau)
    whole = sabot.zeros(4)
    mask = np.array([True, False, True, False])
    part = sabot.part(whole, mask)
    assert (part.present == mask).all()
    assert (whole.present == ~mask).all()
    sabot.pauli(part, np.full(4, 1, dtype=np.uint8))
    sabot.unite(whole, part)
    outcome = sabot.measure(whole, bases(4, Z), zeros(4))
    assert outcome.tolist() == [1, 0, 1, 0]
    assert (sabot.live_qubits, sabot.live_bytes) == (0, 0)


@pytest.mark.parametrize("labels", [1, 2, 3, 8, 9, 200])
def test_a_register_is_divided_by_what_its_qubits_are_labelled(labels: int) -> None:
    own = np.random.default_rng(labels).integers(0, labels, 1_000, dtype=np.uint8)
    register = Register(own.size)
    store = Store()
    store.link(Component(Tableau(1, own.size), [Share(register, WHOLE)]))
    assert store.divide(register, own) is (labels > 1)
    found = [np.arange(own.size)[share.positions].tolist() for share in register.shares]
    numbers = own.tolist()
    expected = [[j for j, each in enumerate(numbers) if each == one] for one in range(labels)]
    assert found == [places for places in expected if places]


def test_reset_makes_zero_and_leaves_the_partner_mixed() -> None:
    sabot, random, size = Sabot(Tableau), np.random.default_rng(7), 10_000
    first, second = sabot.bell_pairs(size)
    chosen = np.arange(size) % 2 == 0
    sabot.reset(first, chosen, draws_for(random, size))
    ours = sabot.measure(first, bases(size, Z), draws_for(random, size))
    theirs = sabot.measure(second, bases(size, Z), draws_for(random, size))
    assert not ours[chosen].any()
    assert (ours == theirs)[~chosen].all()
    assert abs(int(theirs[chosen].sum()) - size / 4) < 5 * (size / 8) ** 0.5


def test_registers_of_different_length_are_no_pairs() -> None:
    sabot = Sabot(Tableau)
    with pytest.raises(ValueError, match="do not make pairs"):
        sabot.gate("CX", sabot.zeros(2), sabot.zeros(3))


def test_a_live_pair_takes_few_bytes() -> None:
    sabot = Sabot(Tableau)
    pairs = [sabot.bell_pairs(1000) for _ in range(10)]
    assert sabot.live_bytes <= 4 * 10_000
    random = np.random.default_rng(6)
    for first, second in pairs:
        sabot.lose(first, random.random(1000) < 0.5)
        sabot.lose(second, random.random(1000) < 0.5)
        sabot.part(first, random.random(1000) < 0.5)
    assert sabot.live_bytes <= 64 * 10_000
    assert sabot.live_qubits == 20_000


class Run:
    """Four registers to which a random experiment is done."""

    def __init__(self, size: int, backend: str = "chp") -> None:
        """Begin with two blocks of Bell pairs."""
        self.sabot = Sabot(BACKENDS[backend])
        self.registers = [*self.sabot.bell_pairs(size), *self.sabot.bell_pairs(size)]
        self.apart: Register | None = None

    def pauli(self, which: int, values: Bytes) -> None:
        """Apply Paulis."""
        self.sabot.pauli(self.registers[which], values)

    def gate(self, name: GateName, which: int, target: int) -> None:
        """Apply a gate."""
        register = self.registers[which]
        if name in ("CX", "CZ"):
            self.sabot.gate(name, register, self.registers[target])
        else:
            self.sabot.gate(name, register)

    def lose(self, which: int, values: Bytes) -> None:
        """Lose a quarter of the qubits."""
        self.sabot.lose(self.registers[which], values == 0)

    def reset(self, which: int, values: Bytes, draws: PhotonDraws) -> None:
        """Reset a quarter of the qubits."""
        self.sabot.reset(self.registers[which], values == 0, draws)

    def apart_gate(self, which: int, values: Bytes) -> None:
        """Apply a Hadamard gate to half of the qubits while they are elsewhere."""
        register = self.registers[which]
        part = self.sabot.part(register, values > 1)
        self.sabot.gate("H", part)
        self.sabot.unite(register, part)

    def read(self, which: int, values: Bytes, draws: PhotonDraws) -> list[int]:
        """Measure a register and put new zeros in its place."""
        register = self.registers[which]
        outcome = self.sabot.measure(register, values, draws)
        self.registers[which] = self.sabot.zeros(register.size)
        return list(outcome)

    def read_pairs(
        self, which: int, target: int, draws: PhotonDraws, more: PhotonDraws
    ) -> list[int]:
        """Bell-measure two registers and put new zeros in their place."""
        pair = self.registers[which], self.registers[target]
        outcome = self.sabot.bell_measure(*pair, (draws, more))
        for index in (which, target):
            self.registers[index] = self.sabot.zeros(pair[0].size)
        return list(outcome)


def step(
    random: Generator, block: Run, singles: list[Run], gates: tuple[GateName, ...]
) -> list[int]:
    """Do the same random thing to the block and to each single photon; return its outcomes."""
    size = len(singles)
    which, target = (int(index) for index in random.permutation(4)[:2])
    values = random.integers(0, 4, size, dtype=np.uint8)
    draws, more = draws_for(random, size), draws_for(random, size)
    name = gates[random.integers(len(gates))]
    kind = random.choice(
        ["pauli", "gate", "lose", "reset", "apart", "read", "pairs"],
        p=[0.15, 0.4, 0.05, 0.05, 0.1, 0.15, 0.1],
    )
    found: list[int] = []
    for run, members in [(block, slice(0, size))] + [
        (single, slice(j, j + 1)) for j, single in enumerate(singles)
    ]:
        if kind == "pauli":
            run.pauli(which, values[members])
        elif kind == "gate":
            run.gate(name, which, target)
        elif kind == "lose":
            run.lose(which, values[members])
        elif kind == "reset":
            run.reset(which, values[members], draws.at(members))
        elif kind == "apart":
            run.apart_gate(which, values[members])
        elif kind == "read":
            found += run.read(which, values[members] % np.uint8(3), draws.at(members))
        else:
            found += run.read_pairs(which, target, draws.at(members), more.at(members))
    assert found[: len(found) // 2] == found[len(found) // 2 :]
    return found


def outcomes_of(backend: str, seed: int, gates: tuple[GateName, ...]) -> list[int]:
    """Return all outcomes of a random experiment with 6 photons in each of 4 registers."""
    random, size = np.random.default_rng(seed), 6
    block, singles = Run(size, backend), [Run(1, backend) for _ in range(size)]
    found: list[int] = []
    for _ in range(30):
        found += step(random, block, singles, gates)
    assert block.sabot.live_qubits == sum(single.sabot.live_qubits for single in singles)
    for run in (block, *singles):
        for register in run.registers:
            run.sabot.drop(register, draws_for(random, register.size))
        assert (run.sabot.live_qubits, run.sabot.live_bytes) == (0, 0)
    return found


@pytest.mark.by_day(every=5)
@pytest.mark.parametrize("seed", range(30))
def test_a_block_behaves_as_its_photons_one_by_one_and_on_any_backend_alike(seed: int) -> None:
    outcomes = outcomes_of("chp", seed, CLIFFORDS)
    assert outcomes_of("stim", seed, CLIFFORDS) == outcomes
    assert outcomes_of("dense", seed, CLIFFORDS) == outcomes


@pytest.mark.by_day(every=5)
@pytest.mark.parametrize("seed", range(30))
def test_a_block_that_becomes_state_vectors_behaves_as_its_photons_one_by_one(seed: int) -> None:
    gates: tuple[GateName, ...] = (*CLIFFORDS, "T", "T_DAG", "T")
    outcomes = outcomes_of("chp", seed, gates)
    assert outcomes_of("stim", seed, gates) == outcomes
    assert outcomes_of("dense", seed, gates) == outcomes


@pytest.mark.parametrize("backend", ["chp", "stim"])
def test_memory_is_counted_alike_before_and_after_gates(backend: str) -> None:
    sabot, random = Sabot(BACKENDS[backend]), np.random.default_rng(8)
    registers = [sabot.zeros(1) for _ in range(20)]
    for target in registers[1:]:
        sabot.gate("CX", registers[0], target)
    for _ in range(10):
        for first, second in random.permutation(20).reshape(10, 2).tolist():
            sabot.gate("H", registers[first])
            sabot.gate("CX", registers[first], registers[second])
        sabot.pauli(registers[first], np.array([3], dtype=np.uint8))
    for register in registers:
        sabot.drop(register, draws_for(random, 1))
    assert (sabot.live_qubits, sabot.live_bytes) == (0, 0)


def turned(sabot: Sabot, size: int, angle_rad: float = 0.5) -> Register:
    """Return qubits that are state vectors."""
    register = sabot.zeros(size)
    sabot.gate("RY", register, angle_rad=angle_rad)
    return register


def test_a_gate_that_is_not_clifford_moves_its_components_alone_to_state_vectors() -> None:
    sabot = Sabot(BACKENDS["chp"])
    first, second = sabot.bell_pairs(3)
    other = sabot.zeros(3)
    sabot.gate("T", first)
    assert [sabot.simulated_by(register) for register in (first, second, other)] == [
        "dense",
        "dense",
        "chp",
    ]
    sabot.gate("CX", second, other)
    assert sabot.simulated_by(other) == "dense"
    sabot.measure(second, bases(3, Z), zeros(3))
    assert (sabot.live_qubits, sabot.live_bytes) == (6, 6 * 2 * 16)  # each for itself again


def test_a_quarter_turn_stays_a_stabilizer_state() -> None:
    sabot = Sabot(BACKENDS["chp"])
    plus = sabot.zeros(4)
    sabot.gate("RY", plus, angle_rad=pi / 2)
    assert sabot.simulated_by(plus) == "chp"
    assert not sabot.measure(plus, bases(4, X), zeros(4)).any()


def test_some_photons_of_a_block_may_be_state_vectors() -> None:
    sabot = Sabot(BACKENDS["chp"])
    whole = sabot.zeros(4)
    part = sabot.part(whole, np.array([True, False, False, True]))
    sabot.gate("RX", part, angle_rad=pi / 3)
    sabot.unite(whole, part)
    assert sabot.simulated_by(whole) == "chp+dense"
    assert sabot.measure(whole, bases(4, Z), zeros(4)).tolist() == [0, 0, 0, 0]
    assert sabot.simulated_by(whole) == "chp"


def test_thirteen_entangled_qubits_are_no_state_vector_and_stay_as_they_are() -> None:
    sabot = Sabot(BACKENDS["chp"])
    registers = [sabot.zeros(2) for _ in range(13)]
    sabot.gate("H", registers[0])
    for target in registers[1:]:
        sabot.gate("CX", registers[0], target)
    before = sabot.live_bytes
    with pytest.raises(TooLarge, match=r"13 qubits .* at most 12"):
        sabot.gate("T", registers[5])
    assert (sabot.live_bytes, sabot.simulated_by(*registers)) == (before, "chp")
    for register in registers:
        assert sabot.measure(register, bases(2, Z), zeros(2)).tolist() == [0, 0]


def test_state_vectors_do_not_grow_beyond_twelve_qubits_by_joining_others() -> None:
    sabot = Sabot(BACKENDS["chp"])
    hub, spokes = turned(sabot, 1), [sabot.zeros(1) for _ in range(12)]
    for spoke in spokes[:11]:
        sabot.gate("CX", hub, spoke)
    before = sabot.live_bytes
    with pytest.raises(TooLarge, match="13 qubits"):
        sabot.gate("CX", spokes[11], hub)
    with pytest.raises(TooLarge, match="13 qubits"):
        sabot.bell_measure(hub, spokes[11], (zeros(1), zeros(1)))
    assert (sabot.live_bytes, sabot.simulated_by(spokes[11])) == (before, "chp")


def test_state_vectors_of_too_many_members_are_refused_all_together() -> None:
    sabot = Sabot(BACKENDS["chp"])
    ours, theirs = sabot.bell_pairs(700_000)
    turned(sabot, 700_000)
    with pytest.raises(TooLarge, match=r"2,800,000 more amplitudes .* 1,400,000 live.* 4,194,304"):
        sabot.gate("T", ours)
    assert sabot.simulated_by(ours, theirs) == "chp"
    with pytest.raises(TooLarge, match="limit of 4,194,304"):
        Sabot(BACKENDS["dense"]).bell_pairs(4_000_000)


def test_state_vectors_that_are_there_count_once() -> None:
    sabot = Sabot(BACKENDS["chp"])
    first, second = turned(sabot, 1_000_000), sabot.zeros(1_000_000)
    sabot.gate("T", first)
    sabot.gate("CX", first, second)  # from 2,000,000 amplitudes to 4,000,000
    sabot.gate("T", second)
    assert sabot.simulated_by(first, second) == "dense"


def test_a_gate_needs_the_registers_it_acts_on() -> None:
    sabot = Sabot(BACKENDS["chp"])
    with pytest.raises(ValueError, match="CX acts on 2 registers"):
        sabot.gate("CX", sabot.zeros(1))
    with pytest.raises(ValueError, match="T acts on 1 registers"):
        sabot.gate("T", sabot.zeros(1), sabot.zeros(1))


def test_angles_follow_the_photons_that_they_are_given_for() -> None:
    sabot = Sabot(BACKENDS["dense"])
    register, angles = sabot.zeros(5), np.array([0.0, pi, 0.0, 0.0, pi])
    shuffled = np.array([4, 0, 3, 1, 2], dtype=np.uint32)
    gathered = sabot.gather([Pick(register, shuffled)])
    sabot.gate("RX", gathered, angle_rad=angles)
    assert sabot.measure(gathered, bases(5, Z), zeros(5)).tolist() == [0, 1, 0, 0, 1]


def test_as_many_angles_as_qubits_are_wanted() -> None:
    sabot = Sabot(BACKENDS["dense"])
    with pytest.raises(ValueError, match="3 angles for 4 qubits"):
        sabot.gate("RX", sabot.zeros(4), angle_rad=np.zeros(3))
