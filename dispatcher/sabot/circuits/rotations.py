"""Rotations that are Clifford gates, written as such; global phases do not matter."""

import math
from collections.abc import Iterator

from dispatcher.sabot.circuits.circuit import Gate

TOLERANCE_RAD = 1e-9  # as near to a multiple of pi/2 is taken for it
ABOUT_Z = ((), ("S",), ("Z",), ("S_DAG",))  # by 0, 1, 2 and 3 quarter turns
# What turns the axis into Z, and back.
TO_Z: dict[str, tuple[str, ...]] = {"RZ": (), "RX": ("H",), "RY": ("S_DAG", "H")}
FROM_Z: dict[str, tuple[str, ...]] = {"RZ": (), "RX": ("H",), "RY": ("H", "S")}


def lowered(gate: Gate) -> Iterator[Gate]:
    """Yield Clifford gates for a rotation by a multiple of pi/2, any other gate as it is."""
    if gate.name not in TO_Z:
        yield gate
        return
    turns = gate.angle_rad / (math.pi / 2)
    if abs(turns - round(turns)) * (math.pi / 2) > TOLERANCE_RAD:
        yield gate
        return
    about_z = ABOUT_Z[round(turns) % 4]
    names = (*TO_Z[gate.name], *about_z, *FROM_Z[gate.name]) if about_z else ("I",)
    for name in names:
        yield Gate(name, gate.qubits)
