"""Operations of quantum switches: cross-connects, tuning, statistics, faults."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager

from dispatcher.layer.layer import PhysicalLayer
from dispatcher.operations import limits
from dispatcher.operations.analysers import Tasks
from dispatcher.operations.blocks import Operations
from dispatcher.operations.transport import Transport
from dispatcher.refusal import Refusal, invalid, not_found, precondition
from dispatcher.switch.optical_switch import MAX_POWER_DBM, OpticalSwitch
from wire.config import FiberEnd
from wire.dispatcher_pb2 import (
    AdjustMemoryReply,
    AdjustMemoryRequest,
    BlockId,
    Connection,
    CreateRequest,
    CrossConnectRequest,
    EmitReply,
    EmitRequest,
    Event,
    InjectFaultRequest,
    Launch,
    SendRequest,
    SwitchCondition,
    SwitchStatisticsReply,
    TunePortRequest,
)
from wire.parameters.checks import check_names
from wire.parameters.physics import ADJUSTABLE
from wire.parameters.switch import Kind, inner_port


def condition(switch: OpticalSwitch) -> SwitchCondition:
    """Return what a switch is and how it is; losses include what heat adds."""
    config = switch.config
    return SwitchCondition(
        temperature_c=switch.temperature_c,
        hot=switch.hot,
        loss_db=config.insertion_loss_db + switch.hot_loss_db,
        rotation=config.rotation,
        paths=[
            SwitchCondition.PathOptics(
                in_port=path.in_port,
                out_port=path.out_port,
                loss_db=path.insertion_loss_db,
                rotation=path.rotation,
            )
            for path in switch.paths
        ],
        stuck=[Connection(in_port=i, out_port=o) for i, o in sorted(switch.stuck.items())],
        failed=sorted(switch.failed),
        cutoffs_s=switch.cutoffs_s,
        memory=switch.memory,
        min_frequency_mhz=config.min_frequency_mhz,
        max_frequency_mhz=config.max_frequency_mhz,
        grid_mhz=config.grid_mhz,
        min_power_dbm=config.min_power_dbm,
        max_power_dbm=MAX_POWER_DBM,
        channels=[
            SwitchCondition.Channel(
                port=number,
                frequency_mhz=port.channel.frequency_mhz,
                grid_mhz=port.channel.grid_mhz,
            )
            for number, port in switch.ports.items()
            if port.channel is not None
        ],
    )


def statistics(
    switch: OpticalSwitch, rx_power_dbm: Mapping[int, float], now_ns: int
) -> SwitchStatisticsReply:
    reply = SwitchStatisticsReply(temperature_c=switch.temperature_c)
    for number, port in switch.ports.items():
        reply.ports.add(
            port=number,
            photons_in=port.photons_in,
            photons_out=port.photons_out,
            photons_lost=port.photons_lost,
            frequency_mhz=int(port.tx_mhz.now),
            rx_frequency_mhz=int(port.rx_mhz.now),
            power_dbm=port.power_dbm.now,
            rx_power_dbm=rx_power_dbm[number],
            bias_ma=port.bias_ma,
        )
    for circuit in switch.circuits(now_ns):
        reply.circuits.add(
            circuit=circuit.number,
            photons=circuit.photons,
            since_ns=circuit.since_ns,
            last_ns=circuit.last_ns,
        )
    return reply


class Emission:
    def __init__(
        self,
        layer: PhysicalLayer,
        blocks: Operations,
        transport: Transport,
        attempt: Callable[[EmitRequest], Awaitable[None]],
        tasks: Tasks,
    ) -> None:
        self._attempt, self._begin = attempt, tasks.begin
        self._sources = layer.network.parts[Kind.SOURCE]
        self._switches = layer.network.switches
        self._blocks, self._transport = blocks, transport
        self._layer = layer
        # Until when a source makes light, and the last that was to make more then, by node.
        self._busy_ns: dict[str, int] = {}
        self._next: dict[str, asyncio.Task[None]] = {}

    async def emit(self, _node: str, request: EmitRequest) -> EmitReply:
        """Make a block of pairs, and send each half out of a port of the source.

        Its light leaves behind that of the block before. A memory's qubits attempt instead.
        """
        if inner_port(request.port).kind == Kind.EMITTER:
            await self._attempt(request)
            return EmitReply()
        inputs = (
            (node, part.ports)
            for node, part in self._sources.items()
            if part.switch == request.switch and str(request.port) in part.ports
        )
        node, ports = next(inputs, ("", []))
        if not node:
            raise not_found(f"port {request.port} of {request.switch} is of no pair source")
        if request.port in self._switches[request.switch].failed:
            raise precondition(f"the source of port {request.port} of {request.switch} has failed")
        session, number = request.session, request.number
        self._blocks.create(
            node, CreateRequest(session=session, number=number, count=request.count)
        )
        launches = [
            Launch(block=BlockId(session=session, number=number, half=half), port=port)
            for half, port in enumerate(ports)
        ]
        light = SendRequest(
            launches=launches, rate_hz=request.rate_hz, frequency_mhz=request.frequency_mhz
        )
        before = self._next.get(node)
        queued = before is not None and not before.done()
        if not queued and self._busy_ns.get(node, 0) <= self._layer.clock.now_ns():
            self._launch(node, light)
        else:
            self._next[node] = self._begin(self._launch_behind(before, node, light))
        return EmitReply()

    async def _launch_behind(
        self, before: asyncio.Task[None] | None, node: str, light: SendRequest
    ) -> None:
        if before is not None:
            await asyncio.wait([before])
        await self._layer.clock.wait_until(self._busy_ns[node])
        try:
            self._launch(node, light)
        except Refusal as refusal:  # nobody waits for it
            self._layer.record(node, "refuse", detail=str(refusal))

    def _launch(self, node: str, light: SendRequest) -> None:
        try:
            self._busy_ns[node] = self._transport.launch(node, light).last_ns
        except Refusal:
            for launch in light.launches:
                self._blocks.discard(node, launch.block)
            raise


DIRECTIONS = {
    TunePortRequest.BOTH: "",
    TunePortRequest.RECEIVE: " for light that comes",
    TunePortRequest.TRANSMIT: " for light that leaves",
}


class Switching:
    def __init__(
        self,
        layer: PhysicalLayer,
        connected: Callable[[str, set[int]], None],
        opened: Callable[[str, int], None],
        failed: Callable[[str], None],
    ) -> None:
        """Call `connected` with a switch and its outputs in use when these change.

        Call `opened` with a switch and a time when what is to be open by then is, `failed` with the
        node of a part of a switch that has failed.
        """
        self._layer, self._connected, self._opened = layer, connected, opened
        self._failed = failed
        self._switches = layer.network.switches
        self._wanted: dict[str, list[Connection]] = {}  # the latest request of each
        self._watchers: dict[str, set[asyncio.Event]] = {name: set() for name in self._switches}

    async def cross_connect(self, _node: str, request: CrossConnectRequest) -> int:
        """Replace a switch's cross-connects; return when all were open, once they are."""
        switch = self._switches[request.switch]
        requested = limits.cross_connects(request.connections)
        for port in (port for connection in requested.items() for port in connection):
            _require_port(switch, port)
        _require_not_stuck(switch, requested)
        self._wanted[request.switch] = list(request.connections)
        ready_ns = self._connect(switch)
        await self._layer.clock.wait_until(ready_ns)
        self._opened(request.switch, ready_ns)
        return ready_ns

    def tune(self, _node: str, request: TunePortRequest) -> int:
        """Tune a port; return from when on light meets the new values."""
        switch = self._switches[request.switch]
        _require_port(switch, request.port)
        power_dbm = request.power_dbm if request.HasField("power_dbm") else None
        limits.require_direction(request.direction)
        port, details = switch.ports[request.port], list[str]()
        limits.require_tuning(switch.config, request.frequency_mhz, power_dbm, port.channel)
        now_ns = self._layer.clock.now_ns()
        if request.frequency_mhz:
            if request.direction != TunePortRequest.TRANSMIT:
                port.rx_mhz.set(request.frequency_mhz, now_ns)
            if request.direction != TunePortRequest.RECEIVE:
                port.tx_mhz.set(request.frequency_mhz, now_ns)
            details.append(f"{request.frequency_mhz} MHz{DIRECTIONS[request.direction]}")
        if power_dbm is not None:
            port.power_dbm.set(power_dbm, now_ns)
            details.append(f"{power_dbm:g} dBm")
        if request.HasField("cutoff_s"):
            self._set_cutoff(switch, request.port, request.cutoff_s)
            details.append(f"cut-off {request.cutoff_s:g} s")
        if details:
            detail = " ".join(details)
            self._layer.record(
                switch.name, "tune", port=str(request.port), detail=detail, time_ns=now_ns
            )
        return now_ns

    def _set_cutoff(self, switch: OpticalSwitch, port: int, cutoff_s: float) -> None:
        inner = switch.config.inner_ports.get(port)
        if inner is None or inner.kind != Kind.MEMORY or not cutoff_s > 0:
            raise invalid(
                f"a cut-off of {cutoff_s:g} s at port {port} of {switch.name}: give more than 0 s "
                "to a memory"
            )
        switch.cutoffs_s[port] = cutoff_s
        for changed in self._watchers[switch.name]:
            changed.set()

    def adjust_memory(self, _node: str, request: AdjustMemoryRequest) -> AdjustMemoryReply:
        """Change settings of a host's memory, or of all memories of a switch, from now on."""
        name, settings = request.node, dict(request.settings)
        check_names(f"memory of {name}", settings, ADJUSTABLE, invalid)
        inside = [
            node for node, part in self._layer.network.memories.items() if part.switch == name
        ]
        self._layer.devices.adjust_memories(inside or [name], settings)
        if inside:
            self._switches[name].memory |= settings
            for changed in self._watchers[name]:
                changed.set()
        detail = ", ".join(f"{each} {value:g}" for each, value in sorted(settings.items()))
        now_ns = self._layer.clock.now_ns()
        self._layer.record(name, "tune", detail=f"memory: {detail}", time_ns=now_ns)
        return AdjustMemoryReply()

    def statistics(self, name: str) -> SwitchStatisticsReply:
        switch, network = self._switches[name], self._layer.network
        powers = {port: network.power_at(FiberEnd(name, str(port))) for port in switch.ports}
        return statistics(switch, powers, self._layer.clock.now_ns())

    @contextmanager
    def watching(self, name: str) -> Iterator[AsyncIterator[SwitchCondition]]:
        """Give a switch's condition now and after changes; a slow reader misses old ones."""
        changed = asyncio.Event()
        self._watchers[name].add(changed)
        try:
            yield self._conditions(self._switches[name], changed)
        finally:
            self._watchers[name].remove(changed)

    async def inject(self, _node: str, request: InjectFaultRequest) -> None:
        """Make a switch faulty, or whole again; refuse what cannot be."""
        switch, kind = self._switches[request.switch], request.WhichOneof("fault")
        if kind == "stuck":
            await self._stick(switch, request.stuck)
        elif kind == "temperature_c":
            self._heat(switch, request.temperature_c)
        elif kind == "failed":
            self._fail(switch, request.failed)
        elif request.repair:
            await self._repair(switch)
        else:
            raise invalid("no fault; name a stuck connection, a temperature, a port or repair")

    async def _conditions(
        self, switch: OpticalSwitch, changed: asyncio.Event
    ) -> AsyncIterator[SwitchCondition]:
        while True:
            changed.clear()
            yield condition(switch)
            await changed.wait()

    async def _stick(self, switch: OpticalSwitch, connection: Connection) -> None:
        in_port, out_port = connection.in_port, connection.out_port
        for port in (in_port, out_port):
            _require_port(switch, port)
        _require_not_stuck(switch, {in_port: out_port})
        switch.stuck[in_port] = out_port
        self._fault(switch, f"stuck {in_port} -> {out_port}")
        ready_ns = self._connect(switch, {in_port: connection.circuit})
        await self._layer.clock.wait_until(ready_ns)

    def _fail(self, switch: OpticalSwitch, port: int) -> None:
        _require_inner_port(switch, port)
        nodes = {p: inner.node(switch.name) for p, inner in switch.config.inner_ports.items()}
        node = nodes[port]
        switch.failed |= {other for other in nodes if nodes[other] == node}
        self._fault(switch, f"{node} has failed")
        self._failed(node)

    def _heat(self, switch: OpticalSwitch, temperature_c: float) -> None:
        limits.require_temperature(temperature_c)
        switch.set_temperature(temperature_c, self._layer.clock.now_ns())
        effect = f", every path loses {switch.hot_loss_db:g} dB more" if switch.hot else ""
        self._fault(switch, f"temperature {temperature_c:g} C{effect}")

    async def _repair(self, switch: OpticalSwitch) -> None:
        switch.stuck.clear()
        switch.failed.clear()
        switch.set_temperature(switch.config.temperature_c, self._layer.clock.now_ns())
        self._fault(switch, "repaired")
        ready_ns = self._connect(switch)
        await self._layer.clock.wait_until(ready_ns)
        self._opened(switch.name, ready_ns)

    def _fault(self, switch: OpticalSwitch, detail: str) -> None:
        self._layer.record(switch.name, "fault", detail=detail)
        for changed in self._watchers[switch.name]:
            changed.set()

    def _connect(self, switch: OpticalSwitch, stuck_circuits: dict[int, int] | None = None) -> int:
        """Make what was wanted last, as far as nothing that is stuck is in its way."""
        layer, stuck = self._layer, switch.stuck
        open_circuits = switch.timeline.open_circuits
        requested, circuits = dict(stuck), {**(stuck_circuits or {})}
        circuits |= {
            i: open_circuits[i] for i, o in stuck.items() if switch.timeline.connections.get(i) == o
        }
        for connection in self._wanted.get(switch.name, ()):
            in_port, out_port = connection.in_port, connection.out_port
            if stuck.get(in_port) == out_port or _is_free(stuck, in_port, out_port):
                requested[in_port], circuits[in_port] = out_port, connection.circuit
        now_ns = layer.clock.now_ns()
        ready_ns, opened, closed = switch.timeline.connect(requested, now_ns, circuits)
        self._connected(switch.name, set(switch.timeline.connections.values()))
        wall_ns = layer.time.wall_ns
        changes = (("close", closed, wall_ns(now_ns)), ("open", opened, wall_ns(ready_ns)))
        events = [
            Event(time_ns=when_ns, node=switch.name, kind=kind, port=str(i), detail=f"{i} -> {o}")
            for kind, ports, when_ns in changes
            for i, o in sorted(ports.items())
        ]
        layer.history.record(*events)
        return ready_ns


def _is_free(stuck: dict[int, int], in_port: int, out_port: int) -> bool:
    return in_port not in stuck and out_port not in stuck.values()


def _require_port(switch: OpticalSwitch, port: int) -> None:
    if port not in switch.ports:
        ports = ", ".join(map(str, switch.ports)) or "none"
        raise not_found(f"port {port} of {switch.name} has no fibre; fibres end in {ports}")


def _require_inner_port(switch: OpticalSwitch, port: int) -> None:
    if port not in switch.config.inner_ports:
        ports = ", ".join(map(str, switch.config.inner_ports)) or "none"
        raise not_found(f"port {port} of {switch.name} is not an inner port; it has {ports}")


def _require_not_stuck(switch: OpticalSwitch, requested: dict[int, int]) -> None:
    for in_port, out_port in requested.items():
        for stuck_in, stuck_out in _in_the_way(switch.stuck, in_port, out_port):
            raise precondition(
                f"{switch.name} cannot connect {in_port} -> {out_port}: its cross-connect "
                f"{stuck_in} -> {stuck_out} is stuck; use other ports, or repair the switch"
            )


def _in_the_way(stuck: dict[int, int], in_port: int, out_port: int) -> Iterable[tuple[int, int]]:
    return (
        (stuck_in, stuck_out)
        for stuck_in, stuck_out in stuck.items()
        if (stuck_in == in_port) != (stuck_out == out_port)
    )
