"""The schedulers: who of those that wait for light is looked at now, and in which order.

fcfs    first come, first served
edf     those of high priority first, of one priority those whose deadline is next
slots   each request the first time slot that can carry it, or it is refused at once if there is
        none by its deadline (controller_apps/sessions/slots.py)

One that finds no light lets pass who finds some. Of yours: a function here, and a line in ORDERS.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf
from types import MappingProxyType


@dataclass(frozen=True)
class Waiting:
    """A request that waits, as schedulers see it; times are seconds of one steady clock."""

    since: float
    priority: int = 0  # the higher the sooner
    deadline: float = inf  # by which it wants to have light


Place = tuple[float, ...]  # in the queue: the least is next


def first_come(waiting: Waiting) -> Place:
    return (waiting.since,)


def earliest_deadline(waiting: Waiting) -> Place:
    """Return the place of a request by priority, then by deadline (Jackson, 1955)."""
    return (-waiting.priority, waiting.deadline, waiting.since)


FCFS, SLOTS = "fcfs", "slots"
ORDERS: Mapping[str, Callable[[Waiting], Place]] = MappingProxyType(
    {FCFS: first_come, "edf": earliest_deadline, SLOTS: first_come}
)


@dataclass(frozen=True)
class Queue:
    """What a policy says of waiting."""

    order: str = FCFS  # of ORDERS
    slot_s: float = 0.5  # of "slots"


IN_TURN = Queue()
