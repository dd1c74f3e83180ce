"""Rotations that are Clifford gates, written as such; global phases do not matter."""

from collections.abc import Iterator
from math import pi

from dispatcher.sabot.circuits.circuit import Gate
from dispatcher.sabot.gates import ROTATIONS, as_clifford

TOLERANCE_RAD = 1e-9  # as near to a multiple of pi/2 is taken for it: programs round their angles


def lowered(gate: Gate) -> Iterator[Gate]:
    """Yield Clifford gates for a rotation by a multiple of pi/2, any other gate as it is."""
    for rotation in ROTATIONS:
        quarters = round(gate.angle_rad / (pi / 2))
        if gate.name == rotation and abs(gate.angle_rad - quarters * pi / 2) < TOLERANCE_RAD:
            names = as_clifford(rotation, quarters * pi / 2)
            yield from (Gate(name, gate.qubits) for name in names or ("I",))
            return
    yield gate
