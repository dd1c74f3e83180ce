"""The order of swaps in a chain of repeaters, by their places: 1, 2, 3, … from the opener on.

parallel        each as soon as both its links hold
left-to-right   each when the bits of the one to its left have come
nested          each of the odd places at once, then every second of the rest when those between
                them have reported, and so on: nested doubling (Briegel, Dür, Cirac and Zoller,
                PRL 81, 5932); a chain that is not a power of two of links is halved all the same

The schedulers: who of those that wait for light is looked at now, and in which order.

fcfs    first come, first served
edf     those of high priority first, of one priority those whose deadline is next
slots   each request the first time slot that can carry it, or it is refused at once if there is
        none by its deadline (controller_apps/sessions/slots.py)

One that finds no light lets pass who finds some. Of yours: a function that a
package registers as an entry point of qmn.schedulers.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from math import inf
from types import MappingProxyType

from wire.registered import Registry


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
ORDERS = Registry[Callable[[Waiting], Place]](
    "qmn.schedulers", callable, {FCFS: first_come, "edf": earliest_deadline, SLOTS: first_come}
)


@dataclass(frozen=True)
class Queue:
    order: str = FCFS  # of ORDERS
    slot_s: float = 0.5  # of "slots"


IN_TURN = Queue()


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


@dataclass(frozen=True)
class Purification:
    """Purification before swaps: the number of rounds at each level of a chain."""

    protocol: str = "dejmps"  # one of PROTOCOLS
    rounds: int = 0


UNPURIFIED = Purification()
PROTOCOLS: Mapping[str, int] = MappingProxyType({"bbpssw": 1, "dejmps": 2})  # as hosts number them


@dataclass(frozen=True)
class Span:
    """Pairs of two nodes of a chain, made of those of the links between them, by their places."""

    left: int
    right: int


def spans(name: str, repeaters: int) -> list[Span]:
    """Return the spans that are purified, shorter ones first.

    Those are the links, and what swaps make of them but for the last one, which the ends of the
    chain purify themselves. Where nobody waits for others, they are the links alone.
    """
    left = {place: place - 1 for place in range(1, repeaters + 2)}
    right = {place: place + 1 for place in range(repeaters + 1)}
    purified = [Span(place, place + 1) for place in right]
    for place in () if name == PARALLEL else _in_order(schedule(name, repeaters)):
        span = Span(left[place], right[place])
        left[span.right], right[span.left] = span.left, span.right
        if span != Span(0, repeaters + 1):
            purified.append(span)
    return purified


def _in_order(turns: Schedule) -> Iterator[int]:
    """Yield places such that each comes behind those it waits for."""
    done = {0}
    while len(done) <= len(turns):
        for place, turn in turns.items():
            if place not in done and {turn.after_left, turn.after_right} <= done:
                done.add(place)
                yield place


_SCHEDULES: Mapping[str, Callable[[int], Schedule]] = MappingProxyType(
    {"parallel": _parallel, "left-to-right": _left_to_right, "nested": _nested}
)
SCHEDULES = tuple(_SCHEDULES)  # what users call them
PARALLEL = "parallel"


def schedule(name: str, repeaters: int) -> Schedule:
    return _SCHEDULES[name](repeaters)
