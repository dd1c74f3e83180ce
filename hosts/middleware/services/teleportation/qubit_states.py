"""States of single qubits: what an opener prepares, what it tells of them, how they are looked for.

Cardinal states are numbered as in wire/dispatcher.proto. Any other is a direction (theta, phi) on
the Bloch sphere: cos(theta/2) |0> + exp(i phi) sin(theta/2) |1>. Directions travel as parts of a
full turn in 32 bits, and what is prepared is exactly what travels.
"""

import re
from dataclasses import dataclass
from math import isfinite, pi
from typing import ClassVar, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hosts.hardware.qnic import BlockName, Directions, Qnic, Symbols
from hosts.middleware.session.channel import SessionError
from hosts.middleware.session.service import ConnectionEnd
from hosts.middleware.session.values import Numbers, expect
from hosts.timeouts import ANSWER_TIMEOUT_S
from wire.metadata import Reason, Topic, Values
from wire.outcomes import NO_COINCIDENCE

NAMES = ("0", "1", "+", "-", "+i", "-i")  # of the cardinal states, by their numbers
RANDOM, HAAR = "random", "haar"
TURN = 1 << 32
PART = 1 << 14  # numbers in a message at most
OF_PI = re.compile(r"([-+]?)(?:([0-9.]+)\*?)?pi(?:/([0-9.]+))?")  # as pi/3 or -2*pi/3


class States(Protocol):
    """The state of each qubit of a block."""

    TOPIC: ClassVar[int]

    async def prepare(self, qnic: Qnic, session: int, number: int) -> BlockName:
        """Make a block of qubits in these states."""

    def say(self, end: ConnectionEnd, number: int) -> None:
        """Tell the other end the states of a block."""

    async def measure(self, qnic: Qnic, name: BlockName) -> Symbols:
        """Measure each qubit for its state: 0 as it should be, 1 orthogonal to it, 255 no click."""


@dataclass(frozen=True)
class Cardinal:
    """Eigenstates of Z, X and Y."""

    TOPIC: ClassVar[int] = Topic.STATES
    symbols: Symbols  # places in NAMES, shape (k,)

    async def prepare(self, qnic: Qnic, session: int, number: int) -> BlockName:
        """Make a block of qubits in these states."""
        return await qnic.prepare(session, number, self.symbols)

    def say(self, end: ConnectionEnd, number: int) -> None:
        """Tell the other end the states of a block."""
        _say_in_parts(end, self.TOPIC, number, self.symbols, 8)

    async def measure(self, qnic: Qnic, name: BlockName) -> Symbols:
        """Measure each qubit in its own basis."""
        found = await qnic.measure(name, self.symbols >> np.uint8(1))
        expected = self.symbols & np.uint8(1)
        return np.where(found <= 1, found ^ expected, NO_COINCIDENCE).astype(np.uint8)


@dataclass(frozen=True)
class Arbitrary:
    """Directions on the Bloch sphere, in parts of a full turn; both of shape (k,)."""

    TOPIC: ClassVar[int] = Topic.DIRECTIONS
    theta: Numbers  # up to half a turn
    phi: Numbers

    @classmethod
    def at(cls, theta_rad: ArrayLike, phi_rad: ArrayLike) -> Self:
        """Return the states of these angles."""
        return cls(_parts(theta_rad), _parts(phi_rad))

    @property
    def directions(self) -> Directions:
        """Return the angles."""
        unit_rad = np.float64(2 * pi / TURN)
        return Directions(self.theta * unit_rad, self.phi * unit_rad)

    async def prepare(self, qnic: Qnic, session: int, number: int) -> BlockName:
        """Make a block of qubits in these states."""
        return await qnic.prepare_along(session, number, self.directions)

    def say(self, end: ConnectionEnd, number: int) -> None:
        """Tell the other end the states of a block."""
        _say_in_parts(end, self.TOPIC, number, np.concatenate([self.theta, self.phi]), 32)

    async def measure(self, qnic: Qnic, name: BlockName) -> Symbols:
        """Measure each qubit along its direction."""
        return await qnic.measure_along(name, self.directions)


def check(state: object) -> None:
    """Raise SessionError for what names no state."""
    chosen(state, np.random.default_rng(0), 1)


def needs_vectors(state: str) -> bool:
    """Return whether no stabiliser state is this one."""
    return state not in (RANDOM, *NAMES)


def chosen(state: object, draws: np.random.Generator, size: int) -> States:
    """Return so many states of this name; raise SessionError if there is none.

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
    found = [_angle(text.strip()) for text in texts]
    if len(found) != 2 or None in found:
        raise SessionError(
            Reason.UNSUPPORTED,
            f"state {state!r}: choose one of {', '.join((RANDOM, *NAMES, HAAR))}, or angles "
            "THETA,PHI on the Bloch sphere in rad, as 1.2,0.5 or pi/3,-pi/4",
        )
    (theta_rad, phi_rad) = (angle for angle in found if angle is not None)
    for name, angle, least, most in (
        ("theta", theta_rad, 0.0, pi),
        ("phi", phi_rad, -2 * pi, 2 * pi),
    ):
        if not least <= angle <= most:
            text = f"state {state!r}: {name} is {angle:g}, choose {least:g} to {most:g} rad"
            raise SessionError(Reason.UNSUPPORTED, text)
    return theta_rad, phi_rad


async def heard(end: ConnectionEnd, number: int, size: int) -> States:
    """Return what the other end tells next: the states of a block of this size.

    Raise SessionError if it tells anything else.
    """
    message = await end.channel.receive(Values, ANSWER_TIMEOUT_S)
    if message.topic != Topic.DIRECTIONS:
        symbols = await _hear_parts(end, message, Topic.STATES, number, size, len(NAMES) - 1)
        return Cardinal(symbols.astype(np.uint8))
    both = await _hear_parts(end, message, Topic.DIRECTIONS, number, 2 * size, TURN - 1)
    theta, phi = np.split(both, 2)
    if theta.max() > TURN // 2:
        raise SessionError(Reason.PROTOCOL, f"theta is {theta.max()}/{TURN} of a turn, over half")
    return Arbitrary(theta, phi)


def _angle(text: str) -> float | None:
    found = OF_PI.fullmatch(text)
    try:
        if found is None:
            angle = float(text)
        else:
            sign, factor, part = found.groups()
            angle = float(f"{sign}1") * float(factor or 1) * pi / float(part or 1)
    except (ValueError, ZeroDivisionError):
        return None
    return angle if isfinite(angle) else None


def _parts(angles_rad: ArrayLike) -> Numbers:
    """Return angles as whole parts of a turn."""
    turns: NDArray[np.float64] = np.asarray(angles_rad, dtype=np.float64) / (2 * pi)
    return (np.rint(turns * TURN) % TURN).astype(np.uint32)


def _say_in_parts(
    end: ConnectionEnd, topic: int, number: int, numbers: ArrayLike, width: int
) -> None:
    array = np.asarray(numbers)
    for start in range(0, array.size, PART):
        end.say(topic, number, array[start : start + PART], width)


async def _hear_parts(
    end: ConnectionEnd, first: Values, topic: int, number: int, count: int, most: int
) -> Numbers:
    parts = [expect(first, topic, number, min(count, PART), most)]
    while left := count - sum(part.size for part in parts):
        parts.append(await end.hear(topic, number, min(left, PART), most))
    return np.concatenate(parts)
