"""New qubits, each in one of the six cardinal states: the eigenstates of Z, X and Y."""

import numpy as np

from dispatcher.sabot.backend import Bytes
from dispatcher.sabot.registers import Mask, Register
from dispatcher.sabot.simulation import Simulation

STATES = ("|0>", "|1>", "|+>", "|->", "|+i>", "|-i>")
Z, X, Y = range(3)  # half of a state's number is its basis, the rest its sign


def prepare(sabot: Simulation, states: Bytes) -> Register:
    """Return qubits in these states, numbered as in STATES; shape (k,)."""
    register = sabot.zeros(states.size)
    turn(sabot, register, states)
    return register


def turn(sabot: Simulation, register: Register, states: Bytes) -> None:
    """Bring qubits from |0> into these states; shape (k,)."""
    signs, bases = states & np.uint8(1), states >> np.uint8(1)
    if signs.any():
        sabot.pauli(register, signs)
    for basis in (X, Y):
        own = bases == basis
        if own.any():
            _turn(sabot, register, basis, own)


def _turn(sabot: Simulation, register: Register, basis: int, own: Mask) -> None:
    turned = register if own.all() else sabot.part(register, own)
    sabot.gate("H", turned)
    if basis == Y:
        sabot.gate("S", turned)
    if turned is not register:
        sabot.unite(register, turned)
