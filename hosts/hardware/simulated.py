"""The simulated QNIC: every call is a request to the dispatcher, over the host's own CNIC."""

from typing import Any

import grpc
import numpy as np

from hosts.hardware.qnic import BlockName, Coincidences, HardwareError, NoLight, Symbols
from wire.dispatcher_pb2 import (
    ApplyRequest,
    BellMeasureRequest,
    BlockId,
    CreateRequest,
    DiscardRequest,
    Feedback,
    Launch,
    ReceiveRequest,
    SendRequest,
)
from wire.dispatcher_pb2_grpc import DispatcherStub

MAX_MESSAGE_BYTES = 16 << 20
CALL_TIMEOUT_S = 20.0


class SimulatedQnic:
    """A QNIC whose photons live in the dispatcher."""

    def __init__(self, dispatcher: str, token: str, ports: list[str]) -> None:
        options = [
            ("grpc.max_receive_message_length", MAX_MESSAGE_BYTES),
            ("grpc.max_send_message_length", MAX_MESSAGE_BYTES),
            ("grpc.enable_http_proxy", 0),
        ]
        self._channel = grpc.aio.insecure_channel(dispatcher, options)
        self._stub = DispatcherStub(self._channel)  # type: ignore[no-untyped-call]
        self._metadata = (("qmn-token", token),)
        self._ports = ports

    @property
    def ports(self) -> list[str]:
        """Interface names of the fibres, in order."""
        return self._ports

    async def create_pairs(self, session: int, number: int, count: int) -> None:
        """Make count Bell pairs Phi+: halves 0 and 1 of a block."""
        await self._call(
            self._stub.Create, CreateRequest(session=session, number=number, count=count)
        )

    async def apply(self, block: BlockName, paulis: Symbols) -> None:
        """Apply one Pauli operator to each photon."""
        await self._call(
            self._stub.Apply, ApplyRequest(block=_block_id(block), paulis=paulis.tobytes())
        )

    async def send(self, launches: list[tuple[BlockName, str]], rate_hz: int) -> int:
        """Launch blocks into ports; return the time (ns) at which the first photon left."""
        request = SendRequest(
            launches=[Launch(block=_block_id(block), port=port) for block, port in launches],
            rate_hz=rate_hz,
        )
        return int((await self._call(self._stub.Send, request)).first_ns)

    async def receive(self, block: BlockName, port: str, timeout_s: float) -> None:
        """Take a block that arrives at a port; raise NoLight if none comes in time."""
        request = ReceiveRequest(block=_block_id(block), port=port, timeout_s=timeout_s)
        await self._call(self._stub.Receive, request)

    async def bell_measure(self, first: BlockName, second: BlockName) -> Coincidences:
        """Measure pairs of photons in the Bell basis."""
        feedback = await self._call(
            self._stub.BellMeasure,
            BellMeasureRequest(first=_block_id(first), second=_block_id(second)),
        )
        outcomes = np.frombuffer(feedback.outcomes, dtype=np.uint8)
        return Coincidences(outcomes, feedback.clicks, feedback.time_ns)

    async def discard(self, session: int) -> None:
        """Let go of all photons of a session."""
        await self._call(self._stub.Discard, DiscardRequest(session=session))

    async def discard_block(self, block: BlockName) -> None:
        """Let go of a block, if it is here."""
        try:
            await self._stub.Discard(
                DiscardRequest(block=_block_id(block)),
                metadata=self._metadata,
                timeout=CALL_TIMEOUT_S,
            )
        except grpc.aio.AioRpcError as error:
            if error.code() is not grpc.StatusCode.NOT_FOUND:
                raise HardwareError(_text(error)) from error

    async def close(self) -> None:
        """Close the connection to the dispatcher."""
        await self._channel.close(None)

    async def _call(self, method: Any, request: Any) -> Feedback:
        try:
            feedback: Feedback = await method(
                request, metadata=self._metadata, timeout=CALL_TIMEOUT_S, wait_for_ready=True
            )
        except grpc.aio.AioRpcError as error:
            dark = isinstance(request, ReceiveRequest)
            if dark and error.code() is grpc.StatusCode.DEADLINE_EXCEEDED:
                raise NoLight(error.details()) from error
            raise HardwareError(_text(error)) from error
        return feedback


def _block_id(block: BlockName) -> BlockId:
    return BlockId(session=block.session, number=block.number, half=block.half)


def _text(error: grpc.aio.AioRpcError) -> str:
    return f"dispatcher: {error.code().name}: {error.details()}"
