"""What waiting does to a qubit in a memory.

Relaxation to |0> with T1 and decay of coherence with T2 are, for T2 <= T1, exactly a reset with
probability 1 - e^(-t/T1) and a Z with (e^(-t/T1) - e^(-t/T2)) / 2. Beyond that, up to T2 = 2 T1,
no mixture of resets and Paulis is the same. The Pauli twirl of it (Sarvepalli, Klappenecker,
Roetteler, Proc. R. Soc. A 465, 1645) is an approximation; in state vectors it is exactly a
rotation of an unseen qubit that is controlled by ours, and a CX back (Nielsen and Chuang,
section 8.3.5).
"""

from math import expm1
from typing import NamedTuple

from wire.physics import Memory


class Decay(NamedTuple):
    """How likely a qubit that has waited is reset or damped, or else meets a Pauli."""

    reset: float = 0.0
    damped: float = 0.0
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    exact: bool = True


def decay(memory: Memory, waited_s: float) -> Decay:
    """Return what has happened to a qubit in a memory for some time."""
    relaxed, dephased = (-expm1(-waited_s / time_s) for time_s in (memory.t1_s, memory.t2_s))
    if memory.t2_s <= memory.t1_s:
        return Decay(reset=relaxed, z=(dephased - relaxed) / 2)
    if memory.damping == "dense":
        # Damping alone keeps e^(-t / 2 T1) of the coherence.
        kept = waited_s / (2 * memory.t1_s) - waited_s / memory.t2_s
        return Decay(damped=relaxed, z=max(-expm1(kept) / 2, 0.0))
    z = max(dephased / 2 - relaxed / 4, 0.0)
    return Decay(x=relaxed / 4, y=relaxed / 4, z=z, exact=relaxed == 0)
