"""Services of lines of hosts between whole stacks: what each host's application is told."""

import asyncio
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from stacks_scene import DEADLINE_S, live_qubits, network, taken_part

from hosts import network_loop
from hosts.service_socket import ServiceSocket
from wire.metadata.header import Message
from wire.metadata.values import Topic, Values
from wire.parameters.physics import Device, Memory

LINE = ["alice", "bob", "charlie", "eve"]
PATHS = [(1, 2), (3, 4), (5, 6)]  # alice to bob, bob to charlie, charlie to eve


async def five_t2_late(_way: str, message: Message) -> Message:
    """Let hosts wait for what they are to measure, with qubits in `MEMORIES`."""
    if isinstance(message, Values) and message.topic == Topic.BASES:
        await asyncio.sleep(1)
    return message


MEMORIES = dict.fromkeys(LINE[1:3], Device(memory=Memory(t2_s=0.2)))


def summaries(
    folder: Path, service: str, line: Sequence[str], words: dict[str, Any], **physics: Any
) -> list[dict[str, Any]]:
    """Return the summaries of all hosts, in their order; in the end no photon may be left."""

    async def run() -> list[dict[str, Any]]:
        async with network(folder, paths=PATHS[: len(line) - 1], **physics):
            found = await asyncio.to_thread(_asked, folder, service, line, words)
            assert await live_qubits(folder) == 0
            return found

    return network_loop.run(run())


def _asked(
    folder: Path, service: str, line: Sequence[str], words: dict[str, Any]
) -> list[dict[str, Any]]:
    first, *others = (folder / f"{name}.sock" for name in line)
    with ThreadPoolExecutor(len(line)) as pool, ExitStack() as sockets:
        asking, *listeners = (sockets.enter_context(ServiceSocket(at)) for at in (first, *others))
        for each in (asking, *listeners):
            each.settimeout(DEADLINE_S)
        for listener in listeners:
            listener.listen(9, service)
        parts = [pool.submit(taken_part, listener) for listener in listeners]
        list(asking.request(service, (line[1], 9), line=",".join(line), **words))
        asking.shutdown()
        return [asking.summary, *(part.result(DEADLINE_S) for part in parts)]
