"""How often a page hears of news: seldom where it would take processors from its network.

A browser that draws 16 pictures a second takes a tenth or more of a processor. Where nothing else
wants that, nobody misses it; where all processors are in use, the network that is shown does.
"""

import time
from collections.abc import Callable
from pathlib import Path

from qmn.timeouts import LIVE_LIST_S, LIVE_LOOK_S, LIVE_SELDOM_S

# Shares of the processors that are idle: with less it is seldom, with more often again. A page
# that seldom hears of news leaves more of them idle, which is no reason to update it often.
NONE_LEFT, SOME_LEFT = 0.05, 0.25
STAT = Path("/proc/stat")
Times = tuple[int, int]  # of all processors since the machine has started: idle, and in all


def processor_times() -> Times:
    with STAT.open() as file:
        clocks = [int(word) for word in file.readline().split()[1:9]]
    idle, waiting = clocks[3:5]
    return idle + waiting, sum(clocks)


class Pace:
    """Knows how much of the machine is in use, as of the last seconds."""

    def __init__(self, times: Callable[[], Times] = processor_times) -> None:
        self.pause_s = LIVE_LIST_S  # between two lists of messages
        self._times = times
        self._before = times()
        self._looked_s = time.monotonic()

    def look(self) -> float:
        now_s = time.monotonic()
        if now_s - self._looked_s < LIVE_LOOK_S:
            return self.pause_s
        (idle_before, all_before), (idle, every) = self._before, self._times()
        self._looked_s, self._before = now_s, (idle, every)
        share = (idle - idle_before) / max(every - all_before, 1)
        if share < NONE_LEFT:
            self.pause_s = LIVE_SELDOM_S
        elif share > SOME_LEFT:
            self.pause_s = LIVE_LIST_S
        return self.pause_s
