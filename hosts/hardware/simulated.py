"""The simulated QNIC: every call is a request to the dispatcher, over the host's own CNIC."""

import math
import time
from collections.abc import AsyncIterator, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from itertools import islice

import grpc
import numpy as np
from numpy.typing import NDArray

from hosts.hardware.operations import OUTCOMES, BlockName, Operation
from hosts.hardware.orders import Chain, NotHere, Orders, Standing, proved
from hosts.hardware.qnic import (
    Coincidences,
    Directions,
    HardwareError,
    Heralds,
    LocalGate,
    NoLight,
    Outcomes,
    Positions,
    Received,
    Stored,
    Symbols,
)
from hosts.hardware.requests import (
    apply_request,
    block_id,
    coincidences_of,
    detection,
    emission,
    half_id,
    measure_request,
    outcomes_of,
    send_request,
    states_field,
    stored_of,
)
from hosts.hardware.steps import steps_of
from hosts.timeouts import DISPATCHER_TIMEOUT_S
from wire import dibits
from wire.credentials import Credentials
from wire.dispatcher_pb2 import (
    ApplyRequest,
    AttemptRequest,
    BellMeasureRequest,
    BlockId,
    CreateRequest,
    DiscardRequest,
    Gate,
    GatherRequest,
    HeraldRequest,
    Launch,
    LookRequest,
    MeasureRequest,
    Pick,
    ReceiveRequest,
    ResendRequest,
    SenseRequest,
    SplitRequest,
    Step,
    StoreRequest,
    TellRequest,
    WatchRequest,
)
from wire.dispatcher_pb2_grpc import DispatcherStub
from wire.dispatcher_service import CHANNEL_OPTIONS
from wire.events import decode_record, encode_record
from wire.optical import frequency_mhz

MAX_STEPS = 64  # in one order
TIMES = 16  # that blocks are measured by one order: so many outcomes wait for who asks at most


class SimulatedQnic:
    """A QNIC whose photons live in the dispatcher."""

    def __init__(self, dispatcher: str, token: str, ports: list[str]) -> None:
        self._dispatcher, self._token, self._ports = dispatcher, token, ports
        self._channel: grpc.aio.Channel | None = None
        self._cutoff_s: float | None = None  # that of the memory itself
        self._begun: dict[int, Chain] = {}  # pairs, by session
        self._standing: dict[int, Standing] = {}  # orders to measure pairs, likewise
        self.credentials: Credentials | None = None  # without, it speaks plainly

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
        return Orders(self._stub, self._token)

    @property
    def ports(self) -> list[str]:
        """Interface names of the fibres, in order."""
        return self._ports

    async def emit_pairs(
        self,
        session: int,
        number: int,
        count: int,
        ports: tuple[str, str],
        rate_hz: int,
        wavelength_pm: int,
    ) -> None:
        steps = emission(session, number, count, ports, rate_hz, wavelength_pm)
        await self._orders.perform(*steps)

    async def begin_pairs(
        self,
        session: int,
        number: int,
        count: int,
        ports: tuple[str, str],
        rate_hz: int,
        wavelength_pm: int,
    ) -> None:
        """Begin to make Bell pairs, behind those begun before."""
        if session not in self._begun:
            self._begun[session] = self._orders.chain()
        steps = emission(session, number, count, ports, rate_hz, wavelength_pm)
        self._begun[session].begin(*steps)

    async def pairs_over(self, session: int) -> None:
        """Wait until pairs that were begun are over."""
        if session in self._begun:
            await self._begun[session].over()

    async def share_pairs(
        self, session: int, number: int, count: int, port: str, rate_hz: int, wavelength_pm: int
    ) -> Stored:
        """Make Bell pairs, store their halves 0, and send halves 1 into a port."""
        create = CreateRequest(session=session, number=number, count=count)
        near, far = (half_id(session, number, half) for half in (0, 1))
        send = send_request([Launch(block=far, port=port)], rate_hz, wavelength_pm)
        _made, stored, sent = await self._orders.perform(
            Step(create=create), self._storing(near), Step(send=send)
        )
        return stored_of(stored.arrived, sent)

    async def attempt(self, block: BlockName, port: str, wavelength_pm: int) -> None:
        """Let qubits of the memory attempt to emit into a port."""
        frequency = frequency_mhz(wavelength_pm)
        attempt = AttemptRequest(
            block=block_id(block), port=port, frequency_mhz=frequency, cutoff_s=self._cutoff_s
        )
        await self._orders.perform(Step(attempt=attempt))

    async def herald(
        self, session: int, number: int, count: int, ports: tuple[str, str], timeout_s: float
    ) -> Heralds:
        """Herald pairs of qubits whose light comes to two ports."""
        request = HeraldRequest(
            session=session, number=number, count=count, ports=ports, timeout_s=timeout_s
        )
        (feedback,) = await self._orders.perform(Step(herald=request))
        return Heralds(np.frombuffer(feedback.outcomes, dtype=np.uint8), feedback.attempts)

    async def modulate(
        self,
        block: BlockName,
        paulis: Symbols,
        port: str,
        rate_hz: int,
        wavelength_pm: int,
        timeout_s: float,
    ) -> int:
        """Apply Pauli operators to the photons that arrive and send them back."""
        name = block_id(block)
        feedbacks = await self._orders.perform(
            Step(receive=ReceiveRequest(block=name, port=port, timeout_s=timeout_s)),
            Step(apply=ApplyRequest(block=name, dibits=dibits.pack(paulis, "little"))),
            Step(send=send_request([Launch(block=name, port=port)], rate_hz, wavelength_pm)),
        )
        return int(feedbacks[-1].first_ns)

    async def detect_pairs(
        self,
        session: int,
        number: int,
        ports: tuple[str, str],
        timeout_s: float,
        following: bool = False,
    ) -> Coincidences:
        """Make Bell measurements on what arrives at two ports."""
        names = [half_id(session, number, half) for half in (0, 1)]
        if not following:
            return coincidences_of(await self._orders.perform(*detection(names, ports, timeout_s)))
        standing = self._standing.pop(session, None)
        if standing is not None and standing.next_number != number:
            standing.end()
            standing = None
        if standing is None:
            steps = detection(names, ports, timeout_s)
            standing = self._orders.repeat(TIMES, number, *steps)
        try:
            found = await standing.next()
        except BaseException:
            standing.end()
            raise
        if standing.left:
            self._standing[session] = standing
        return coincidences_of(found)

    async def detect_arrivals(
        self, blocks: tuple[BlockName, BlockName], ports: tuple[str, str], timeout_s: float
    ) -> Coincidences:
        """Make Bell measurements on two blocks that arrive at two ports."""
        names = [block_id(block) for block in blocks]
        try:
            return coincidences_of(await self._orders.perform(*detection(names, ports, timeout_s)))
        except NoLight:
            await self._discard_blocks(names)
            raise

    async def prepare(
        self, session: int, number: int, states: Symbols, levels: Symbols | None = None
    ) -> BlockName:
        """Make a photon in each of these states, at this host."""
        create = CreateRequest(
            session=session,
            number=number,
            count=states.size,
            state=CreateRequest.PREPARED,
            **states_field(states),
            levels=b"" if levels is None else levels.tobytes(),
        )
        await self._orders.perform(Step(create=create))
        return BlockName(session, number, 0)

    async def prepare_along(self, session: int, number: int, directions: Directions) -> BlockName:
        """Make a photon along each of these directions, at this host."""
        name = BlockName(session, number, 0)
        theta, phi = directions.theta_rad, directions.phi_rad
        zeros = CreateRequest(
            session=session, number=number, count=theta.size, state=CreateRequest.ZEROS
        )
        turns = [Gate(name=Gate.RY, angles_rad=theta), Gate(name=Gate.RZ, angles_rad=phi)]
        apply = ApplyRequest(block=block_id(name), gates=turns)
        await self._orders.perform(Step(create=zeros), Step(apply=apply))
        return name

    async def send(self, block: BlockName, port: str, rate_hz: int, wavelength_pm: int) -> int:
        """Send photons of this host into a port."""
        launches = [Launch(block=block_id(block), port=port)]
        (feedback,) = await self._orders.perform(
            Step(send=send_request(launches, rate_hz, wavelength_pm))
        )
        return int(feedback.first_ns)

    def arrivals(self, port: str) -> AsyncIterator[BlockName]:
        """Yield blocks that arrive at a port from now on."""
        return self._arrivals(port, time.time_ns())

    async def _arrivals(self, port: str, since_ns: int) -> AsyncIterator[BlockName]:
        # With the history, or what comes meanwhile would be missed.
        async for record in self.watch(0, history=True, follow=True):
            event = decode_record(record)
            if event.kind == "arrive" and event.port == port and event.time_ns >= since_ns:
                block = event.block
                yield BlockName(block.session, block.number, block.half)

    async def receive(self, block: BlockName, port: str, timeout_s: float) -> Received:
        receive = ReceiveRequest(block=block_id(block), port=port, timeout_s=timeout_s)
        (feedback,) = await self._orders.perform(Step(receive=receive))
        return Received(feedback.photons, feedback.first_ns, feedback.last_ns)

    async def resend(self, block: BlockName, bases: Symbols) -> Symbols:
        resend = ResendRequest(block=block_id(block), bases=bases.tobytes())
        (feedback,) = await self._orders.perform(Step(resend=resend))
        return np.frombuffer(feedback.outcomes, dtype=np.uint8)

    async def split(self, block: BlockName, into: BlockName) -> Symbols:
        split = SplitRequest(block=block_id(block), into=block_id(into))
        (feedback,) = await self._orders.perform(Step(split=split))
        return np.frombuffer(feedback.outcomes, dtype=np.uint8)

    async def receive_into_memory(self, block: BlockName, port: str, timeout_s: float) -> Stored:
        name = block_id(block)
        _received, feedback = await self._orders.perform(
            Step(receive=ReceiveRequest(block=name, port=port, timeout_s=timeout_s)),
            self._storing(name),
        )
        return stored_of(feedback.arrived, feedback)

    def give_up(self, *blocks: BlockName) -> None:
        """Let nobody wait any longer for light of these blocks."""
        self._orders.give_up([block_id(block) for block in blocks])

    async def apply(self, block: BlockName, paulis: Symbols) -> int:
        apply = Step(apply=apply_request(block_id(block), paulis))
        (feedback,) = await self._orders.perform(apply)
        return int(feedback.time_ns)

    async def rotate(self, block: BlockName, gates: Sequence[LocalGate]) -> None:
        """Apply gates to every photon of a block at this host."""
        named = [Gate(name=gate) for gate in gates]
        await self._orders.perform(Step(apply=ApplyRequest(block=block_id(block), gates=named)))

    async def controlled_x(self, control: BlockName, target: BlockName) -> None:
        """Apply CX to pairs of photons of two blocks at this host."""
        gates = [Gate(name=Gate.CX, target=block_id(target))]
        await self._orders.perform(Step(apply=ApplyRequest(block=block_id(control), gates=gates)))

    def set_cutoff(self, cutoff_s: float) -> None:
        self._cutoff_s = cutoff_s

    async def store(self, block: BlockName, for_good: bool = False) -> Stored:
        (feedback,) = await self._orders.perform(self._storing(block_id(block), for_good))
        return stored_of(feedback.arrived, feedback)

    def _storing(self, block: BlockId, for_good: bool = False) -> Step:
        cutoff_s = math.inf if for_good else self._cutoff_s
        return Step(store=StoreRequest(block=block, cutoff_s=cutoff_s))

    async def gather(
        self, into: BlockName, picks: Mapping[BlockName, Positions], keep_rest: bool = False
    ) -> None:
        """Make a block of photons at this host; keep or discard the rest."""
        picked = [
            Pick(block=block_id(block), photons=positions.tolist())
            for block, positions in picks.items()
        ]
        gather = GatherRequest(into=block_id(into), picks=picked, keep_rest=keep_rest)
        await self._orders.perform(Step(gather=gather))

    async def measure(self, block: BlockName, bases: Symbols) -> Symbols:
        return (await self.outcomes(block, bases)).outcomes

    async def outcomes(
        self, block: BlockName, bases: Symbols, paulis: Symbols | None = None
    ) -> Outcomes:
        """Measure photons at this host, each in a basis; also say when."""
        steps = [Step(measure=measure_request(block_id(block), bases))]
        if paulis is not None:
            steps.insert(0, Step(apply=apply_request(block_id(block), paulis)))
        feedbacks = await self._orders.perform(*steps)
        return Outcomes(outcomes_of(feedbacks[-1]), feedbacks[0].time_ns)

    async def measure_along(
        self, block: BlockName, directions: Directions, paulis: Symbols
    ) -> Outcomes:
        """Measure photons at this host, each along a direction; also say when."""
        theta, phi = -directions.theta_rad, -directions.phi_rad
        turns = [Gate(name=Gate.RZ, angles_rad=phi), Gate(name=Gate.RY, angles_rad=theta)]
        apply = apply_request(block_id(block), paulis)
        apply.gates.extend(turns)
        measure = MeasureRequest(block=block_id(block), basis=MeasureRequest.Z)
        feedbacks = await self._orders.perform(Step(apply=apply), Step(measure=measure))
        found = np.frombuffer(feedbacks[-1].outcomes, dtype=np.uint8)
        return Outcomes(found, feedbacks[0].time_ns)

    async def sense(self, block: BlockName) -> None:
        await self._orders.perform(Step(sense=SenseRequest(block=block_id(block))))

    async def measure_at(self, block: BlockName, angle_rad: float) -> Symbols:
        """Measure photons at this host between X and Y."""
        steps = [Step(measure=MeasureRequest(block=block_id(block), basis=MeasureRequest.X))]
        if angle_rad:
            gates = [Gate(name=Gate.RZ, angle_rad=-angle_rad)]
            steps.insert(0, Step(apply=ApplyRequest(block=block_id(block), gates=gates)))
        feedbacks = await self._orders.perform(*steps)
        return np.frombuffer(feedbacks[-1].outcomes, dtype=np.uint8)

    async def measure_arrivals(
        self, block: BlockName, port: str, bases: Symbols, timeout_s: float
    ) -> Symbols:
        """Measure the photons that arrive at a port."""
        name = block_id(block)
        feedbacks = await self._orders.perform(
            Step(receive=ReceiveRequest(block=name, port=port, timeout_s=timeout_s)),
            Step(measure=measure_request(name, bases)),
        )
        return outcomes_of(feedbacks[-1])

    async def bell_measure(self, first: BlockName, second: BlockName) -> Symbols:
        return (await self.coincidences(first, second)).outcomes

    async def coincidences(self, first: BlockName, second: BlockName) -> Coincidences:
        """Make Bell measurements on pairs of photons at this host; also say when."""
        bell = BellMeasureRequest(first=block_id(first), second=block_id(second), packed=True)
        return coincidences_of(await self._orders.perform(Step(bell_measure=bell)))

    async def process(self, operations: Sequence[Operation]) -> list[int]:
        """Do operations on single qubits at this host, one after the other."""
        outcomes = b""
        for steps in _orders(steps_of(operations)):
            feedbacks = await self._orders.perform(*steps)
            outcomes += b"".join(feedback.outcomes for feedback in feedbacks)
        assert len(outcomes) == sum(each.kind in OUTCOMES for each in operations)
        return list(outcomes)

    async def tell(self, instructions: str) -> None:
        await self._orders.perform(Step(tell=TellRequest(text=instructions)))

    async def look(self, block: BlockName, entangled: bool) -> NDArray[np.complex128]:
        """Return the density matrix of a qubit at this host."""
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
        """Yield what happens at this host; the dispatcher tells a host nothing else."""
        request = WatchRequest(session=session, history=history, until_now=not follow)
        stream = None
        try:
            proof = await proved(self._stub, self._token, "Watch")
            stream = self._stub.Watch(request, metadata=proof)
            async for told in stream:
                for event in told.events:
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
        await self._orders.perform(Step(discard=DiscardRequest(session=session)))

    async def discard_block(self, session: int, number: int) -> None:
        """Discard what has come of both halves of a block."""
        await self._discard_blocks([half_id(session, number, half) for half in (0, 1)])

    async def _discard_blocks(self, names: Sequence[BlockId]) -> None:
        for name in names:
            with suppress(NotHere):
                await self._orders.perform(Step(discard=DiscardRequest(block=name)))

    async def close(self) -> None:
        await self._orders.close()
        if self._channel is not None:
            await self._channel.close(None)


def _orders(steps: Iterable[Step]) -> Iterator[tuple[Step, ...]]:
    """Yield as many steps as an order may have, until there are no more."""
    coming = iter(steps)
    while order := tuple(islice(coming, MAX_STEPS)):
        yield order
