"""Stations in quantum switches: analysers to whose inputs light of memories that emit is led.

    alice, attempting --- 2 -> 60001 ---.
                                         station --- heralds ---> agent
    memory of q2 -------- 3 -> 60002 ---'

Light has no header: the first that attempts by one input does so with the first by the other, for
as many pairs as either wants, and for one block at a time. It waits for that as light does.
"""

import asyncio
from collections import deque
from collections.abc import Collection
from dataclasses import dataclass

from dispatcher.devices import hardware
from dispatcher.layer.layer import PhysicalLayer
from dispatcher.operations import limits
from dispatcher.operations.analysers import Reports, Tasks
from dispatcher.operations.heralded_link import Offer
from dispatcher.operations.heralding import Heralding
from dispatcher.operations.station_path import find_path
from dispatcher.refusal import Refusal, exhausted, not_found, precondition
from dispatcher.sabot.limits import require_count
from dispatcher.timeouts import ANALYSER_WAIT_S, FIRST_HERALD_S, HERALD_BLOCK_S, MAX_HERALD_S
from wire.config import FiberEnd
from wire.dispatcher_pb2 import (
    AttemptRequest,
    BellOutcomes,
    BlockId,
    EmitRequest,
    Feedback,
)
from wire.features import INTERFERE
from wire.optical import DEFAULT_FREQUENCY_MHZ
from wire.parameters.switch import Kind

MAX_WAITING = 10_000


@dataclass(eq=False)
class Attempts:
    """A memory that attempts to emit to one input of a station."""

    offer: Offer
    count: int  # pairs wanted
    limit_s: float  # that the station attempts
    limit: asyncio.Task[None] | None = None


class Stations:
    def __init__(
        self, layer: PhysicalLayer, heralding: Heralding, reports: Reports, tasks: Tasks
    ) -> None:
        self._layer, self._heralding = layer, heralding
        self._reports, self._begin = reports, tasks.begin
        self._waiting: dict[tuple[str, str], deque[Attempts]] = {}  # by node and port
        self._busy: dict[str, asyncio.Task[None]] = {}  # by the station's node

    async def attempt(self, node: str, request: AttemptRequest) -> Feedback:
        """Let qubits of a node attempt to emit to a station."""
        layer = self._layer
        require_count(request.count)
        limit_s = limits.timeout(request.timeout_s or HERALD_BLOCK_S, MAX_HERALD_S)
        try:
            end = self._station(node, request)
        except Refusal:
            await layer.clock.wait_until(layer.clock.now_ns() + layer.news.farthest_ns(node))
            raise
        if sum(map(len, self._waiting.values())) >= MAX_WAITING:
            raise exhausted(f"{MAX_WAITING} blocks are attempted at once; discard some sessions")
        offer = self._heralding.offer(node, request)
        self._add(end, Attempts(offer, request.count, limit_s))
        return Feedback(time_ns=layer.clock.now_ns())

    async def emit(self, request: EmitRequest) -> None:
        """Let qubits in the memory of a switch attempt."""
        require_count(request.count)
        layer, port = self._layer, str(request.port)
        emitters = (
            node
            for node, part in layer.network.parts[Kind.EMITTER].items()
            if part.switch == request.switch and port in part.ports
        )
        node = next(emitters, "")
        if not node:
            raise not_found(f"port {port} of {request.switch} is of no memory that emits")
        switch = layer.network.switches[request.switch]
        if request.port in switch.failed:
            raise precondition(f"the memory of port {port} of {request.switch} has failed")
        attempt = AttemptRequest(
            block=BlockId(session=request.session, number=request.number),
            port=port,
            frequency_mhz=request.frequency_mhz,
            cutoff_s=switch.cutoffs_s.get(int(layer.network.memories[node].ports[0])),
            count=request.count,
        )
        await self.attempt(node, attempt)

    def forget(self, node: str, session: int) -> None:
        for queue in self._waiting.values():
            for request in list(queue):
                if (request.offer.end.node, request.offer.name.session) == (node, session):
                    self._take(queue, request)

    def close(self, switch: str, connected: set[int]) -> None:
        """End attempts at inputs to which no connection of the switch leads any more."""
        for node, part in self._layer.network.analysers.items():
            closed = [port for port in part.ports if int(port) not in connected]
            if part.switch == switch and closed:
                self._end(node, closed, BellOutcomes.CLOSED)

    def fail(self, node: str) -> None:
        if part := self._layer.network.analysers.get(node):
            self._end(node, part.ports, BellOutcomes.FAILED)

    def _station(self, node: str, request: AttemptRequest) -> FiberEnd:
        """Return the input to which light of an attempt comes; refuse what is none of a station."""
        layer, start = self._layer, FiberEnd(node, request.port)
        end = find_path(layer, start, request.frequency_mhz or DEFAULT_FREQUENCY_MHZ).end
        part = layer.network.analysers.get(end.node)
        if part is None:
            raise precondition(f"light of {node} comes to {end.node}: lead it to a station")
        hardware.require(layer.devices, end.node, INTERFERE)
        if int(end.port) in layer.network.switches[part.switch].failed:
            raise precondition(f"the station of port {end.port} of {part.switch} has failed")
        return end

    def _add(self, end: FiberEnd, attempts: Attempts) -> None:
        queue, other = self._queues(end.node, end.port)
        queue.append(attempts)
        attempts.limit = self._begin(self._expire(end, attempts))
        if len(queue) > len(other):
            self._report(end.node, BellOutcomes.WAITS, attempts.count)
        self._meet(end.node)

    def _queues(self, node: str, port: str) -> list[deque[Attempts]]:
        """Return those who attempt by an input, and by the other one."""
        ports = sorted(self._layer.network.analysers[node].ports, key=lambda each: each != port)
        return [self._waiting.setdefault((node, each), deque()) for each in ports]

    def _meet(self, node: str) -> None:
        """Begin with the first that attempt by either input, if the station is free."""
        ports = self._layer.network.analysers[node].ports
        queues = self._queues(node, ports[0])
        if node not in self._busy and all(queues):
            pair = [self._take(queue, queue[0]) for queue in queues]
            self._busy[node] = self._begin(self._herald(node, pair))

    def _take(self, queue: deque[Attempts], attempts: Attempts) -> Attempts:
        queue.remove(attempts)
        if attempts.limit is not None and attempts.limit is not asyncio.current_task():
            attempts.limit.cancel()
        return attempts

    async def _expire(self, end: FiberEnd, attempts: Attempts) -> None:
        clock, waits = self._layer.clock, True
        while waits:
            await clock.wait_until(clock.now_ns() + int(ANALYSER_WAIT_S * 1e9))
            waits = end.node in self._busy
        self._end_alone(end.node, end.port, attempts, BellOutcomes.NO_PARTNER)

    def _end(self, node: str, ports: Collection[str], end: "BellOutcomes.End") -> None:
        for port in ports:
            for attempts in list(self._waiting.get((node, port), ())):
                self._end_alone(node, port, attempts, end)
        if task := self._busy.pop(node, None):
            task.cancel()
            self._report(node, end, 1)

    def _end_alone(self, node: str, port: str, attempts: Attempts, end: "BellOutcomes.End") -> None:
        self._take(self._waiting[node, port], attempts)
        self._report(node, end, attempts.count)

    def _report(self, node: str, end: "BellOutcomes.End", count: int) -> None:
        self._reports.add(node, BellOutcomes(end=end, photons=count))

    async def _herald(self, node: str, pair: list[Attempts]) -> None:
        """Herald pairs of two memories, and report them; then go on with the next."""
        offers, count = (pair[0].offer, pair[1].offer), min(each.count for each in pair)
        ports = self._layer.network.analysers[node].ports
        try:
            limits_s = max(each.limit_s for each in pair), FIRST_HERALD_S
            report = await self._heralding.between(node, offers, ports, count, limits_s)
        except Refusal as refusal:
            self._layer.record(node, "refuse", detail=str(refusal))
            self._report(node, BellOutcomes.UNFIT, count)
        else:
            self._reports.add(node, report)
        del self._busy[node]
        self._meet(node)
