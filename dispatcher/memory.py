"""Quantum memories: what waiting does to qubits, by the time that they really waited.

Relaxation to |0> with T1 and decay of coherence with T2 are, for T2 <= T1, exactly a reset with
probability 1 - e^(-t/T1) and a Z with (e^(-t/T1) - e^(-t/T2)) / 2. Beyond that, up to T2 = 2 T1,
no mixture of resets and Paulis is the same; the Pauli twirl of it (Sarvepalli, Klappenecker,
Roetteler, arXiv:0804.4316) is an approximation.
"""

from math import expm1
from typing import NamedTuple

import numpy as np

from dispatcher import drift, pulses
from dispatcher.chance import Chance
from dispatcher.clock import Clock
from dispatcher.devices import Devices
from dispatcher.ownership import Block
from dispatcher.refusal import exhausted
from dispatcher.sabot.draws import Draws
from dispatcher.sabot.manager import Sabot
from wire.physics import Memory


class Decay(NamedTuple):
    """How likely a qubit that has waited is reset, or else meets a Pauli."""

    reset: float
    x: float
    y: float
    z: float
    exact: bool


def decay(memory: Memory, waited_s: float) -> Decay:
    """Return what has happened to a qubit in a memory for some time."""
    relaxed, dephased = (-expm1(-waited_s / time_s) for time_s in (memory.t1_s, memory.t2_s))
    if memory.t2_s <= memory.t1_s:
        return Decay(relaxed, 0.0, 0.0, (dephased - relaxed) / 2, True)
    return Decay(0.0, relaxed / 4, relaxed / 4, dephased / 2 - relaxed / 4, relaxed == 0)


class Memories:
    """The memories of all hosts."""

    def __init__(self, devices: Devices, clock: Clock, sabot: Sabot, draws: Draws) -> None:
        """Begin with empty ones."""
        self._devices, self._clock = devices, clock
        self._sabot, self._draws = sabot, draws
        self._stored: dict[str, dict[Block, int]] = {}  # qubits of each block, by node

    def store(self, block: Block) -> None:
        """Put a block at a node into its memory, or keep it there; refuse what has no room."""
        stored = self._stored.setdefault(block.node, {})
        if block in stored:
            return
        capacity = self._devices.of(block.node).memory.capacity
        used, more = sum(stored.values()), block.register.remaining
        if used + more > capacity:
            raise exhausted(
                f"{more} more qubits with {used} stored exceed the capacity of {block.node}'s "
                f"memory, {capacity}; measure, send or discard some first"
            )
        stored[block] = more
        block.stored_ns, block.stores = self._clock.now_ns(), block.stores + 1

    def forget(self, block: Block) -> None:
        """Free the place of a block that is discarded."""
        self._stored.get(block.node, {}).pop(block, None)

    def read_out(self, block: Block) -> str | None:
        """Take a block out of the memory, if it is in one; return what has happened to it."""
        if block not in self._stored.get(block.node, {}):
            return None
        self.forget(block)
        waited_ns = self._clock.now_ns() - block.stored_ns
        block.start_ns += waited_ns
        block.first_ns += waited_ns
        block.last_ns += waited_ns
        memory = self._devices.of(block.node).memory
        where = f"memory of {block.node}, {block.fibers_passed}, {block.stores}"
        chance = Chance(self._draws, block.name, where, block.register.size)
        counts = {"lost": self._lose(block, memory.efficiency, chance)}
        counts |= self._decay(block, decay(memory, waited_ns / 1e9), chance)
        told = "".join(f" {name}={count}" for name, count in counts.items() if count)
        return f"after {waited_ns / 1e9:.9f} s{told}"

    def _lose(self, block: Block, efficiency: float, chance: Chance) -> int:
        if efficiency == 1:
            return 0
        everything = np.ones(chance.photons, dtype=bool)
        pulses.thin(block.pulses, everything, efficiency, chance, "further photons")
        return self._sabot.lose(block.register, chance.happens("efficiency", 1 - efficiency))

    def _decay(self, block: Block, happened: Decay, chance: Chance) -> dict[str, int]:
        counts = {}
        present = block.register.present
        if happened.reset:
            reset = chance.happens("reset", happened.reset) & present
            counts["reset"] = int(np.count_nonzero(reset))
            if counts["reset"]:
                purpose = f"reset {block.fibers_passed}, {block.stores}"
                draws = self._draws.photons(block.name, purpose, chance.photons)
                self._sabot.reset(block.register, reset, draws)
        errors = happened.x + happened.y + happened.z
        if errors:
            # A reset and a Pauli exclude each other, but Z does nothing to what has been reset.
            met = np.flatnonzero(chance.happens("decay", errors / (1 - happened.reset)) & present)
            paulis = np.zeros(chance.photons, dtype=np.uint8)
            paulis[met] = 1 + chance.which("Pauli", met.size, (happened.x, happened.z, happened.y))
            self._sabot.pauli(block.register, paulis)
            drift.reflect(block.pulses, paulis)
            tally = np.bincount(paulis, minlength=4)
            counts |= {name: int(tally[i]) for i, name in enumerate(("X", "Z", "XZ"), 1)}
        block.pulses.exact &= happened.exact
        return counts
