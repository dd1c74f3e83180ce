"""The decay of a qubit that waits in a memory.

Relaxation to |0> with T1 and decay of coherence with T2 are, for T2 <= T1, exactly a reset with
probability 1 - e^(-t/T1) and a Z with (e^(-t/T1) - e^(-t/T2)) / 2. Beyond that, up to T2 = 2 T1,
no mixture of resets and Paulis is the same. The Pauli twirl of it (Sarvepalli, Klappenecker,
Roetteler, Proc. R. Soc. A 465, 1645) is an approximation; in state vectors it is exactly a
rotation of an unseen qubit that is controlled by ours, and a CX back (Nielsen and Chuang,
section 8.3.5).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wire.parameters.physics import Memory

Each = float | NDArray[np.float64]  # the same for all qubits, or one for each, shape (k,)

LEAST = 1e-300  # of what is divided by


class Decay(NamedTuple):
    """How likely a qubit that has waited is reset or damped, or else meets a Pauli."""

    reset: Each = 0.0
    damped: Each = 0.0
    x: Each = 0.0
    y: Each = 0.0
    z: Each = 0.0
    exact: bool = True
    depolarized: Each = 0.0  # beside all that: X, Y or Z, a third of it each

    @property
    def error(self) -> Each:
        """Return how likely a Pauli is if there was no reset."""
        return (self.x + self.y + self.z) / np.maximum(1 - self.reset, LEAST)


class Waits(NamedTuple):
    """How long k qubits have waited: the first for a time, and each next one for a step more.

    Or each for a time of its own, shape (k,).
    """

    first_s: float
    step_s: float
    qubits: int
    each_s: NDArray[np.float64] | None = None

    @property
    def shortest_s(self) -> float:
        if self.each_s is not None:
            return max(float(self.each_s.min()), 0.0)
        return max(min(self.first_s, self._last_s), 0.0)

    @property
    def longest_s(self) -> float:
        if self.each_s is not None:
            return max(float(self.each_s.max()), 0.0)
        return max(self.first_s, self._last_s, 0.0)

    @property
    def alike(self) -> bool:
        return self.shortest_s == self.longest_s

    @property
    def _last_s(self) -> float:
        return self.first_s + (self.qubits - 1) * self.step_s

    def of(self, qubits: NDArray[np.int64]) -> NDArray[np.float64]:
        if self.each_s is not None:
            return np.clip(self.each_s[qubits], 0.0, None)
        return np.clip(self.first_s + qubits * self.step_s, 0.0, None)


def decay(memory: Memory, waited_s: Each) -> Decay:
    """Return what has happened to qubits that were in a memory for so long.

    They are depolarised beside that, with 1 - e^(-t / time); a quarter of it does nothing.

    A reset, and a Pauli if there was no reset, are the likelier the longer it was.
    """
    relaxed, dephased = (-np.expm1(-waited_s / time_s) for time_s in (memory.t1_s, memory.t2_s))
    if memory.t2_s <= memory.t1_s:
        noise = -np.expm1(-waited_s / memory.depolarizing_s) * 3 / 4
        return Decay(reset=relaxed, z=(dephased - relaxed) / 2, depolarized=noise)
    if memory.damping == "dense":
        # Damping alone keeps e^(-t / 2 T1) of the coherence.
        coherence = waited_s / (2 * memory.t1_s) - waited_s / memory.t2_s
        return Decay(damped=relaxed, z=np.maximum(-np.expm1(coherence) / 2, 0.0))
    z = np.maximum(dephased / 2 - relaxed / 4, 0.0)
    return Decay(x=relaxed / 4, y=relaxed / 4, z=z, exact=not np.any(relaxed))
