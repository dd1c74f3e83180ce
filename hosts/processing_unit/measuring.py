"""Pairs that are measured at once, as NetQASM asks for it: rotations, or bases drawn at random."""

from collections.abc import Sequence
from math import pi

import numpy as np

from hosts.hardware.operations import BlockName, Kind, Operation
from wire.netqasm.pair_requests import Measuring, RandomBasis

STEP_RAD = pi / 16
AXES = ((Kind.RX, Kind.RY, Kind.RX), (Kind.RY, Kind.RZ, Kind.RY), (Kind.RZ, Kind.RX, Kind.RZ))
Z, X, Y, Z_PLUS_X, Z_MINUS_X = range(5)  # as NetQASM numbers bases
CHOICES = {
    RandomBasis.NONE: (Z,),
    RandomBasis.XZ: (X, Z),
    RandomBasis.XYZ: (X, Y, Z),
    RandomBasis.CHSH: (Z_PLUS_X, Z_MINUS_X),
}
# What turns the direction of a basis into that of Z.
TURNS = {
    Z: (),
    X: ((Kind.RY, -pi / 2),),
    Y: ((Kind.RX, pi / 2),),
    Z_PLUS_X: ((Kind.RY, -pi / 4),),
    Z_MINUS_X: ((Kind.RY, pi / 4),),
}


def choose(how: Measuring, pairs: int, draws: np.random.Generator) -> list[int]:
    """Return a basis for each pair."""
    return [int(basis) for basis in draws.choice(CHOICES[how.bases], pairs)]


def measurement(
    blocks: Sequence[BlockName], how: Measuring, bases: Sequence[int]
) -> list[Operation]:
    """Return the operations that measure each qubit in its basis, after the rotations."""
    turns = [
        (axis, number * STEP_RAD)
        for axis, number in zip(AXES[how.axes], how.rotations, strict=True)
        if number
    ]
    operations = []
    for block, basis in zip(blocks, bases, strict=True):
        operations += [
            Operation(kind, block, angle_rad=angle) for kind, angle in (*turns, *TURNS[basis])
        ]
        operations.append(Operation(Kind.MEASURE, block))
    return operations
