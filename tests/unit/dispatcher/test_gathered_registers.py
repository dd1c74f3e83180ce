"""Qubits with new numbers stay what they were: random experiments with stim as the judge."""

from itertools import count

import numpy as np
import pytest
import stim
from numpy.typing import NDArray

from dispatcher.sabot.backend import CliffordName
from dispatcher.sabot.backends import BACKENDS
from dispatcher.sabot.dense import TooLarge
from dispatcher.sabot.draws import PhotonDraws
from dispatcher.sabot.manager import Sabot
from dispatcher.sabot.registers import Pick, Register
from wire.outcomes import NO_CLICK

SIZE = 4  # of the blocks of an experiment
STEPS = 40
Z, X, Y = range(3)


class Experiment:
    """Registers on one backend, and the same qubits one by one in stim.

    Whatever a measurement has found must be possible in stim, given all that was found before.
    Qubits that are reset, lost or let go stay in stim as qubits that nobody sees.
    """

    def __init__(self, backend: str, seed: int) -> None:
        self.sabot = Sabot(BACKENDS[backend])
        self.random = np.random.default_rng(seed)
        self.judge, self.numbers = stim.TableauSimulator(seed=0), count()
        self.qubits: dict[Register, NDArray[np.int64]] = {}
        self.found: list[int] = []
        for _ in range(2):
            self.pairs()

    def pairs(self) -> None:
        """Make a block of pairs."""
        halves = self.sabot.bell_pairs(SIZE)
        for half in halves:
            self.qubits[half] = np.array([next(self.numbers) for _ in range(SIZE)])
        for a, b in zip(*(self.qubits[half].tolist() for half in halves), strict=True):
            self.judge.h(a)
            self.judge.cx(a, b)

    def draws(self, size: int) -> PhotonDraws:
        """Return the random numbers of a measurement of qubits."""
        return PhotonDraws.given(self.random.integers(0, 2, size, dtype=np.uint8))

    def any(self) -> Register:
        """Return a register."""
        registers = list(self.qubits)
        return registers[self.random.integers(len(registers))]

    def two(self) -> tuple[Register, Register] | None:
        """Return two registers whose qubits pair up, if two are found."""
        one = self.any()
        others = [r for r in self.qubits if r.size == one.size and r is not one]
        return (one, others[self.random.integers(len(others))]) if others else None

    def step(self) -> None:
        """Do a random thing."""
        acts = [self.pauli, self.gate, self.gate_pairs, self.gate_pairs, self.lose, self.reset]
        acts += [self.gather_one, self.gather_one, self.gather, self.measure, self.bell_measure]
        acts[self.random.integers(len(acts))]()
        if len(self.qubits) < 4:
            self.pairs()

    def pauli(self) -> None:
        register = self.any()
        paulis = self.random.integers(0, 4, register.size, dtype=np.uint8)
        self.sabot.pauli(register, paulis)
        for qubit, pauli in zip(self.qubits[register].tolist(), paulis.tolist(), strict=True):
            if pauli & 1:
                self.judge.x(qubit)
            if pauli & 2:
                self.judge.z(qubit)

    def gate(self) -> None:
        register = self.any()
        self.sabot.gate("H", register)
        self.sabot.gate("S", register)
        self.judge.h(*self.qubits[register].tolist())
        self.judge.s(*self.qubits[register].tolist())

    def gate_pairs(self) -> None:
        if (registers := self.two()) is None:
            return
        names: tuple[CliffordName, ...] = ("CX", "CZ")
        name = names[self.random.integers(2)]
        try:
            self.sabot.gate(name, *registers)
        except TooLarge:
            return
        act = self.judge.cx if name == "CX" else self.judge.cz
        for pair in self.paired(*registers):
            act(*pair)

    def paired(self, one: Register, other: Register) -> list[list[int]]:
        """Return the qubits that pair up, where both are there."""
        both = one.present & other.present
        pairs = np.stack((self.qubits[one][both], self.qubits[other][both]), axis=1)
        return [[int(a), int(b)] for a, b in pairs]

    def lose(self) -> None:
        register = self.any()
        self.sabot.lose(register, self.random.random(register.size) < 0.1)

    def reset(self) -> None:
        register = self.any()
        mask = self.random.random(register.size) < 0.3
        self.sabot.reset(register, mask, self.draws(register.size))
        fresh = np.array([next(self.numbers) for _ in range(register.size)])
        self.qubits[register] = np.where(mask, fresh, self.qubits[register])

    def gather_one(self) -> None:
        self._gather([self.any()])

    def gather(self) -> None:
        self._gather(list(dict.fromkeys((self.any(), self.any()))))

    def _gather(self, sources: list[Register]) -> None:
        """Take some qubits out of registers, in any order; mostly let go of the rest."""
        picks, taken = [], []
        for register in sources:
            most = register.size if self.random.random() < 0.5 else SIZE // 2
            chosen = self.random.permutation(register.size)[:most].astype(np.uint32)
            if self.random.random() < 0.5:
                chosen = np.sort(chosen)
            picks.append(Pick(register, chosen))
            taken.append(self.qubits[register][chosen])
            self.qubits[register][chosen] = [next(self.numbers) for _ in chosen]
        present = np.concatenate([pick.register.present[pick.positions] for pick in picks])
        gathered = self.sabot.gather(picks)
        assert (gathered.present == present).all()
        for register in sources:
            if self.random.random() < 0.8:
                self.sabot.drop(register, self.draws(register.size))
                del self.qubits[register]
        self.qubits[gathered] = np.concatenate(taken)

    def measure(self) -> None:
        register = self.any()
        bases = self.random.integers(0, 3, register.size, dtype=np.uint8)
        present = register.present
        found = self.sabot.measure(register, bases, self.draws(register.size))
        assert ((found == NO_CLICK) == ~present).all()
        for qubit, basis, bit in zip(self.qubits.pop(register).tolist(), bases, found, strict=True):
            if bit != NO_CLICK:
                (self.judge.postselect_z, self.judge.postselect_x, self.judge.postselect_y)[basis](
                    [qubit], desired_value=bool(bit)
                )
        self.found += found.tolist()

    def bell_measure(self) -> None:
        if (registers := self.two()) is None:
            return
        both = registers[0].present & registers[1].present
        pairs = self.paired(*registers)
        draws = self.draws(both.size), self.draws(both.size)
        try:
            found = self.sabot.bell_measure(*registers, draws)
        except TooLarge:
            return
        assert ((found == NO_CLICK) == ~both).all()
        for (a, b), outcome in zip(pairs, found[both].tolist(), strict=True):
            self.judge.cx(a, b)
            self.judge.h(a)
            self.judge.postselect_z([b], desired_value=bool(outcome & 1))
            self.judge.postselect_z([a], desired_value=bool(outcome & 2))
        for register in registers:
            del self.qubits[register]
        self.found += found.tolist()

    def end(self) -> None:
        """Measure all there is, and find that nothing is left."""
        while self.qubits:
            self.measure()
        assert (self.sabot.live_qubits, self.sabot.live_bytes) == (0, 0)


@pytest.mark.by_day(every=3)
@pytest.mark.parametrize("backend", ["chp", "stim", "dense"])
@pytest.mark.parametrize("seed", range(20))
def test_whatever_is_found_of_gathered_qubits_is_possible(backend: str, seed: int) -> None:
    experiment = Experiment(backend, seed)
    for _ in range(STEPS):
        experiment.step()
    experiment.end()
