"""Outcomes, bases, Pauli operators and Bell states: their numbers in messages, and their names."""

from enum import IntEnum

NO_CLICK = 255  # in place of a measured bit
NO_COINCIDENCE = NO_CLICK  # in place of a Bell state
BASES = ("Z", "X", "Y", "Z+X", "Z-X")  # by number, as in MeasureRequest of wire/dispatcher.proto
PAULI_BASES = 3  # the first of these; the others lie halfway between Z and X, or Z and -X


class Pauli(IntEnum):
    """Pauli operators as two bits: bit 0 flips (X), bit 1 changes the phase (Z)."""

    I = 0  # noqa: E741
    X = 1
    Z = 2
    XZ = 3


PAULIS = tuple(pauli.name for pauli in Pauli)  # names by number
ERRORS = PAULIS[1:]  # those that change a qubit
BELL_STATES = ("Phi+", "Psi+", "Phi-", "Psi-")  # by number, that of the Pauli that Phi+ has met
