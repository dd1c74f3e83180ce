"""Stabilizer states written as strings, and random circuits, for the tests of the backends."""

from typing import Any

import numpy as np
import stim
from numpy.random import Generator

from dispatcher.sabot.backend import Backend, Bytes, CliffordName
from dispatcher.sabot.dense import Dense
from dispatcher.sabot.draws import PhotonDraws

PAULIS = "IXZY"  # XZ is Y up to a phase
ONE_QUBIT: tuple[CliffordName, ...] = ("H", "S", "S_DAG")
TWO_QUBITS: tuple[CliffordName, ...] = ("CX", "CZ")


def given(*values: int) -> PhotonDraws:
    """Return these bits as what a measurement draws."""
    return PhotonDraws.given(np.array(values, dtype=np.uint8))


def canonical(state: Backend, member: int = 0) -> list[str]:
    """Return the reduced generators of a member's state, as stim writes them."""
    x, z, signs = state.generators()
    bits = zip((x + 2 * z).tolist(), signs[:, member].tolist(), strict=True)
    rows = ["+-"[sign] + "".join("_XZY"[letter] for letter in row) for row, sign in bits]
    tableau = stim.Tableau.from_stabilizers([stim.PauliString(row) for row in rows])
    return [str(row) for row in tableau.to_stabilizers(canonicalize=True)]


def draw_gate(random: Generator, qubits: int) -> tuple[CliffordName, list[int]]:
    """Draw a Clifford gate and the qubits it acts on."""
    names = ONE_QUBIT + TWO_QUBITS if qubits > 1 else ONE_QUBIT
    name = names[random.integers(len(names))]
    return name, random.permutation(qubits)[: 1 + (name in TWO_QUBITS)].tolist()


def draw_paulis(random: Generator, members: int) -> Bytes:
    """Draw a Pauli for each member."""
    return random.integers(0, 4, members, dtype=np.uint8)


def overlaps(one: Dense, other: Dense) -> Any:
    """Return how alike the state vectors are: 1 if they are the same up to a phase."""
    return np.abs(np.sum(one.amplitudes.conj() * other.amplitudes, axis=1))
