"""The simulation manager: what can be done to registers of qubits."""

from collections.abc import Sequence

import numpy as np

from dispatcher.sabot.backend import Angle, Begin, Bytes, GateName
from dispatcher.sabot.capacity import DIAGONAL, GateStep, require_amplitudes, require_capacity
from dispatcher.sabot.dense import Dense
from dispatcher.sabot.draws import PhotonDraws
from dispatcher.sabot.gates import TWO_QUBIT_GATES, as_clifford
from dispatcher.sabot.joining import join
from dispatcher.sabot.kraus import Operators, of_qubits
from dispatcher.sabot.registers import (
    WHOLE,
    Component,
    Mask,
    Pick,
    Register,
    Share,
    Store,
    ordered,
)
from wire.outcomes import NO_CLICK, PAULI_BASES

PAIR = 2
TURNS_RAD = -np.pi / 4, np.pi / 4  # about Y, that bring Z+X and Z-X to Z


class Sabot:
    """All quantum states of a network, on one backend.

    States that are no stabilizer states become state vectors, if they are small.
    Lost qubits stay in their states, where nobody sees them: that is to trace them out.
    """

    def __init__(self, backend: Begin) -> None:
        self._backend = backend
        self._store = Store()

    @property
    def backend(self) -> str:
        return self._backend.NAME

    def simulated_by(self, *registers: Register) -> str:
        names = {share.component.state.NAME for register in registers for share in register.shares}
        return "+".join(sorted(names)) or self.backend

    @property
    def live_qubits(self) -> int:
        return self._store.live_qubits

    @property
    def live_bytes(self) -> int:
        return self._store.live_bytes

    def zeros(self, count: int) -> Register:
        """Return a register of `count` qubits in |0>."""
        (register,) = self._create(count, 1)
        return register

    def bell_pairs(self, count: int) -> tuple[Register, Register]:
        """Return the halves of `count` pairs in (|00> + |11>)/sqrt 2."""
        first, second = self._create(count, 2)
        (share,) = first.shares
        share.component.state.gate("H", 0)
        share.component.state.gate("CX", 0, 1)
        return first, second

    def pauli(self, register: Register, paulis: Bytes) -> None:
        """Apply to qubit j the Pauli paulis[j]: 0 I, 1 X, 2 Z, 3 XZ; shape (k,)."""
        for share in register.shares:
            share.component.state.pauli(share.qubit, paulis[share.positions])

    def require_capacity(self, register: Register, steps: Sequence[GateStep]) -> None:
        """Raise TooLarge if these gates would need state vectors beyond the limits."""
        require_capacity(register, steps, self._store.live_amplitudes)

    def gate(
        self,
        name: GateName,
        register: Register,
        target: Register | None = None,
        angle_rad: Angle = 0.0,
    ) -> None:
        """Apply a gate to every qubit, or to every pair of which both are there.

        The angle is for RX, RY and RZ: one for all, or one for each qubit, shape (k,).
        Raise TooLarge, with nothing changed, if it would need state vectors beyond the limits.
        """
        if (target is not None) != (name in TWO_QUBIT_GATES):
            raise ValueError(f"gate {name} acts on {1 + (name in TWO_QUBIT_GATES)} registers")
        if target is not None:
            self._require_pair(register, target)
        if np.size(angle_rad) not in (1, register.size):
            raise ValueError(f"{np.size(angle_rad)} angles for {register.size} qubits")
        self.require_capacity(register, [GateStep(name, target, angle_rad)])
        if target is None:
            self._gate_each(name, register, angle_rad)
        else:
            self._gate_pairs(name, register, target)

    def _gate_each(self, name: GateName, register: Register, angle_rad: Angle) -> None:
        cliffords = as_clifford(name, angle_rad)
        for share in register.shares:
            if cliffords is None:
                dense = self._store.make_dense(share.component)
                angle = angle_rad
                if isinstance(angle_rad, np.ndarray):
                    angle = angle_rad[share.positions]
                dense.gate(name, share.qubit, angle_rad=angle)
            for clifford in cliffords or ():
                share.component.state.gate(clifford, share.qubit)

    def _gate_pairs(self, name: GateName, register: Register, target: Register) -> None:
        both = register.present & target.present
        if not both.all():
            self._store.divide(register, both)
            self._store.divide(target, both)
        for share, other in join(self._store, register, target):
            if both[share.first]:
                for clifford in as_clifford(name) or ():
                    share.component.state.gate(clifford, share.qubit, other.qubit)

    def kraus(
        self, register: Register, operators: Operators, mask: Mask, draws: PhotonDraws
    ) -> None:
        """Let each qubit of mask, shape (k,), meet one of these Kraus operators, drawn.

        They have shape (m, 2, 2), or (k, m, 2, 2): those of each qubit. Raise ValueError where
        states are not state vectors: begin with them (backend dense).
        """
        if self.backend != Dense.NAME:
            raise ValueError(f"Kraus operators on backend {self.backend}; begin with {Dense.NAME}")
        for share in register.shares:
            state, at = share.component.state, share.positions
            assert isinstance(state, Dense)
            state.kraus(share.qubit, of_qubits(operators, at), mask[at], draws.at(at))

    def measure(self, register: Register, bases: Bytes, draws: PhotonDraws) -> Bytes:
        """Measure and discard every qubit in its own basis: 0 Z, 1 X, 2 Y, 3 Z+X, 4 Z-X.

        All arrays have shape (k,); the outcome of a lost qubit is NO_CLICK. Raise TooLarge, with
        nothing changed, if the last two would need state vectors beyond the limits.
        """
        if (bases >= PAULI_BASES).any():
            self.require_capacity(register, [DIAGONAL])
        self._store.divide(register, bases)
        for share in register.shares:
            if bases[share.first] >= PAULI_BASES:
                dense = self._store.make_dense(share.component)
                dense.gate("RY", share.qubit, angle_rad=TURNS_RAD[bases[share.first] - PAULI_BASES])
                continue
            if bases[share.first] == 2:
                share.component.state.gate("S_DAG", share.qubit)
            if bases[share.first]:
                share.component.state.gate("H", share.qubit)
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
        self.require_capacity(first, [GateStep("CX", second)])
        outcomes = np.zeros(first.size, dtype=np.uint8)
        for share, other in join(self._store, first, second):
            share.component.state.gate("CX", share.qubit, other.qubit)
            share.component.state.gate("H", share.qubit)
            if len(share.component.shares) == PAIR:
                outcomes[share.positions] = self._read_out_pairs(share, other, draws)
        outcomes |= self._read_out(second, draws[1])
        outcomes |= self._read_out(first, draws[0]) << np.uint8(1)
        return _hide(outcomes, first.present & second.present)

    def reset(self, register: Register, mask: Mask, draws: PhotonDraws) -> None:
        """Put the qubits of mask, shape (k,), into |0>: measure them unseen, flip what is 1.

        Draws must be for this reset alone: a block that is reset again needs others.
        """
        self._store.divide(register, mask)
        for share in list(register.shares):
            if not mask[share.first]:
                continue
            component, qubit = share.component, share.qubit
            self._store.unlink(component)
            bits, _determined = component.state.measure(qubit, draws.at(share.positions))
            component.state.pauli(qubit, bits)
            self._link_parts(component)

    def drop(self, register: Register, draws: PhotonDraws) -> None:
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
        for share in list(register.shares):
            if mask[share.first]:
                self._store.hand_over(share, part)
        self._store.lose(register, mask)
        return part

    def gather(self, picks: Sequence[Pick]) -> Register:
        """Move qubits of some registers, in this order, into a register of their own.

        Each register is named once, with positions in it that are all different. In it the
        qubits are lost then.
        """
        gathered = Register(sum(pick.positions.size for pick in picks))
        lost = np.concatenate([~pick.register.present[pick.positions] for pick in picks])
        start = 0
        for register, positions in picks:
            places = np.full(register.size, gathered.size, dtype=np.uint32)  # that is nowhere
            places[positions] = np.arange(start, start + positions.size)
            start += positions.size
            taken = places < gathered.size
            self._store.divide(register, taken)
            for share in list(register.shares):
                if taken[share.first]:
                    self._store.move(share, ordered(places[share.positions], gathered.size))
                    self._store.hand_over(share, gathered)
            self._store.lose(register, taken)
        if lost.any():
            self._store.lose(gathered, lost)
        return gathered

    def explain(self, register: Register, place: str, photons: Bytes | Mask) -> None:
        """Hear where what is done next to photons, those that are not 0, comes from.

        It changes nothing; `dispatcher.tracing` writes it down.
        """

    def unite(self, register: Register, other: Register) -> None:
        present = register.present | other.present
        for share in list(other.shares):
            self._store.hand_over(share, register)
        self._store.forget(other)
        assert register.lost is not None  # it has been divided
        np.logical_not(present, out=register.lost)

    def _create(self, count: int, registers: int) -> list[Register]:
        if self.backend == Dense.NAME:
            require_amplitudes(registers, count, self._store.live_amplitudes)
        created = [Register(count) for _ in range(registers)]
        shares = [Share(register, WHOLE) for register in created]
        self._store.link(Component(self._backend(registers, count), shares))
        return created

    def _read_out(self, register: Register, draws: PhotonDraws) -> Bytes:
        """Measure Z of every qubit and discard the register."""
        bits = np.zeros(register.size, dtype=np.uint8)
        for share in list(register.shares):
            component, qubit = share.component, share.qubit
            self._store.unlink(component)
            bits[share.positions], _determined = component.state.measure(
                qubit, draws.at(share.positions)
            )
            del component.shares[qubit]
            if component.shares:
                component.state.discard(qubit)
                self._link_parts(component)
        self._store.forget(register)
        return bits

    def _read_out_pairs(
        self, share: Share, other: Share, draws: tuple[PhotonDraws, PhotonDraws]
    ) -> Bytes:
        """Measure Z of both qubits of pairs that nothing else is entangled with, and discard them.

        Return the bit of the other one, and that of the first above it.
        """
        state, at = share.component.state, share.positions
        self._store.unlink(share.component)
        bits, _determined = state.measure(other.qubit, draws[1].at(at))
        high_bits, _determined = state.measure(share.qubit, draws[0].at(at))
        return bits | (high_bits << np.uint8(1))

    def _link_parts(self, component: Component) -> None:
        if not component.shares:
            return
        for qubits, state in component.state.factor():
            self._store.link(Component(state, [component.shares[qubit] for qubit in qubits]))

    @staticmethod
    def _require_pair(first: Register, second: Register) -> None:
        if first is second or first.size != second.size:
            raise ValueError(
                f"registers of {first.size} and {second.size} qubits do not make pairs"
            )


def _hide(outcomes: Bytes, seen: Mask) -> Bytes:
    if not seen.all():
        outcomes |= ~seen * np.uint8(NO_CLICK)  # all bits are set
    return outcomes
