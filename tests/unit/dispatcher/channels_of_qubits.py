"""Density matrices of two qubits, from the definition: what Kraus operators are held against.

Nothing here is of the product: matrices of numpy, outcomes by Born's rule.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.complex128]

ONE: Matrix = np.eye(2, dtype=np.complex128)
X: Matrix = np.array([[0, 1], [1, 0]], dtype=np.complex128)
Y: Matrix = np.array([[0, -1j], [1j, 0]], dtype=np.complex128)
Z: Matrix = np.array([[1, 0], [0, -1]], dtype=np.complex128)
AXES = [Z, X, Y, (Z + X) / np.sqrt(2), (Z - X) / np.sqrt(2)]  # by the number of a basis
PHI_PLUS: Matrix = np.array([1, 0, 0, 1], dtype=np.complex128) / np.sqrt(2)
BELL = [np.kron(pauli, ONE) @ PHI_PLUS for pauli in (ONE, X, Z, X @ Z)]


def damping(gamma: float) -> Matrix:
    """Return amplitude damping (Nielsen and Chuang, section 8.3.5), shape (2, 2, 2)."""
    return np.array([[[1, 0], [0, np.sqrt(1 - gamma)]], [[0, np.sqrt(gamma)], [0, 0]]], complex)


def some_channel(seed: int, operators: int) -> Matrix:
    """Return a channel of no symmetry, shape (m, 2, 2): the blocks of a random isometry."""
    random = np.random.default_rng(seed)
    shape = (2 * operators, 2)
    isometry, _ = np.linalg.qr(random.standard_normal(shape) + 1j * random.standard_normal(shape))
    blocks: Matrix = isometry.reshape(operators, 2, 2)
    return blocks


def pair() -> Matrix:
    """Return Phi+, shape (4, 4)."""
    return np.outer(PHI_PLUS, PHI_PLUS.conj())


def through(state: Matrix, half: int, operators: Any) -> Matrix:
    """Return a pair of which one half has met Kraus operators, shape (m, 2, 2)."""
    whole = [np.kron(*((k, ONE) if half == 0 else (ONE, k))) for k in np.asarray(operators)]
    met: Matrix = sum((k @ state @ k.conj().T for k in whole), np.zeros((4, 4), complex))
    return met


def outcomes(state: Matrix, bases: Sequence[int]) -> list[float]:
    """Return how likely 00, 01, 10 and 11 are in these bases of both halves."""
    half = [[(ONE + sign * AXES[basis]) / 2 for sign in (1, -1)] for basis in bases]
    both = [np.kron(one, other) for one in half[0] for other in half[1]]
    return [float(np.trace(projector @ state).real) for projector in both]


def bell_outcomes(state: Matrix) -> list[float]:
    """Return how likely Phi+, Psi+, Phi- and Psi- are."""
    return [float((bell.conj() @ state @ bell).real) for bell in BELL]
