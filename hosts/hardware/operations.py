"""Blocks of a host by name, and operations on single qubits of it.

A processing unit has many operations done in one call.
"""

from dataclasses import dataclass
from enum import Enum


@dataclass(frozen=True)
class BlockName:
    """k photons: half 0 or 1 of the pairs of one block of a session."""

    session: int
    number: int
    half: int


class Kind(Enum):
    """An operation on the qubit of a block, alone or with that of the target."""

    ZERO = "zero"  # a new qubit in |0>
    X = "X"
    Y = "Y"
    Z = "Z"
    H = "H"
    S = "S"
    S_DAG = "S_DAG"
    T = "T"
    RX = "RX"  # by angle_rad: exp(-i angle/2 P)
    RY = "RY"
    RZ = "RZ"
    CX = "CX"  # from the block to the target
    CZ = "CZ"
    MEASURE = "measure"  # in the basis Z; the qubit is used up
    OBSERVE = "observe"  # the same, and the qubit stays in the state that was found
    STORE = "store"  # into memory, where it decoheres until it is used
    TAKE = "take"  # a photon (`position`) of a block into the target, which is new
    DISCARD = "discard"


OUTCOMES = (Kind.MEASURE, Kind.OBSERVE)  # the kinds that have one


@dataclass(frozen=True)
class Operation:
    """One operation; every block but one that is taken from holds one qubit."""

    kind: Kind
    block: BlockName
    target: BlockName | None = None
    angle_rad: float = 0.0
    position: int = 0
