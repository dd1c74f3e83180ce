"""The order in which the dispatcher does things, written down so that it can be repeated.

What changes the physical layer happens without a pause, from the beginning of a request or from
the end of a wait until the next wait. The order of these stretches, and what the clock said in
them, decide all that happens; a journal is told of each. This one does not listen.
"""

import asyncio
from contextlib import AbstractContextManager, nullcontext
from typing import Any

from wire.network_time import REAL_TIME, NetworkTime


class Journal:
    """Told when a request begins and when a wait is over."""

    def __init__(self, network_time: NetworkTime = REAL_TIME) -> None:
        """Count the time of the network."""
        self._time = network_time

    def request(self, _node: str, _kind: str, _request: Any) -> AbstractContextManager[None]:
        """Begin a request; it lasts as long as the context, its flights may last longer."""
        return nullcontext()

    async def resumed(self) -> None:
        """Go on after a wait that is not the clock's."""

    def timeout(self, limit_s: float) -> asyncio.Timeout:
        """Return the time-out of a wait, in seconds of the network."""
        return asyncio.timeout(self._time.wall_s(limit_s))
