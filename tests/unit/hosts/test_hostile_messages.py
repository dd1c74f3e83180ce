"""Messages with bytes changed at random, in the middle of sessions of every service.

Whatever they make of it, both ends come to an end, with an error or without, nothing unexpected is
raised on any host, no photon stays, and the next session goes well.
"""

import asyncio
import random
from pathlib import Path
from typing import Any

import pytest
from fault_scene import SERVICES, Once, Raw, running, session

from hosts import network_loop
from wire.metadata.header import HEADER, Message

SESSIONS = 6
LENGTH = range(4, 8)  # of the header: what has another one is waited for, see the faults


class Hostile:
    """Changes bytes of one message, the n-th that comes by."""

    def __init__(self, draw: random.Random) -> None:
        self._draw = draw
        self._left = draw.randrange(14)

    def fits(self, _way: str, _message: Message) -> bool:
        """Count the messages; return whether it is this one's turn."""
        self._left -= 1
        return self._left < 0

    def change(self, message: Message) -> Any:
        """Return it with bytes changed; mostly of what is behind the header."""
        data = bytearray(message.encode())
        for _ in range(self._draw.randrange(1, 4)):
            first = 0 if self._draw.random() < 0.2 or len(data) == HEADER.size else HEADER.size
            place = self._draw.randrange(first, len(data))
            if place not in LENGTH:
                values = {0, 1, 0x7F, 0x80, 0xFF, 0x55} - {data[place]}
                data[place] = self._draw.choice(sorted(values))
        return Raw(bytes(data))


@pytest.mark.parametrize("service", SERVICES)
def test_changed_bytes_leave_nothing_behind(tmp_path: Path, service: str) -> None:
    draw = random.Random(20161)
    changes = [Hostile(draw) for _ in range(SESSIONS)]
    turn = [Once(each.fits, each.change) for each in changes]
    now: list[Once] = []

    async def change(way: str, message: Message) -> Any:
        return await now[-1](way, message) if now else message

    async def run() -> list[str]:
        texts = []
        async with running(tmp_path, service, change=change):
            for each in turn:
                now.append(each)
                alice, bob = await asyncio.to_thread(session, tmp_path, service)
                assert bool(alice.text) or not bob.text
                texts.append(alice.text)
            now.clear()
            again = await asyncio.to_thread(session, tmp_path, service)
            assert [each.text for each in again] == ["", ""]
        return texts

    texts = network_loop.run(run())
    assert sum(map(bool, texts)) >= SESSIONS / 3
