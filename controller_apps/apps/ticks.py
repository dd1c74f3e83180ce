"""Looks at what is due: by the wall, or whenever stepped time has gone on."""

from math import inf, isfinite

from controller_apps.openflow.framework import hub
from wire.network_time import NEVER, TICKS, GateClient, NetworkTime, SteppedTime

NS = 1_000_000_000


class Ticks:
    """When to look again, and the seconds by which devices and links count as silent.

    Stepped, the clock does not leap for a look. However far it leaps, no more than a pause counts:
    who had no time to speak is not silent.
    """

    def __init__(self, network_time: NetworkTime, pause_s: float) -> None:
        self._time, self._pause_s = network_time, pause_s
        self._gate: GateClient | None = None
        if isinstance(network_time, SteppedTime):
            self._gate = GateClient(network_time, TICKS)
        self._passed_s = 0.0

    def now_s(self) -> float:
        return self._time.background_s() if self._gate is None else self._passed_s

    def wait(self, next_s: float = inf) -> None:
        """Wait for the next look, or until `next_s` of the network's time."""
        if self._gate is None:
            hub.sleep(min(self._pause_s, self._time.wall_s(next_s - self._time.now_s())))
            return
        began_ns = self._time.now_ns()
        next_ns = self._time.since_ns + round(next_s * NS) if isfinite(next_s) else NEVER
        self._gate.wait_for(max(next_ns, began_ns + 1), began_ns + round(self._pause_s * NS))
        self._gate.take_notice()
        self._passed_s += min((self._time.now_ns() - began_ns) / NS, self._pause_s)
