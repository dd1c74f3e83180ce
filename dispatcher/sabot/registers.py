"""Registers of k qubits, and the entangled components that hold their states.

    register A   [  component 1          ][ component 2 ]
    register B   [  component 1          ][ component 3 ]
                  positions 0, 1, 2, ...

A component is many equal systems, its members. Each qubit of them is a share of a register, which
says at which position of the register that qubit of member 0, 1, 2, ... is. Registers that were
made together have their members at the same positions, and qubits that are taken from a register
into another come to other positions; dispatcher.sabot.joining brings together what is to pair up.
"""

from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dispatcher.sabot.backend import Backend
from dispatcher.sabot.backends import as_dense
from dispatcher.sabot.dense import Dense

Mask = NDArray[np.bool_]
Positions = NDArray[np.uint32] | slice

WHOLE = slice(None)
FEW_LABELS = 8  # are found one by one in less time than they are sorted


@lru_cache(maxsize=16)
def everything(size: int) -> Mask:
    mask = np.ones(size, dtype=bool)
    mask.setflags(write=False)
    return mask


@dataclass(eq=False, slots=True)
class Register:
    """k qubits of one kind; positions that no share covers are not in this register."""

    size: int
    shares: "dict[Share, None]" = field(default_factory=dict)
    lost: Mask | None = None  # None: no qubit is lost

    @property
    def components(self) -> "dict[Component, None]":
        return {share.component: None for share in self.shares}

    @property
    def present(self) -> Mask:
        """Return which qubits are there, shape (k,); not to be written into."""
        return everything(self.size) if self.lost is None else ~self.lost

    @property
    def remaining(self) -> int:
        return self.size - (0 if self.lost is None else int(np.count_nonzero(self.lost)))

    def labels(self) -> NDArray[np.int32]:
        """Return which share each position belongs to, shape (k,); -1 for none."""
        labels = np.full(self.size, -1, dtype=np.int32)
        for label, share in enumerate(self.shares):
            labels[share.positions] = label
        return labels


class Pick(NamedTuple):
    """Qubits of a register, in an order of their own."""

    register: Register
    positions: NDArray[np.uint32]


@dataclass(eq=False, slots=True)
class Share:
    """One qubit of each member of a component, and where in its register that is."""

    register: Register
    positions: Positions  # of member 0, 1, ...; members at the same ones share the array
    component: "Component" = field(init=False)

    @property
    def first(self) -> int:
        return 0 if isinstance(self.positions, slice) else int(self.positions[0])

    @property
    def qubit(self) -> int:
        return self.component.shares.index(self)


@dataclass(eq=False, slots=True)
class Component:
    state: Backend
    shares: list[Share]  # in the order of the state's qubits

    @property
    def nbytes(self) -> int:
        arrays = {
            id(at): at.nbytes
            for share in self.shares
            if not isinstance(at := share.positions, slice)
        }
        return self.state.nbytes + sum(arrays.values())

    def take(self, members: NDArray[np.intp]) -> "Component":
        taken: dict[int, Positions] = {}
        shares = []
        for share in self.shares:
            positions = taken.get(id(share.positions))
            if positions is None:
                positions = taken[id(share.positions)] = _taken(share.positions, members)
            shares.append(Share(share.register, positions))
        return Component(self.state.take(members), shares)


class Store:
    """Keeps registers and components linked to each other, and counts what they take."""

    def __init__(self) -> None:
        self.live_qubits = 0
        self.live_bytes = 0
        self.live_amplitudes = 0  # of state vectors

    def link(self, component: Component) -> None:
        for share in component.shares:
            share.component = component
            share.register.shares[share] = None
        self._count(component, 1)

    def unlink(self, component: Component) -> None:
        """Take a component out of its registers, before it is changed or replaced."""
        for share in component.shares:
            del share.register.shares[share]
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
        assert not register.shares
        if register.lost is not None:
            self.live_bytes -= register.lost.nbytes

    def divide(self, register: Register, labels: NDArray[np.generic]) -> bool:
        """Split components so that each share has one label; labels has shape (k,).

        Return whether there was anything to split.
        """
        divided, waiting = False, list(register.shares)
        for share in waiting:  # which grows
            if share not in register.shares:
                continue  # another share has split its component
            labels_here = labels[share.positions]
            if (labels_here == labels_here[0]).all():
                continue
            divided = True
            for part in self.split(share.component, labels_here):
                others = [other for other in part.shares if other.register is register]
                waiting += others[1:] and others
        return divided

    def split(self, component: Component, labels: NDArray[np.generic]) -> list[Component]:
        self.unlink(component)
        parts = [component.take(members) for members in _grouped(labels)]
        for part in parts:
            self.link(part)
        return parts

    def make_dense(self, component: Component) -> Dense:
        self._count(component, -1)
        component.state = dense = as_dense(component.state)
        self._count(component, 1)
        return dense

    def hand_over(self, share: Share, taker: Register) -> None:
        del share.register.shares[share]
        share.register = taker
        taker.shares[share] = None

    def move(self, share: Share, positions: Positions) -> None:
        self._count(share.component, -1)
        share.positions = positions
        self._count(share.component, 1)

    def _count(self, component: Component, sign: int) -> None:
        self.live_qubits += sign * component.state.qubits * component.state.members
        self.live_bytes += sign * component.nbytes
        if isinstance(component.state, Dense):
            self.live_amplitudes += sign * (component.state.members << component.state.qubits)


def ordered(positions: NDArray[np.uint32], size: int) -> Positions:
    """Return positions as they are kept: WHOLE for those of a register, one after the other."""
    if positions.size == size and (positions == np.arange(size, dtype=np.uint32)).all():
        return WHOLE
    return positions


def _taken(positions: Positions, members: NDArray[np.intp]) -> NDArray[np.uint32]:
    return members.astype(np.uint32) if isinstance(positions, slice) else positions[members]


def _grouped(labels: NDArray[np.generic]) -> list[NDArray[np.intp]]:
    if labels.dtype == np.bool_:
        return [np.flatnonzero(labels == label) for label in (False, True)]
    if labels.dtype == np.uint8 and labels.max() < FEW_LABELS:
        groups = (np.flatnonzero(labels == label) for label in range(labels.max() + 1))
        return [group for group in groups if group.size]
    order = np.argsort(labels, kind="stable")
    ordered = labels[order]
    return np.split(order, np.flatnonzero(ordered[1:] != ordered[:-1]) + 1)
