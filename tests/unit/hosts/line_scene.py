"""Services of lines of hosts between whole stacks: the result of each host's application."""

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from stacks_scene import live_qubits, network, requested

from hosts import network_loop
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
            options = {"line": ",".join(line), **words}
            found = await asyncio.to_thread(requested, folder, service, line, **options)
            assert await live_qubits(folder) == 0
            return found

    return network_loop.run(run())
