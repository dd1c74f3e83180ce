"""Orders for chains of repeaters on their way to the hosts: sent again until they are answered."""

from collections.abc import Iterator
from dataclasses import dataclass, field

from controller_apps.framework import Event
from controller_apps.sessions.actions import SwapsOrdered
from wire.device import SwapOrder

ORDER_DEADLINE_S = 4.0  # hosts wait 5 s for theirs


class EventSwapsOrdered(Event):
    """A chain has been chosen."""

    def __init__(self, ordered: SwapsOrdered) -> None:
        super().__init__()
        self.ordered = ordered


@dataclass
class SwapOrders:
    """The orders that no host has answered yet, by host and number."""

    _waiting: dict[tuple[str, int], tuple[SwapOrder, float]] = field(default_factory=dict)

    def add(self, host: str, order: SwapOrder, now: float) -> None:
        """Send it from now on."""
        self._waiting[host, order.session] = order, now + ORDER_DEADLINE_S

    def answered(self, host: str, number: int) -> None:
        """Send it no more."""
        self._waiting.pop((host, number), None)

    def due(self) -> Iterator[tuple[str, SwapOrder]]:
        """Yield what has to be sent again, and to which host."""
        for (host, _number), (order, _until) in list(self._waiting.items()):
            yield host, order

    def give_up(self, now: float) -> list[tuple[str, SwapOrder]]:
        """Drop and return what has not been answered in time."""
        late = [key for key, (_order, until) in self._waiting.items() if until <= now]
        return [(host, self._waiting.pop((host, number))[0]) for host, number in late]
