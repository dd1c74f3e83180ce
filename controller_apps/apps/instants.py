"""Decides at the end of an instant of stepped time on all that came then, in order.

Two hosts that ask for the same light at one instant: the machine must not say who gets it.
"""

from collections.abc import Callable

from controller_apps.light.optics import SwitchPort
from controller_apps.openflow.framework import hub
from wire.network_time import CONTROLLER, NEVER, GateClient, NetworkTime, SteppedTime

ENDS = slice(26, 38)  # of a frame with TCP over IPv4: addresses and ports


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
        """Return what has come, by the ends of its connections."""
        came, self._came = sorted(self._came, key=lambda each: each[1][ENDS]), []
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
