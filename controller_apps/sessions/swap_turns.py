"""The turns in which switches of a chain swap blocks, of which several are under way.

    both ends of both links of a place hold one, and those before have swapped it, purified
        --> pulses named, which releases them --outcomes--> done

The two ends of a link hold different pulses: some were lost. A memory is sent a herald of those
that are at both, so that the i-th of every link is of the i-th pair. Entries lead memories to their
analyser from the first block on; later ones leave when they are named. Hosts are ends, too, if
pairs are purified.
"""

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import groupby
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Hop
from controller_apps.light.routing import LightPath
from controller_apps.policy.schedules import UNPURIFIED, Purification, Span, schedule, spans
from controller_apps.sessions.chain_pairs import Half, Pairs
from wire.analyser_frames import MEASURING, AnalyserFrame, End, Parts, Receivers
from wire.malformed import MalformedPacket
from wire.parameters.switch import INNER_PORTS, Kind, inner_port

Swap = tuple[Hop, ...]  # of one switch: its memories, left and right, to the inputs of its analyser


class Command(NamedTuple):
    """A frame for an end: it names pulses, or has them purified."""

    at: SwitchPort | Receivers
    frame: AnalyserFrame


class Release(NamedTuple):
    """A swap that is due for the first time: its entries are to come."""

    place: int
    swap: Swap


Due = list[Command | Release]


class Hosts(NamedTuple):
    """Where frames to the hosts of a session go in, and from which address theirs come."""

    session: int = 0
    dpid: int = 0
    addresses: Mapping[Receivers, bytes] = MappingProxyType({})


NOWHERE = Hosts()


@dataclass
class SwapTurns:
    """Those of one session; places are counted from 1, from the opener on, blocks from 0."""

    swaps: tuple[Swap, ...]
    schedule: str
    purification: Purification = UNPURIFIED
    hosts: Hosts = NOWHERE
    stations: tuple[SwitchPort, ...] = ()  # of all links, if pairs that they herald are purified
    _parts: Parts = field(default_factory=Parts)  # of blocks, from ends and analysers
    # Heralds by block, of links whose other end, or station, has none yet.
    _held: defaultdict[SwitchPort, dict[int, AnalyserFrame]] = field(
        default_factory=lambda: defaultdict(dict)
    )
    _pairs: defaultdict[int, dict[Span, Pairs]] = field(default_factory=lambda: defaultdict(dict))
    # How many blocks each memory has held, each place has released and has swapped.
    _came: Counter[SwitchPort] = field(default_factory=Counter)
    _released: Counter[int] = field(default_factory=Counter)
    _done: Counter[int] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        self._turns = schedule(self.schedule, len(self.swaps))
        self._purified = spans(self.schedule, len(self.swaps))
        self._whole = Span(0, len(self.swaps) + 1)

    @property
    def hops(self) -> frozenset[Hop]:
        return frozenset(hop for swap in self.swaps for hop in swap)

    def arrived(self, at: SwitchPort | Receivers, frame: AnalyserFrame) -> Due:
        """Take what a memory holds or has purified, or an analyser measured; return what is due."""
        try:
            whole = self._parts.whole(at, frame)
        except MalformedPacket:  # a part of it was lost
            return []
        if whole is None:
            return []
        if whole.end == End.PURIFIED:
            due = self._compared(at, whole)
        elif isinstance(at, SwitchPort) and whole.end in (*MEASURING, End.STORED):
            due = (self._measured if whole.end == End.MEASURED else self._stored)(at, whole)
        else:
            return []
        return [*due, *self._due()]

    def _stored(self, at: SwitchPort, whole: AnalyserFrame) -> Due:
        """Note what a memory holds, or a station heralds; begin with the pairs of a whole link."""
        block, span = self._came[at], self._link(at)
        if span is None:
            return []
        self._came[at] += 1
        self._held[at][block] = whole
        ends = [self._end(span.left, True), self._end(span.right, False)]
        memories = [end for end in ends if isinstance(end, SwitchPort)]
        heralds = [self._held[end].get(block) for end in memories]
        if len({herald.pulses if herald else 0 for herald in heralds}) > 1 or not all(heralds):
            return []
        held = [np.frombuffer(herald.outcomes, np.uint8) for herald in heralds if herald]
        at_both = np.flatnonzero(np.bitwise_or.reduce(held) == 0)  # 0: it is held
        operators = np.zeros(at_both.size, np.uint8)
        if self.stations:
            states = self._held[self.stations[span.left]].pop(block, None)
            if states is None or (at_both.size and states.pulses != held[0].size):
                return []
            operators = np.frombuffer(states.outcomes, np.uint8)[at_both]
        numbers = {end: self._held[end].pop(block).number for end in memories}
        left, right = (
            Half(end.port, numbers[end], held[0].size, at_both)
            if isinstance(end, SwitchPort)
            else Half(end, block + 1, held[0].size, at_both)
            for end in ends
        )
        self._pairs[block][span] = Pairs.of_link(left, right, operators, self._rounds(span))
        return self._begin(block, span)

    def _compared(self, at: SwitchPort | Receivers, whole: AnalyserFrame) -> Due:
        """Note what an end has measured in a round; return what follows from it."""
        for block, made in self._pairs.items():
            for span, pairs in made.items():
                for is_right, half in enumerate((pairs.left, pairs.right)):
                    end = self._end(span.right if is_right else span.left, not is_right)
                    if (end, half.number) == (at, whole.number) and pairs.rounds:
                        over = pairs.measured(bool(is_right), whole.outcomes)
                        return self._begin(block, span) if over else []
        return []

    def _measured(self, at: SwitchPort, whole: AnalyserFrame) -> Due:
        """Note that an analyser has measured a block, which joins the pairs at its sides."""
        for place, swap in enumerate(self.swaps, 1):
            is_here = any((hop.dpid, hop.out_port) == at for hop in swap)
            if is_here and self._done[place] < self._released[place]:
                block = self._done[place]
                self._done[place] += 1
                made, (left, right) = self._pairs[block], self._sides(block, place)
                span = Span(left.left, right.right)
                outcomes = np.frombuffer(whole.outcomes, np.uint8)
                joined = made.pop(left).joined(made.pop(right), outcomes, self._rounds(span))
                made[span] = joined
                return self._begin(block, span)
        return []

    def _begin(self, block: int, span: Span) -> Due:
        """Begin the next round of pairs, if there is one; tell hosts the last of all."""
        pairs, frames = self._pairs[block][span], list[AnalyserFrame]()
        if pairs.rounds:
            seed = self.hosts.session, block, span.left, span.right, pairs.rounds
            frames = pairs.begin_round(self.purification.protocol, seed)
        elif span == self._whole:
            del self._pairs[block]
            rounds = self.purification.rounds
            frames = pairs.last(rounds) if rounds else []
        ends = self._end(span.left, True), self._end(span.right, False)
        return [Command(*each) for each in zip(ends, frames, strict=False)]

    def _due(self) -> Due:
        """Return what is due; of a place block after block."""
        due = Due()
        for place, swap in enumerate(self.swaps, 1):
            turn = self._turns[place]
            before = {turn.after_left, turn.after_right} - {0}
            while self._is_ready(self._released[place], place) and all(
                self._done[other] > self._released[place] for other in before
            ):
                due += self._release(place, swap)
        return due

    def _is_ready(self, block: int, place: int) -> bool:
        """Whether pairs at both sides of a place are as they are to be swapped."""
        made = self._pairs.get(block, {})
        sides = self._sides(block, place)
        return len(sides) == len(("left", "right")) and not any(made[span].rounds for span in sides)

    def _release(self, place: int, swap: Swap) -> Due:
        block = self._released[place]
        self._released[place] += 1
        left, right = (self._pairs[block][span] for span in self._sides(block, place))
        named: Due = [
            Command(SwitchPort(hop.dpid, hop.in_port), half.frame(End.STORED, 0))
            for hop, half in zip(swap, (left.right, right.left), strict=True)
        ]
        return [*named, Release(place, swap)] if block == 0 else named

    def _sides(self, block: int, place: int) -> list[Span]:
        """Return between which ends pairs of a block are to the left and right of a place."""
        made = self._pairs.get(block, {})
        left = [span for span in made if span.right == place]
        return [*left, *(span for span in made if span.left == place)]

    def _rounds(self, span: Span) -> int:
        return self.purification.rounds if span in self._purified else 0

    def _end(self, place: int, to_the_right: bool) -> SwitchPort | Receivers:
        """Return the memory of a place for pairs to one side of it, or a host."""
        if place in (self._whole.left, self._whole.right):
            return Receivers.ACCEPTOR if place else Receivers.OPENER
        hop = self.swaps[place - 1][to_the_right]
        return SwitchPort(hop.dpid, hop.in_port)

    def _link(self, at: SwitchPort) -> Span | None:
        """Return the link that a memory is an end of, or that a station heralds."""
        if at in self.stations:
            place = self.stations.index(at)
            return Span(place, place + 1)
        for place, swap in enumerate(self.swaps, 1):
            for to_the_right, hop in enumerate(swap):
                if (hop.dpid, hop.in_port) == at:
                    return Span(place - 1 + to_the_right, place + to_the_right)
        return None


def swap_turns(
    hops: Iterable[Hop], name: str, purification: Purification, hosts: Hosts
) -> SwapTurns | None:
    """Return the turns of a chain by a schedule's name; None: no memory holds its light."""
    hops = list(hops)
    releases = [hop for hop in hops if _is_memory(hop.in_port)]
    swaps = tuple(tuple(each) for _dpid, each in groupby(releases, key=lambda hop: hop.dpid))
    stations = [
        SwitchPort(hop.dpid, hop.out_port)
        for hop in hops
        if hop not in releases and _is_input(hop.out_port) and purification.rounds
    ]
    return SwapTurns(swaps, name, purification, hosts, tuple(stations)) if swaps else None


def are_stored(paths: Iterable[LightPath]) -> bool:
    """Whether light of a chain goes to analysers from memories."""
    return any(_is_memory(hop.in_port) for path in paths for hop in path.hops)


def heralds_to_hosts(paths: tuple[LightPath, ...], dpid: int) -> dict[int, Receivers]:
    """Return which memories of a switch hold light of a host, and what host that is."""
    lasts = [path.hops[-1] for path in (paths[0], paths[-1])]
    ends = zip(lasts, (Receivers.OPENER, Receivers.ACCEPTOR), strict=True)
    return {
        last.out_port: to for last, to in ends if last.dpid == dpid and _is_memory(last.out_port)
    }


def _is_input(port: int) -> bool:
    """Whether a port is the first input of an analyser, by which it reports."""
    inner = inner_port(port) if port in INNER_PORTS else None
    return inner is not None and (inner.kind, inner.which) == (Kind.ANALYSER, 1)


def _is_memory(port: int) -> bool:
    return port in INNER_PORTS and inner_port(port).kind == Kind.MEMORY
