"""The clock of a program that people have written, whose pauses count stepped time of the network.

`time.sleep`, `time.time` and `time.monotonic` of Python are replaced; each thread waits by itself.
"""

import select
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from unittest.mock import patch

from programs.network_waits import NetworkWaits
from wire.network_time import REAL_TIME, NetworkTime, SteppedTime


class _Waits(threading.local):
    time: NetworkTime = REAL_TIME

    @property
    def own(self) -> NetworkWaits:
        if "_own" not in vars(self):
            self._own = NetworkWaits(_Waits.time)
        return self._own

    def close(self) -> None:
        """Forget those of this thread: later ones may count another time."""
        if "_own" in vars(self):
            vars(self).pop("_own").close()


_waits = _Waits()


@contextmanager
def counting(network_time: NetworkTime) -> Iterator[None]:
    """Let this program count stepped time meanwhile; paced, it counts that of the wall."""
    if not isinstance(network_time, SteppedTime):
        yield
        return
    _waits.close()
    with (
        closing(_waits),
        patch.object(_Waits, "time", network_time),
        patch.object(time, "sleep", lambda seconds: _waits.own.sleep(seconds)),
        patch.object(time, "time", lambda: network_time.now_ns() / 1e9),
        patch.object(time, "monotonic", network_time.now_s),
    ):
        yield


def ready(poll: select.poll, seconds: float | None) -> bool:
    """Return whether a file is ready within seconds; None: wait until one is."""
    return _waits.own.ready(poll, seconds)
