"""Light on its way: launching blocks and receiving them."""

import asyncio
from collections.abc import Callable

import grpc

from dispatcher.approximations import UNLIKE_LIGHT, approximation
from dispatcher.devices import hardware
from dispatcher.fiber.noise import Pattern
from dispatcher.layer import cutoff, drift, extra_pairs, pulses
from dispatcher.layer.layer import PhysicalLayer, block_name
from dispatcher.layer.ownership import Block, BlockName
from dispatcher.operations import limits, weak_light
from dispatcher.operations.flight import Arrival, Departure, Flight
from dispatcher.refusal import Refusal, invalid
from wire.config import FiberEnd
from wire.dispatcher_pb2 import Feedback, ReceiveRequest, SendRequest
from wire.features import EMIT
from wire.optical import DEFAULT_FREQUENCY_MHZ
from wire.outcomes import ERRORS


class Transport:
    def __init__(
        self,
        layer: PhysicalLayer,
        failed: Callable[[BaseException], None],
        came: Callable[[BlockName], None],
    ) -> None:
        """Move blocks of this layer; call `failed` with what ends a flight unexpectedly.

        `came` is called when light of a block has come somewhere, or comes no more.
        """
        self._layer, self._came = layer, came
        self._failed = failed
        self._flights: dict[asyncio.Task[None], Flight] = {}
        self._waiting: dict[BlockName, list[asyncio.Future[None]]] = {}

    async def send(self, node: str, request: SendRequest) -> Feedback:
        """Launch blocks together; return when the last photon has left.

        The reply is about the light as it leaves, not about what becomes of it.
        """
        feedback = self.launch(node, request)
        # A caller that goes away cancels this wait; its photons fly on.
        await self._layer.clock.wait_until(feedback.last_ns)
        feedback.time_ns = self._layer.clock.now_ns()
        return feedback

    def launch(self, node: str, request: SendRequest) -> Feedback:
        """Launch blocks together; return when they will have left."""
        layer, rate_hz = self._layer, request.rate_hz
        launches = [(block_name(launch.block), launch.port) for launch in request.launches]
        frequency_mhz = request.frequency_mhz or DEFAULT_FREQUENCY_MHZ
        if not launches:
            raise invalid("no launches; name at least one block and its port")
        if len({name for name, _port in launches}) < len(launches):
            raise invalid("a block is launched twice; name each block once")
        blocks = [layer.ownership.require(name, node) for name, _port in launches]
        ends = [layer.network.require_port(node, port) for _name, port in launches]
        sizes = [block.size for block in blocks]
        limits.require_rate(rate_hz, max(sizes))
        for block in blocks:
            limits.require_source_rate(block, rate_hz)
        if not all(block.fibers_passed for block in blocks):  # light that begins here
            hardware.require(layer.devices, node, EMIT)
        for block, end in zip(blocks, ends, strict=True):
            weak_light.prepare(layer, block, end, frequency_mhz)
        layer.take_up(*blocks, made=True)
        start_ns = layer.clock.now_ns()
        # Halves of a block share a pattern, whose times are computed once.
        patterns = {size: Pattern(1e9 / rate_hz, size) for size in set(sizes)}
        departures = [Departure(start_ns, patterns[size], frequency_mhz) for size in sizes]
        feedback = Feedback(
            photons=sum(departure.pattern.photons for departure in departures),
            first_ns=start_ns,
            last_ns=max(departure.last_ns for departure in departures),
        )
        layer.mark(feedback, blocks)
        for path in zip(blocks, ends, departures, strict=True):
            self._launch(*path)
        return feedback

    async def receive(self, node: str, request: ReceiveRequest) -> Feedback:
        """Wait for a block at a port of the node until all has come, and take it from there."""
        layer, name, port = self._layer, block_name(request.block), request.port
        layer.network.require_port(node, port)
        limit_s = limits.timeout(request.timeout_s)
        block = self._whole(name, node, port)
        if block is None:
            try:
                async with layer.journal.timeout(limit_s):
                    block = await self._arrived(name, node, port)
            except TimeoutError:
                block = self._whole(name, node, port)  # a busy program may see it late
                if block is None:
                    message = f"{name} did not arrive at {port} of {node} within {limit_s:g} s"
                    raise Refusal(grpc.StatusCode.DEADLINE_EXCEEDED, message) from None
                await layer.journal.resumed()
        feedback = layer.feedback(block)
        self._bring(block, node, "")
        layer.record(node, "receive", block, port=port)
        return feedback

    def release(self, block: Block, port: str, over: Callable[[], None]) -> None:
        """Send a block out of its node's memory as it came; call `over` when it has landed.

        That is of the stretch in which it lands, as a replay has it (dispatcher/layer/journal.py).
        """
        layer, interval_ns = self._layer, block.interval_ns
        layer.recall(block, interval_ns=interval_ns)
        pattern = Pattern(interval_ns, block.register.size)
        departure = Departure(layer.clock.now_ns(), pattern, block.pulses.frequency_mhz)
        self._launch(block, FiberEnd(block.node, port), departure, over)

    async def settled(self) -> None:
        """Wait until light has come that is due to be somewhere now: a busy program is late."""
        now_ns = self._layer.clock.now_ns()
        while any(flight.due_ns <= now_ns for flight in self._flights.values()):
            await asyncio.sleep(0)

    async def landed(self) -> None:
        """Wait until no light is under way any more."""
        while self._flights:
            await asyncio.wait(self._flights)

    def _launch(
        self,
        block: Block,
        end: FiberEnd,
        departure: Departure,
        over: Callable[[], None] = lambda: None,
    ) -> None:
        layer = self._layer
        layer.record(end.node, "send", block, port=end.port, time_ns=departure.start_ns)
        self._keep_time(block, departure)
        layer.ownership.move(block, "")
        block.interval_ns = departure.pattern.interval_ns
        block.pulses.frequency_mhz = departure.frequency_mhz
        block.source_rate_hz = float("inf")
        cutoff.forget(block)
        block.kept, block.false_heralds = False, None
        flight = Flight(block, departure, layer)
        flight.announce(end)
        flight.launch(end)
        task = asyncio.create_task(self._fly(block, end, flight, over))
        self._flights[task] = flight
        task.add_done_callback(self._landed)

    def _keep_time(self, block: Block, departure: Departure) -> None:
        """Let the half that stays begin to be when its source emits this one, pair by pair."""
        name = block.name._replace(half=1 - block.name.half)
        other = self._layer.ownership.at(name, block.node)
        if other is None or other.maker != block.maker:
            return
        if block.fibers_passed or other.fibers_passed or other.interval_ns:
            return
        if other.start_ns == block.start_ns:  # it has not been used since both were created
            other.start_ns, other.interval_ns = departure.start_ns, departure.pattern.interval_ns
            other.first_ns, other.last_ns = departure.start_ns, departure.last_ns

    def _landed(self, task: asyncio.Task[None]) -> None:
        del self._flights[task]
        if not task.cancelled() and (error := task.exception()) is not None:
            self._failed(error)

    async def _fly(
        self, block: Block, end: FiberEnd, flight: Flight, over: Callable[[], None]
    ) -> None:
        layer = self._layer
        left, landed = True, False
        while left and (arrival := await flight.next_arrival(layer.clock)):
            self._land(arrival)
            left, landed = flight.has_light, True
        layer.photons_lost += flight.lost
        for dark in flight.give_up():
            layer.drop(dark)
        if left:
            self._wake(block.name)
            await layer.clock.wait_until(flight.known_ns)
        if not landed:
            layer.record(end.node, "dark", block, end.port, "no light came out")
        over()

    def _land(self, arrival: Arrival) -> None:
        layer, beam, block = self._layer, arrival.beam, arrival.beam.block
        block.fibers_passed = beam.fibers_passed
        if block.pulses.turn is not None:
            block.pulses.turn = block.pulses.turn.behind(beam.rotation)
        drift.turn(block, beam.turn)
        if beam.polarization is not None:
            block.pulses.polarization = beam.polarization.after(block.pulses.polarization)
        block.path_ps += beam.delay_ps
        block.pulses.dispersion_ps_per_nm += beam.dispersion_ps_per_nm
        block.start_ns = arrival.schedule.first_ns
        first, last = 0, block.size - 1
        if block.weak is None and (lit := extra_pairs.lit(block)).any():
            first, last = int(lit.argmax()), lit.tobytes().rfind(1)
        block.first_ns = arrival.schedule.time_ns(first)
        block.last_ns = arrival.schedule.time_ns(last)
        end = arrival.end
        counts = zip(ERRORS, arrival.errors, strict=True)
        noise = " ".join(f"{pauli}={count}" for pauli, count in counts if count)
        detail = f"noise: {noise}" if noise else ""
        layer.record(end.node, "arrive", block, end.port, detail, block.last_ns)
        if layer.ownership.is_closed(end.node, block.name.session):
            layer.drop(block)
        else:
            self._bring(block, end.node, end.port)
        self._wake(block.name)

    def _bring(self, block: Block, node: str, port: str) -> None:
        """Bring a block to a place, where it joins a part of the same block."""
        layer = self._layer
        there = layer.ownership.at(block.name, node, port)
        if there is None:
            layer.ownership.move(block, node, port)
            return
        if there.maker != block.maker:
            layer.record(node, "discard", block, port, f"{there.maker} has made it")
            layer.drop(block)
            return
        weak_light.draw(layer, "light of several paths", there, block)
        layer.recall(there)
        for part in (there, block):
            drift.twirl_turn(part, layer.sabot, layer.draws)
        if (extra_pairs.lit(there) & extra_pairs.lit(block)).any():  # angles are of pulses
            for part in (there, block):
                drift.twirl(part, layer.sabot, layer.draws)
            if there.pulses.polarization is not block.pulses.polarization:
                there.pulses.approximations |= approximation(UNLIKE_LIGHT, 0.5)
        pulses.unite(there.pulses, block.pulses, extra_pairs.lit(block))
        layer.sabot.unite(there.register, block.register)
        extra_pairs.unite(layer.sabot, there, block)
        there.first_ns = min(there.first_ns, block.first_ns)
        there.last_ns = max(there.last_ns, block.last_ns)
        there.fibers_passed = max(there.fibers_passed, block.fibers_passed)
        there.resends = max(there.resends, block.resends)
        there.gates = max(there.gates, block.gates)
        layer.ownership.remove(block)

    def _wake(self, name: BlockName) -> None:
        self._came(name)
        for waiter in self._waiting.get(name, ()):
            if not waiter.done():
                waiter.set_result(None)

    def _whole(self, name: BlockName, node: str, port: str) -> Block | None:
        """Return the part of a block at a port, None if there is none or more will come."""
        block = self._layer.ownership.at(name, node, port)
        return None if block is None or self._layer.ownership.rest_flies(block) else block

    async def _arrived(self, name: BlockName, node: str, port: str) -> Block:
        while (block := self._whole(name, node, port)) is None:
            waiter = asyncio.get_running_loop().create_future()
            waiters = self._waiting.setdefault(name, [])
            waiters.append(waiter)
            try:
                await waiter
            finally:
                waiters.remove(waiter)
                if not waiters:
                    del self._waiting[name]
            await self._layer.journal.resumed()
        return block
