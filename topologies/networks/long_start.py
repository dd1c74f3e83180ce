"""Words about a start that takes long: what it waits for."""

import time
from collections.abc import Callable

from topologies.timeouts import QUIET_START_S


class LongStart:
    """Tells a person what a start waits for, every few seconds."""

    def __init__(self, say: Callable[[str], None] | None) -> None:
        self._say = say
        self._began_s = time.monotonic()
        self._next_s = self._began_s + QUIET_START_S

    def waits_for(self, what: str) -> None:
        now_s = time.monotonic()
        if self._say is not None and now_s >= self._next_s:
            self._say(f"still starting after {now_s - self._began_s:.0f} s: waiting for {what}")
            self._next_s = now_s + QUIET_START_S
