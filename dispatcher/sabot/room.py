"""Whether gates keep state vectors within their limits, asked before anything is changed."""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from dispatcher.sabot.backend import Backend, GateName
from dispatcher.sabot.dense import MAX_AMPLITUDES, MAX_QUBITS, Dense, TooLarge
from dispatcher.sabot.gates import as_clifford
from dispatcher.sabot.registers import Component, Register


class GateStep(NamedTuple):
    """A gate on a register, or on each pair that it forms with the target."""

    name: GateName
    target: Register | None = None
    angle_rad: float = 0.0  # of RX, RY and RZ


def require_amplitudes(qubits: int, members: int, live: int) -> None:
    """Raise TooLarge if a state vector for each of so many members is too much."""
    if qubits > MAX_QUBITS:
        raise TooLarge(
            f"{qubits} qubits would be entangled in one state vector, which has at most "
            f"{MAX_QUBITS}; measure some first, or use Clifford gates only"
        )
    require_total(members << qubits, live)


def require_total(more: int, live: int) -> None:
    """Raise TooLarge if all state vectors together would have too many amplitudes."""
    if live + more > MAX_AMPLITUDES:
        raise TooLarge(
            f"state vectors with {more:,} more amplitudes (members times 2^qubits), {live:,} "
            f"live, exceed the limit of {MAX_AMPLITUDES:,}; use smaller blocks, or Clifford "
            "gates only"
        )


def require_room(register: Register, steps: Sequence[GateStep], live: int) -> None:
    """Raise TooLarge if the steps would make state vectors too large; `live` amplitudes are held.

    Every gate acts on the register, so its components can only grow.
    """
    open_gates = [step for step in steps if as_clifford(step.name, step.angle_rad) is None]
    if not open_gates and not live:
        return
    registers = [register, *(step.target for step in steps if step.target is not None)]
    more = 0
    for components, members in _meetings(list(dict.fromkeys(registers))):
        states = [component.state for component in components]
        if states and (open_gates or any(isinstance(state, Dense) for state in states)):
            qubits = sum(state.qubits for state in states)
            require_amplitudes(qubits, members, 0)
            more += (members << qubits) - sum(_amplitudes(state, members) for state in states)
    require_total(more, live)


def _amplitudes(state: Backend, members: int) -> int:
    return members << state.qubits if isinstance(state, Dense) else 0


def _meetings(registers: Sequence[Register]) -> Iterator[tuple[Iterable[Component], int]]:
    """Yield the components that the registers have at the same positions, and at how many."""
    codes = np.zeros(registers[0].size, dtype=np.int64)
    for register in registers:
        codes = codes * (len(register.components) + 1) + register.labels() + 1
        _values, codes = np.unique(codes, return_inverse=True)
    _values, firsts, counts = np.unique(codes, return_index=True, return_counts=True)
    lists = [(list(register.components), register.labels()) for register in registers]
    for first, members in zip(firsts.tolist(), counts.tolist(), strict=True):
        met = {
            components[labels[first]]: None
            for components, labels in lists
            if labels[first] >= 0  # not covered: no qubit there
        }
        yield met, members
