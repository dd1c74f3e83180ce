"""States of single qubits: their names and angles, and what an opener tells of them.

Cardinal states are numbered as in wire/dispatcher.proto. Any other is a direction (theta, phi) on
the Bloch sphere: cos(theta/2) |0> + exp(i phi) sin(theta/2) |1>. Directions travel as parts of a
full turn in 32 bits, and what is prepared is exactly what travels.
"""

import re
from dataclasses import dataclass
from math import isfinite, pi
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from applications.teleportation.along import Directions
from hosts.hardware.replies import Symbols
from hosts.middleware.session.errors import SessionError, unsupported
from hosts.middleware.session.values import Numbers, expect, values
from wire.metadata.values import Topic, Values
from wire.metadata.vocabulary import Reason

NAMES = ("0", "1", "+", "-", "+i", "-i")  # of the cardinal states, by their numbers
RANDOM, HAAR = "random", "haar"
TURN = 1 << 32
PART = 1 << 14  # numbers in a message at most
OF_PI = re.compile(r"([-+]?)(?:([0-9.]+)\*?)?pi(?:/([0-9.]+))?")  # as pi/3 or -2*pi/3


@dataclass(frozen=True)
class Cardinal:
    """Eigenstates of Z, X and Y."""

    symbols: Symbols  # places in NAMES, shape (k,)

    @property
    def bases(self) -> Symbols:
        """Return in which basis each qubit is of a definite value: 0 Z, 1 X, 2 Y."""
        return self.symbols >> np.uint8(1)

    @property
    def bits(self) -> Symbols:
        return self.symbols & np.uint8(1)

    def messages(self, session: int, block: int) -> list[Values]:
        """Return what tells the other end the states of a block."""
        return _in_parts(session, Topic.STATES, block, self.symbols, 8)


@dataclass(frozen=True)
class Arbitrary:
    """Directions on the Bloch sphere, in parts of a full turn; both of shape (k,)."""

    theta: Numbers  # up to half a turn
    phi: Numbers

    @classmethod
    def at(cls, theta_rad: ArrayLike, phi_rad: ArrayLike) -> Self:
        return cls(_parts(theta_rad), _parts(phi_rad))

    @property
    def directions(self) -> Directions:
        unit_rad = np.float64(2 * pi / TURN)
        return Directions(self.theta * unit_rad, self.phi * unit_rad)

    def messages(self, session: int, block: int) -> list[Values]:
        both = np.concatenate([self.theta, self.phi])
        return _in_parts(session, Topic.DIRECTIONS, block, both, 32)


States = Cardinal | Arbitrary  # of each qubit of a block


class Heard:
    """The states of a block, as the other end tells them in one or more messages."""

    def __init__(self, block: int, size: int) -> None:
        self._block, self._size = block, size
        self._topic: int = Topic.STATES  # until the first message says that it is the other
        self._parts: list[Numbers] = []

    def hear(self, message: Values) -> States | None:
        """Return the states once all have arrived; raise SessionError for anything else."""
        if not self._parts and message.topic == Topic.DIRECTIONS:
            self._topic = Topic.DIRECTIONS
        directions = self._topic == Topic.DIRECTIONS
        count, most = (2 * self._size, TURN - 1) if directions else (self._size, len(NAMES) - 1)
        left = count - sum(part.size for part in self._parts)
        self._parts.append(expect(message, self._topic, self._block, min(left, PART), most))
        if left > PART:
            return None
        numbers = np.concatenate(self._parts)
        return _arbitrary(numbers) if directions else Cardinal(numbers.astype(np.uint8))


def check(state: object) -> None:
    """Raise SessionError for what names no state."""
    chosen(state, np.random.default_rng(0), 1)


def needs_vectors(state: str) -> bool:
    return state not in (RANDOM, *NAMES)


def chosen(state: object, draws: np.random.Generator, size: int) -> States:
    """Return `size` states of this name; raise SessionError if there is none.

    Random ones are cardinal; haar ones are spread evenly over the Bloch sphere.
    """
    if state == RANDOM:
        return Cardinal(draws.integers(0, len(NAMES), size, dtype=np.uint8))
    if state == HAAR:
        theta_rad = np.arccos(1 - 2 * draws.random(size))
        return Arbitrary.at(theta_rad, 2 * pi * draws.random(size))
    if state in NAMES:
        return Cardinal(np.full(size, NAMES.index(str(state)), dtype=np.uint8))
    return Arbitrary.at(*(np.full(size, angle) for angle in angles(state)))


def angles(state: object) -> tuple[float, float]:
    """Return theta and phi of a text such as 1.2,0.5 or pi/3,-pi/4; raise SessionError."""
    texts = state.split(",") if isinstance(state, str) else []
    angles_rad = [_angle(text.strip()) for text in texts]
    if len(angles_rad) != 2 or None in angles_rad:
        raise unsupported(
            f"state {state!r}: choose one of {', '.join((RANDOM, *NAMES, HAAR))}, or angles "
            "THETA,PHI on the Bloch sphere in rad, as 1.2,0.5 or pi/3,-pi/4",
        )
    (theta_rad, phi_rad) = (angle for angle in angles_rad if angle is not None)
    for name, angle, least, most in (
        ("theta", theta_rad, 0.0, pi),
        ("phi", phi_rad, -2 * pi, 2 * pi),
    ):
        if not least <= angle <= most:
            text = f"state {state!r}: {name} is {angle:g}, choose {least:g} to {most:g} rad"
            raise unsupported(text)
    return theta_rad, phi_rad


def _arbitrary(numbers: Numbers) -> Arbitrary:
    theta, phi = np.split(numbers, 2)
    if theta.max() > TURN // 2:
        raise SessionError(Reason.PROTOCOL, f"theta is {theta.max()}/{TURN} of a turn, over half")
    return Arbitrary(theta, phi)


def _angle(text: str) -> float | None:
    match = OF_PI.fullmatch(text)
    try:
        if match is None:
            angle = float(text)
        else:
            sign, factor, part = match.groups()
            angle = float(f"{sign}1") * float(factor or 1) * pi / float(part or 1)
    except (ValueError, ZeroDivisionError):
        return None
    return angle if isfinite(angle) else None


def _parts(angles_rad: ArrayLike) -> Numbers:
    turns: NDArray[np.float64] = np.asarray(angles_rad, dtype=np.float64) / (2 * pi)
    return (np.rint(turns * TURN) % TURN).astype(np.uint32)


def _in_parts(session: int, topic: int, block: int, numbers: ArrayLike, width: int) -> list[Values]:
    array = np.asarray(numbers)
    starts = range(0, array.size, PART)
    return [values(session, topic, block, array[start : start + PART], width) for start in starts]
