"""The leaps of a stepped clock as a run keeps them, by which captures get the network's time."""

import struct
from bisect import bisect_right
from collections.abc import Callable
from pathlib import Path

from wire.pcapng import PcapReader

LEAPS = "clock.leaps"  # in the folder of a run
LEAP = struct.Struct("=QQ")  # when, by the wall, and to which instant


class LeapingClock:
    """The network's clock at times of the wall; the wall's own before the first leap."""

    def __init__(self, run: Path) -> None:
        file = run / LEAPS
        leaps = file.read_bytes() if file.exists() else b""
        self._leaps = [*LEAP.iter_unpack(leaps[: len(leaps) // LEAP.size * LEAP.size])]

    def at(self, wall_ns: int) -> int:
        number = bisect_right(self._leaps, wall_ns, key=lambda leap: leap[0])
        return int(self._leaps[number - 1][1]) if number else wall_ns

    def of(self, capture: PcapReader) -> Callable[[int], int]:
        """Return what gives the network's time (ns) for the times that a capture has."""
        return int if capture.network_time else self.at
