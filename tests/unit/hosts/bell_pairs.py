"""Bell-diagonal pairs, and whether an estimate of their fidelity is what they let expect."""

from math import sqrt
from typing import Any

Bell = tuple[float, float, float, float]  # Phi+, Psi+, Phi-, Psi-: which adds up to 1


def near(summary: dict[str, Any], bell: Bell) -> bool:
    """Return whether a fidelity is what these pairs let expect."""
    right = [bell[0] + bell[place] for place in (2, 1, 3)]  # in Z, X and Y
    variance = sum(share * (1 - share) for share in right) / 4 / (summary["sampled"] / 3)
    return abs(float(summary["fidelity"]) - bell[0]) <= 5 * sqrt(variance)
