"""The Clifford gates of a state by their names."""

from abc import ABC, abstractmethod

from dispatcher.sabot.backend import CliffordName


class NamedGates(ABC):
    """A state that has a method for each gate."""

    def gate(self, name: CliffordName, *qubits: int) -> None:
        """Apply the gate of that name to every member; raise ValueError for other counts."""
        match name, qubits:
            case "H", (qubit,):
                self.h(qubit)
            case "S", (qubit,):
                self.s(qubit)
            case "S_DAG", (qubit,):
                self.s_dag(qubit)
            case "CX", (control, target):
                self.cx(control, target)
            case "CZ", (control, target):
                self.cz(control, target)
            case _:
                raise ValueError(f"gate {name} does not act on {len(qubits)} qubits")

    @abstractmethod
    def h(self, qubit: int) -> None:
        """Apply the Hadamard gate."""

    @abstractmethod
    def s(self, qubit: int) -> None:
        """Apply the phase gate."""

    @abstractmethod
    def s_dag(self, qubit: int) -> None:
        """Apply the inverse of the phase gate."""

    @abstractmethod
    def cx(self, control: int, target: int) -> None:
        """Apply the controlled NOT."""

    @abstractmethod
    def cz(self, one: int, other: int) -> None:
        """Apply the controlled Z."""
