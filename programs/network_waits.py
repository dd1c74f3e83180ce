"""Waits of a program without an event loop, in time of the network."""

import select
import time
from typing import Self

from wire.network_time import NEVER, GateClient, NetworkTime, SteppedTime


class NetworkWaits:
    """The instant up to which a program lets stepped time pass."""

    def __init__(self, network_time: NetworkTime) -> None:
        self.time = network_time
        self._gate = GateClient(network_time) if isinstance(network_time, SteppedTime) else None

    def hold(self) -> None:
        """Let stepped time stand until `pass_until`."""
        self.pass_until(self.time.now_ns())

    def pass_until(self, time_ns: int = NEVER) -> None:
        """Let stepped time pass, at most up to an instant; return at once."""
        if self._gate is not None:
            self._gate.wait_for(time_ns)

    def sleep(self, seconds: float) -> None:
        """Return after seconds of the network."""
        if self._gate is None:
            time.sleep(self.time.wall_s(seconds))
            return
        self.ready(select.poll(), seconds)

    def ready(self, poll: select.poll, seconds: float | None) -> bool:
        """Return whether a file is ready within seconds of the network; None: wait until one is."""
        if self._gate is None or seconds is None:
            return bool(poll.poll(None if seconds is None else 1e3 * self.time.wall_s(seconds)))
        due_ns = self.time.now_ns() + round(1e9 * seconds)
        poll.register(self._gate, select.POLLIN)
        self._gate.wait_for(due_ns)
        try:
            while True:
                files = {file for file, _event in poll.poll()}
                if self._gate.fileno() in files:
                    self._gate.take_notice()
                if files - {self._gate.fileno()}:
                    return True
                if self.time.now_ns() >= due_ns:
                    return False
        finally:
            self._gate.wait_for(NEVER)

    def close(self) -> None:
        """Disconnect: time does not wait for this program any more."""
        if self._gate is not None:
            self._gate.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()
