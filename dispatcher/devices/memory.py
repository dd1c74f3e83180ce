"""Quantum memories: what waiting does to qubits, by the time that they really waited.

A block that is used again has left its memory: to wait on it is stored again. Light that waits at
a port, or is kept without being stored, is in an ideal delay line.
"""

from collections.abc import Sequence
from math import asin, sqrt

import numpy as np

from dispatcher.chance import Chance
from dispatcher.clock import Clock
from dispatcher.devices import abilities
from dispatcher.devices.decay import Decay, decay
from dispatcher.devices.hardware import Devices
from dispatcher.light import drift, pulses
from dispatcher.ownership import Block
from dispatcher.refusal import exhausted
from dispatcher.sabot.draws import Draws
from dispatcher.sabot.room import GateStep
from dispatcher.sabot.simulation import Simulation
from dispatcher.software_time import SoftwareTime
from wire.features import STORE


class Memories:
    """The memories of all hosts."""

    def __init__(
        self,
        devices: Devices,
        clock: Clock,
        sabot: Simulation,
        draws: Draws,
        software: SoftwareTime,
    ) -> None:
        """Begin with empty ones; tell of each wait how long it was."""
        self._software = software
        self._devices, self._clock = devices, clock
        self._sabot, self._draws = sabot, draws
        self._stored: dict[str, dict[Block, int]] = {}  # qubits of each block, by node

    def store(self, block: Block) -> None:
        """Put a block at a node into its memory, or keep it there; refuse what has no room."""
        stored = self._stored.setdefault(block.node, {})
        if block in stored:
            return
        abilities.require(self._devices, block.node, STORE)
        capacity = self._devices.of(block.node).memory.capacity
        used, more = sum(stored.values()), block.register.remaining
        if used + more > capacity:
            raise exhausted(
                f"{more} more qubits with {used} stored exceed the capacity of {block.node}'s "
                f"memory, {capacity}; measure, send or discard some first"
            )
        stored[block] = more
        block.stored_ns, block.stores = self._clock.now_ns(), block.stores + 1

    def holds(self, block: Block) -> bool:
        """Return whether a block is in its node's memory."""
        return block in self._stored.get(block.node, {})

    def forget(self, block: Block) -> None:
        """Free the place of a block that is discarded."""
        self._stored.get(block.node, {}).pop(block, None)

    def read_out(self, block: Block) -> str | None:
        """Take a block out of the memory, if it is in one; return what has happened to it.

        Raise TooLarge, and leave it there, if that would take too large state vectors.
        """
        return self._wait_is_over(block, leaves=True) if self.holds(block) else None

    def look_in(self, block: Block) -> str:
        """Decide what the wait so far has done to a block that stays in the memory.

        Waits add up: what comes later is the same as without looking in. Raise as read_out.
        """
        return self._wait_is_over(block, leaves=False)

    def exchange(self, givers: Sequence[Block], taker: Block) -> None:
        """Let a new block be in the memory with photons that were in there: a part of others'."""
        stored = self._stored.setdefault(taker.node, {})
        for block in (*givers, taker):
            stored[block] = block.register.remaining
        taker.stored_ns = self._clock.now_ns()

    def _wait_is_over(self, block: Block, leaves: bool) -> str:
        now_ns = self._clock.now_ns()
        waited_ns = now_ns - block.stored_ns
        memory = self._devices.of(block.node).memory
        happened = decay(memory, waited_ns / 1e9)
        self._software.waited(block.node, block.stored_ns, now_ns, memory.decays)
        if happened.damped:
            self._damp(block, happened.damped)
        block.start_ns += waited_ns
        block.first_ns += waited_ns
        block.last_ns += waited_ns
        where = f"memory of {block.node}, {block.fibers_passed}, {block.stores}"
        chance = Chance(self._draws, block.name, block.draws_for(where), block.register.size)
        counts = {}
        if leaves:
            self.forget(block)
            counts["lost"] = self._lose(block, memory.efficiency, chance)
        counts |= self._decay(block, happened, chance)
        if not leaves:
            block.stored_ns, block.stores = now_ns, block.stores + 1
        told = "".join(f" {name}={count}" for name, count in counts.items() if count)
        return f"after {waited_ns / 1e9:.9f} s{told}"

    def _lose(self, block: Block, efficiency: float, chance: Chance) -> int:
        if efficiency == 1:
            return 0
        everything = np.ones(chance.photons, dtype=bool)
        pulses.thin(block.pulses, everything, efficiency, chance, "further photons")
        return self._sabot.lose(block.register, chance.happens("efficiency", 1 - efficiency))

    def _damp(self, block: Block, share: float) -> None:
        """Let so much of the excitation pass into qubits that nobody sees; or raise TooLarge."""
        sabot, angle_rad = self._sabot, asin(sqrt(share))
        unseen = sabot.zeros(block.register.size)
        purpose = block.draws_for(f"damped {block.fibers_passed}, {block.stores}")
        draws = self._draws.photons(block.name, purpose, block.register.size)
        try:
            rotation = GateStep("RY", angle_rad=angle_rad)
            sabot.require_room(unseen, [rotation, GateStep("CX", block.register)])
            sabot.gate("RY", unseen, angle_rad=angle_rad)
            sabot.gate("CX", block.register, unseen)
            sabot.gate("RY", unseen, angle_rad=-angle_rad)
            sabot.gate("CX", block.register, unseen)
            sabot.gate("CX", unseen, block.register)
        finally:
            sabot.drop(unseen, draws)

    def _decay(self, block: Block, happened: Decay, chance: Chance) -> dict[str, int]:
        counts = {}
        present = block.register.present
        if happened.reset:
            reset = chance.happens("reset", happened.reset) & present
            counts["reset"] = int(np.count_nonzero(reset))
            if counts["reset"]:
                purpose = block.draws_for(f"reset {block.fibers_passed}, {block.stores}")
                draws = self._draws.photons(block.name, purpose, chance.photons)
                self._sabot.reset(block.register, reset, draws)
        errors = happened.x + happened.y + happened.z
        if errors:
            # A reset and a Pauli exclude each other, but Z does nothing to what has been reset.
            met = np.flatnonzero(chance.happens("decay", errors / (1 - happened.reset)) & present)
            paulis = np.zeros(chance.photons, dtype=np.uint8)
            paulis[met] = 1 + chance.which("Pauli", met.size, (happened.x, happened.z, happened.y))
            self._sabot.explain(block.register, f"decay in the memory of {block.node}", paulis)
            self._sabot.pauli(block.register, paulis)
            drift.reflect(block.pulses, paulis)
            tally = np.bincount(paulis, minlength=4)
            counts |= {name: int(tally[i]) for i, name in enumerate(("X", "Z", "XZ"), 1)}
        block.pulses.exact &= happened.exact
        return counts
