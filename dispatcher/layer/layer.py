"""The physical layer as the operations share it: state, place, time and record."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from dispatcher.approximations import EXACT, Approximations
from dispatcher.clock import Clock
from dispatcher.devices.detectors import ClickObserver
from dispatcher.devices.hardware import Devices
from dispatcher.layer import extra_pairs
from dispatcher.layer.compensation import Compensation
from dispatcher.layer.history import History
from dispatcher.layer.journal import Journal, asked_ns
from dispatcher.layer.memory import Memories
from dispatcher.layer.network import Network
from dispatcher.layer.news_delays import NewsDelays
from dispatcher.layer.ownership import MAX_BLOCKS, Block, BlockName, Ownership
from dispatcher.sabot.draws import Draws
from dispatcher.sabot.simulation import Simulation
from wire.dispatcher_pb2 import BlockId, Event, Feedback, HeldBlock
from wire.network_time import REAL_TIME, NetworkTime

FIRST_PHOTONS = 20  # that an event of the first block describes one by one


@dataclass
class PhysicalLayer:
    """Everything there is; touched on the event loop alone."""

    clock: Clock
    sabot: Simulation
    draws: Draws
    network: Network
    ownership: Ownership
    history: History
    devices: Devices
    compensation: Compensation
    memories: Memories
    max_live_qubits: int
    share: int  # of these, for what one node has made
    share_of_blocks: int = MAX_BLOCKS
    photons_lost: int = 0
    photons_lost_waiting: int = 0  # of these, in delay lines of analysers
    drawn_for: dict[str, None] = field(default_factory=dict)  # why weak pulses were drawn whole
    journal: Journal = field(default_factory=Journal)
    time: NetworkTime = REAL_TIME
    news: NewsDelays = field(default_factory=NewsDelays)
    approximations: Approximations = EXACT  # of all that was reported
    observer: ClickObserver | None = None

    def record(
        self,
        node: str,
        kind: str,
        block: Block | None = None,
        port: str = "",
        detail: str = "",
        time_ns: int = 0,
        each: Callable[[int], str] | None = None,
    ) -> None:
        """Record an event; it happened now unless a time of the network is given.

        `each` says of a photon, by its position, what `detail` says of all.
        """
        event = Event(node=node, kind=kind, port=port, detail=detail)
        happened_ns = time_ns or self.clock.now_ns()
        event.time_ns = self.time.wall_ns(happened_ns)
        if block is not None:
            event.block.CopyFrom(block_id(block.name))
            event.photons = block.size
            event.lost = max(0, block.size - block.remaining)
            if each is not None and block.name.number == 0:
                event.first.extend(map(each, range(min(FIRST_PHOTONS, block.size))))
        self.history.record(event)
        if block is not None and (limit := self.history.photons_wanted):
            self.history.record_photons(_photons(event, block, limit, each))

    def feedback(self, block: Block, *others: Block) -> Feedback:
        """Return the feedback that is common to all operations on a block, with others if any."""
        feedback = Feedback(
            time_ns=self.clock.now_ns(),
            photons=block.size,
            first_ns=block.first_ns,
            last_ns=block.last_ns,
        )
        return self.mark(feedback, (block, *others))

    def mark(self, feedback: Feedback, blocks: Sequence[Block]) -> Feedback:
        """Say in the feedback what simulates the blocks, and whether that is exact."""
        registers = [block.register for block in blocks if block.weak is None]
        feedback.backend = self.sabot.simulated_by(*registers)
        feedback.exact = self.count_exact(blocks)
        return feedback

    def count_exact(self, blocks: Sequence[Block]) -> bool:
        """Return whether the blocks hold no approximation, which is then in what is reported."""
        for block in blocks:
            self.approximations |= block.pulses.approximations
        return all(block.pulses.exact for block in blocks)

    @property
    def exact(self) -> bool:
        return not self.approximations

    def take_up(self, *blocks: Block, made: bool = False) -> None:
        """Let blocks that are to be used have waited until their host has asked for it.

        `made`: light that has been nowhere yet is made only now.
        """
        for block in blocks:
            if self.memories.holds(block):
                self.recall(block)
            elif not (made and block.is_new):
                self._hold(block)

    def waits(self, block: Block) -> str | None:
        """Return which memory a block has waited in until it is used; None: in none."""
        waited = self.memories.holds(block) or self.memories.has_waited(block, asked_ns())
        return f"the memory of {block.node}" if waited else None

    def take_up_pair(self, first: Block, second: Block) -> None:
        """The same of blocks whose photons pair up: what waits does so for light that comes later.

        That sources have emitted together, and no memory has kept, meets by a delay line.
        """
        pairs = (first, second), (second, first)
        for block, other in pairs:
            if not self.memories.holds(block):
                waits = other.retimed and not block.retimed and not self.memories.holds(other)
                self._hold(block, other if waits and other.interval_ns else None)
        for block, other in pairs:
            if self.memories.holds(block):
                comes = other.interval_ns and not self.memories.holds(other)
                self.recall(block, other if comes else None)

    def _hold(self, block: Block, light: Block | None = None) -> None:
        before = block.register.remaining
        self._report(block, before, self.memories.hold(block, asked_ns(), light))

    def recall(self, block: Block, light: Block | None = None, interval_ns: float = 0.0) -> None:
        """Take a block out of its node's memory, if it is in there; light: that it waited for.

        Without light, qubits come out one after the other, by an interval.
        """
        before = block.register.remaining
        self._report(block, before, self.memories.read_out(block, light, interval_ns))

    def _report(self, block: Block, before: int, detail: str | None) -> None:
        if detail is not None:
            self.photons_lost += before - block.register.remaining
            self.record(block.node, "recall", block, detail=detail)

    def held(self, block: Block) -> HeldBlock:
        return HeldBlock(
            block=block_id(block.name),
            port=block.port,
            photons=block.remaining,
            stored=self.memories.holds(block),
        )

    def drop(self, block: Block) -> None:
        self.memories.forget(block)
        if block.weak is None:
            purpose = block.draws_for("discard")
            draws = self.draws.photons(block.name, purpose, block.register.size)
            self.sabot.drop(block.register, draws)
            extra_pairs.drop(self.sabot, block, self.draws)
        self.ownership.remove(block)


def _photons(
    event: Event, block: Block, limit: int, each: Callable[[int], str] | None
) -> list[Event]:
    """Return the event once for each of the first photons of its block."""
    events = []
    for position, present in enumerate(block.register.present[:limit].tolist()):
        photon = Event()
        photon.CopyFrom(event)
        del photon.first[:]
        photon.photon, photon.photons, photon.lost = position + 1, 1, int(not present)
        photon.detail = each(position) if each is not None else ""
        events.append(photon)
    return events


def block_id(name: BlockName) -> BlockId:
    return BlockId(session=name.session, number=name.number, half=name.half)


def block_name(block: BlockId) -> BlockName:
    return BlockName(block.session, block.number, block.half)


def tally(values: np.ndarray[tuple[int], np.dtype[np.uint8]], names: tuple[str, ...]) -> str:
    counts = (int(np.count_nonzero(values == value)) for value in range(len(names)))
    return " ".join(f"{name}={count}" for name, count in zip(names, counts, strict=True) if count)
