"""Quantum memories: what waiting does to qubits, by the time that each has really waited.

A stored qubit decoheres from its arrival, not from the request to store it: light from its arrival
at the port; the half of a pair that stays, when the source emits the other half; a qubit that is
made on the spot at once. It ends when the block is used: at once for
all, but with light that is not stored one by one, as that comes. A block that is used again has
left its memory.

A request made before the light arrives is executed on arrival. Light that came before the
request was in the memory meanwhile, stored or not, and so was light that waited for other light
that a memory elsewhere has kept. Nobody hears a herald of it. A host whose memory takes none lets
it wait in a fibre that loses nothing: an approximation, as large as what the host's delay line
would lose.
"""

from collections.abc import Sequence

import numpy as np

from dispatcher.approximations import FREE_WAIT, approximation
from dispatcher.clock import Clock
from dispatcher.devices import hardware
from dispatcher.devices.decay import Each, Waits
from dispatcher.devices.hardware import Devices
from dispatcher.layer import cutoff, decoherence, device_noise, drift, herald, pulses
from dispatcher.layer.ownership import Block
from dispatcher.photon_random import PhotonRandom
from dispatcher.refusal import exhausted
from dispatcher.sabot.draws import Draws
from dispatcher.sabot.simulation import Simulation
from wire.features import ABSORB, STORE
from wire.parameters.fiber import SPEED_IN_FIBER_M_PER_S
from wire.parameters.physics import BellAnalyser


class Memories:
    def __init__(
        self,
        devices: Devices,
        clock: Clock,
        sabot: Simulation,
        draws: Draws,
    ) -> None:
        self._devices, self._clock = devices, clock
        self._sabot, self._draws = sabot, draws
        self._stored: dict[str, dict[Block, int]] = {}  # qubits of each block, by node

    def store(self, block: Block, cutoff_s: float | None = None) -> tuple[str, int]:
        """Put a block at a node into its memory, or keep it there; refuse what has no room.

        Photons older than the cut-off (the given one, or the memory's) are dropped. Return the
        text of the event log on wrong heralds, and how many were too old.
        """
        stored = self._stored.setdefault(block.node, {})
        wrong = "" if block in stored else self._put(block, stored)
        default_s = self._devices.of(block.node).memory.cutoff_s
        if cutoff_s == cutoff.NEVER:
            cutoff.remember(block)
        block.cutoff_s = default_s if cutoff_s is None else cutoff_s
        return wrong, cutoff.drop(self._sabot, block, self._clock.now_ns())

    def _put(self, block: Block, stored: dict[Block, int]) -> str:
        hardware.require(self._devices, block.node, STORE)
        if block.fibers_passed:
            hardware.require(self._devices, block.node, ABSORB)
        if block.heard_ns <= self._clock.now_ns():
            self.require_capacity(block.node, block.register.remaining)
        memory = self._devices.of(block.node).memory
        wrong = herald.meet(self._sabot, self._draws, block, memory)
        stored[block] = block.register.remaining
        block.stored_ns, block.stores = self._clock.now_ns(), block.stores + 1
        block.kept = True
        return wrong

    def require_capacity(self, node: str, more: int, known_ns: int = 0) -> None:
        """Refuse this number of further qubits if a node's memory has no room for them.

        Pairs that were heralded count when the node can have heard of them: by now, unless given.
        """
        used = self._used(node, known_ns or self._clock.now_ns())
        capacity = self._devices.of(node).memory.capacity
        if used + more > capacity:
            raise exhausted(
                f"{more} more qubits with {used} stored exceed the capacity of {node}'s "
                f"memory, {capacity}; measure, send or discard some first"
            )

    def has_capacity(self, node: str) -> bool:
        return self._used(node, self._clock.now_ns()) <= self._devices.of(node).memory.capacity

    def _used(self, node: str, known_ns: int) -> int:
        stored = self._stored.get(node, {}).items()
        return sum(qubits for block, qubits in stored if block.heard_ns <= known_ns)

    def holds(self, block: Block) -> bool:
        return block in self._stored.get(block.node, {})

    def forget(self, block: Block) -> None:
        """Free the place of a block that is discarded."""
        self._stored.get(block.node, {}).pop(block, None)

    def read_out(
        self, block: Block, light: Block | None = None, interval_ns: float = 0.0
    ) -> str | None:
        """Take a block out of the memory, if it is in one; return what has happened to it.

        Each qubit is read out when the photon of the light in its place comes, if there is any, or
        an interval after the one before.
        Raise TooLarge, and leave the block there, if that would take too large state vectors.
        """
        if not self.holds(block):
            return None
        now_ns, memory = self._clock.now_ns(), self._devices.of(block.node).memory
        pattern = (now_ns, interval_ns)
        if light is not None:
            pattern = light.start_ns, light.interval_ns
        detail = self._wait_is_over(block, now_ns, pattern, memory.efficiency)
        pulses.retime(block.pulses)
        return detail

    def hold(self, block: Block, asked_ns: int, light: Block | None = None) -> str | None:
        """Apply decoherence to an unstored block up to the time of the request, or of the light.

        A request at 0 is one of now. Return the effect as a text, or None. Raise as read_out.
        """
        if self._keeps(block):
            return None
        device = self._devices.of(block.node)
        memory, can_keep = device.memory, self._can_keep(block)
        until_ns, interval_ns = asked_ns or self._clock.now_ns(), 0.0
        if light is not None and light.start_ns > until_ns:
            until_ns, interval_ns = light.start_ns, light.interval_ns
        waits = _waits(block, until_ns, interval_ns)
        if waits.longest_s == 0:
            return None
        if not can_keep:
            _wait_for_free(block, waits.longest_s, device.analyser)
            return None
        all_waited = waits.shortest_s > 0
        missed: Each = 0.0 if block.kept else 1 - memory.efficiency
        if missed and not all_waited:
            waited = waits.of(np.arange(waits.qubits)) > 0
            missed = np.where(waited, missed, 0.0)
        block.kept, block.stores = True, block.stores + 1
        schedule = block.start_ns, block.interval_ns, block.first_ns, block.last_ns
        detail = self._wait_is_over(block, until_ns, (until_ns, interval_ns), 1 - missed)
        if not all_waited:  # some of it has come as it was wanted
            block.start_ns, block.interval_ns, block.first_ns, block.last_ns = schedule
        return f"{detail}, not stored"

    def has_waited(self, block: Block, asked_ns: int) -> bool:
        if self._keeps(block):
            return False
        return _waits(block, asked_ns or self._clock.now_ns(), 0.0).longest_s > 0

    def _can_keep(self, block: Block) -> bool:
        memory = self._devices.of(block.node).memory
        light_of_others = block.fibers_passed and not block.kept
        return memory.capacity > 0 and not (light_of_others and memory.kind == "emissive")

    def _keeps(self, block: Block) -> bool:
        """Return whether waiting here does nothing to a block."""
        if block.is_new and block.retimed:  # prepared when it is wanted
            return True
        ideal = self._devices.of(block.node).memory.keeps
        noise = self._devices.noise(block.node, "memory")
        return self._can_keep(block) and ideal and noise is None

    def look_in(self, block: Block) -> str:
        """Decide what the wait so far has done to a block that stays in the memory.

        Waits add up: what comes later is the same as without looking in. Raise as read_out.
        """
        now_ns = self._clock.now_ns()
        return self._wait_is_over(block, now_ns, (now_ns, 0.0), 1.0, leaves=False)

    def exchange(self, givers: Sequence[Block], taker: Block) -> None:
        """Let a new block be in the memory with photons that were in there: a part of others'."""
        stored = self._stored.setdefault(taker.node, {})
        for block in (*givers, taker):
            stored[block] = block.register.remaining
        taker.stored_ns = self._clock.now_ns()

    def _wait_is_over(
        self,
        block: Block,
        now_ns: int,
        pattern: tuple[int, float],
        efficiency: Each,
        leaves: bool = True,
    ) -> str:
        """Do what the wait does until qubits are wanted: from a time on, each an interval later."""
        start_ns, interval_ns = pattern
        waits = _waits(block, start_ns, interval_ns)
        old = cutoff.drop(self._sabot, block, start_ns, interval_ns)
        memory = self._devices.of(block.node).memory
        drift.twirl_turn(block, self._sabot, self._draws)
        decoherence.damp(self._sabot, self._draws, block, memory, waits)
        cutoff.remember(block)
        block.start_ns, block.interval_ns, block.came_ns = start_ns, interval_ns, None
        block.first_ns, block.last_ns = start_ns, _time_ns(block, block.register.size - 1)
        where = f"memory of {block.node}, {block.fibers_passed}, {block.stores}"
        random = PhotonRandom(self._draws, block.name, block.draws_for(where), block.register.size)
        counts = {"old": old}
        if leaves:
            self.forget(block)
            block.path_ps, block.retimed = 0.0, True
        counts["lost"] = decoherence.lose(self._sabot, block, memory, waits, random, efficiency)
        counts |= decoherence.decohere(self._sabot, self._draws, block, memory, waits, random)
        if (model := self._devices.noise(block.node, "memory")) is not None:
            waited_s = waits.of(np.arange(waits.qubits))
            effect = device_noise.effect_of(
                model, self._draws, block, "memory", where, now_ns, waited_s=waited_s
            )
            counts["lost"] += device_noise.meet(self._sabot, self._draws, block, effect, where)
        if not leaves:
            block.stored_ns, block.stores = now_ns, block.stores + 1
        detail = "".join(f" {name}={count}" for name, count in counts.items() if count)
        longest = "" if waits.alike else f" to {waits.longest_s:.9f}"
        return f"after {waits.shortest_s:.9f}{longest} s{detail}"


def _wait_for_free(block: Block, waited_s: float, line: BellAnalyser) -> None:
    """Note how much of a block a fibre would have lost in which it could have waited so long."""
    length_km = waited_s * SPEED_IN_FIBER_M_PER_S / 1e3
    passes = 10 ** (-line.delay_line_db_per_km * length_km / 10)
    lost = 1 - passes * (length_km <= line.delay_line_km)
    block.pulses.approximations |= approximation(FREE_WAIT, lost)


def _time_ns(block: Block, photon: int) -> int:
    return block.start_ns + int(photon * block.interval_ns)


def _waits(block: Block, start_ns: int, interval_ns: float) -> Waits:
    """Return how long the qubits have waited that are wanted from a time on, one by one."""
    if block.came_ns is not None:
        qubits = block.register.size
        waited_ns = np.arange(qubits) * interval_ns + (start_ns - block.came_ns)
        return Waits(0.0, 0.0, qubits, np.asarray(waited_ns / 1e9, np.float64))
    step_s = (interval_ns - block.interval_ns) / 1e9
    return Waits((start_ns - block.start_ns) / 1e9, step_s, block.size)
