"""Looks at states: what a simulation can tell, and hardware cannot."""

from math import sqrt

import numpy as np

from dispatcher.operations.state_inspection import density


def test_a_qubit_of_a_bell_pair_is_mixed_and_the_pair_is_not() -> None:
    pair = np.array([1, 0, 0, 1], dtype=np.complex128) / sqrt(2)
    assert np.allclose(density(pair, 0, entangled=False), np.eye(2) / 2)
    assert np.allclose(density(pair, 1, entangled=True), np.outer(pair, pair))


def test_the_qubit_that_is_asked_for_comes_first() -> None:
    """Of |q2 q1 q0>: vectors index them so, qubit 0 in the lowest bit."""
    one, two, three = (np.array([np.cos(a), 1j**n * np.sin(a)]) for n, a in enumerate((1, 2, 3)))
    vector = np.kron(three, np.kron(two, one))
    for qubit, state in enumerate((one, two, three)):
        assert np.allclose(density(vector, qubit, entangled=False), np.outer(state, state.conj()))
    middle = np.kron(two, np.kron(three, one))
    assert np.allclose(density(vector, 1, entangled=True), np.outer(middle, middle.conj()))
