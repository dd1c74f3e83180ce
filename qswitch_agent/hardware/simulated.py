"""The simulated switch: every call is a request to the dispatcher."""

import asyncio
from asyncio import StreamReader, StreamWriter
from collections.abc import Awaitable, Callable, Iterable
from dataclasses import fields
from typing import TypeVar

import grpc
from google.protobuf.message import DecodeError

from programs.network_timers import sleep_until
from qswitch_agent.hardware.optics import (
    Channel,
    CircuitReading,
    Condition,
    CrossConnect,
    Direction,
    HardwareFault,
    HardwareRefusal,
    Path,
    PortReading,
    Readings,
    Tuning,
)
from qswitch_agent.timeouts import CALL_DEADLINE_S, STEPPED_DEADLINE_S
from wire import dispatcher_pb2 as messages
from wire import dispatcher_service
from wire.analyser_frames import AnalyserCounts, AnalyserFrame, Emission, End, MemoryCounts
from wire.dispatcher_pb2 import CrossConnectOutcome, CrossConnectRequest
from wire.dispatcher_pb2_grpc import DispatcherStub
from wire.dispatcher_service import cross_connects_socket
from wire.malformed import MalformedPacket
from wire.network_time import REAL_TIME, LinkCounts, NetworkTime, SteppedTime


class DispatcherLink:
    """Requests one after the other; the caller sees to it that they do not overlap."""

    def __init__(self, dispatcher: str, token: str) -> None:
        """Name the dispatcher's own socket and the switch's token; nothing is connected yet."""
        self._path = cross_connects_socket(dispatcher)
        self._token = token
        self._idle: tuple[StreamReader, StreamWriter] | None = None  # nothing is unanswered

    async def ask(self, request: CrossConnectRequest) -> CrossConnectOutcome:
        """Return what became of a request.

        Raise OSError, EOFError or MalformedPacket if there is no dispatcher to tell. A
        connection on which that happened, or on which nobody waits any more, is left.
        """
        streams, self._idle = self._idle, None
        if streams is None or streams[0].at_eof():
            self._leave(streams)
            streams = await self._connect()
        reader, writer = streams
        try:
            writer.write(dispatcher_service.encode(request.SerializeToString()))
            outcome = CrossConnectOutcome.FromString(await dispatcher_service.read(reader))
            self._idle = streams
        except DecodeError as error:
            raise MalformedPacket(f"no outcome of cross-connects: {error}") from error
        finally:
            if self._idle is None:
                writer.close()
        return outcome

    async def _connect(self) -> tuple[StreamReader, StreamWriter]:
        reader, writer = await asyncio.open_unix_connection(self._path)
        writer.write(dispatcher_service.encode(self._token.encode()))
        return reader, writer

    def close(self) -> None:
        self._leave(self._idle)
        self._idle = None

    def _leave(self, streams: tuple[StreamReader, StreamWriter] | None) -> None:
        if streams is not None:
            streams[1].close()


REFUSALS = (
    grpc.StatusCode.INVALID_ARGUMENT,
    grpc.StatusCode.NOT_FOUND,
    grpc.StatusCode.ALREADY_EXISTS,
    grpc.StatusCode.FAILED_PRECONDITION,
    grpc.StatusCode.RESOURCE_EXHAUSTED,
)

DIRECTIONS = {
    Direction.BOTH: messages.TunePortRequest.BOTH,
    Direction.RECEIVE: messages.TunePortRequest.RECEIVE,
    Direction.TRANSMIT: messages.TunePortRequest.TRANSMIT,
}
COUNTERS = [field.name for field in fields(AnalyserCounts)]
STATUS = {status.value[0]: status for status in grpc.StatusCode}

Reply = TypeVar("Reply")


class SimulatedSwitch:
    def __init__(
        self, switch: str, socket: str, token: str, network_time: NetworkTime = REAL_TIME
    ) -> None:
        self._time = network_time
        self._asked = LinkCounts(network_time)
        self._switch = switch
        self._socket = socket
        self._metadata = dispatcher_service.metadata(token)
        self._channel = grpc.aio.insecure_channel(
            f"unix:{socket}", dispatcher_service.CHANNEL_OPTIONS
        )
        self._cross_connects = DispatcherLink(socket, token)
        self._stub = DispatcherStub(self._channel)  # type: ignore[no-untyped-call]

    async def set_cross_connects(self, cross_connects: Iterable[CrossConnect]) -> None:
        """Tell the dispatcher, and wait until the switching time has passed."""
        request = messages.CrossConnectRequest(switch=self._switch)
        for path in sorted(cross_connects):
            request.connections.add(
                in_port=path.in_port, out_port=path.out_port, circuit=path.circuit
            )
        outcome = await self._outcome(request)
        if outcome.code:
            raise self._meaning(STATUS[outcome.code], outcome.text)
        await self._wait_until(outcome.ready_ns)

    async def _outcome(self, request: messages.CrossConnectRequest) -> messages.CrossConnectOutcome:
        try:
            async with asyncio.timeout(self._time.wall_s(self._deadline_s)):
                return await self._cross_connects.ask(request)
        except TimeoutError as error:
            late = grpc.StatusCode.DEADLINE_EXCEEDED
            raise self._meaning(late, f"no outcome in {self._deadline_s} s") from error
        except (OSError, EOFError, MalformedPacket) as error:
            raise self._meaning(grpc.StatusCode.UNAVAILABLE, str(error)) from error

    async def tune(
        self,
        port: int,
        frequency_mhz: int | None,
        power_dbm: float | None,
        direction: Direction = Direction.BOTH,
        cutoff_s: float | None = None,
    ) -> None:
        request = messages.TunePortRequest(
            switch=self._switch,
            port=port,
            power_dbm=power_dbm,
            direction=DIRECTIONS[direction],
            cutoff_s=cutoff_s,
        )
        if frequency_mhz is not None:
            if not 0 < frequency_mhz < 1 << 32:
                raise HardwareRefusal(f"port {port} cannot be tuned to {frequency_mhz} MHz")
            request.frequency_mhz = frequency_mhz
        reply = await self._answer(
            self._stub.TunePort(request, timeout=self._deadline_s, metadata=self._metadata)
        )
        await self._wait_until(reply.ready_ns)

    async def read(self) -> Readings:
        request = messages.SwitchStatisticsRequest(switch=self._switch)
        reply = await self._answer(
            self._stub.SwitchStatistics(request, timeout=self._deadline_s, metadata=self._metadata)
        )
        return _readings(reply, self._time.now_ns())

    async def watch(self, on_condition: Callable[[Condition], None]) -> None:
        """Report the condition at once and after each change; raise HardwareFault at the end.

        The stream's end tells at once that the dispatcher is gone.
        """
        request = messages.WatchSwitchRequest(switch=self._switch)
        call = self._stub.WatchSwitch(request, metadata=self._metadata)
        heard = False
        try:
            async for condition in call:
                heard = True
                on_condition(_condition(condition))
        except grpc.aio.AioRpcError as error:
            if not heard:
                meaning = self._meaning(error.code(), error.details())
                raise HardwareFault(str(meaning)) from error
        finally:
            call.cancel()
        raise HardwareFault(
            f"dispatcher at {self._socket} does not answer; its connection ended and its "
            "quantum state is lost: start the network again"
        )

    async def watch_analysers(self, on_report: Callable[[AnalyserFrame], None]) -> None:
        request = messages.WatchSwitchRequest(switch=self._switch)
        call = self._stub.WatchAnalysers(request, metadata=self._metadata)
        try:
            async for report in call:
                end, waited_us = End(report.end), report.attempts or report.waited_ns // 1000
                port, number, pulses = report.port, report.number, report.photons
                frame = AnalyserFrame(port, number, end, pulses, 0, report.outcomes, waited_us)
                on_report(frame)
        except grpc.aio.AioRpcError as error:
            meaning = self._meaning(error.code(), error.details())
            raise HardwareFault(str(meaning)) from error
        finally:
            call.cancel()
        raise HardwareFault(f"dispatcher at {self._socket} no longer reports outcomes of analysers")

    async def emit(self, port: int, emission: Emission) -> None:
        request = messages.EmitRequest(
            switch=self._switch,
            port=port,
            session=emission.session,
            number=emission.number,
            count=emission.pairs,
            rate_hz=emission.rate_hz,
            frequency_mhz=emission.frequency_mhz,
        )
        call = self._stub.Emit(request, timeout=self._deadline_s, metadata=self._metadata)
        await self._answer(call)

    async def keep(self, chosen: AnalyserFrame) -> None:
        request = messages.KeepRequest(
            switch=self._switch,
            port=chosen.port,
            number=chosen.number,
            outcomes=chosen.outcomes,
            method=chosen.method,
        )
        call = self._stub.Keep(request, timeout=self._deadline_s, metadata=self._metadata)
        await self._answer(call)

    @property
    def _deadline_s(self) -> float:
        return STEPPED_DEADLINE_S if isinstance(self._time, SteppedTime) else CALL_DEADLINE_S

    async def close(self) -> None:
        self._cross_connects.close()
        await self._channel.close(None)

    async def _answer(self, call: Awaitable[Reply]) -> Reply:
        self._asked.sent()
        try:
            return await call
        except grpc.aio.AioRpcError as error:
            raise self._meaning(error.code(), error.details()) from error
        finally:
            self._asked.answered()

    async def _wait_until(self, ready_ns: int) -> None:
        remaining_s = (ready_ns - self._time.now_ns()) / 1e9
        if remaining_s > CALL_DEADLINE_S:
            raise HardwareFault(
                f"dispatcher at {self._socket} says that {self._switch} needs {remaining_s:.1f} s "
                f"to switch; lower its switching time to {CALL_DEADLINE_S} s at most"
            )
        await sleep_until(self._time, ready_ns)

    def _meaning(self, code: grpc.StatusCode, details: str | None) -> Exception:
        cause = f"{code.name}: {details}"
        if code in REFUSALS:
            return HardwareRefusal(cause)
        if code in (grpc.StatusCode.UNAUTHENTICATED, grpc.StatusCode.PERMISSION_DENIED):
            return HardwareFault(
                f"dispatcher at {self._socket} does not accept the token of {self._switch}: {cause}"
            )
        return HardwareFault(
            f"dispatcher at {self._socket} does not answer; start it before the agents, "
            f"and the network again if it ended ({cause})"
        )


def _readings(reply: messages.SwitchStatisticsReply, now_ns: int) -> Readings:
    return Readings(
        ports={
            port.port: PortReading(
                photons_in=port.photons_in,
                photons_out=port.photons_out,
                photons_lost=port.photons_lost,
                tx_mhz=port.frequency_mhz,
                rx_mhz=port.rx_frequency_mhz,
                tx_dbm=port.power_dbm,
                rx_dbm=port.rx_power_dbm,
                bias_ma=port.bias_ma,
            )
            for port in reply.ports
        },
        circuits={
            circuit.circuit: CircuitReading(circuit.photons, circuit.since_ns, circuit.last_ns)
            for circuit in reply.circuits
        },
        temperature_c=reply.temperature_c,
        memories=[
            MemoryCounts(
                memory.port,
                memory.held,
                max(1, now_ns - memory.oldest_ns) if memory.oldest_ns else 0,
                memory.stored,
                memory.released,
                memory.cut_off,
                memory.refused,
            )
            for memory in reply.memories
        ],
        analysers=[
            AnalyserCounts(**{name: getattr(each, name) for name in COUNTERS})
            for each in reply.analysers
        ],
    )


def _condition(condition: messages.SwitchCondition) -> Condition:
    return Condition(
        tuning=Tuning(
            min_mhz=condition.min_frequency_mhz,
            max_mhz=condition.max_frequency_mhz,
            grid_mhz=condition.grid_mhz,
            min_dbm=condition.min_power_dbm,
            max_dbm=condition.max_power_dbm,
        ),
        others=Path(condition.loss_db, condition.rotation),
        paths={
            (path.in_port, path.out_port): Path(path.loss_db, path.rotation)
            for path in condition.paths
        },
        stuck=frozenset((one.in_port, one.out_port) for one in condition.stuck),
        failed=frozenset(condition.failed),
        cutoffs_s=dict(condition.cutoffs_s),
        memory=dict(condition.memory),
        hot=condition.hot,
        channels={one.port: Channel(one.frequency_mhz, one.grid_mhz) for one in condition.channels},
    )
