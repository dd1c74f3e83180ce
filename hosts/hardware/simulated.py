"""The simulated QNIC: it performs steps by orders to the dispatcher, over the host's own CNIC.

The QNIC that a host's configuration names: the simulated one, or a class of the user's own.

Such a class is a subclass of Qnic. It is made with what SimulatedQnic takes (the dispatcher's
address, the host's token, the names of its fibres' interfaces) and keywords of its own.
"""

import math
from collections.abc import AsyncIterator
from functools import cached_property

import grpc
import numpy as np
from numpy.typing import NDArray

from hosts.hardware.block_name import BlockName
from hosts.hardware.orders import Chain, Orders, Standing, proved
from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import HardwareError
from hosts.hardware.steps import block_id
from hosts.timeouts import DISPATCHER_TIMEOUT_S
from programs.custom_class import load_class
from wire.config import BadConfig, HostConfig
from wire.credentials import Credentials
from wire.dispatcher_pb2 import Feedback, LookRequest, Step, WatchRequest
from wire.dispatcher_pb2_grpc import DispatcherStub
from wire.dispatcher_service import CHANNEL_OPTIONS
from wire.events import decode_record, encode_record
from wire.network_time import REAL_TIME

TIMES = 16  # blocks that one order measures, and outcomes that it buffers, at most


class SimulatedQnic(Qnic):
    def __init__(self, dispatcher: str, token: str, ports: list[str]) -> None:
        self._dispatcher, self._token, self.ports = dispatcher, token, ports
        self._channel: grpc.aio.Channel | None = None
        self._begun: dict[int, Chain] = {}  # pairs, by session
        self._standing: dict[int, Standing] = {}  # orders to measure pairs, likewise
        self.credentials: Credentials | None = None  # without, it speaks plainly
        self.network_time = REAL_TIME

    @cached_property
    def _stub(self) -> DispatcherStub:
        """The dispatcher, from the first order on: who waits for light needs no threads for it."""
        self._channel = self._connect()
        return DispatcherStub(self._channel)  # type: ignore[no-untyped-call]

    def _connect(self) -> grpc.aio.Channel:
        if self.credentials is None:
            return grpc.aio.insecure_channel(self._dispatcher, CHANNEL_OPTIONS)
        authority, certificate, private_key = self.credentials.read()
        shown = grpc.ssl_channel_credentials(authority, private_key, certificate)
        return grpc.aio.secure_channel(self._dispatcher, shown, CHANNEL_OPTIONS)

    @cached_property
    def _orders(self) -> Orders:
        return Orders(self._stub, self._token, self.network_time)

    async def connect(self) -> None:
        """Connect to the dispatcher before the first order."""
        self._orders.open()
        await self._orders.connected.wait()

    async def perform(self, *order: Step) -> list[Feedback]:
        return await self._orders.perform(*order)

    async def perform_repeatedly(self, session: int, number: int, *order: Step) -> list[Feedback]:
        standing = self._standing.pop(session, None)
        if standing is not None and standing.next_number != number:
            standing.end()
            standing = None
        if standing is None:
            standing = self._orders.repeat(TIMES, number, *order)
        try:
            feedbacks = await standing.next()
        except BaseException:
            standing.end()
            raise
        if standing.left:
            self._standing[session] = standing
        return feedbacks

    def begin(self, session: int, *order: Step) -> None:
        if session not in self._begun:
            self._begun[session] = self._orders.chain()
        self._begun[session].begin(*order)

    async def finish(self, session: int) -> None:
        if session in self._begun:
            await self._begun[session].over()

    def arrivals(self, port: str) -> AsyncIterator[BlockName]:
        now_ns = self.network_time.wall_ns(self.network_time.now_ns())  # as events are stamped
        return self._arrivals(port, now_ns)

    async def _arrivals(self, port: str, since_ns: int) -> AsyncIterator[BlockName]:
        # With the history, or arrivals before the watch begins would be missed.
        async for record in self.watch(0, history=True, follow=True):
            event = decode_record(record)
            if event.kind == "arrive" and event.port == port and event.time_ns >= since_ns:
                yield BlockName(event.block.session, event.block.number, event.block.half)

    def give_up(self, *blocks: BlockName) -> None:
        self._orders.give_up([block_id(block) for block in blocks])

    async def look(self, block: BlockName, entangled: bool) -> NDArray[np.complex128]:
        try:
            proof = await proved(self._stub, self._token, "Look")
            request = LookRequest(block=block_id(block), entangled=entangled)
            reply = await self._stub.Look(request, metadata=proof, timeout=DISPATCHER_TIMEOUT_S)
        except grpc.aio.AioRpcError as error:
            raise HardwareError(f"dispatcher: {error.details()}") from error
        flat = np.array(reply.real) + 1j * np.array(reply.imaginary)
        size = math.isqrt(flat.size)
        return flat.reshape(size, size)

    async def watch(self, session: int, history: bool, follow: bool) -> AsyncIterator[bytes]:
        request = WatchRequest(session=session, history=history, until_now=not follow)
        stream = None
        try:
            proof = await proved(self._stub, self._token, "Watch")
            stream = self._stub.Watch(request, metadata=proof)
            async for reply in stream:
                for event in reply.events:
                    yield encode_record(event)
        except grpc.aio.AioRpcError as error:
            raise HardwareError(f"dispatcher: {error.details()}") from error
        finally:
            if stream is not None:
                stream.cancel()

    async def discard(self, session: int) -> None:
        if session in self._begun:
            self._orders.forget_chain(self._begun.pop(session))
        if session in self._standing:
            self._standing.pop(session).end()
        await super().discard(session)

    async def close(self) -> None:
        await self._orders.close()
        if self._channel is not None:
            await self._channel.close(None)


def chosen_qnic(config: HostConfig) -> Qnic:
    """Return the hardware of a host; raise BadConfig for a class that cannot be it."""
    if not config.qnic:
        if config.qnic_parameters:
            raise BadConfig("qnic_parameters are given without qnic; name the class, too")
        return with_credentials(
            SimulatedQnic(config.dispatcher, config.token, config.qnics), config
        )
    kind = load_class("qnic", config.qnic)
    if problem := _problem(kind):
        raise BadConfig(f"qnic {config.qnic}: {kind.__name__} {problem}")
    try:
        made: Qnic = kind(config.dispatcher, config.token, config.qnics, **config.qnic_parameters)
    except (TypeError, ValueError) as error:
        raise BadConfig(f"qnic {config.qnic} with {config.qnic_parameters}: {error}") from error
    if config.time_folder and not isinstance(made, SimulatedQnic):
        raise BadConfig(f"qnic {config.qnic} counts a time of its own: leave --time stepped out")
    return with_credentials(made, config)


def _problem(kind: type) -> str:
    """Return why a class cannot be a QNIC; empty if it can."""
    if not issubclass(kind, Qnic):
        return "is not a subclass of Qnic; derive it from hosts.hardware.qnic.Qnic"
    missing = ", ".join(sorted(kind.__abstractmethods__))
    return f"has no {missing}; see hosts/hardware/primitives.py" if missing else ""


def with_credentials(qnic: Qnic, config: HostConfig) -> Qnic:
    """Let a QNIC that asks the dispatcher do so by TLS, if hosts do."""
    if isinstance(qnic, SimulatedQnic):
        qnic.credentials, qnic.network_time = config.credentials, config.time
    return qnic
