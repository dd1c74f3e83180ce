"""The use of pairs in NetQASM's requests, and how they are measured: rotations, random bases."""

from collections.abc import Sequence
from math import pi

import numpy as np

from applications.processing_unit.memory import Value
from applications.processing_unit.operations import Kind, Operation
from applications.processing_unit.pair_requests import Measuring, RandomBasis, Use
from hosts.hardware.block_name import BlockName
from hosts.middleware.session.errors import unsupported

WORDS = 22  # of a request: NetQASM's SerializedCreateRequestIndex
STEP_RAD = pi / 16
AXES = ((Kind.RX, Kind.RY, Kind.RX), (Kind.RY, Kind.RZ, Kind.RY), (Kind.RZ, Kind.RX, Kind.RZ))
Z, X, Y, Z_PLUS_X, Z_MINUS_X = range(5)  # as NetQASM numbers bases
CHOICES = {
    RandomBasis.NONE: (Z,),
    RandomBasis.XZ: (X, Z),
    RandomBasis.XYZ: (X, Y, Z),
    RandomBasis.CHSH: (Z_PLUS_X, Z_MINUS_X),
}
# Gates that turn the direction of a basis into that of Z.
TURNS = {
    Z: (),
    X: ((Kind.RY, -pi / 2),),
    Y: ((Kind.RX, pi / 2),),
    Z_PLUS_X: ((Kind.RY, -pi / 4),),
    Z_MINUS_X: ((Kind.RY, pi / 4),),
}


def choose(how: Measuring, pairs: int, draws: np.random.Generator) -> list[int]:
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


def read_use(words: Sequence[Value]) -> tuple[Use, Measuring, Measuring]:
    """Return the use of the pairs that a request asks for, and its measurements here and there.

    Raise SessionError for a request that cannot be met.
    """
    if len(words) != WORDS:
        raise unsupported(f"a request for pairs of {len(words)} words, not {WORDS}")
    try:
        use = Use(read_word(words, 0))
        ours, theirs = (
            Measuring(
                RandomBasis(read_word(words, bases)),
                (_turn(words, first), _turn(words, first + 1), _turn(words, first + 2)),
                read_word(words, axes),
            )
            for bases, first, axes in ((2, 14, 20), (3, 17, 21))
        )
    except ValueError as error:
        raise unsupported(f"a request for pairs: {error}") from error
    for how in (ours, theirs):
        if not 0 <= how.axes <= 2:
            raise unsupported(f"axes {how.axes} of a measurement: 0 XYX, 1 YZY, 2 ZXZ")
    return use, ours, theirs


def read_word(words: Sequence[Value], place: int, default: int = 0) -> int:
    word = words[place] if place < len(words) else None
    return word if isinstance(word, int) else default


def _turn(words: Sequence[Value], place: int) -> int:
    return read_word(words, place) % 32
