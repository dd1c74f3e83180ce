"""The order of swaps in a chain of repeaters, by their places: 1, 2, 3, … from the opener on.

parallel        each as soon as both its links hold
left-to-right   each when the bits of the one to its left have come
nested          each of the odd places at once, then every second of the rest when those between
                them have told it, and so on: nested doubling (Briegel, Dür, Cirac and Zoller,
                PRL 81, 5932); a chain that is no power of two of links is halved all the same
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True)
class Turn:
    """When a repeater swaps: after those at these places; 0 is nobody."""

    after_left: int = 0
    after_right: int = 0


Schedule = Mapping[int, Turn]  # by place


def _parallel(repeaters: int) -> Schedule:
    return {place: Turn() for place in range(1, repeaters + 1)}


def _left_to_right(repeaters: int) -> Schedule:
    return {place: Turn(after_left=place - 1) for place in range(1, repeaters + 1)}


def _nested(repeaters: int) -> Schedule:
    turns: dict[int, Turn] = {}

    def last_of(first: int, last: int) -> int:
        """Schedule these places; return the one that swaps last, 0 if there are none."""
        if first > last:
            return 0
        middle = (first + last) // 2
        turns[middle] = Turn(last_of(first, middle - 1), last_of(middle + 1, last))
        return middle

    last_of(1, repeaters)
    return turns


_SCHEDULES: Mapping[str, Callable[[int], Schedule]] = MappingProxyType(
    {"parallel": _parallel, "left-to-right": _left_to_right, "nested": _nested}
)
SCHEDULES = tuple(_SCHEDULES)  # what users call them
PARALLEL = "parallel"


def schedule(name: str, repeaters: int) -> Schedule:
    """Return when each of so many repeaters swaps."""
    return _SCHEDULES[name](repeaters)
