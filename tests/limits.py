"""How long tests wait before they say that something hangs; no statement about how long it takes.

Machines that run tests are shared, and may be several times slower than this one was an hour ago.
"""

import asyncio
import time
from collections.abc import Callable

PROGRAM_S = 280.0  # for a program that builds a network and does something in it
SOON_S = 120.0  # for what takes seconds where nothing else runs


def wait_until(condition: Callable[[], object], what: str, timeout_s: float = SOON_S) -> None:
    """Wait for a condition; fail naming it when the deadline passes."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, f"not in {timeout_s:g} s: {what}"
        time.sleep(0.02)


async def until(condition: Callable[[], object]) -> None:
    """Wait for a condition of this loop."""
    async with asyncio.timeout(SOON_S):
        while not condition():
            await asyncio.sleep(0.005)
