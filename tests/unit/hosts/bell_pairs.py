"""Bell-diagonal pairs, and whether an estimate of their fidelity is what they let expect."""

from math import exp, sqrt
from typing import Any

Bell = tuple[float, float, float, float]  # Phi+, Psi+, Phi-, Psi-: which adds up to 1


def convolved(one: Bell, other: Bell) -> Bell:
    """Return the pair that a swap makes of two: the Pauli operators of both, multiplied."""
    first, second, third, fourth = (
        sum(one[a] * other[a ^ state] for a in range(4)) for state in range(4)
    )
    return first, second, third, fourth


def dephased(waits: float) -> Bell:
    """Return the pair Phi+ whose halves have waited a multiple of T2, added up."""
    flipped = (1 - exp(-waits)) / 2
    return 1 - flipped, 0.0, flipped, 0.0


def near(summary: dict[str, Any], bell: Bell) -> bool:
    """Return whether a fidelity is what these pairs let expect."""
    right = [bell[0] + bell[place] for place in (2, 1, 3)]  # in Z, X and Y
    variance = sum(share * (1 - share) for share in right) / 4 / (summary["sampled"] / 3)
    return abs(float(summary["fidelity"]) - bell[0]) <= 5 * sqrt(variance)
