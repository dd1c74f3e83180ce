"""The simulated switch: every call is a request to the dispatcher."""

import asyncio
import time
from collections.abc import Callable, Iterable

import grpc

from qswitch_agent.hardware.optics import *
from qswitch_agent.hardware.optics import (
    CALL_DEADLINE_S,
    CrossConnect,
    HardwareFault,
    HardwareRefusal,
)
from wire import dispatcher_pb2 as pb
from wire import service
from wire.dispatcher_pb2 import Connection, CrossConnectReply, CrossConnectRequest

REFUSALS = (
    grpc.StatusCode.INVALID_ARGUMENT,
    grpc.StatusCode.NOT_FOUND,
    grpc.StatusCode.FAILED_PRECONDITION,
    grpc.StatusCode.RESOURCE_EXHAUSTED,
)


class SimulatedSwitch:
    """The switch that the dispatcher simulates."""

    def __init__(self, switch: str, socket: str, token: str) -> None:
        """Name the switch, the dispatcher's unix socket and the switch's token."""
        self._switch = switch
        self._socket = socket
        self._metadata = service.metadata(token)
        # An idle channel must stay connected: its end tells that the dispatcher is gone.
        options = [*service.CHANNEL_OPTIONS, ("grpc.client_idle_timeout_ms", 2**31 - 1)]
        self._channel = grpc.aio.insecure_channel(f"unix:{socket}", options=options)
        self._cross_connect = self._channel.unary_unary(
            "/qmn.Dispatcher/CrossConnect",
            request_serializer=CrossConnectRequest.SerializeToString,
            response_deserializer=CrossConnectReply.FromString,
        )

    async def set_cross_connects(self, cross_connects: Iterable[CrossConnect]) -> None:
        """Tell the dispatcher, and wait until the switching time has passed."""
        request = CrossConnectRequest(switch=self._switch)
        for path in sorted(cross_connects):
            request.connections.append(
                Connection(in_port=path.in_port, out_port=path.out_port, circuit=path.circuit)
            )
        try:
            reply = await self._cross_connect(
                request, timeout=CALL_DEADLINE_S, metadata=self._metadata
            )
        except grpc.aio.AioRpcError as error:
            raise self._meaning(error) from error
        remaining_s = (reply.ready_ns - time.time_ns()) / 1e9
        if remaining_s > CALL_DEADLINE_S:
            raise HardwareFault(
                f"dispatcher at {self._socket} says that {self._switch} needs {remaining_s:.1f} s "
                f"to switch; lower its switching time to {CALL_DEADLINE_S} s at most"
            )
        if remaining_s > 0:
            await asyncio.sleep(remaining_s)

    async def tune(self, port: int, frequency_mhz: int | None, power_dbm: float | None) -> None:
        call = self._channel.unary_unary(
            "/qmn.Dispatcher/TunePort",
            request_serializer=pb.TunePortRequest.SerializeToString,
            response_deserializer=pb.TunePortReply.FromString,
        )
        try:
            await call(
                pb.TunePortRequest(
                    switch=self._switch,
                    port=port,
                    frequency_mhz=frequency_mhz or 0,
                    power_dbm=power_dbm,
                ),
                timeout=CALL_DEADLINE_S,
                metadata=self._metadata,
            )
        except grpc.aio.AioRpcError as error:
            raise self._meaning(error) from error

    async def read(self) -> Readings:
        call = self._channel.unary_unary(
            "/qmn.Dispatcher/SwitchStatistics",
            request_serializer=pb.SwitchStatisticsRequest.SerializeToString,
            response_deserializer=pb.SwitchStatisticsReply.FromString,
        )
        try:
            r = await call(
                pb.SwitchStatisticsRequest(switch=self._switch),
                timeout=CALL_DEADLINE_S,
                metadata=self._metadata,
            )
        except grpc.aio.AioRpcError as error:
            raise self._meaning(error) from error
        return Readings(
            {
                p.port: PortReading(
                    p.photons_in,
                    p.photons_out,
                    p.photons_lost,
                    p.frequency_mhz,
                    p.power_dbm,
                    p.rx_power_dbm,
                    p.bias_ma,
                )
                for p in r.ports
            },
            {c.circuit: CircuitReading(c.photons, c.since_ns, c.last_ns) for c in r.circuits},
            r.temperature_c,
        )

    async def watch(self, on_condition: Callable[[Condition], None]) -> None:
        call = self._channel.unary_stream(
            "/qmn.Dispatcher/WatchSwitch",
            request_serializer=pb.WatchSwitchRequest.SerializeToString,
            response_deserializer=pb.SwitchCondition.FromString,
        )
        try:
            async for c in call(
                pb.WatchSwitchRequest(switch=self._switch), metadata=self._metadata
            ):
                on_condition(
                    Condition(
                        Tuning(
                            c.min_frequency_mhz,
                            c.max_frequency_mhz,
                            c.grid_mhz,
                            c.min_power_dbm,
                            c.max_power_dbm,
                        ),
                        Path(c.loss_db, c.rotation),
                        {(p.in_port, p.out_port): Path(p.loss_db, p.rotation) for p in c.paths},
                        frozenset((s.in_port, s.out_port) for s in c.stuck),
                        c.hot,
                    )
                )
        except grpc.aio.AioRpcError as error:
            raise HardwareFault(str(self._meaning(error))) from error
        raise HardwareFault(f"dispatcher at {self._socket} is gone")

    async def close(self) -> None:
        """Close the channel."""
        await self._channel.close(None)

    def _meaning(self, error: grpc.aio.AioRpcError) -> Exception:
        cause = f"{error.code().name}: {error.details()}"
        if error.code() in REFUSALS:
            return HardwareRefusal(cause)
        if error.code() in (grpc.StatusCode.UNAUTHENTICATED, grpc.StatusCode.PERMISSION_DENIED):
            return HardwareFault(
                f"dispatcher at {self._socket} does not accept the token of {self._switch}: {cause}"
            )
        return HardwareFault(
            f"dispatcher at {self._socket} does not answer; start it before the agents, "
            f"and the network again if it ended ({cause})"
        )
