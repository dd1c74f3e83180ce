"""The physical layer without a network around it: what hosts ask, at the speed of the simulation.

    alice = Laboratory(config).host("alice")
    await alice.create(1000)
    await alice.send({(0, 1): "alice-q0"})

Every request takes the way that a host's takes, checks included; only sockets and waiting are
missing: the clock jumps to whatever is waited for.
"""

import asyncio
from collections.abc import AsyncIterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dispatcher.build import build_layer
from dispatcher.layer.journal import CausedBy
from dispatcher.layer.ownership import BlockName
from dispatcher.operations.request_table import RequestTable
from dispatcher.sabot.backend import Bytes
from dispatcher.timeouts import RECEIVE_TIMEOUT_S
from wire import gaps
from wire.config import DispatcherConfig
from wire.dispatcher_pb2 import (
    BellOutcomes,
    BlockId,
    Connection,
    CreateRequest,
    CrossConnectRequest,
    Feedback,
    Gate,
    Launch,
    MeasureRequest,
    Pick,
    PulseKey,
)
from wire.positions import pack

START_NS = 1_700_000_000_000_000_000
RATE_HZ = 1_000_000_000
SESSION = 1

BlockKey = tuple[int, int]  # number and half of a block


class JumpingClock:
    def __init__(self, time_ns: int = START_NS) -> None:
        self.time_ns = time_ns

    def now_ns(self) -> int:
        return self.time_ns

    async def wait_until(self, time_ns: int) -> None:
        self.time_ns = max(self.time_ns, time_ns + 1)


class Laboratory:
    """The hosts, fibres and switches of a configuration."""

    def __init__(self, config: DispatcherConfig, clock: JumpingClock | None = None) -> None:
        """Build the layer; raise BadConfig for an impossible network."""
        self.clock = clock or JumpingClock()
        self.layer = build_layer(config, self.clock, None)
        self._errors: list[BaseException] = []
        self.table = RequestTable(self.layer, self._errors.append)

    def host(self, name: str) -> "LaboratoryHost":
        return LaboratoryHost(self, name)

    async def connect(self, switch: str, connections: dict[int, int]) -> None:
        """Replace a switch's cross-connects, and wait until light passes."""
        ports = [Connection(in_port=i, out_port=o) for i, o in connections.items()]
        request = CrossConnectRequest(switch=switch, connections=ports)
        await self.table.handle(switch, "cross_connect", request)

    async def wait(self, seconds: float) -> None:
        await self.clock.wait_until(self.clock.now_ns() + round(seconds * 1e9))

    async def act(self, node: str, operation: str, request: Any) -> Feedback:
        """Execute a host's request, and wait for what follows from it; raise Refusal."""
        with CausedBy(node, operation, request):
            feedback: Feedback = await self.table.handle(node, operation, request)
            await self.table.transport.landed()
            await self.table.heralding.announced()
        if self._errors:  # flights are tasks of their own
            raise self._errors[0]
        return feedback

    async def heralded(
        self, switch: str, ports: Mapping[str, str], count: int, number: int = 0, **more: Any
    ) -> tuple[BellOutcomes, float]:
        """Let hosts attempt, each by a port; return the station's report, and after how long (s).

        `more` is of all their requests.
        """
        with self.table.reports.watching(switch) as reports:
            for half, (host, port) in enumerate(ports.items()):
                name = block_id((number, half))
                request = self.request("attempt", block=name, port=port, count=count, **more)
                await self.table.handle(host, "attempt", request)
            began_ns, coming = self.clock.now_ns(), asyncio.ensure_future(self._herald(reports))
            while not coming.done() and not self._errors:
                await asyncio.sleep(0)
            took_s = (self.clock.now_ns() - began_ns) / 1e9
            await self.table.heralding.announced()
        if self._errors:
            coming.cancel()
            raise self._errors[0]
        return await coming, took_s

    async def _herald(self, reports: AsyncIterator[BellOutcomes]) -> BellOutcomes:
        report = await anext(reports)
        return report if report.end != BellOutcomes.WAITS else await self._herald(reports)

    def request(self, operation: str, **fields: Any) -> Any:
        return self.table.rows[operation].message(**fields)


class LaboratoryHost:
    """One host's requests, with blocks of one session named by number and half."""

    def __init__(self, laboratory: Laboratory, name: str) -> None:
        self._laboratory, self.name = laboratory, name
        self.asked_ns = 0  # time of the requests from now on; 0: the time of their execution

    async def create(
        self, count: int, number: int = 0, state: CreateRequest.State = CreateRequest.BELL_PAIRS
    ) -> Feedback:
        """Make a block of `count` Bell pairs, or of qubits in |0>."""
        return await self._act("create", session=SESSION, number=number, count=count, state=state)

    async def prepare(
        self, states: Bytes, number: int = 0, levels: Bytes | None = None
    ) -> Feedback:
        """Make a block of photons in these states (dispatcher.operations.emission.STATES).

        Levels, shape (k,): the source's intensity of each pulse.
        """
        return await self._act(
            "create",
            session=SESSION,
            number=number,
            count=states.size,
            state=CreateRequest.PREPARED,
            states=states.tobytes(),
            levels=packed(levels),
        )

    async def emit(
        self, count: int, number: int, key: bytes, shares: Sequence[float] = ()
    ) -> Feedback:
        """Make a block of photons in states that a key chooses, and intensities by their shares."""
        name, prepared = {"session": SESSION, "number": number}, CreateRequest.PREPARED
        chosen = PulseKey(key=key, shares=shares)
        return await self._act("create", **name, count=count, state=prepared, key=chosen)

    async def apply(
        self, block: BlockKey, paulis: Bytes | None = None, gates: Sequence[Gate] = ()
    ) -> Feedback:
        """Apply a Pauli to each photon (0 I, 1 X, 2 Z, 3 XZ; shape (k,)), then gates to all."""
        return await self._act("apply", block=block_id(block), paulis=packed(paulis), gates=gates)

    async def send(
        self, launches: dict[BlockKey, str], rate_hz: int = RATE_HZ, frequency_mhz: int = 0
    ) -> Feedback:
        """Launch blocks together, each into the port named; return when all have come or are lost.

        Frequency 0: channel 1.
        """
        paths = [Launch(block=block_id(block), port=port) for block, port in launches.items()]
        return await self._act("send", launches=paths, rate_hz=rate_hz, frequency_mhz=frequency_mhz)

    async def receive(self, block: BlockKey, port: str) -> Feedback | None:
        """Take a block from a port; return None if no light came."""
        name = BlockName(SESSION, *block)
        if self._laboratory.layer.ownership.at(name, self.name, port) is None:
            return None  # all that was sent has come or is lost by now
        return await self._act(
            "receive", block=block_id(block), port=port, timeout_s=RECEIVE_TIMEOUT_S
        )

    async def measure(
        self,
        block: BlockKey,
        basis: MeasureRequest.Basis = MeasureRequest.Z,
        bases: Bytes | None = None,
    ) -> Bytes:
        """Measure and use up a block; return the outcomes, 255 for no click, shape (k,)."""
        return outcomes(
            await self._act("measure", block=block_id(block), basis=basis, bases=packed(bases))
        )

    async def clicks(self, block: BlockKey, key: bytes) -> tuple[NDArray[np.int64], Bytes]:
        """Measure and use up a block in bases that a key chooses; return where, and the bits."""
        feedback = await self._act("measure", block=block_id(block), key=key)
        at = gaps.decode(feedback.gaps, feedback.photons)
        return at, np.unpackbits(np.frombuffer(feedback.bits, np.uint8), count=at.size)

    async def resend(self, block: BlockKey, bases: Bytes) -> Bytes:
        """Measure photons and put new ones in their places; a basis of 255 leaves one alone."""
        return outcomes(await self._act("resend", block=block_id(block), bases=packed(bases)))

    async def split(self, block: BlockKey, into: BlockKey) -> Bytes:
        """Count photons of pulses, and take one of several into a new block; return the counts."""
        return outcomes(await self._act("split", block=block_id(block), into=block_id(into)))

    async def bell_measure(self, first: BlockKey, second: BlockKey) -> Bytes:
        """Bell-measure two blocks; return 0 Phi+, 1 Psi+, 2 Phi-, 3 Psi-, 255 none, shape (k,)."""
        return outcomes(
            await self._act("bell_measure", first=block_id(first), second=block_id(second))
        )

    async def store(self, block: BlockKey, cutoff_s: float | None = None) -> Feedback:
        """Put a block into the host's memory, which drops qubits older than the cut-off."""
        return await self._act("store", block=block_id(block), cutoff_s=cutoff_s)

    async def sense(self, block: BlockKey) -> Feedback:
        """Let every photon of a block take the phase of the host's sensor."""
        return await self._act("sense", block=block_id(block))

    async def discard(self, block: BlockKey) -> Feedback:
        return await self._act("discard", block=block_id(block))

    async def gather(
        self,
        into: BlockKey,
        picks: Mapping[BlockKey, NDArray[np.integer]],
        keep_rest: bool = False,
    ) -> Feedback:
        """Make a block of photons of others, by their positions; keep or discard the rest."""
        every = [Pick(block=block_id(block), photons=pack(at)) for block, at in picks.items()]
        return await self._act("gather", into=block_id(into), picks=every, keep_rest=keep_rest)

    async def _act(self, operation: str, **fields: Any) -> Feedback:
        request = self._laboratory.request(operation, **fields)
        if self.asked_ns and "asked_ns" in request.DESCRIPTOR.fields_by_name:
            request.asked_ns = self.asked_ns
        return await self._laboratory.act(self.name, operation, request)


def block_id(block: BlockKey) -> BlockId:
    number, half = block
    return BlockId(session=SESSION, number=number, half=half)


def packed(values: Bytes | None) -> bytes:
    return b"" if values is None else values.tobytes()


def outcomes(feedback: Feedback) -> Bytes:
    return np.frombuffer(feedback.outcomes, dtype=np.uint8)
