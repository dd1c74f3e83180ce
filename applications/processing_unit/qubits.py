"""The qubits of one application, by the numbers that it calls them.

Gates are gathered and given to the hardware in one call, when somebody needs to
know an outcome, or at the end of a subroutine. Between two calls they wait in the host's memory.
"""

from itertools import count
from math import pi

import numpy as np
from numpy.typing import NDArray

from applications.processing_unit.operations import OUTCOMES, Kind, Operation, process
from hosts.hardware.block_name import BlockName
from hosts.hardware.qnic import Qnic
from hosts.middleware.session.errors import SessionError, unsupported
from wire.metadata.vocabulary import Reason
from wire.outcomes import NO_CLICK

MOST_GATHERED = 4096  # operations
GATES: dict[str, tuple[Kind, ...]] = {
    "x": (Kind.X,),
    "y": (Kind.Y,),
    "z": (Kind.Z,),
    "h": (Kind.H,),
    "s": (Kind.S,),
    "k": (Kind.S_DAG, Kind.H, Kind.S),  # (Y + Z) / sqrt 2
    "t": (Kind.T,),
}
ROTATIONS = {"rot_x": Kind.RX, "rot_y": Kind.RY, "rot_z": Kind.RZ}
PAIR_GATES = {"cnot": Kind.CX, "cphase": Kind.CZ}


class Outcome:
    """The outcome of a measurement that may not have been made yet."""

    value: int | None = None


class Qubits:
    """Qubits by number: allocated, acted on, measured, freed."""

    def __init__(self, qnic: Qnic, session: int, most: int) -> None:
        """Begin with none; at most `most` qubits. Their photons are of this session."""
        self._qnic, self._session, self.most = qnic, session, most
        self._blocks: dict[int, BlockName] = {}
        self._numbers = count(1)
        self._operations: list[Operation] = []
        self._outcomes: list[Outcome] = []

    def __contains__(self, qubit: int) -> bool:
        return qubit in self._blocks

    def new_block(self) -> BlockName:
        return BlockName(self._session, next(self._numbers), 0)

    def place(self, qubit: int, block: BlockName) -> None:
        """Give an existing qubit this number; raise SessionError if another has it."""
        if not 0 <= qubit < self.most:
            text = f"qubit {qubit}: this application has {self.most}, from 0; ask for more"
            raise unsupported(f"{text} (max_qubits)")
        if qubit in self._blocks:
            raise unsupported(f"qubit {qubit} is allocated already: free it first")
        self._blocks[qubit] = block

    def allocate(self, qubit: int) -> None:
        block = self.new_block()
        self.place(qubit, block)
        self._do(Kind.ZERO, block)

    def initialize(self, qubit: int) -> None:
        """Put a qubit into |0>, whatever it was in."""
        block = self._block(qubit)
        if self._last(block) != Kind.ZERO:
            self._discard(block)
            self._blocks[qubit] = block = self.new_block()
            self._do(Kind.ZERO, block)

    def free(self, qubit: int) -> None:
        block = self._block(qubit)
        del self._blocks[qubit]
        self._discard(block)

    def gate(self, name: str, qubit: int) -> None:
        block = self._block(qubit)
        for kind in GATES[name]:
            self._do(kind, block)

    def rotate(self, name: str, qubit: int, numerator: int, denominator: int) -> None:
        """Turn a qubit by numerator pi / 2^denominator about an axis."""
        angle_rad = numerator * pi / 2**denominator
        self._do(ROTATIONS[name], self._block(qubit), angle_rad=angle_rad)

    def pair_gate(self, name: str, first: int, second: int) -> None:
        one, other = self._block(first), self._block(second)
        if one == other:
            raise unsupported(f"{name} of qubit {first} with itself: name two different qubits")
        self._do(PAIR_GATES[name], one, target=other)

    def move(self, source: int, target: int) -> None:
        """Give a qubit another number; what had that one is discarded."""
        block = self._block(source)
        if source != target:
            if target in self._blocks:
                self.free(target)
            self.place(target, block)
            del self._blocks[source]

    def swap(self, first: int, second: int) -> None:
        """Exchange the numbers of two qubits."""
        one, other = self._block(first), self._block(second)
        self._blocks[first], self._blocks[second] = other, one

    def measure(self, qubit: int) -> Outcome:
        """Measure a qubit in the basis Z; it stays, in the state that is found."""
        self._do(Kind.OBSERVE, self._block(qubit))
        self._outcomes.append(outcome := Outcome())
        return outcome

    @property
    def full(self) -> bool:
        """Return whether so much is to be done that it should be done now."""
        return len(self._operations) >= MOST_GATHERED

    async def flush(self) -> None:
        """Have everything done; every outcome is known then."""
        if not self._operations:
            return
        operations, outcomes = self._operations, self._outcomes
        self._operations, self._outcomes = [], []
        held = set(self._blocks.values())
        used = (block for operation in operations for block in (operation.block, operation.target))
        stored = (Operation(Kind.STORE, block) for block in dict.fromkeys(used) if block in held)
        bits = await process(self._qnic, [*operations, *stored])
        if NO_CLICK in bits:
            raise SessionError(
                Reason.HARDWARE,
                "no detector has clicked for a qubit that was measured: NetQASM knows no such "
                "outcome; take hosts whose memory and detectors have an efficiency of 1",
            )
        for outcome, bit in zip(outcomes, bits, strict=True):
            outcome.value = bit

    async def look(self, qubit: int, entangled: bool) -> NDArray[np.complex128]:
        """Return the density matrix of a qubit, where states are simulated."""
        await self.flush()
        return await self._qnic.look(self._block(qubit), entangled)

    def _block(self, qubit: int) -> BlockName:
        if qubit not in self._blocks:
            raise unsupported(f"qubit {qubit} is not allocated")
        return self._blocks[qubit]

    def _do(self, kind: Kind, block: BlockName, **words: object) -> None:
        self._operations.append(Operation(kind, block, **words))  # type: ignore[arg-type]

    def _last(self, block: BlockName) -> Kind | None:
        if self._operations and self._operations[-1].block == block:
            return self._operations[-1].kind
        return None

    def _discard(self, block: BlockName) -> None:
        """Discard a qubit; one that has just been measured is used up by the measurement."""
        if self._last(block) in OUTCOMES:
            self._operations[-1] = Operation(Kind.MEASURE, block)
        else:
            self._do(Kind.DISCARD, block)
