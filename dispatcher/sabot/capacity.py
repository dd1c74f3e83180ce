"""Limits of states, checked for a series of gates before anything is changed."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dispatcher.sabot.backend import Angle, Backend, GateName
from dispatcher.sabot.dense import MAX_AMPLITUDES, MAX_QUBITS, Dense, TooLarge
from dispatcher.sabot.gates import as_clifford
from dispatcher.sabot.joining import same
from dispatcher.sabot.registers import Component, Positions, Register

MAX_ACROSS = 64  # qubits of one system, where pairs meet pairs at other positions than before


class GateStep(NamedTuple):
    """A gate on a register, or on each pair that it forms with the target."""

    name: GateName
    target: Register | None = None
    angle_rad: Angle = 0.0  # of RX, RY and RZ


DIAGONAL = GateStep("RY", angle_rad=np.pi / 4)  # before a measurement halfway between Z and X


def require_amplitudes(qubits: int, members: int, live: int) -> None:
    """Raise TooLarge if a state vector for each member is too large."""
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


def require_capacity(register: Register, steps: Sequence[GateStep], live: int) -> None:
    """Raise TooLarge if the steps would make states too large; `live` amplitudes are held.

    Every gate acts on the register, so its components can only grow.
    """
    open_gates = [step for step in steps if as_clifford(step.name, step.angle_rad) is None]
    targets = [step.target for step in steps if step.target is not None]
    if not open_gates and not live and not targets:
        return
    registers = list(dict.fromkeys([register, *targets]))
    across = bool(targets) and _reach_across(registers)
    if not open_gates and not live and not across:
        return
    systems = _systems(registers)
    if across and systems.qubits.max(initial=0) > MAX_ACROSS:
        raise TooLarge(
            f"{systems.qubits.max()} qubits would be entangled by pairing photons of the same "
            f"pairs across each other, at most {MAX_ACROSS} may; measure some first"
        )
    vectors = systems.counts > 0 if open_gates else systems.dense
    if vectors.any():
        require_amplitudes(int(systems.qubits[vectors].max()), 0, 0)
        more = int((systems.counts[vectors] << systems.qubits[vectors]).sum())
        held = sum(_amplitudes(c.state) for c in _components(registers))
        require_total(more - held, live)


class Systems(NamedTuple):
    """The entangled systems once some registers are joined, by kind."""

    qubits: NDArray[np.int64]
    dense: NDArray[np.bool_]  # whether state vectors are among them
    counts: NDArray[np.int64]  # of systems of this kind


def _systems(registers: Sequence[Register]) -> Systems:
    """Follow qubits that are at the same positions, and members that they belong to."""
    components = _components(registers)
    numbers, size = {}, 0
    for component in components:
        numbers[component] = np.arange(size, size + component.state.members)
        size += component.state.members
    shares = [share for register in registers for share in register.shares]
    lowest = np.full(registers[0].size, size)
    rounds, changed = 0, True
    while changed:
        if (rounds := rounds + 1) > MAX_ACROSS:
            raise TooLarge(
                f"more than {MAX_ACROSS} qubits would be entangled by pairing photons of the same "
                "pairs across each other; measure some first"
            )
        changed = False
        for share in shares:
            at = share.positions
            lowest[at] = np.minimum(lowest[at], numbers[share.component])
        for share in shares:
            systems = numbers[share.component]
            smallest = np.minimum(systems, lowest[share.positions])
            changed |= bool((smallest != systems).any())
            numbers[share.component] = smallest
    return _counted(numbers, size)


def _counted(numbers: dict[Component, NDArray[np.int64]], size: int) -> Systems:
    qubits, dense = np.zeros(size, dtype=np.int64), np.zeros(size, dtype=bool)
    for component, places in numbers.items():
        qubits += component.state.qubits * np.bincount(places, minlength=size)
        if isinstance(component.state, Dense):
            dense[places] = True
    kinds, counts = np.unique(2 * qubits + dense, return_counts=True)
    some = kinds > 0
    return Systems(kinds[some] // 2, kinds[some] % 2 == 1, counts[some])


def _reach_across(registers: Sequence[Register]) -> bool:
    places: dict[Component, Positions] = {}
    for register in registers:
        for share in register.shares:
            place = places.setdefault(share.component, share.positions)
            if place is not share.positions and not same(place, share.positions):
                return True
    return False


def _components(registers: Sequence[Register]) -> list[Component]:
    return list(dict.fromkeys(c for register in registers for c in register.components))


def _amplitudes(state: Backend) -> int:
    return state.members << state.qubits if isinstance(state, Dense) else 0
