"""Pairs for the applications of processing units: agreed on between two units, made by a service.

creator's unit                                     receiver's unit
PairRequest ------------------------------------->  waits until its application wants some
   <----------------------- READY, port, how many now
session of `distribute`, to that port <---------->  light, as the controller grants it
both take the pairs out of the session, which ends then
PairsMade ----------------------------------------> how long their light has lasted
the creator requests the pairs that are left
"""

import asyncio
import logging
from collections import defaultdict, deque
from collections.abc import Awaitable, Callable, Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import count
from math import ceil
from typing import Any, NamedTuple

from applications.processing_unit.agreement import Agreement, reported_light_us
from applications.processing_unit.operations import Kind, Operation, process
from applications.processing_unit.pair_requests import (
    MADE,
    MAX_LIGHT_US,
    REQUEST,
    PairAnswer,
    PairRequest,
    Use,
    Verdict,
    decode_request,
)
from applications.processing_unit.qubits import Qubits
from applications.timeouts import FREE_TIMEOUT_S, WANTED_TIMEOUT_S
from hosts.hardware.block_name import BlockName
from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import HardwareError
from hosts.middleware.session.arrangement import growing_pauses
from hosts.middleware.session.blocks import PAIRS
from hosts.middleware.session.ends import Answerer
from hosts.middleware.session.errors import SessionError, unsupported
from hosts.network_loop import now_s, retry_pause
from hosts.serving.processing import Sessions
from hosts.timeouts import ANSWER_TIMEOUT_S, MAX_BLOCK_S
from wire.config import HostConfig
from wire.malformed import MalformedPacket
from wire.metadata.vocabulary import Reason, Service
from wire.services import is_heralded

log = logging.getLogger("pairs")

SERVICE = "distribute"
BLOCK_PAIRS = 16_384
FIRST_PORT, LAST_PORT = 49_152, 65_535  # of sessions with pairs
MOST_WAITING = 64  # units that want something of this one, at a time
CREATOR, RECEIVER = 0, 1  # halves of the pairs
Key = tuple[str, int, int]  # the creator's node, the receiver's socket, the creator's socket


class Arriving:
    """Pairs on their way to this host, in a session that another host has opened."""

    def __init__(self, peer: str, take: Callable[[int], Awaitable[list[BlockName]]]) -> None:
        """`take` is given the session's number when the pairs are there."""
        self.peer, self._take = peer, take
        self.ended = asyncio.Event()
        self.blocks: asyncio.Future[list[BlockName]] = asyncio.get_running_loop().create_future()

    async def tell(self, **_fields: Any) -> None:
        """Nobody wants to know how far the service is."""

    async def deliver(self, _data: bytes) -> None:
        raise SessionError(Reason.PROTOCOL, "bytes in the place of pairs")

    async def ready(self, summary: dict[str, Any], _answer: Answerer) -> None:
        """Take the pairs; the session may end then."""
        self.blocks.set_result(await self._take(int(summary["session"], 16)))

    async def finish(self, _summary: dict[str, Any]) -> None:
        self.ended.set()

    async def fail(self, error: BaseException) -> None:
        if not self.blocks.done():
            cause = error if isinstance(error, SessionError | HardwareError) else None
            self.blocks.set_exception(cause or SessionError(Reason.PROTOCOL, "the unit has ended"))
        self.ended.set()


class Made(NamedTuple):
    """One end's halves of pairs, and how long the light of a source lasts that makes them."""

    blocks: list[BlockName]
    light_us: int


@dataclass(eq=False)
class Wanted:
    """Pairs that an application here wants to receive."""

    pairs: int
    can_keep: bool
    qubits: Qubits
    came: "asyncio.Future[tuple[PairRequest, Made]]" = field(
        default_factory=lambda: asyncio.get_running_loop().create_future()
    )

    def fail(self, error: SessionError | HardwareError) -> None:
        """Tell who waits for this, if somebody still does, why it does not come."""
        if not self.came.done():
            self.came.set_exception(error)

    def verdict(self, request: PairRequest) -> Verdict:
        if request.use != Use.MEASURE and not self.can_keep:
            return Verdict.OTHER_USE
        return Verdict.READY


class PairService:
    """All pairs between the applications of this unit and those of others."""

    def __init__(
        self, config: HostConfig, nodes: Mapping[str, str], qnic: Qnic, sessions: Sessions
    ) -> None:
        """Nodes: name to address."""
        self.node, self._nodes, self._source = config.name, nodes, config.source
        self._heralded = is_heralded(Service.DISTRIBUTE, config.node_features.features)
        self._rate_hz = config.pair_rate_hz
        self._qnic, self._sessions = qnic, sessions
        self._wanted: defaultdict[Key, deque[Wanted]] = defaultdict(deque)
        self._changed = asyncio.Condition()
        self._ports = count()
        self._waiting = 0

    async def create(self, request: PairRequest, remote: str, qubits: Qubits) -> Made:
        """Return this end's halves of new pairs with a node, as many as that wants now.

        Wait for light that others use. Raise SessionError if there are no pairs.
        """
        async with Agreement(request, remote, self._nodes[remote]) as agreement:
            request, port = replace(request, pairs=agreement.pairs), agreement.port
            deadline_s = now_s() + FREE_TIMEOUT_S
            pauses = growing_pauses(f"{self.node} {remote} {port}")
            while True:
                try:
                    made = await self._make(request, remote, port, qubits)
                    agreement.report(made.light_us)
                    return made
                except SessionError as error:
                    left_s = deadline_s - now_s()
                    if error.reason != Reason.BUSY or left_s <= 0:
                        raise
                await retry_pause(next(pauses), left_s)

    async def receive(
        self, key: Key, pairs: int, can_keep: bool, qubits: Qubits
    ) -> tuple[PairRequest, Made]:
        """Return a request of another node, and this end's halves of at most `pairs` pairs."""
        receiver = Wanted(pairs, can_keep, qubits)
        self._wanted[key].append(receiver)
        try:
            async with self._changed:
                self._changed.notify_all()
            async with asyncio.timeout(WANTED_TIMEOUT_S):
                return await receiver.came
        except TimeoutError as error:
            text = f"no pairs from {key[0]} in {WANTED_TIMEOUT_S:g} s: does its program create them"
            raise SessionError(Reason.NO_LISTENER, f"{text}, for the same sockets?") from error
        finally:
            self._forget(key, receiver)

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve another unit that wants pairs with an application here."""
        self._waiting += 1
        try:
            if self._waiting <= MOST_WAITING:
                async with asyncio.timeout(ANSWER_TIMEOUT_S):
                    data = await reader.readexactly(REQUEST.size)
                await self._answer(decode_request(data), reader, writer)
        except MalformedPacket as error:
            log.warning("%s", error)
        except (asyncio.IncompleteReadError, ConnectionError, TimeoutError):
            log.info("a unit closed its connection")
        finally:
            self._waiting -= 1
            writer.close()

    async def _answer(
        self, request: PairRequest, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        """Tell a creator when pairs are wanted here, and take them in; unless it goes before."""
        end = asyncio.create_task(reader.readexactly(MADE.size))
        serving = asyncio.create_task(self._provide(request, writer, end))
        await asyncio.wait([end, serving], return_when=asyncio.FIRST_COMPLETED)
        if end.done() and end.exception() is not None:
            serving.cancel()
        with suppress(asyncio.CancelledError):
            await serving
        end.cancel()
        await asyncio.gather(end, return_exceptions=True)

    async def _provide(
        self, request: PairRequest, writer: asyncio.StreamWriter, end: "asyncio.Task[bytes]"
    ) -> None:
        key = request.creator, request.receiver_socket, request.creator_socket
        try:
            async with asyncio.timeout(WANTED_TIMEOUT_S), self._changed:
                await self._changed.wait_for(lambda: self._wanted.get(key))
        except TimeoutError:
            writer.write(PairAnswer(Verdict.NOBODY).encode())
            return
        receiver = self._wanted[key].popleft()
        verdict = receiver.verdict(request)
        try:
            if verdict != Verdict.READY:
                writer.write(PairAnswer(verdict).encode())
                raise unsupported(
                    f"{request.creator} asks for others: "
                    f"{request.pairs} pairs, {request.use.name.lower()}",
                )
            blocks = await self._arrived(request, receiver, writer)
            made = Made(blocks, await reported_light_us(end))
        except (SessionError, HardwareError) as error:
            receiver.fail(error)
        except asyncio.CancelledError:
            text = f"{request.creator} has asked for pairs, and gone before they were there"
            receiver.fail(SessionError(Reason.PROTOCOL, text))
            raise
        else:
            if not receiver.came.done():  # the application may have gone meanwhile
                receiver.came.set_result((request, made))

    async def _arrived(
        self, request: PairRequest, receiver: Wanted, writer: asyncio.StreamWriter
    ) -> list[BlockName]:
        """Return the halves of pairs that the creator has made after an answer."""
        port = FIRST_PORT + next(self._ports) % (LAST_PORT - FIRST_PORT)
        pairs = min(request.pairs, receiver.pairs)

        async def take(session: int) -> list[BlockName]:
            return await self._take(session, RECEIVER, pairs, receiver.qubits)

        arriving = Arriving(request.creator, take)
        with self._sessions.expecting(port, (SERVICE,), arriving):
            writer.write(PairAnswer(Verdict.READY, port, pairs).encode())
            return await arriving.blocks

    async def _make(self, request: PairRequest, remote: str, port: int, qubits: Qubits) -> Made:
        """Have pairs made, and take this end's halves."""
        ends = self.node, remote
        fields = {
            "service": SERVICE,
            "host": remote,
            "port": port,
            "count": request.pairs,
            "sample": 0.0,
            "rate_hz": self._rate_hz,
            "block_pairs": max(1, min(BLOCK_PAIRS, int(self._rate_hz * MAX_BLOCK_S))),
            "source": self._source_of(ends),
        }
        session = self._sessions.request(fields)
        with self._sessions.opening(session):
            try:
                await session.run(_unsaid)
                number = session.setup.session
                blocks = await self._take(number, CREATOR, request.pairs, qubits)
                await session.finish()
            except (SessionError, HardwareError) as error:
                await session.give_up(error)
                raise
            finally:
                await session.close()
            return Made(blocks, self._lasted_us(session.summary))

    def _source_of(self, ends: Collection[str]) -> str:
        """Return who makes pairs; "": a station in a switch."""
        if self._heralded:
            return ""
        return self.node if self._source in ends else self._source

    async def _take(self, session: int, half: int, pairs: int, qubits: Qubits) -> list[BlockName]:
        """Take photons out of a session, one by one, into blocks of an application's own."""
        taken = [qubits.new_block() for _ in range(pairs)]
        whole = BlockName(session, PAIRS, half)
        await process(
            self._qnic,
            [
                Operation(Kind.TAKE, whole, target=block, position=position)
                for position, block in enumerate(taken)
            ],
        )
        return taken

    def _lasted_us(self, summary: dict[str, Any]) -> int:
        """Return how long light with all pairs, or all attempts at heralds, of a session lasts."""
        emitted: int = max(summary["emitted"], summary.get("attempts", 0))
        return min(ceil(emitted * 1e6 / self._rate_hz), MAX_LIGHT_US)

    def _forget(self, key: Key, receiver: Wanted) -> None:
        with suppress(ValueError):  # taken up already
            self._wanted[key].remove(receiver)
        if not self._wanted[key]:
            del self._wanted[key]


async def _unsaid(**_result: Any) -> None:
    """Tell nobody how far a service is."""
