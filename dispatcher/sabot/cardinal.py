"""The cardinal states of qubits, of those that are in no joint state with others.

Only a simulation knows; who asks must let nobody learn more of it than a measurement tells.
"""

import numpy as np
from numpy.typing import NDArray

from dispatcher.sabot.backend import Backend, Bytes
from dispatcher.sabot.dense import Dense
from dispatcher.sabot.registers import Register
from wire.outcomes import NO_CLICK

CLOSE = 1e-9  # of a component of the Bloch vector to 1


def cardinal_states(register: Register) -> Bytes:
    """Return of each qubit 0 |0>, 1 |1>, 2 |+>, 3 |->, 4 |+i>, 5 |-i>; shape (k,).

    NO_CLICK: it is in another state, or shares one with others.
    """
    states = np.full(register.size, NO_CLICK, np.uint8)
    for share in register.shares:
        state = share.component.state
        if state.qubits == 1:
            states[share.positions] = _of_one(state)
    return states


def _of_one(state: Backend) -> Bytes:
    if isinstance(state, Dense):
        return _of_vectors(state.amplitudes)
    x, z, signs = state.generators()
    basis = 1 + int(z[0, 0]) if x[0, 0] else 0  # Z, X, Y
    states: Bytes = signs[0] + np.uint8(2 * basis)
    return states


def _of_vectors(amplitudes: NDArray[np.complex128]) -> Bytes:
    zero, one = amplitudes.T
    both = 2 * zero.conj() * one
    bloch = np.stack([abs(zero) ** 2 - abs(one) ** 2, both.real, both.imag])
    basis = abs(bloch).argmax(axis=0)
    along = np.take_along_axis(bloch, basis[None], axis=0)[0]
    states: Bytes = (2 * basis + (along < 0)).astype(np.uint8)
    states[abs(along) < 1 - CLOSE] = NO_CLICK
    return states
