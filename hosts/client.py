"""A client of sessions: one program that calls the stack of every host that takes part.

async with session(stacks, "distribute", ("alice", "bob"), 9, limit_s=10, count=1000) as pairs:
    await pairs.results()
    print(await pairs.ask(measure=[0, 1, 2], basis="Z"))  # the outcomes of each host
    await pairs.end()

`blocking_session` is its face for programs without an event loop. A program on a host reaches that
host's stack alone: hosts.quantum_socket.
"""

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import AsyncExitStack, asynccontextmanager, contextmanager, suppress
from typing import Any, TypeVar

from hosts import network_loop
from hosts.stack_socket import QuantumSocketError, StackEnded, failure, no_stack, not_refused
from hosts.timeouts import CLOSING_TIMEOUT_S, LOOK_S
from wire.network_time import REAL_TIME, NetworkTime
from wire.socket_calls import (
    HEADER,
    MAX_PAYLOAD,
    Call,
    decode_fields,
    decode_header,
    encode,
    encode_fields,
)

T = TypeVar("T")
Take = Callable[[bytes], object]  # the bytes that an asked host receives
Note = Callable[[dict[str, Any]], object]  # a result
Look = Callable[[], object]  # at the network, again and again; it may raise


def ignore(_result: dict[str, Any]) -> None:
    """Note nothing."""


class End:
    """The end of a session at one host: a connection to the host's stack (wire.socket_calls)."""

    def __init__(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, limit_s: float | None
    ) -> None:
        self._reader, self._writer, self._limit_s = reader, writer, limit_s
        self._requested = False
        self.summary: dict[str, Any] = {}  # of the session, as far as this end knows
        self.over = False

    def say(self, call: Call, **fields: Any) -> None:
        self._requested = self._requested or call == Call.REQUEST
        self._writer.write(encode_fields(call, **fields))

    async def reply(self) -> dict[str, Any]:
        """Return the fields of DONE; raise QuantumSocketError if anything else comes."""
        call, payload = await self._read()
        if call != Call.DONE:
            raise QuantumSocketError(f"the stack answered {call.name}")
        return decode_fields(payload)

    async def results(self, take: Take | None = None) -> AsyncIterator[dict[str, Any]]:
        """Yield results until the session is over or its product can be used.

        `summary` is complete then, and `over` tells which. Bytes that come are given to `take`.
        """
        while not self.over:
            call, payload = await self._read()
            if call in (Call.CLOSE, Call.DONE):
                self.summary, self.over = decode_fields(payload), call == Call.CLOSE
                return
            if call == Call.DATA:
                if take is not None:
                    take(payload)
            elif call == Call.RESULT:
                yield decode_fields(payload)
            else:
                raise QuantumSocketError(f"the stack answered {call.name} in a session")

    async def ask(self, **question: Any) -> dict[str, Any]:
        self.say(Call.ASK, **question)
        return not_refused(await self.reply())

    async def sendall(self, data: bytes) -> None:
        """Send all of data; return when the other host's stack holds every byte of it."""
        for start in range(0, len(data), MAX_PAYLOAD):
            self._writer.write(encode(Call.DATA, data[start : start + MAX_PAYLOAD]))
            self.summary = await self.reply()

    async def _read(self) -> tuple[Call, bytes]:
        async with asyncio.timeout(self._limit_s):
            try:
                call, length = decode_header(await self._reader.readexactly(HEADER.size))
                payload = await self._reader.readexactly(length)
            except (asyncio.IncompleteReadError, ConnectionError) as error:
                raise StackEnded("the host's stack has ended") from error
        if call == Call.FAILED:
            raise failure(decode_fields(payload))
        return call, payload

    async def close(self) -> None:
        """Close; a session that this end has requested and not ended is broken off then."""
        try:
            if self._requested and not self.over:
                with suppress(OSError):  # TimeoutError is one
                    async with network_loop.wall_timeout(CLOSING_TIMEOUT_S):
                        self._writer.write_eof()
                        while await self._reader.read(MAX_PAYLOAD):
                            continue
        finally:
            self._writer.close()


class Session:
    """A session with all its ends: `opener` has requested it, others hear of it meanwhile."""

    def __init__(self, opener: End, hearing: Sequence["asyncio.Task[End]"]) -> None:
        self.opener, self._hearing = opener, hearing

    async def results(self, note: Note = ignore) -> list[dict[str, Any]]:
        """Return the opener's results when the session is over, or its product can be used.

        Each is given to `note` as it comes.
        """
        results = []
        async for result in self.opener.results():
            note(result)
            results.append(result)
        return results

    async def heard(self) -> list[End]:
        """Return the ends of the hosts that were asked, when they can use the product as well."""
        return await asyncio.gather(*self._hearing)

    async def ask(self, **question: Any) -> list[dict[str, Any]]:
        """Return every host's answer about the product, the opener's first."""
        ends = self.opener, *await self.heard()
        return await asyncio.gather(*(end.ask(**question) for end in ends))

    async def end(self) -> list[dict[str, Any]]:
        """End the session; return every host's summary when it is over, the opener's first."""
        if not self.opener.over:
            self.opener.say(Call.CLOSE)
        while not self.opener.over:
            await self.results()
        ends = self.opener, *await self.heard()
        for end in ends:
            async for _result in end.results():
                continue
        return [end.summary for end in ends]


@asynccontextmanager
async def session(
    stacks: Callable[[str], str],
    service: str,
    hosts: Sequence[str],
    port: int,
    *,
    limit_s: float | None,
    take: Take | None = None,
    **options: Any,
) -> AsyncIterator[Session]:
    """Request a service as the first of the hosts, from the second; all others take part.

    `stacks` gives the socket of a host's stack. Every wait for a stack raises TimeoutError after
    `limit_s` of the loop's time; a service that is refused or breaks raises QuantumSocketError with
    the reason. A session that has not ended at the end of the block is broken off.
    """
    opener, *acceptors = hosts
    async with AsyncExitStack() as closing:
        waiting = []
        for host in acceptors:
            listener = await closing.enter_async_context(_connected(stacks(host), limit_s))
            listener.say(Call.LISTEN, port=port, service=service)
            await listener.reply()
            end = await closing.enter_async_context(_connected(stacks(host), limit_s))
            end.say(Call.ACCEPT, port=port)
            waiting.append(end)
        requesting = await closing.enter_async_context(_connected(stacks(opener), limit_s))
        requesting.say(Call.REQUEST, service=service, host=acceptors[0], port=port, **options)
        hearing = [asyncio.create_task(_hear(end, take)) for end in waiting]
        try:
            yield Session(requesting, hearing)
        finally:
            for task in hearing:
                task.cancel()
            await asyncio.gather(*hearing, return_exceptions=True)


@asynccontextmanager
async def _connected(stack: str, limit_s: float | None) -> AsyncIterator[End]:
    try:
        reader, writer = await asyncio.open_unix_connection(stack, limit=MAX_PAYLOAD)
    except OSError as error:
        raise no_stack(stack, error) from error
    end = End(reader, writer, limit_s)
    try:
        yield end
    finally:
        await end.close()


async def _hear(end: End, take: Take | None) -> End:
    end.summary = await end.reply()
    async for _result in end.results(take):
        continue
    return end


class BlockingSession:
    """A session whose event loop runs in a thread of its own."""

    def __init__(self, inner: Session, loop: asyncio.AbstractEventLoop) -> None:
        self._own, self._loop = inner, loop

    @property
    def summary(self) -> dict[str, Any]:
        return self._own.opener.summary

    def results(self, note: Note = ignore, look: Look | None = None) -> list[dict[str, Any]]:
        return _wait(self._own.results(note), self._loop, look)

    def ask(self, **question: Any) -> list[dict[str, Any]]:
        return _wait(self._own.ask(**question), self._loop)

    def sendall(self, data: bytes) -> None:
        _wait(self._own.opener.sendall(data), self._loop)

    def end(self, look: Look | None = None) -> list[dict[str, Any]]:
        return _wait(self._own.end(), self._loop, look)


@contextmanager
def blocking_session(
    stacks: Callable[[str], str],
    service: str,
    hosts: Sequence[str],
    port: int,
    network_time: NetworkTime = REAL_TIME,
    **how: Any,
) -> Iterator[BlockingSession]:
    """Request a service, as `session` does, on a loop of the network's time."""
    with _loop_in_thread(network_time) as loop:
        opening = session(stacks, service, hosts, port, **how)
        inner = _wait(opening.__aenter__(), loop)
        try:
            yield BlockingSession(inner, loop)
        finally:
            _wait(opening.__aexit__(None, None, None), loop)


@contextmanager
def _loop_in_thread(network_time: NetworkTime) -> Iterator[asyncio.AbstractEventLoop]:
    started: Future[tuple[asyncio.AbstractEventLoop, asyncio.Event]] = Future()

    async def run() -> None:
        over = asyncio.Event()
        started.set_result((asyncio.get_running_loop(), over))
        await over.wait()

    with ThreadPoolExecutor(1) as thread:
        running = thread.submit(network_loop.run, run(), network_time)
        loop, over = started.result()
        try:
            yield loop
        finally:
            loop.call_soon_threadsafe(over.set)
            running.result()


def _wait(
    work: Coroutine[Any, Any, T], loop: asyncio.AbstractEventLoop, look: Look | None = None
) -> T:
    doing = asyncio.run_coroutine_threadsafe(work, loop)
    try:
        while look is not None and not wait([doing], LOOK_S).done:
            look()
        return doing.result()
    finally:
        doing.cancel()  # where a signal has ended the wait
