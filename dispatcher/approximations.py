"""The approximations that were met, each with the most by which it can make a probability wrong.

The size is that of one qubit's outcome, or of a part of all outcomes where it says so. Sizes of one
kind are not added up: the largest is kept.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

NOTHING: Mapping[str, float] = MappingProxyType({})
# Names of the approximations in results.
PHASE = "phase drift becomes phase flips"
TURN = "polarisation drift becomes Pauli errors"
LOSS_OF_POLARISATION = "polarisation-dependent loss becomes loss and Pauli errors"
MODE_DISPERSION = "polarisation mode dispersion becomes Pauli errors"
CLASSICAL_LIGHT = "scattered classical light comes with pulses alone"
CROSSTALK = "light that strays into other channels is drawn apart from them"
STIMULATED = "pairs of one thermal pulse are independent"
SEVERAL_PAIRS = "pairs of one pulse do not interfere in Bell measurements"
SEVERAL_IN_GATES = "further photons of pulses pass no two-qubit gate"
CROWD = "too many or unlike photons at a beam splitter go each for itself"
RELAXATION = "relaxation beyond T2 = T1 becomes Pauli errors"
UNEQUAL_ARMS = "pairs heralded by unequal arms are Bell states"
READY_STATION = "detectors of a station are never dead, and click once for a photon"
UNLIKE_DETECTORS = "heralds by dark counts of a station's unlike detectors are as of like ones"
STRAYED = "light of heralded attempts that strays in switches is lost"
UNLIKE_LIGHT = "photons of unlike light in one block or pulse count as alike"
FREE_WAIT = "light waits for its host, which cannot keep it, in a fibre without loss"


@dataclass(frozen=True)
class Approximations:
    sizes: Mapping[str, float] = field(default_factory=lambda: NOTHING)

    def __bool__(self) -> bool:
        return bool(self.sizes)

    def __or__(self, other: "Approximations") -> "Approximations":
        if not other.sizes or self is other:
            return self
        if not self.sizes:
            return other
        both = dict(self.sizes)
        for name, size in other.sizes.items():
            both[name] = max(both.get(name, size), size)
        return Approximations(both)


EXACT = Approximations()


def approximation(name: str, most: float) -> Approximations:
    """Return one approximation, with the most that a probability can be wrong by it."""
    return Approximations({name: most})


def of_outcomes(name: str, wrong: NDArray[np.bool_], reported: NDArray[np.bool_]) -> Approximations:
    """Return by how much pulses that are wrong change a share of the reported outcomes.

    Shapes (k,). Each of w wrong ones may in truth be reported or not, with any outcome. Beside c
    other reported ones they change a share of all outcomes by w/(w + c) at most.
    """
    count = int(np.count_nonzero(wrong))
    right = int(np.count_nonzero(reported & ~wrong))
    return approximation(name, count / (count + right)) if count else EXACT


def twirled_phase(angle_rad: float) -> Approximations:
    """Return what flips with sin^2(angle / 2) are wrong by, for angles up to this.

    Half the trace norm of their difference from the rotation: |sin angle| / 2, of the states of the
    equator, looked at a quarter turn further. In the basis of X or Y of a state of it: nothing.
    """
    return approximation(PHASE, float(np.sin(min(abs(angle_rad), np.pi / 2))) / 2)


def twirled_turn(quaternions: NDArray[np.float64]) -> Approximations:
    """Return the same of turns about any axis, shape (..., 4).

    The twirl is the mean of the turn conjugated by I, X, Y, Z, of which none is further from it
    than sin angle: 3/4 of that at most.
    """
    squared = np.clip(np.square(quaternions[..., 1:]).sum(axis=-1), 0, 0.5)
    most = float(squared.max(initial=0.0))
    return approximation(TURN, 1.5 * np.sqrt(most * (1 - most)))
