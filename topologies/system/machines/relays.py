"""Sockets here in the place of sockets of another machine: what connects to one reaches that.

program === socket here === runner === TLS === agent === socket of the same path there === stack
"""

import asyncio
import itertools
from collections.abc import Callable

from topologies.timeouts import AGENT_ANSWER_TIMEOUT_S

CHUNK_BYTES = 1 << 18

Stream = tuple[asyncio.StreamReader, asyncio.StreamWriter]


class Relays:
    """The sockets here that are in the place of those of one machine; of one event loop."""

    def __init__(self, ask: Callable[[str, int], None]) -> None:
        self._ask = ask
        self._numbers = itertools.count(1)
        self._expected: dict[int, asyncio.Future[Stream]] = {}
        self._servers: list[asyncio.Server] = []
        self._serving: set[asyncio.Task[None]] = set()

    async def listen(self, path: str) -> None:
        def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            task = asyncio.create_task(self._serve(path, (reader, writer)))
            self._serving.add(task)
            task.add_done_callback(self._serving.discard)

        self._servers.append(await asyncio.start_unix_server(serve, path))

    async def _serve(self, path: str, here: Stream) -> None:
        number = next(self._numbers)
        coming = self._expected[number] = asyncio.get_running_loop().create_future()
        try:
            self._ask(path, number)
            async with asyncio.timeout(AGENT_ANSWER_TIMEOUT_S):
                there = await coming
            await join(here, there)
        except TimeoutError:
            return  # who has connected finds its connection closed
        finally:
            del self._expected[number]
            here[1].close()

    def take(self, number: object, stream: Stream) -> None:
        """Take what the agent has connected to a socket there; close what nobody waits for."""
        coming = self._expected.get(number) if isinstance(number, int) else None
        if coming is None or coming.done():
            stream[1].close()
        else:
            coming.set_result(stream)

    def close(self) -> None:
        for server in self._servers:
            server.close()
        for task in self._serving:
            task.cancel()


async def join(one: Stream, other: Stream) -> None:
    """Pass on what comes from each to the other until either ends; close both.

    Neither can end one direction alone: TLS has no such end.
    """
    ways = [asyncio.create_task(_pass_on(*way)) for way in ((one[0], other[1]), (other[0], one[1]))]
    try:
        await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for way in ways:
            way.cancel()
        await asyncio.gather(*ways, return_exceptions=True)
        for _reader, writer in (one, other):
            writer.close()  # which still says what it was given


async def _pass_on(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    try:
        while data := await reader.read(CHUNK_BYTES):
            writer.write(data)
            await writer.drain()
    except OSError:
        return  # one of them is gone, which ends both
