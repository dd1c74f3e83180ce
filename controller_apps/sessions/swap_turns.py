"""The turns in which switches of a chain swap a block, if not as soon as possible.

    both memories of a place hold it, and those before have swapped --> released --outcomes--> done

Light is released by the entries that lead memories to their analyser, which are there until then.
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import groupby

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Hop
from controller_apps.policy.schedules import PARALLEL, Schedule, schedule
from wire.parameters.switch import INNER_PORTS, Kind, inner_port

Swap = tuple[Hop, ...]  # of one switch: its memories to the inputs of its analyser


@dataclass
class SwapTurns:
    """Those of one session; places are counted from 1, from the opener on."""

    swaps: tuple[Swap, ...]
    turns: Schedule
    _held: Counter[int] = field(default_factory=Counter)  # memories that hold the block, by place
    _released: set[int] = field(default_factory=set)
    _done: set[int] = field(default_factory=set)

    @property
    def hops(self) -> frozenset[Hop]:
        return frozenset(hop for swap in self.swaps for hop in swap)

    def stored(self, at: SwitchPort) -> list[Swap]:
        """Note that a memory holds a block; return the swaps that are due."""
        for place, swap in enumerate(self.swaps, 1):
            self._held[place] += sum(hop[:2] == at for hop in swap)
        return self._due()

    def measured(self, at: SwitchPort) -> tuple[Swap, list[Swap]]:
        """Note that an analyser has measured; return its swap, and those that are due now."""
        for place, swap in enumerate(self.swaps, 1):
            if place in self._released and any((hop.dpid, hop.out_port) == at for hop in swap):
                self._released.discard(place)
                self._done.add(place)
                self._held[place] -= len(swap)
                if len(self._done) == len(self.swaps):  # the next block begins
                    self._done.clear()
                return swap, self._due()
        return (), []

    def _due(self) -> list[Swap]:
        before = {0, *self._done}
        due = [
            place
            for place, swap in enumerate(self.swaps, 1)
            if self._held[place] >= len(swap)
            and place not in self._released | self._done
            and {self.turns[place].after_left, self.turns[place].after_right} <= before
        ]
        self._released.update(due)
        return [self.swaps[place - 1] for place in due]


def swap_turns(hops: Iterable[Hop], name: str) -> SwapTurns | None:
    """Return the turns of a chain by a schedule's name; None: as soon as possible."""
    releases = [hop for hop in hops if hop.in_port in INNER_PORTS and _releases(hop)]
    swaps = tuple(tuple(each) for _dpid, each in groupby(releases, key=lambda hop: hop.dpid))
    if name == PARALLEL or len(swaps) < 2:
        return None
    return SwapTurns(swaps, schedule(name, len(swaps)))


def _releases(hop: Hop) -> bool:
    return inner_port(hop.in_port).kind == Kind.MEMORY
