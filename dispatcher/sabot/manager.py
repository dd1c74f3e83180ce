"""The simulation manager: what can be done to registers of qubits."""

from collections.abc import Iterator, Sequence

import numpy as np

from dispatcher.sabot.backend import Begin, Bytes, GateName
from dispatcher.sabot.dense import Dense
from dispatcher.sabot.draws import PhotonDraws
from dispatcher.sabot.gates import TWO_QUBIT_GATES, as_clifford
from dispatcher.sabot.registers import WHOLE, Component, Mask, Register, Store
from dispatcher.sabot.room import GateStep, require_amplitudes, require_room

NO_CLICK = 255


class Sabot:
    """All quantum states of a network, on one backend.

    What a backend of stabilizer states cannot hold becomes state vectors, if it is small.
    Lost qubits stay in their states, where nobody sees them: that is to trace them out.
    """

    def __init__(self, backend: Begin) -> None:
        """Simulate with this backend."""
        self._backend = backend
        self._store = Store()

    @property
    def backend(self) -> str:
        """Return the name of the backend on which states begin."""
        return self._backend.NAME

    def simulated_by(self, *registers: Register) -> str:
        """Return the backends that hold registers, joined by + if there are several."""
        components = {component for register in registers for component in register.components}
        names = {component.state.NAME for component in components}
        return "+".join(sorted(names)) or self.backend

    @property
    def live_qubits(self) -> int:
        """Return how many qubits are held, lost ones included."""
        return self._store.live_qubits

    @property
    def live_bytes(self) -> int:
        """Return the memory that their states take."""
        return self._store.live_bytes

    def zeros(self, count: int) -> Register:
        """Return a register of `count` qubits in |0>."""
        (register,) = self._create(count, 1)
        return register

    def bell_pairs(self, count: int) -> tuple[Register, Register]:
        """Return the halves of `count` pairs in (|00> + |11>)/sqrt 2."""
        first, second = self._create(count, 2)
        self.gate("H", first)
        self.gate("CX", first, second)
        return first, second

    def pauli(self, register: Register, paulis: Bytes) -> None:
        """Apply to qubit j the Pauli paulis[j]: 0 I, 1 X, 2 Z, 3 XZ; shape (k,)."""
        for component in register.components:
            component.state.pauli(component.qubit(register), paulis[component.positions])

    def require_room(self, register: Register, steps: Sequence[GateStep]) -> None:
        """Raise TooLarge if these gates would need state vectors beyond the limits."""
        require_room(register, steps, self._store.live_amplitudes)

    def gate(
        self,
        name: GateName,
        register: Register,
        target: Register | None = None,
        angle_rad: float = 0.0,
    ) -> None:
        """Apply a gate to every qubit, or to every pair of which both are there.

        The angle is for RX, RY and RZ. Raise TooLarge, with nothing changed, if it would
        need state vectors beyond the limits.
        """
        if (target is not None) != (name in TWO_QUBIT_GATES):
            raise ValueError(f"gate {name} acts on {1 + (name in TWO_QUBIT_GATES)} registers")
        if target is not None:
            self._require_pair(register, target)
        self.require_room(register, [GateStep(name, target, angle_rad)])
        if target is None:
            self._gate_each(name, register, angle_rad)
        else:
            self._gate_pairs(name, register, target)

    def _gate_each(self, name: GateName, register: Register, angle_rad: float) -> None:
        cliffords = as_clifford(name, angle_rad)
        for component in register.components:
            qubit = component.qubit(register)
            if cliffords is None:
                dense = self._store.make_dense(component)
                dense.gate(name, qubit, angle_rad=angle_rad)
            for clifford in cliffords or ():
                component.state.gate(clifford, qubit)

    def _gate_pairs(self, name: GateName, register: Register, target: Register) -> None:
        both = register.present & target.present
        if not both.all():
            self._store.divide(register, both)
            self._store.divide(target, both)
        self._store.join(register, target)
        for component in _shared(register, target):
            if both[component.start]:
                qubits = component.qubit(register), component.qubit(target)
                for clifford in as_clifford(name) or ():
                    component.state.gate(clifford, *qubits)

    def measure(self, register: Register, bases: Bytes, draws: PhotonDraws) -> Bytes:
        """Measure and discard every qubit in its own basis: 0 Z, 1 X, 2 Y.

        All arrays have shape (k,); the outcome of a lost qubit is NO_CLICK.
        """
        self._store.divide(register, bases)
        for component in register.components:
            qubit = component.qubit(register)
            if bases[component.start] == 2:
                component.state.gate("S_DAG", qubit)
            if bases[component.start]:
                component.state.gate("H", qubit)
        return _hide(self._read_out(register, draws), register.present)

    def bell_measure(
        self, first: Register, second: Register, draws: tuple[PhotonDraws, PhotonDraws]
    ) -> Bytes:
        """Measure in the Bell basis and discard: 0 Phi+, 1 Psi+, 2 Phi-, 3 Psi-.

        Each register has draws of its own. The outcome has shape (k,); that of a pair that
        lacks a photon is NO_CLICK. Raise TooLarge, with nothing changed, if the joint state
        of state vectors would be beyond their limits.
        """
        self._require_pair(first, second)
        self.require_room(first, [GateStep("CX", second)])
        self._store.join(first, second)
        for component in _shared(first, second):
            qubits = component.qubit(first), component.qubit(second)
            component.state.gate("CX", *qubits)
            component.state.gate("H", qubits[0])
        flips = self._read_out(second, draws[1])
        phases = self._read_out(first, draws[0])
        return _hide(flips | (phases << np.uint8(1)), first.present & second.present)

    def reset(self, register: Register, mask: Mask, draws: PhotonDraws) -> None:
        """Put the qubits of mask, shape (k,), into |0>: measure them unseen, flip what is 1.

        Draws must be for this reset alone: a block that is reset again needs others.
        """
        self._store.divide(register, mask)
        for component in list(register.components):
            if not mask[component.start]:
                continue
            qubit = component.qubit(register)
            self._store.unlink(component)
            bits, _determined = component.state.measure(qubit, draws.at(component.positions))
            component.state.pauli(qubit, bits)
            self._link_parts(component)

    def drop(self, register: Register, draws: PhotonDraws) -> None:
        """Discard a register whatever its state, as measuring it unseen does."""
        self._read_out(register, draws)

    def lose(self, register: Register, lost: Mask) -> int:
        """Mark qubits as lost, shape (k,); return how many were there until now."""
        return self._store.lose(register, lost)

    def part(self, register: Register, mask: Mask) -> Register:
        """Move the qubits of mask, shape (k,), into a register of their own.

        In either register the other's qubits are lost.
        """
        self._store.divide(register, mask)
        part = Register(register.size)
        self._store.lose(part, ~(register.present & mask))
        for component in list(register.components):
            if mask[component.start]:
                self._store.hand_over(component, register, part)
        self._store.lose(register, mask)
        return part

    def explain(self, register: Register, place: str, photons: Bytes | Mask) -> None:
        """Hear where what is done next to photons, those that are not 0, comes from.

        It changes nothing; `dispatcher.tracing` writes it down.
        """

    def unite(self, register: Register, other: Register) -> None:
        """Move the qubits of another part of the same register into this one."""
        present = register.present | other.present
        for component in list(other.components):
            self._store.hand_over(component, other, register)
        self._store.forget(other)
        assert register.lost is not None  # it has been divided
        np.logical_not(present, out=register.lost)

    def _create(self, count: int, registers: int) -> list[Register]:
        if self.backend == Dense.NAME:
            require_amplitudes(registers, count, self._store.live_amplitudes)
        made = [Register(count) for _ in range(registers)]
        self._store.link(Component(self._backend(registers, count), WHOLE, list(made)))
        return made

    def _read_out(self, register: Register, draws: PhotonDraws) -> Bytes:
        """Measure Z of every qubit and discard the register."""
        bits = np.zeros(register.size, dtype=np.uint8)
        for component in list(register.components):
            qubit = component.qubit(register)
            self._store.unlink(component)
            bits[component.positions], _determined = component.state.measure(
                qubit, draws.at(component.positions)
            )
            component.state.discard(qubit)
            del component.registers[qubit]
            self._link_parts(component)
        self._store.forget(register)
        return bits

    def _link_parts(self, component: Component) -> None:
        """Link what a measurement has left, each independent part for itself."""
        if not component.registers:
            return
        for qubits, state in component.state.factor():
            registers = [component.registers[qubit] for qubit in qubits]
            self._store.link(Component(state, component.positions, registers))

    @staticmethod
    def _require_pair(first: Register, second: Register) -> None:
        if first is second or first.size != second.size:
            raise ValueError(f"registers of {first.size} and {second.size} qubits are no pairs")


def _shared(first: Register, second: Register) -> Iterator[Component]:
    return (component for component in first.components if component in second.components)


def _hide(outcomes: Bytes, seen: Mask) -> Bytes:
    if not seen.all():
        outcomes |= ~seen * np.uint8(NO_CLICK)  # all bits are set
    return outcomes
