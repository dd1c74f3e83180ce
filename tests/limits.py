"""How long tests wait before they say that something hangs; no statement about how long it takes.

Seconds of a machine on which programs have a processor whenever they want one. Beside others a test
gets more, as chaos judges: as much more as the kernel says that this process, and all below it, had
to wait for processors. As a plug-in of pytest it has pytest-timeout count so.
"""

import asyncio
import faulthandler
import os
import signal
import time
from collections.abc import Callable
from typing import Any

import pytest

MOST = 6.0  # times as many seconds, by the wall
WAIT_S = 120.0  # for what takes seconds where nothing else runs
# By the wall, of single calls: the test's own limit, `timeout` in pyproject.toml, comes first.
SOON_S = PROGRAM_S = MOST * 300.0


def left_s(began_s: float, limit_s: float) -> float:
    """Return for how long a wait may go on that began then, by time.monotonic."""
    from machine import descendants, slowed  # the path of a plug-in lacks it at the start

    if (passed_s := time.monotonic() - began_s) > limit_s:
        own = os.getpid()
        slower = slowed(own, *(each.pid for each in descendants(own)))
        limit_s *= min(slower or 1.0, MOST)
    return limit_s - passed_s


@pytest.hookimpl(optionalhook=True)
def pytest_timeout_set_timer(item: pytest.Item, settings: Any) -> bool:
    """End a test that has had its time; look at the machine only when the wall says so."""
    began_s = time.monotonic()

    def look(_number: int, _frame: object) -> None:
        if (more_s := left_s(began_s, settings.timeout)) > 0:
            signal.setitimer(signal.ITIMER_REAL, max(more_s, 0.01))
        else:
            signal.setitimer(signal.ITIMER_REAL, settings.timeout)  # for what it has to end
            faulthandler.dump_traceback(2)  # of all threads
            pytest.fail(f"has not ended in {settings.timeout:g} s")

    def cancel() -> None:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, signal.SIG_DFL)

    item.cancel_timeout = cancel  # type: ignore[attr-defined]
    signal.signal(signal.SIGALRM, look)
    signal.setitimer(signal.ITIMER_REAL, settings.timeout)
    return True


def wait_until(condition: Callable[[], object], what: str, limit_s: float = WAIT_S) -> None:
    """Wait for a condition; fail naming it when its time has passed."""
    began_s = time.monotonic()
    while not condition():
        assert left_s(began_s, limit_s) > 0, f"not in {limit_s:g} s: {what}"
        time.sleep(0.02)


async def until(condition: Callable[[], object]) -> None:
    """Wait for a condition of this loop."""
    began_s = time.monotonic()
    while not condition():
        assert left_s(began_s, WAIT_S) > 0, f"not in {WAIT_S:g} s"
        await asyncio.sleep(0.005)
