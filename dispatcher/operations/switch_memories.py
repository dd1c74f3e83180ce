"""Quantum memories of switches: light that is led to their inner ports waits there, block by block.

    fibre --- 2 -> 61001 --- memory --- 61001 -> 60001 ---.
                                                           analyser
    fibre --- 3 -> 61002 --- memory --- 61002 -> 60002 ---'

A block is stored when all of it has come. The first that came leaves first, as its pulses came one
after the other. It leaves when a cross-connect leads on: to an analyser only when its partner is
at the other input, or in a memory that leads to it; to anything else at once.

Of two blocks whose pulses a controller has named (`keep`) the i-th that is held of one meets the
i-th that is held of the other, as many as the poorer has; the others are discarded. A memory of
which a block was named keeps later ones until they are named, too, as long as light is led in.
Before, a controller may have a block purified round by round; each round is reported.
"""

import asyncio
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from dispatcher.layer import cutoff, extra_pairs
from dispatcher.layer.layer import PhysicalLayer
from dispatcher.layer.ownership import Block, BlockName
from dispatcher.operations import weak_light
from dispatcher.operations.analysers import Analysers, Reports, Tasks
from dispatcher.operations.gathering import Gathering
from dispatcher.operations.imperfections import over
from dispatcher.operations.purification import Purification
from dispatcher.operations.transport import Transport
from dispatcher.refusal import Refusal, invalid, not_found
from dispatcher.sabot.backend import Bytes
from dispatcher.sabot.dense import TooLarge
from dispatcher.timeouts import FIRST_HERALD_S, MEMORY_WAIT_S
from wire.analyser_frames import METHODS, SYMBOLS
from wire.dispatcher_pb2 import (
    BellOutcomes,
    Feedback,
    KeepReply,
    KeepRequest,
    SwitchStatisticsReply,
)
from wire.outcomes import NO_CLICK
from wire.parameters.switch import HALVES, Kind


class SwitchMemories:
    def __init__(
        self,
        layer: PhysicalLayer,
        transport: Transport,
        analysers: Analysers,
        reports: Reports,
        purification: Purification,
        tasks: Tasks,
    ) -> None:
        self._layer, self._transport, self._begin = layer, transport, tasks.begin
        self._analysers, self._reports = analysers, reports
        self._purification = purification
        memories, inputs = layer.network.memories, layer.network.analysers
        self._held = {node: deque[Block]() for node in memories}
        self._gathering = Gathering(layer)
        self._limits: dict[Block, asyncio.Task[None]] = {}
        self._numbers: dict[Block, int] = {}  # of the reports that they are held
        self._named: set[Block] = set()  # whose pulses a controller has named
        self._by_name: set[str] = set()  # memories that blocks leave only when they are named
        self._leads: dict[str, dict[int, int]] = {}  # outputs by input, of each switch
        self._sending: set[str] = set()  # memories whose light is on its way
        self._counts = {node: Counter[str]() for node in memories}
        # By switch and port of an input: the analyser's node, and its other input.
        self._partners = {
            (part.switch, int(port)): (node, other)
            for node, part in inputs.items()
            for port, other in zip(part.ports, reversed(part.ports), strict=True)
        }

    def look(self, name: BlockName) -> None:
        """Store light of a block that has come to a memory, and send on what can leave now."""
        ownership, memories = self._layer.ownership, self._layer.network.memories
        for block in ownership.parts(name) if memories else ():
            is_new = block.node in memories and block not in self._limits
            if is_new and not ownership.rest_flies(block):
                self._store(block)
        for switch in {part.switch for part in memories.values()}:
            self.release(switch)

    def close(self, switch: str) -> None:
        """Forget the cross-connects of a switch that have ended."""
        now = self._layer.network.switches[switch].timeline.connections
        leads = self._leads.get(switch, {})
        self._leads[switch] = {i: o for i, o in leads.items() if now.get(i) == o}
        network = self._layer.network
        lit, emitters = {str(port) for port in (*now, *now.values())}, network.parts[Kind.EMITTER]
        dark = {
            node
            for node, part in network.memories.items()
            if part.switch == switch and lit.isdisjoint(emitters.get(node, part).ports)
        }
        self._by_name -= dark
        for node in sorted(dark & emitters.keys()):  # nobody is left to release it
            self._end(node, BellOutcomes.CLOSED, "cut_off")

    def opened(self, switch: str, ready_ns: int) -> None:
        """Lead light on by the cross-connects of a switch that are open, which is now."""
        timeline = self._layer.network.switches[switch].timeline
        self._leads[switch] = timeline.open_outputs(ready_ns)
        self.release(switch)

    def release(self, switch: str) -> None:
        """Send on what the cross-connects of a switch lead on, as long as there is any."""
        while leaving := self._leaving(switch):
            for nodes in self._meeting(switch, leaving):
                sizes = [self._held[node][0].register.remaining for node in nodes]
                named = len(nodes) > 1 and all(self._held[n][0] in self._named for n in nodes)
                for node in nodes:
                    self._send(node, min(sizes) if named else None)
                if named and not min(sizes):
                    self._analysers.report_nothing(self._partner_of(switch, nodes[0])[0])

    def keep(self, _node: str, request: KeepRequest) -> KeepReply:
        """Discard pulses of a block that are not to leave, or have it purified."""
        if request.method not in (0, *METHODS) or request.outcomes.translate(None, SYMBOLS):
            raise invalid(f"method {request.method} or an outcome of it is none: see KeepRequest")
        blocks = (
            block
            for node, part in self._layer.network.memories.items()
            if part.switch == request.switch and str(request.port) in part.ports
            for block in self._held[node]
            if self._numbers[block] == request.number
        )
        block = next(blocks, None)
        named = np.frombuffer(request.outcomes, np.uint8)
        if block is None or named.size != block.register.size:
            raise not_found(
                f"no {named.size} pulses of number {request.number} are in the "
                f"memory at port {request.port} of {request.switch}"
            )
        if request.method:
            self._purify(block, named, request.method)
            return KeepReply()
        unwanted = named != 0
        extra_pairs.darken(self._layer.sabot, block, unwanted)
        dropped = self._layer.sabot.lose(block.register, unwanted)
        self._layer.record(block.node, "keep", block, block.port, f"dropped={dropped}")
        self._by_name.add(block.node)
        self._named.add(block)
        self.release(request.switch)
        return KeepReply()

    def _purify(self, block: Block, order: Bytes, method: int) -> None:
        waited_ns = self._layer.clock.now_ns() - cutoff.came_ns(block)
        port, interval_ns, cutoff_s = block.port, block.interval_ns, block.cutoff_s
        try:
            left, bits, feedback = self._purification.round(block, order, method)
        except (Refusal, TooLarge):
            if not block.port:  # the round has begun
                self._give_up(block, port)
            raise
        self._layer.memories.store(left, cutoff_s)
        left.port, left.interval_ns = port, interval_ns
        left.came_ns = np.full(left.register.size, left.start_ns)
        left.waited_ns = block.waited_ns + round(waited_ns.mean())
        self._replace(block, left)
        outcomes = np.where(left.register.present, bits, NO_CLICK).astype(np.uint8)
        self._begin(self._purified(left, outcomes.tobytes(), feedback))

    def _give_up(self, block: Block, port: str) -> None:
        """Discard the parts of a block of which a round has failed."""
        name, block.port = block.name, port
        parts = [
            part
            for part in self._layer.ownership.of_session(block.node, name.session)
            if (part.name.number, part.name.half % HALVES) == (name.number, name.half % HALVES)
        ]
        self._take(block)
        self._discard(block, BellOutcomes.UNFIT, "refused", parts)

    def _replace(self, block: Block, left: Block) -> None:
        held = self._held[block.node]
        held[held.index(block)] = left
        self._numbers[left] = self._numbers.pop(block)
        self._limits.pop(block).cancel()
        self._limits[left] = self._begin(self._expire(left))
        self._by_name.add(left.node)

    async def _purified(self, block: Block, bits: bytes, feedback: Feedback) -> None:
        """Report a round when it is over."""
        await over(self._layer, block.node, feedback)
        if block in self._numbers:
            report = BellOutcomes(end=BellOutcomes.PURIFIED, photons=len(bits), outcomes=bits)
            self._reports.add(block.node, report, self._numbers[block])

    def fail(self, node: str) -> None:
        self._end(node, BellOutcomes.FAILED, "refused")

    def _end(self, node: str, end: "BellOutcomes.End", count: str) -> None:
        for block in list(self._held.get(node, ())):
            self._take(block)
            self._discard(block, end, count)

    def states(self, switch: str) -> Iterator[SwitchStatisticsReply.Memory]:
        for node, part in self._layer.network.memories.items():
            if part.switch == switch:
                held = [block for block in self._held[node] if block.register.remaining]
                yield SwitchStatisticsReply.Memory(
                    port=int(part.ports[0]),
                    held=sum(block.register.remaining for block in held),
                    oldest_ns=held[0].first_ns if held else 0,
                    **self._counts[node],
                )

    def _store(self, block: Block) -> None:
        layer, node = self._layer, block.node
        switch = layer.network.switches[layer.network.memories[node].switch]
        if int(block.port) in switch.failed:
            self._discard(block, BellOutcomes.FAILED, "refused")
            return
        try:
            weak_light.draw(layer, f"the memory {node}", block)
            _wrong, old = layer.memories.store(block, switch.cutoffs_s.get(int(block.port)))
        except Refusal as refusal:
            layer.record(node, "refuse", block, block.port, str(refusal))
            self._discard(block, BellOutcomes.UNFIT, "refused")
            return
        self._counts[node]["stored"] += block.register.remaining + old
        self._counts[node]["cut_off"] += old
        layer.record(node, "store", block, block.port)
        held = np.where(block.register.present, 0, NO_CLICK).astype(np.uint8)
        report = BellOutcomes(end=BellOutcomes.STORED, photons=held.size, outcomes=held.tobytes())
        self._reports.add(node, report)
        self._numbers[block] = report.number
        self._held[node].append(block)
        self._limits[block] = self._begin(self._expire(block))

    async def _expire(self, block: Block) -> None:
        """Drop what is too old, whose block leaves in its turn, and end the wait of the block."""
        clock = self._layer.clock
        emits = block.node in self._layer.network.parts[Kind.EMITTER]
        longest_s = MEMORY_WAIT_S + FIRST_HERALD_S * emits
        if block.cutoff_s < longest_s:
            await clock.wait_until(block.last_ns + int(block.cutoff_s * 1e9))
            self._drop_old(block)
        await clock.wait_until(block.last_ns + int(longest_s * 1e9))
        self._take(block)
        self._discard(block, BellOutcomes.CUT_OFF, "cut_off")

    def _drop_old(self, block: Block) -> None:
        every = np.ones(block.register.size, bool)
        extra_pairs.darken(self._layer.sabot, block, every)
        dropped = self._layer.sabot.lose(block.register, every)
        self._counts[block.node]["cut_off"] += dropped
        self._layer.record(block.node, "expire", block, block.port, f"dropped={dropped}")

    def _leaving(self, switch: str) -> list[str]:
        """Return the memories whose first block can leave now."""
        network, leads = self._layer.network, self._leads.get(switch, {})
        ready = {
            leads[int(part.ports[0])]: node
            for node, part in network.memories.items()
            if part.switch == switch and self._held[node] and node not in self._sending
            if int(part.ports[0]) in leads
            if node not in self._by_name or self._held[node][0] in self._named
        }
        return [node for output, node in ready.items() if self._may_leave(switch, output, ready)]

    def _meeting(self, switch: str, leaving: list[str]) -> list[list[str]]:
        """Return the memories that light leaves, those together whose light meets."""
        together: dict[str, list[str]] = {}
        for node in leaving:
            together.setdefault(self._partner_of(switch, node)[0] or node, []).append(node)
        return list(together.values())

    def _partner_of(self, switch: str, node: str) -> tuple[str, str]:
        """Return the analyser that a memory leads to, and its other input; empty: to none."""
        output = self._leads[switch][int(self._layer.network.memories[node].ports[0])]
        return self._partners.get((switch, output), ("", ""))

    def _may_leave(self, switch: str, output: int, ready: dict[int, str]) -> bool:
        if (switch, output) not in self._partners:
            return True
        analyser, other = self._partners[switch, output]
        return int(other) in ready or self._analysers.waits(analyser, other)

    def _send(self, node: str, most: int | None) -> None:
        """Send the first block of a memory, its first pulses that are held or all as they came."""
        block = self._held[node][0]
        self._take(block)
        if most == 0:
            self._layer.drop(block)
            return
        if most is not None and most < block.register.size:
            block = self._gathering.fill_gaps(block, most)
        photons, port = block.register.remaining, block.port
        steps_ns = np.arange(block.register.size) * block.interval_ns
        waits_ns = self._layer.clock.now_ns() - cutoff.came_ns(block) + steps_ns
        block.waited_ns += round(waits_ns[block.register.present].mean()) if photons else 0
        try:
            self._transport.release(block, port, partial(self._sent, node))
        except TooLarge as error:
            self._layer.record(node, "refuse", block, port, str(error))
            self._discard(block, BellOutcomes.UNFIT, "refused")
            return
        self._sending.add(node)
        self._counts[node]["released"] += photons

    def _sent(self, node: str) -> None:
        self._sending.discard(node)
        self.release(self._layer.network.memories[node].switch)

    def _take(self, block: Block) -> None:
        self._held[block.node].remove(block)
        self._named.discard(block)
        del self._numbers[block]
        limit = self._limits.pop(block)
        if limit is not asyncio.current_task():
            limit.cancel()

    def _discard(
        self, block: Block, end: "BellOutcomes.End", count: str, parts: Sequence[Block] = ()
    ) -> None:
        """Discard a block, or the parts in which it is now, and report its end."""
        layer, node = self._layer, block.node
        name = BellOutcomes.End.Name(end).lower().replace("_", " ")
        report = BellOutcomes(end=end, photons=block.size)
        for part in parts or (block,):
            self._counts[node][count] += part.remaining
            layer.record(node, "discard", part, block.port, name)
            layer.drop(part)
        self._reports.add(node, report)
