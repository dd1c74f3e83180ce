"""Registers of k qubits, and the entangled components that hold their states.

    register A   [  component 1          ][ component 2 ]
    register B   [  component 1          ][ component 3 ]
                  positions 0, 1, 2, ...

Qubit j of one register is only ever entangled with qubit j of others: a component is a set of
positions together with the registers whose qubits there share one state.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dispatcher.sabot.backend import Backend
from dispatcher.sabot.backends import as_dense, tensor
from dispatcher.sabot.dense import Dense

Mask = NDArray[np.bool_]
Positions = NDArray[np.uint32] | slice

WHOLE = slice(None)


@dataclass(eq=False, slots=True)
class Register:
    """k qubits of one kind; positions that no component covers are not in this register."""

    size: int
    components: "dict[Component, None]" = field(default_factory=dict)
    lost: Mask | None = None  # None: no qubit is lost

    @property
    def present(self) -> Mask:
        """Return which qubits are there, shape (k,)."""
        return np.ones(self.size, dtype=bool) if self.lost is None else ~self.lost

    @property
    def remaining(self) -> int:
        """Return how many qubits are there."""
        return self.size - (0 if self.lost is None else int(np.count_nonzero(self.lost)))

    def labels(self) -> NDArray[np.int32]:
        """Return which component each position belongs to, shape (k,); -1 for none."""
        labels = np.full(self.size, -1, dtype=np.int32)
        for label, component in enumerate(self.components):
            labels[component.positions] = label
        return labels


@dataclass(eq=False, slots=True)
class Component:
    """One state for each of its positions, of one qubit of each of its registers."""

    state: Backend
    positions: Positions  # ascending
    registers: list[Register]  # in the order of the state's qubits

    @property
    def start(self) -> int:
        """Return the first position, which names the component within a register."""
        return 0 if isinstance(self.positions, slice) else int(self.positions[0])

    @property
    def nbytes(self) -> int:
        """Return the memory that it takes, in bytes."""
        positions = 0 if isinstance(self.positions, slice) else self.positions.nbytes
        return self.state.nbytes + positions

    def qubit(self, register: Register) -> int:
        """Return which qubit of the state belongs to the register."""
        return self.registers.index(register)

    def take(self, members: NDArray[np.intp]) -> "Component":
        """Return a component with these members alone, for the same registers."""
        positions = (
            members.astype(np.uint32)
            if isinstance(self.positions, slice)
            else self.positions[members]
        )
        return Component(self.state.take(members), positions, list(self.registers))


class Store:
    """Keeps registers and components linked to each other, and counts what they take."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self.live_qubits = 0
        self.live_bytes = 0
        self.live_amplitudes = 0  # of state vectors

    def link(self, component: Component) -> None:
        """Enter a component into its registers."""
        for register in component.registers:
            register.components[component] = None
        self._count(component, 1)

    def unlink(self, component: Component) -> None:
        """Take a component out of its registers, before it is changed or replaced."""
        for register in component.registers:
            del register.components[component]
        self._count(component, -1)

    def lose(self, register: Register, lost: Mask) -> int:
        """Mark qubits as lost; return how many were there until now."""
        before = register.remaining
        if register.lost is None:
            register.lost = lost.copy()
            self.live_bytes += register.lost.nbytes
        else:
            register.lost |= lost
        return before - register.remaining

    def forget(self, register: Register) -> None:
        """Account for a register that has no components any more."""
        assert not register.components
        if register.lost is not None:
            self.live_bytes -= register.lost.nbytes

    def divide(self, register: Register, labels: NDArray[np.generic]) -> None:
        """Split components so that each of them has one label; labels has shape (k,)."""
        for component in list(register.components):
            own = labels[component.positions]
            if (own == own[0]).all():
                continue
            self.unlink(component)
            for members in _grouped(own):
                self.link(component.take(members))

    def join(self, first: Register, second: Register) -> None:
        """Make every position that both registers cover share one component."""
        if first.components.keys() != second.components.keys():
            self.divide(first, second.labels())
            self.divide(second, first.labels())
        others = {component.start: component for component in second.components}
        for component in list(first.components):
            other = others.get(component.start)
            if other is not None and other is not component:
                self._merge(component, other)

    def make_dense(self, component: Component) -> Dense:
        """Hold a component as state vectors from now on."""
        self._count(component, -1)
        component.state = dense = as_dense(component.state)
        self._count(component, 1)
        return dense

    def hand_over(self, component: Component, giver: Register, taker: Register) -> None:
        """Let the taker have the giver's qubits of a component."""
        component.registers[component.qubit(giver)] = taker
        del giver.components[component]
        taker.components[component] = None

    def _merge(self, one: Component, other: Component) -> None:
        self.unlink(one)
        self.unlink(other)
        registers = one.registers + other.registers
        self.link(Component(tensor(one.state, other.state), one.positions, registers))

    def _count(self, component: Component, sign: int) -> None:
        self.live_qubits += sign * component.state.qubits * component.state.members
        self.live_bytes += sign * component.nbytes
        if isinstance(component.state, Dense):
            self.live_amplitudes += sign * (component.state.members << component.state.qubits)


def _grouped(labels: NDArray[np.generic]) -> list[NDArray[np.intp]]:
    """Return where each label is, by ascending labels."""
    if labels.dtype == np.bool_:
        return [np.flatnonzero(labels == label) for label in (False, True)]
    order = np.argsort(labels, kind="stable")
    ordered = labels[order]
    return np.split(order, np.flatnonzero(ordered[1:] != ordered[:-1]) + 1)
