"""Lets Kraus operators act on the photons of a block, behind all that these have met before.

Turns and angles that wait to be twirled (dispatcher.layer.drift) do not commute with them. States
are vectors here, so these act first, as the unitary operators that they are.
"""

import numpy as np

from dispatcher.fiber.turn import Turn
from dispatcher.layer.drift import Angles
from dispatcher.layer.ownership import Block
from dispatcher.sabot.backend import Bytes
from dispatcher.sabot.dense import Dense
from dispatcher.sabot.draws import Draws
from dispatcher.sabot.kraus import Operators, of_qubits
from dispatcher.sabot.registers import Mask, everything
from dispatcher.sabot.simulation import Simulation
from wire.config import BadConfig

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
        block, further = self._block, self._block.further
        size, of_further = block.register.size, None
        if operators.ndim == EACH_ITS_OWN and operators.shape[0] > size:
            operators, of_further = operators[:size], operators[size:]
        purpose = block.draws_for(f"{self._place} {what}")
        draws = self._draws.photons(block.name, purpose, block.register.size)
        mask = members & block.register.present
        self._sabot.kraus(block.register, operators, mask, draws)
        if further is not None:
            here = members[further.pulses]
            own = of_qubits(operators, further.pulses) if of_further is None else of_further
            drawn = self._draws.photons(block.name, f"{purpose} further", further.pulses.size)
            self._sabot.kraus(further.register, own, here & further.register.present, drawn)

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
