"""The simulated switch: every call is a request to the dispatcher."""

import asyncio
import time
from collections.abc import Iterable

import grpc

from qswitch_agent.hardware.optics import (
    CALL_DEADLINE_S,
    CrossConnect,
    HardwareFault,
    HardwareRefusal,
)
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
            request.connections.append(Connection(in_port=path.in_port, out_port=path.out_port))
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

    async def watch(self) -> None:
        """Raise HardwareFault when the connection to the dispatcher, once made, is lost."""
        ready = grpc.ChannelConnectivity.READY
        state = self._channel.get_state(try_to_connect=True)
        while state is not ready:
            await self._channel.wait_for_state_change(state)
            state = self._channel.get_state()
        await self._channel.wait_for_state_change(ready)
        raise HardwareFault(
            f"dispatcher at {self._socket} does not answer; its connection ended and its "
            "quantum state is lost: start the network again"
        )

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
