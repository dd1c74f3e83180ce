"""The turns in which switches of a chain swap blocks, of which several are under way.

    both ends of both links of a place hold one, and those before have swapped it
        --> pulses named, which releases them --outcomes--> done

The two ends of a link hold different pulses: some were lost. A memory is sent a herald of those
that are at both, so that the i-th of every link is of the i-th pair. Entries lead memories to their
analyser from the first block on; later ones leave when they are named.
"""

from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import NamedTuple

import numpy as np

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Hop
from controller_apps.light.routing import LightPath
from controller_apps.policy.schedules import Schedule, schedule
from wire.analyser_frames import AnalyserFrame, Receivers
from wire.parameters.switch import INNER_PORTS, Kind, inner_port

Swap = tuple[Hop, ...]  # of one switch: its memories to the inputs of its analyser


class Release(NamedTuple):
    """A swap that is due: of each of its memories, the pulses that both ends of a link hold."""

    place: int
    swap: Swap
    is_first: bool  # of the session there: its entries are to come
    pulses: tuple[tuple[SwitchPort, AnalyserFrame], ...]


@dataclass
class SwapTurns:
    """Those of one session; places are counted from 1, from the opener on, blocks from 0."""

    swaps: tuple[Swap, ...]
    turns: Schedule
    # Heralds of each memory, by block; what is not whole yet.
    _held: defaultdict[SwitchPort, dict[int, AnalyserFrame]] = field(
        default_factory=lambda: defaultdict(dict)
    )
    _begun: dict[SwitchPort, AnalyserFrame] = field(default_factory=dict)
    # How many blocks each memory has held, each place has released and has swapped.
    _came: Counter[SwitchPort] = field(default_factory=Counter)
    _released: Counter[int] = field(default_factory=Counter)
    _done: Counter[int] = field(default_factory=Counter)

    @property
    def hops(self) -> frozenset[Hop]:
        return frozenset(hop for swap in self.swaps for hop in swap)

    def stored(self, at: SwitchPort, herald: AnalyserFrame) -> list[Release]:
        """Note that a memory holds pulses; return the swaps that are due."""
        begun = self._begun.pop(at, None) if herald.first else None
        before = begun.outcomes if begun and begun.number == herald.number else b""
        if herald.first != len(before):  # a part of it was lost
            return []
        whole = replace(herald, first=0, outcomes=before + herald.outcomes)
        if len(whole.outcomes) < whole.pulses:
            self._begun[at] = whole
            return []
        self._held[at][self._came[at]] = whole
        self._came[at] += 1
        return self._due()

    def measured(self, at: SwitchPort) -> list[Release]:
        """Note that an analyser has measured a block; return the swaps that are due now."""
        for place, swap in enumerate(self.swaps, 1):
            if any((hop.dpid, hop.out_port) == at for hop in swap):
                if self._done[place] < self._released[place]:
                    self._done[place] += 1
                    self._forget(self._done[place] - 1)
                return self._due()
        return []

    def _forget(self, block: int) -> None:
        """Forget a block that all have swapped."""
        if all(self._done[place] > block for place in range(1, len(self.swaps) + 1)):
            for heralds in self._held.values():
                heralds.pop(block, None)

    def _release(self, place: int) -> Release:
        swap, block = self.swaps[place - 1], self._released[place]
        self._released[place] += 1
        pulses = []
        for hop in swap:
            at = SwitchPort(hop.dpid, hop.in_port)
            heralds = [self._held[end][block] for end in self._link(at)]
            held = [np.frombuffer(herald.outcomes, np.uint8) for herald in heralds]
            both = np.bitwise_or.reduce(held).tobytes()  # 0: it is held
            pulses.append((at, replace(heralds[0], outcomes=both)))
        return Release(place, swap, block == 0, tuple(pulses))

    def _link(self, at: SwitchPort) -> list[SwitchPort]:
        """Return a memory, and that at the other end of its link; a host has none."""
        memories = [SwitchPort(hop.dpid, hop.in_port) for swap in self.swaps for hop in swap]
        place = memories.index(at)
        other = place - 1 if place % 2 == 0 else place + 1
        return [at, memories[other]] if 0 <= other < len(memories) else [at]

    def _is_held(self, at: SwitchPort, block: int) -> bool:
        """Whether both ends of a link hold a block."""
        heralds = [self._held[end].get(block) for end in self._link(at)]
        return all(heralds) and len({each.pulses for each in heralds if each}) == 1

    def _due(self) -> list[Release]:
        """Return what is due; of a place block after block."""
        due = []
        for place, swap in enumerate(self.swaps, 1):
            before = {self.turns[place].after_left, self.turns[place].after_right} - {0}
            while all(
                self._is_held(SwitchPort(*hop[:2]), self._released[place]) for hop in swap
            ) and all(self._done[other] > self._released[place] for other in before):
                due.append(self._release(place))
        return due


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
