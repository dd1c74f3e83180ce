"""Time of the network and of the wall: one second of the network takes `scale` seconds here.

          network   0        1        2        3
    scale 1         |--------|--------|--------|
    scale 2         |-----------------|-----------------|----  wall

What is physical, and every time-out of a protocol, counts network time. Captures, events and logs
carry the wall clock. Each process converts by one of these, from its configuration.
"""

from dataclasses import dataclass

LEAST_SCALE, MOST_SCALE = 1.0, 1e9


@dataclass(frozen=True)
class NetworkTime:
    """The relation of both clocks, which agree at `since_ns` (nanoseconds since 1970).

    Raise ValueError for a scale out of range.
    """

    scale: float = 1.0
    since_ns: int = 0

    def __post_init__(self) -> None:
        # Faster than the wall would make software a larger part of time, and not a smaller one.
        if not LEAST_SCALE <= self.scale <= MOST_SCALE:
            raise ValueError(
                f"time scale {self.scale:g}: choose {LEAST_SCALE:g} to {MOST_SCALE:g} seconds here "
                "for one second of the network"
            )

    def network_ns(self, wall_ns: int) -> int:
        """Return what the clock of the network says at a time of the wall clock."""
        if self.scale == 1:
            return wall_ns
        return self.since_ns + round((wall_ns - self.since_ns) / self.scale)

    def wall_ns(self, network_ns: int) -> int:
        """Return what the wall clock says at a time of the network."""
        if self.scale == 1:
            return network_ns
        return self.since_ns + round((network_ns - self.since_ns) * self.scale)

    def network_s(self, wall_s: float) -> float:
        """Return how much time of the network passes in a time here."""
        return wall_s / self.scale

    def wall_s(self, network_s: float) -> float:
        """Return how long a time of the network takes here."""
        return network_s * self.scale


REAL_TIME = NetworkTime()  # one second of the network takes one here
