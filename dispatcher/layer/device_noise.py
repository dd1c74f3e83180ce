"""Lets what a noise model of a user's own says happen to the qubits of a block.

Lets Kraus operators act on the photons of a block, behind all that these have met before.

Turns and angles that wait to be twirled (dispatcher.layer.drift) do not commute with them. States
are vectors here, so these act first, as the unitary operators that they are.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from dispatcher.devices.hardware import PartNoise
from dispatcher.fiber.noise import Effect
from dispatcher.fiber.turn import Turn
from dispatcher.layer import drift, pulses
from dispatcher.layer.drift import Angles
from dispatcher.layer.ownership import Block
from dispatcher.sabot.backend import Bytes
from dispatcher.sabot.dense import Dense
from dispatcher.sabot.draws import Draws
from dispatcher.sabot.kraus import Operators, of_qubits
from dispatcher.sabot.registers import Mask, Register, everything
from dispatcher.sabot.simulation import Simulation
from wire.config import BadConfig
from wire.outcomes import NO_CLICK

EACH_ITS_OWN = 4  # dimensions of operators
_COS, _SIN = np.cos(np.pi / 8), np.sin(np.pi / 8)
TO_Z: Operators = np.array(
    [
        [[1, 0], [0, 1]],
        [[np.sqrt(0.5), np.sqrt(0.5)], [np.sqrt(0.5), -np.sqrt(0.5)]],
        [[np.sqrt(0.5), -1j * np.sqrt(0.5)], [np.sqrt(0.5), 1j * np.sqrt(0.5)]],
        [[_COS, _SIN], [-_SIN, _COS]],
        [[_COS, -_SIN], [_SIN, _COS]],
    ]
)  # what brings each of wire.outcomes.BASES to Z: Z, X, Y, Z+X, Z-X


class Channels:
    """The Kraus operators that act on one block at one point of its way."""

    def __init__(
        self, sabot: Simulation, draws: Draws, block: Block, place: str, noise: str
    ) -> None:
        """Draw for this place; raise BadConfig, naming the noise, where states are not vectors."""
        if sabot.backend != Dense.NAME:
            raise BadConfig(
                f"Kraus operators of {noise} need state vectors, and the backend is "
                f"{sabot.backend}: start with --backend dense, or let the model return Paulis"
            )
        self._sabot, self._draws, self._block, self._place = sabot, draws, block, place

    def act(self, operators: Operators, members: Mask, what: str = "Kraus") -> None:
        """Let all photons of the members' pulses meet one of the operators, each for itself.

        They have shape (m, 2, 2), or (k, m, 2, 2): those of each pulse, or of each own photon and
        then of each further one.
        """
        block, extra_pairs = self._block, self._block.extra_pairs
        size, of_extra_pairs = block.register.size, None
        if operators.ndim == EACH_ITS_OWN and operators.shape[0] > size:
            operators, of_extra_pairs = operators[:size], operators[size:]
        purpose = block.draws_for(f"{self._place} {what}")
        draws = self._draws.photons(block.name, purpose, block.register.size)
        mask = members & block.register.present
        self._sabot.kraus(block.register, operators, mask, draws)
        if extra_pairs is not None:
            here = members[extra_pairs.pulses]
            extra_operators = (
                of_qubits(operators, extra_pairs.pulses)
                if of_extra_pairs is None
                else of_extra_pairs
            )
            drawn = self._draws.photons(block.name, f"{purpose} further", extra_pairs.pulses.size)
            self._sabot.kraus(
                extra_pairs.register, extra_operators, here & extra_pairs.register.present, drawn
            )

    def settle(self) -> None:
        """Let what has turned the whole block be in its state."""
        self.settle_turn()
        self.settle_angles(everything(self._block.register.size))

    def settle_turn(self) -> None:
        """Let the block's turn of polarisation be in its state."""
        if self._block.pulses.turn is not None:
            self.turn(self._block.pulses.turn, everything(self._block.register.size))
            self._block.pulses.turn = None

    def turn(self, turn: Turn, members: Mask) -> None:
        photons = np.arange(members.size)
        w, x, y, z = turn.quaternions[turn.stretch(photons)].T
        rows = [[w - 1j * z, -1j * x - y], [-1j * x + y, w + 1j * z]]
        self.act(_of_each(rows), members, "turn")

    def settle_angles(self, members: Mask) -> None:
        """Let the members' rotations about Z be in their states."""
        pulses = self._block.pulses
        if pulses.angles_rad is not None:
            half: Angles = pulses.angles_rad / 2
            none = np.zeros_like(half)
            rows = [[np.exp(-1j * half), none], [none, np.exp(1j * half)]]
            self.act(_of_each(rows), members, "angles")
            pulses.angles_rad = None if members.all() else pulses.angles_rad * ~members


def in_bases(operators: Operators, bases: Bytes) -> Operators:
    """Return what operators of the basis Z are for qubits of these bases, shape (k, m, 2, 2)."""
    turns = TO_Z[bases][:, None]
    turned: Operators = turns.conj().swapaxes(-1, -2) @ operators @ turns
    return turned


def _of_each(rows: list[list[Operators]]) -> Operators:
    """Return one operator for each photon, shape (k, 1, 2, 2), of its four elements' arrays."""
    return np.array(rows, dtype=np.complex128).transpose(2, 0, 1)[:, None]


BIT, BELL_STATE = np.uint8(1), np.uint8(3)


def effect_of(
    model: PartNoise,
    draws: Draws,
    block: Block,
    what: str,
    place: str,
    time_ns: int,
    *,
    waited_s: NDArray[np.float64] | None = None,
    qubits: int = 1,
) -> Effect:
    """Return the effect on a block in a part of its node's device.

    First on the own photon of each pulse, then on the others; for detectors, on the outcome of each
    pulse.
    """
    if waited_s is None:
        waited_s = np.zeros(block.register.size)
    if what != "detectors" and block.extra_pairs is not None:
        waited_s = np.concatenate([waited_s, waited_s[block.extra_pairs.pulses]])
    key = block.draws_for(place)
    effect = model.effect(draws, block.name, what, key, time_ns, waited_s, qubits)
    block.pulses.approximations |= effect.approximations
    return effect


def meet(
    sabot: Simulation,
    draws: Draws,
    block: Block,
    effect: Effect | None,
    place: str,
    members: Mask | None = None,
    with_extra_pairs: bool = True,
) -> int:
    """Let it happen to the photons of the members' pulses; return how many qubits are lost.

    The place is that of `effect_of`, so that each has random numbers of its own.
    """
    if effect is None:
        return 0
    if members is None:
        members = everything(block.register.size)
    if effect.paulis is not None:
        for register, affected, here in _photons(block, members, with_extra_pairs):
            paulis = effect.paulis[here] * affected
            sabot.explain(register, f"noise of its own at {block.node}", paulis)
            sabot.pauli(register, paulis)
            if register is block.register:
                drift.reflect(block.pulses, paulis)
    if effect.kraus is not None:
        channels = Channels(sabot, draws, block, place, f"noise at {block.node}")
        channels.settle()
        channels.act(effect.kraus, members)
    if effect.lost is None:
        return 0
    pulses.darken(block.pulses, effect.lost[: members.size] & members)
    gone = _photons(block, members, with_extra_pairs)
    return sum(
        sabot.lose(register, effect.lost[here] & affected) for register, affected, here in gone
    )


def _photons(
    block: Block, members: Mask, with_extra_pairs: bool
) -> Iterator[tuple[Register, Mask, slice]]:
    """Yield own and further photons: which are of the members, and where an effect has them."""
    size = block.register.size
    yield block.register, members, slice(size)
    if block.extra_pairs is not None and with_extra_pairs:
        yield block.extra_pairs.register, members[block.extra_pairs.pulses], slice(size, None)


def in_front(
    sabot: Simulation, draws: Draws, block: Block, effect: Effect | None, place: str, bases: Bytes
) -> None:
    """Let Kraus operators act in front of detectors that tell each qubit's basis, shape (k,).

    They act on the outcome: |0> is the state that is reported as 0, in any basis. Of a Bell
    measurement they act on the first half, in the basis 0.
    """
    if effect is not None and effect.kraus is not None:
        operators = in_bases(effect.kraus, bases)
        meet(sabot, draws, block, Effect(kraus=operators), place)


def reported(outcomes: Bytes, effect: Effect | None, bits: np.uint8 = BIT) -> Bytes:
    """Return outcomes after an effect: X flips a bit, of a Bell state the parity, Z its phase."""
    if effect is None:
        return outcomes
    flips = np.zeros(outcomes.size, np.uint8) if effect.paulis is None else effect.paulis.copy()
    flips &= bits
    flips[outcomes == NO_CLICK] = 0
    changed = outcomes ^ flips
    if effect.lost is not None:
        changed[effect.lost] = NO_CLICK
    return changed
