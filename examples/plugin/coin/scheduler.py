"""A scheduler: of those that wait for light, who came last is next."""

from typing import Protocol


class Waiting(Protocol):
    since: float


def last_come(waiting: Waiting) -> tuple[float, ...]:
    """Return the place in the queue; the least is next."""
    return (-waiting.since,)
