"""One application of a processing unit: its machine, its sockets for pairs, its requests."""

import asyncio
from collections import defaultdict
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from applications.processing_unit.machine import Machine
from applications.processing_unit.measuring import choose, measurement, read_use, read_word
from applications.processing_unit.memory import MOST, Value
from applications.processing_unit.messages import OpenSocket, ReturnedArray, ReturnedRegister
from applications.processing_unit.operations import process
from applications.processing_unit.pair_requests import MAX_PAIRS, Measuring, PairRequest, Use
from applications.processing_unit.pairs import Made, PairService
from applications.processing_unit.qubits import Qubits
from applications.processing_unit.subroutine import Subroutine
from hosts.hardware.block_name import BlockName
from hosts.hardware.qnic import Qnic, release
from hosts.middleware.session.errors import SessionError, unsupported
from wire.dispatcher_pb2 import Step, TellRequest
from wire.metadata.vocabulary import Reason
from wire.outcomes import NO_CLICK

FIELDS = 10  # of each pair in its array
PHI_PLUS = 0
MOST_EVENT_TEXT = 1000  # characters of a subroutine in quantum events


def event_text(subroutine: Subroutine) -> str:
    instructions = [str(instruction) for instruction in subroutine.instructions]
    text = "; ".join(instructions) or "no instruction"
    if len(text) <= MOST_EVENT_TEXT:
        return text
    return f"{text[:MOST_EVENT_TEXT].rpartition(';')[0]}; ... of {len(instructions)} instructions"


@dataclass(eq=False)
class Request:
    """Pairs that the application has asked for, and where it wants to know of them."""

    node: int
    socket: int
    pairs: int
    qubits: int | None  # address of the array of their numbers
    into: int  # address of the array that describes them
    received: bool  # not created here
    made: int = 0  # pairs so far
    light_us: int = 0  # that these have taken

    @property
    def left(self) -> int:
        return self.pairs - self.made

    def add(self, made: Made) -> list["Half"]:
        """Count more pairs; return their halves."""
        self.light_us += made.light_us
        places = enumerate(made.blocks, self.made)
        self.made += len(made.blocks)
        return [Half(self, place, block, self.light_us) for place, block in places]


@dataclass(frozen=True)
class Half:
    """One end of a pair, by its place in a request."""

    request: Request
    place: int
    block: BlockName
    lasted_us: int  # from the begin of the request's light on


class Application:
    """Executes the subroutines of one application on this host."""

    def __init__(
        self,
        nodes: Sequence[str],
        qnic: Qnic,
        pair_service: PairService,
        session: int,
        most_qubits: int,
        draws: np.random.Generator,
    ) -> None:
        """Nodes are numbered from 0; the qubits are photons of the session."""
        self._nodes, self._qnic, self._pair_service, self._draws = nodes, qnic, pair_service, draws
        self._session = session
        self._qubits = Qubits(qnic, session, most_qubits)
        self._machine = Machine(self._qubits, self._ask, self._settled, self._arrived)
        self._sockets: dict[tuple[int, int], int] = {}  # node and socket: the socket there
        self._turns: defaultdict[tuple[int, int], asyncio.Lock] = defaultdict(asyncio.Lock)
        self._requests: dict[asyncio.Task[None], Request] = {}
        self._failure: BaseException | None = None
        self._changed = asyncio.Event()
        self._homeless: list[Half] = []  # without a number yet

    def open_socket(self, message: OpenSocket) -> None:
        if not 0 <= message.remote_node < len(self._nodes):
            raise unsupported(f"node {message.remote_node}: there are {len(self._nodes)}, from 0")
        self._sockets[message.remote_node, message.socket] = message.remote_socket

    async def run(self, subroutine: Subroutine) -> list[ReturnedArray | ReturnedRegister]:
        """Execute a subroutine, and tell those who watch of it; return what it returns."""
        self._settle()
        tell = TellRequest(text=event_text(subroutine))
        await self._qnic.perform(Step(tell=tell))
        return await self._machine.run(subroutine)

    async def look(self, qubit: int, entangled: bool) -> NDArray[np.complex128]:
        await self._arrived(qubit)
        return await self._qubits.look(qubit, entangled)

    async def close(self) -> None:
        for request in self._requests:
            request.cancel()
        await asyncio.gather(*self._requests, return_exceptions=True)
        await release(self._qnic, self._session)

    def _ask(
        self, node: int, socket: int, qubits: int | None, words: list[Value] | None, into: int
    ) -> None:
        """Begin to make pairs as an array of words says, or to receive some."""
        if (node, socket) not in self._sockets:
            raise unsupported(f"socket {socket} to node {node} is not open")
        length = len(self._machine.memory.array(into))
        pairs = length // FIELDS if words is None else read_word(words, 1, 1)
        if not 0 < pairs <= MAX_PAIRS or length != pairs * FIELDS:
            raise unsupported(
                f"{pairs} pairs, and an array of {length} numbers: ask for 1 to {MAX_PAIRS}, "
                f"with {FIELDS} numbers for each"
            )
        request = Request(node, socket, pairs, qubits, into, words is None)
        work = self._receive(request) if words is None else self._create(request, words)
        task = asyncio.create_task(self._in_turn(request, work))
        self._requests[task] = request
        task.add_done_callback(self._note_end)

    def _note_end(self, task: "asyncio.Task[None]") -> None:
        del self._requests[task]
        if not task.cancelled() and task.exception() is not None:
            self._failure = self._failure or task.exception()
        self._changed.set()

    async def _in_turn(self, request: Request, work: Coroutine[Any, Any, None]) -> None:
        """Requests of a socket are done in the order in which they were made."""
        async with self._turns[request.node, request.socket]:
            await work

    async def _create(self, request: Request, words: list[Value]) -> None:
        use, ours, theirs = read_use(words)
        if use == Use.KEEP and not self._can_keep(request):
            raise unsupported(f"{request.pairs} pairs to keep, and not as many qubits are named")
        remote_socket = self._sockets[request.node, request.socket]
        pair_request = PairRequest(
            self._pair_service.node, request.socket, remote_socket, request.pairs, use, theirs
        )
        remote = self._nodes[request.node]
        while request.left:
            rest = replace(pair_request, pairs=request.left)
            halves = request.add(await self._pair_service.create(rest, remote, self._qubits))
            if use == Use.KEEP:
                self._keep(halves)
            else:
                await self._measure(halves, use, ours)

    async def _receive(self, request: Request) -> None:
        remote_socket = self._sockets[request.node, request.socket]
        key = self._nodes[request.node], request.socket, remote_socket
        while request.left:
            can_keep = self._can_keep(request)
            agreed, made = await self._pair_service.receive(
                key, request.left, can_keep, self._qubits
            )
            halves = request.add(made)
            if agreed.use == Use.MEASURE:
                await self._measure(halves, agreed.use, agreed.receiver)
            else:
                self._keep(halves)

    def _can_keep(self, request: Request) -> bool:
        return len(self._machine.memory.entries(request.qubits)) == request.pairs

    def _keep(self, halves: list[Half]) -> None:
        self._homeless += halves
        self._settle()

    def _settle(self) -> None:
        """Give pairs the numbers that the application wants, as soon as these are free."""
        waiting, self._homeless = self._homeless, []
        taken = set()
        for half in waiting:
            assert half.request.qubits is not None
            number = self._machine.memory.entry(half.request.qubits, half.place)
            if not isinstance(number, int):
                raise unsupported("the number of a qubit for a pair is not known yet")
            if number in taken or number in self._qubits:
                self._homeless.append(half)
                taken.add(number)
            else:
                self._qubits.place(number, half.block)
                self._tell(half, Use.KEEP, number)

    async def _measure(self, halves: list[Half], use: Use, how: Measuring) -> None:
        bases = choose(how, len(halves), self._draws)
        blocks = [half.block for half in halves]
        outcomes = await process(self._qnic, measurement(blocks, how, bases))
        if NO_CLICK in outcomes:
            text = "no detector has clicked for half of a pair: take one of efficiency 1"
            raise SessionError(Reason.HARDWARE, text)
        for half, *outcome in zip(halves, outcomes, bases, strict=True):
            self._tell(half, use, *outcome)

    def _tell(self, half: Half, use: Use, outcome: int, *basis: int) -> None:
        """Write the facts of a pair as NetQASM lays them out: its number, or outcome and basis."""
        request, place = half.request, half.place
        lasted_us = min(half.lasted_us, MOST)
        head = [use.value, 0, outcome, *basis, int(request.received), place, request.socket]
        row = [*head, request.node, lasted_us]
        row += [0] * (FIELDS - 1 - len(row)) + [PHI_PLUS]
        for field, value in enumerate(row):
            self._machine.memory.put(request.into, place * FIELDS + field, value)
        self._changed.set()

    async def _arrived(self, number: int) -> None:
        """Wait for the qubit of this number if it is half of a pair on its way."""

        def is_clear() -> bool:
            return number in self._qubits or not (self._failure or self._is_coming(number))

        self._settle()
        if not is_clear():
            await self._qubits.flush()
            await self._settled(is_clear)

    def _is_coming(self, number: int) -> bool:
        named = (request.qubits for request in self._requests.values())
        return any(number in self._machine.memory.entries(address) for address in named)

    async def _settled(self, there: Callable[[], bool]) -> None:
        """Wait until the condition holds; raise the error that prevents it."""
        while True:
            self._changed.clear()
            self._settle()
            if there():
                return
            if self._failure is not None:
                raise self._failure
            if not self._requests:
                raise unsupported("nothing comes any more of what is waited for")
            await self._changed.wait()
