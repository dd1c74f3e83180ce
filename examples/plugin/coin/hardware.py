"""A QNIC that says in its host's log how many steps it has performed."""

import logging
from typing import Any

from qmn.services import SimulatedQnic

log = logging.getLogger(__name__)


class CountingQnic(SimulatedQnic):
    steps = 0

    async def perform(self, *order: Any) -> Any:
        """Perform steps, and count them."""
        self.steps += len(order)
        return await super().perform(*order)

    async def discard(self, session: int) -> None:
        """End a session, and say how many steps there were."""
        log.warning("counting: %d steps so far", self.steps)
        await super().discard(session)
