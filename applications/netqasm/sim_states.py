"""netqasm.sdk.toolbox.sim_states without NetSquid: states as arrays, of one qubit or several.

A vector is a pure state, a matrix a density matrix.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

State = NDArray[np.complex128]


def qubit_from(phi: float, theta: float) -> State:
    """Return |0> turned by theta about Y and then by phi about Z."""
    z, y = np.exp(np.array([-0.5j, 0.5j]) * phi), np.array([np.cos(theta / 2), np.sin(theta / 2)])
    state: State = z * y
    return state


def to_dm(q: ArrayLike) -> State:
    state = np.squeeze(np.asarray(q, complex))  # NetSquid's vectors are columns
    return np.outer(state, state.conj()) if state.ndim == 1 else state


def get_fidelity(q1: ArrayLike, q2: ArrayLike) -> float:
    """Return the fidelity of two states as NetSquid does, not squared: |<q1|q2>| of pure ones."""
    return float(np.linalg.norm(_root(to_dm(q1)) @ _root(to_dm(q2)), "nuc"))


def _root(matrix: State) -> State:
    values, vectors = np.linalg.eigh(matrix)
    root: State = (vectors * np.sqrt(values.clip(0))) @ vectors.conj().T
    return root
