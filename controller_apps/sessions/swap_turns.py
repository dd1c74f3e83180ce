"""The turns in which switches of a chain swap a block.

    both ends of both links of a place hold it, and those before have swapped
        --> pulses named, memories released --outcomes--> done

The two ends of a link hold different pulses: some were lost. A memory is sent a herald of those
that are at both, so that the i-th of every link is of the i-th pair. Light is released by the
entries that lead memories to their analyser, which are there until then.
"""

from collections import defaultdict, deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import groupby

import numpy as np

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Hop
from controller_apps.light.routing import LightPath
from controller_apps.policy.schedules import Schedule, schedule
from wire.analyser_frames import AnalyserFrame, Receivers
from wire.parameters.switch import INNER_PORTS, Kind, inner_port

Swap = tuple[Hop, ...]  # of one switch: its memories to the inputs of its analyser


@dataclass
class SwapTurns:
    """Those of one session; places are counted from 1, from the opener on."""

    swaps: tuple[Swap, ...]
    turns: Schedule
    # Heralds of each memory, of this block and later ones; what is not whole yet.
    _held: defaultdict[SwitchPort, deque[AnalyserFrame]] = field(
        default_factory=lambda: defaultdict(deque)
    )
    _begun: dict[SwitchPort, AnalyserFrame] = field(default_factory=dict)
    _released: set[int] = field(default_factory=set)
    _done: set[int] = field(default_factory=set)

    @property
    def hops(self) -> frozenset[Hop]:
        return frozenset(hop for swap in self.swaps for hop in swap)

    def stored(self, at: SwitchPort, herald: AnalyserFrame) -> list[Swap]:
        """Note that a memory holds pulses; return the swaps that are due."""
        begun = self._begun.pop(at, None) if herald.first else None
        before = begun.outcomes if begun and begun.number == herald.number else b""
        if herald.first != len(before):  # a part of it was lost
            return []
        whole = replace(herald, first=0, outcomes=before + herald.outcomes)
        if len(whole.outcomes) < whole.pulses:
            self._begun[at] = whole
            return []
        self._held[at].append(whole)
        return self._due()

    def measured(self, at: SwitchPort) -> tuple[Swap, list[Swap]]:
        """Note that an analyser has measured; return its swap, and those that are due now."""
        for place, swap in enumerate(self.swaps, 1):
            if place in self._released and any((hop.dpid, hop.out_port) == at for hop in swap):
                self._released.discard(place)
                self._done.add(place)
                if len(self._done) == len(self.swaps):  # the next block begins
                    self._done.clear()
                    for heralds in self._held.values():
                        heralds.popleft()
                return swap, self._due()
        return (), []

    def named(self, swap: Swap) -> Iterator[tuple[SwitchPort, AnalyserFrame]]:
        """Yield, for each memory of a swap, the pulses that both ends of its link hold."""
        for hop in swap:
            at = SwitchPort(hop.dpid, hop.in_port)
            heralds = [self._held[end][0] for end in self._link(at)]
            held = [np.frombuffer(herald.outcomes, np.uint8) for herald in heralds]
            both = np.bitwise_or.reduce(held).tobytes()  # 0: it is held
            yield at, replace(heralds[0], outcomes=both)

    def _link(self, at: SwitchPort) -> list[SwitchPort]:
        """Return a memory, and that at the other end of its link; a host has none."""
        memories = [SwitchPort(hop.dpid, hop.in_port) for swap in self.swaps for hop in swap]
        place = memories.index(at)
        other = place - 1 if place % 2 == 0 else place + 1
        return [at, memories[other]] if 0 <= other < len(memories) else [at]

    def _is_held(self, at: SwitchPort) -> bool:
        """Whether both ends of a link hold the same block."""
        heralds = [self._held[end] for end in self._link(at)]
        return all(heralds) and len({each[0].pulses for each in heralds}) == 1

    def _due(self) -> list[Swap]:
        before = {0, *self._done}
        due = [
            place
            for place, swap in enumerate(self.swaps, 1)
            if all(self._is_held(SwitchPort(*hop[:2])) for hop in swap)
            and place not in self._released | self._done
            and {self.turns[place].after_left, self.turns[place].after_right} <= before
        ]
        self._released.update(due)
        return [self.swaps[place - 1] for place in due]


def swap_turns(hops: Iterable[Hop], name: str) -> SwapTurns | None:
    """Return the turns of a chain by a schedule's name; None: no memory holds its light."""
    releases = [hop for hop in hops if _is_memory(hop.in_port)]
    swaps = tuple(tuple(each) for _dpid, each in groupby(releases, key=lambda hop: hop.dpid))
    return SwapTurns(swaps, schedule(name, len(swaps))) if swaps else None


def heralds_to_hosts(paths: tuple[LightPath, ...], dpid: int) -> dict[int, Receivers]:
    """Return which memories of a switch hold light of a host, and what host that is."""
    lasts = [path.hops[-1] for path in (paths[0], paths[-1])]
    ends = zip(lasts, (Receivers.OPENER, Receivers.ACCEPTOR), strict=True)
    return {
        last.out_port: to for last, to in ends if last.dpid == dpid and _is_memory(last.out_port)
    }


def _is_memory(port: int) -> bool:
    return port in INNER_PORTS and inner_port(port).kind == Kind.MEMORY
