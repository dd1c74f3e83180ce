"""Kraus operators: what any channel of one qubit does to state vectors, drawn.

A channel takes rho to the sum of K rho K†. Of a state vector one K is drawn with the probability
|K psi|^2, and K psi, normalised, is the state then: on average that is the channel, exactly
(Nielsen and Chuang, section 8.2.4).
"""

import numpy as np
from numpy.typing import NDArray

Operators = NDArray[np.complex128]  # shape (m, 2, 2), or (k, m, 2, 2): those of each qubit

MOST_OPERATORS = 16
TOLERANCE = 1e-9  # of the sum of K†K
DIGITS = 12  # of a probability; what differs by less is rounding


def wrong_with(operators: Operators, qubits: int) -> str | None:
    """Return in words why these are no channel of this number of qubits; None if they are one."""
    one = operators.ndim == 3 or (operators.ndim == 4 and len(operators) == qubits)
    if not one or operators.shape[-2:] != (2, 2):
        return f"shape {operators.shape} is neither (m, 2, 2) nor ({qubits}, m, 2, 2)"
    if not 1 <= operators.shape[-3] <= MOST_OPERATORS:
        return f"{operators.shape[-3]} operators; give 1 to {MOST_OPERATORS}"
    if not np.isfinite(operators).all():
        return "they hold what is not a number"
    sums = np.einsum("...mji,...mjk->...ik", operators.conj(), operators).reshape(-1, 2, 2)
    off = np.abs(sums - np.eye(2)).max(axis=(1, 2))
    if off.max() <= TOLERANCE:
        return None
    worst = int(off.argmax())
    whose = f" of photon {worst}" if operators.ndim > 3 else ""
    text = np.array2string(sums[worst], precision=6, separator=", ").replace("\n", "")
    return f"they are not complete: the sum of K†K{whose} is {text}, not 1"


def of_qubits(operators: Operators, positions: NDArray[np.integer] | slice) -> Operators:
    """Return the operators of these qubits: all have the same, or each its own."""
    return operators if operators.ndim == 3 else operators[positions]


def drawn(
    operators: Operators, density: Operators, uniform: NDArray[np.float64] | None
) -> Operators:
    """Return which operator each of k qubits meets, shape (k, 2, 2).

    density has shape (k, 2, 2): what each qubit is in, whatever it is entangled with. None as
    random numbers is enough where there is one operator.
    """
    each = operators if operators.ndim > 3 else operators[None]
    if uniform is None:
        return np.broadcast_to(each[:, 0], density.shape)
    likely = np.einsum("...mij,...jl,...mil->...m", each, density, each.conj()).real
    bounds = np.round(likely, DIGITS).cumsum(axis=1)
    which = (uniform[:, None] * bounds[:, -1:] >= bounds[:, :-1]).sum(axis=1)
    rows = np.arange(len(each)) if len(each) > 1 else 0
    chosen: Operators = each[rows, which]
    return chosen
