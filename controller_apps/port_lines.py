"""The lines that a controller's log has of what hosts send: of each switch port some a second.

A program's log keeps its newest lines (topologies/networks/disk.py): who floods a port would leave
none of what others have said.
"""

import logging
from dataclasses import dataclass

from controller_apps.light.optics import SwitchPort

LINES = 5  # of a port, in a second


@dataclass
class Second:
    """What a port has had of a second."""

    began_s: float
    lines: int = 0
    left_out: int = 0


class PortLines:
    """Writes a port's share of lines, and how many more there would be."""

    def __init__(self, logger: logging.Logger) -> None:
        self._logger = logger
        self._seconds: dict[SwitchPort, Second] = {}

    def add(self, at: SwitchPort, text: str, now_s: float, level: int = logging.INFO) -> None:
        """Write a line about what came at a port, if that has not had its share."""
        if self._is_over(at, now_s):
            self._begin_anew(at)
        second = self._seconds.setdefault(at, Second(now_s))
        if second.lines < LINES:
            second.lines += 1
            self._logger.log(level, "%s", text)
        else:
            second.left_out += 1

    def time_passed(self, now_s: float) -> None:
        """Say of which ports lines were left out in a second that is over."""
        for at in [at for at in self._seconds if self._is_over(at, now_s)]:
            self._begin_anew(at)

    def _is_over(self, at: SwitchPort, now_s: float) -> bool:
        return at in self._seconds and now_s - self._seconds[at].began_s >= 1

    def _begin_anew(self, at: SwitchPort) -> None:
        if left_out := self._seconds.pop(at).left_out:
            text = "switch %#x port %d: %d more lines, which are left out"
            self._logger.info(text, at.dpid, at.port, left_out)
