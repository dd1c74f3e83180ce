"""Bell analysers of quantum switches: the light of two inner ports meets there, block by block.

    alice --- 2 -> 60001 ---.
                             analyser --- outcomes ---> agent
    bob ----- 3 -> 60002 ---'

Light has no header: the first block that has come to one input meets the first that has come to
the other, pulse by pulse. It waits for that as at a host (Measurements), ANALYSER_WAIT_S at most.
Every block that comes ends here, and its end is reported.
"""

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from dispatcher.layer.journal import CausedBy
from dispatcher.layer.layer import PhysicalLayer, block_id
from dispatcher.layer.network import Network, Part
from dispatcher.layer.ownership import Block, BlockName
from dispatcher.operations.imperfections import over
from dispatcher.operations.measurements import Measurements
from dispatcher.refusal import Refusal
from dispatcher.timeouts import ANALYSER_WAIT_S
from wire.analyser_frames import AnalyserCounts, End
from wire.dispatcher_pb2 import (
    BellMeasureRequest,
    BellOutcomes,
    Feedback,
    SwitchStatisticsReply,
)
from wire.outcomes import NO_CLICK
from wire.parameters.physics import BEAM_SPLITTER

MOST_REPORTS = 1000  # that an agent has not read yet; beyond, the oldest are lost
INDISTINGUISHABLE = (0, 2)  # by linear optics


class Reports:
    """How light ends in the parts of switches, for their agents; counts of analysers."""

    def __init__(self, network: Network) -> None:
        self._parts = {**network.analysers, **network.memories}
        self._numbers = dict.fromkeys(self._parts, 0)
        self._counts = {
            node: AnalyserCounts(int(part.ports[0])) for node, part in network.analysers.items()
        }
        self._queues: dict[str, set[asyncio.Queue[BellOutcomes]]] = {}  # by switch

    @contextmanager
    def watching(self, switch: str) -> Iterator[AsyncIterator[BellOutcomes]]:
        """Give the reports of a switch's parts from now on."""
        reports = asyncio.Queue[BellOutcomes](MOST_REPORTS)
        watchers = self._queues.setdefault(switch, set())
        watchers.add(reports)
        try:
            yield _each(reports)
        finally:
            watchers.remove(reports)

    def add(self, node: str, report: BellOutcomes, block: int = 0) -> None:
        """Number a report of a part, and queue it for the agent, if that watches.

        `block`: the number of an earlier report on the same block, which this has, too.
        """
        part, number = self._parts[node], self._numbers[node] + 1
        report.port, report.number = int(part.ports[0]), block or number
        if not block and report.end != BellOutcomes.WAITS:  # whose report is to come
            self._numbers[node] = number
        if node in self._counts:
            self._counts[node].add(End(report.end), report.outcomes, report.attempts)
        for reports in self._queues.get(part.switch, ()):
            if reports.full():
                reports.get_nowait()
            reports.put_nowait(report)

    def counts(self, switch: str) -> Iterator[SwitchStatisticsReply.Analyser]:
        for node, counts in self._counts.items():
            if self._parts[node].switch == switch:
                yield SwitchStatisticsReply.Analyser(**vars(counts))


class Tasks:
    def __init__(self, layer: PhysicalLayer, failed: Callable[[BaseException], None]) -> None:
        """Call `failed` with what ends a task unexpectedly."""
        self._layer, self._failed = layer, failed
        self._tasks: set[asyncio.Task[None]] = set()

    def begin(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        task = asyncio.create_task(work)
        self._layer.journal.begun(task)
        self._tasks.add(task)
        task.add_done_callback(self._ended)
        return task

    def _ended(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            self._failed(error)


class Analysers:
    def __init__(
        self,
        layer: PhysicalLayer,
        measurements: Measurements,
        reports: Reports,
        tasks: Tasks,
    ) -> None:
        self._layer, self._measurements, self._begin = layer, measurements, tasks.begin
        self._reports = reports
        self._waiting: dict[tuple[str, str], deque[Block]] = {}  # by node and port
        self._limits: dict[Block, asyncio.Task[None]] = {}

    def look(self, name: BlockName) -> None:
        """Take light of a block that waits at an input, if the rest of it does not fly."""
        ownership, analysers = self._layer.ownership, self._layer.network.analysers
        for block in ownership.parts(name) if analysers else ():
            is_new = block.node in analysers and block not in self._limits
            if is_new and not ownership.rest_flies(block):
                self._take(block, analysers[block.node])

    def close(self, switch: str, connected: set[int]) -> None:
        """End the wait of light at inputs to which no connection of the switch leads any more."""
        for (node, port), blocks in list(self._waiting.items()):
            if self._layer.network.analysers[node].switch == switch and int(port) not in connected:
                for block in list(blocks):
                    self._end_alone(block, BellOutcomes.CLOSED)

    def waits(self, node: str, port: str) -> bool:
        """Tell whether light waits at an input of an analyser."""
        return (node, port) in self._waiting

    def report_nothing(self, node: str) -> None:
        """Report the meeting of two blocks of which one had no pulse left."""
        self._reports.add(node, BellOutcomes(end=BellOutcomes.MEASURED))

    def fail(self, node: str) -> None:
        for (place, _port), blocks in list(self._waiting.items()):
            for block in list(blocks) if place == node else ():
                self._end_alone(block, BellOutcomes.FAILED)

    def _take(self, block: Block, inputs: Part) -> None:
        if int(block.port) in self._layer.network.switches[inputs.switch].failed:
            self._discard(BellOutcomes.FAILED, block)
            return
        (other,) = (port for port in inputs.ports if port != block.port)
        if partners := self._waiting.get((block.node, other)):
            partner = partners[0]
            self._end_wait(partner)
            pair = (block, partner) if block.port == inputs.ports[0] else (partner, block)
            self._meet(*pair)
            return
        self._waiting.setdefault((block.node, block.port), deque()).append(block)
        self._limits[block] = self._begin(self._expire(block))

    async def _expire(self, block: Block) -> None:
        await self._layer.clock.wait_until(block.last_ns + int(ANALYSER_WAIT_S * 1e9))
        self._end_alone(block, BellOutcomes.NO_PARTNER)

    def _end_wait(self, block: Block) -> None:
        place = block.node, block.port
        self._waiting[place].remove(block)
        if not self._waiting[place]:
            del self._waiting[place]
        limit = self._limits.pop(block)
        if limit is not asyncio.current_task():
            limit.cancel()

    def _end_alone(self, block: Block, end: "BellOutcomes.End") -> None:
        """Discard light that nothing will meet."""
        self._end_wait(block)
        self._discard(end, block)

    def _discard(self, end: "BellOutcomes.End", *blocks: Block) -> None:
        layer, node = self._layer, blocks[0].node
        for block in blocks:
            name = BellOutcomes.End.Name(end).lower().replace("_", " ")
            layer.record(node, "discard", block, block.port, name)
            layer.drop(block)
        self._reports.add(node, BellOutcomes(end=end, photons=blocks[0].size))

    def _meet(self, first: Block, second: Block) -> None:
        """Bell-measure the light of two inputs; what does not fit together is discarded."""
        layer, node = self._layer, first.node
        request = BellMeasureRequest(first=block_id(first.name), second=block_id(second.name))
        try:
            with CausedBy(node, "bell_measure", request):
                feedback = self._measurements.bell_measure_blocks(node, first, second)
        except Refusal as refusal:
            layer.record(node, "refuse", first, first.port, str(refusal))
            self._discard(BellOutcomes.UNFIT, first, second)
            return
        waited_ns = (first.waited_ns + second.waited_ns) // 2
        outcomes = np.frombuffer(feedback.outcomes, np.uint8).copy()
        if layer.devices.of(node).analyser.kind in ("linear", BEAM_SPLITTER):
            outcomes[np.isin(outcomes, INDISTINGUISHABLE)] = NO_CLICK
        report = BellOutcomes(
            end=BellOutcomes.MEASURED,
            photons=len(outcomes),
            outcomes=outcomes.tobytes(),
            waited_ns=waited_ns,
        )
        self._begin(self._measured(node, feedback, report))

    async def _measured(self, node: str, feedback: Feedback, report: BellOutcomes) -> None:
        await over(self._layer, node, feedback)
        self._reports.add(node, report)


async def _each(reports: asyncio.Queue[BellOutcomes]) -> AsyncIterator[BellOutcomes]:
    while True:
        yield await reports.get()
