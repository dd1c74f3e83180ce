"""Looks at what is due: by the wall, or whenever stepped time has gone on.

Decides at the end of an instant of stepped time on all that came then, in order.

Two hosts that ask for the same light at one instant: the machine must not say who gets it.
"""

from collections.abc import Callable
from math import inf, isfinite

from controller_apps.light.optics import SwitchPort
from controller_apps.openflow.framework import hub
from controller_apps.packets import SYN
from wire.network_time import CONTROLLER, NEVER, TICKS, GateClient, NetworkTime, SteppedTime

NS = 1_000_000_000


class Ticks:
    """When to look again, and the seconds by which devices and links count as silent.

    Stepped, the clock does not leap for a look. However far it leaps, no more than a pause counts:
    who had no time to speak is not silent.
    """

    def __init__(self, network_time: NetworkTime, pause_s: float, turn: int = TICKS) -> None:
        self._time, self._pause_s = network_time, pause_s
        self._gate: GateClient | None = None
        if isinstance(network_time, SteppedTime):
            self._gate = GateClient(network_time, turn)
        self._passed_s, self._began_ns = 0.0, network_time.now_ns()

    def now_s(self) -> float:
        return self._time.background_s() if self._gate is None else self._passed_s

    def wait(self, next_s: float = inf) -> None:
        """Wait for the next look, or until `next_s` of the network's time."""
        if self._gate is None:
            hub.sleep(min(self._pause_s, self._time.wall_s(next_s - self._time.now_s())))
            return
        self._began_ns = self._time.now_ns()
        self.wake_by(lambda: next_s)
        self._gate.take_notice()
        self._passed_s += min((self._time.now_ns() - self._began_ns) / NS, self._pause_s)

    def wake_by(self, look_s: Callable[[], float]) -> None:
        """Have who waits look at that time of the network; paced, no pause is long."""
        if self._gate is None:
            return
        next_s = look_s()
        next_ns = self._time.since_ns + round(next_s * NS) if isfinite(next_s) else NEVER
        next_ns = max(next_ns, self._time.now_ns() + 1)
        self._gate.wait_for(next_ns, self._began_ns + round(self._pause_s * NS))


# Of a frame with TCP over IPv4: addresses and ports, and the octet of flags.
ENDS, FLAGS = slice(26, 38), 47


class Instants:
    """Keeps frames until the instant at which they have come is over."""

    def __init__(self, time: NetworkTime, over: Callable[[], None]) -> None:
        """Call `over` at the end of each instant that brought something; paced, there is none."""
        self._time, self._over = time, over
        self._gate = GateClient(time, CONTROLLER) if isinstance(time, SteppedTime) else None
        self._came: list[tuple[SwitchPort, bytes]] = []

    def start(self) -> None:
        if self._gate is not None:
            hub.spawn(self._notice, self._gate)

    def keeps(self, at: SwitchPort, frame: bytes) -> bool:
        """Keep a frame; return False if it is to be looked at now."""
        if self._gate is None:
            return False
        self._came.append((at, frame))
        if len(self._came) == 1:
            self._gate.wait_for(self._time.now_ns())
        return True

    def take(self) -> list[tuple[SwitchPort, bytes]]:
        """Return what has come: openings of connections, then the rest, by their ends."""
        came, self._came = sorted(self._came, key=_turn), []
        return came

    def go_on(self) -> None:
        """Let time go on: what has come is done."""
        assert self._gate is not None
        self._gate.wait_for(NEVER)

    def close(self) -> None:
        """Let time pass without the controller."""
        if self._gate is not None:
            self._gate.close()

    def _notice(self, gate: GateClient) -> None:
        while True:
            gate.take_notice()
            self._over()


def _turn(came: tuple[SwitchPort, bytes]) -> tuple[bool, bytes]:
    frame = came[1]
    opens = len(frame) > FLAGS and bool(frame[FLAGS] & SYN)
    return not opens, frame[ENDS]
