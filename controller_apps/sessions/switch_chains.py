"""Chains of quantum switches that swap: the hops of light through their memories and analysers.

    alice --- mL q1 mR <-- source 1 of q1 --> mL q2 mR --- bob
              |     |                         |     |
              +-[x]-+                         +-[x]-+

Light of a memory goes on to an analyser of its switch: swaps are as soon as possible. A switch
without memories, alone between two hosts, has their light meet in its analyser.

When the first memory holds a block of the opener's, all sources emit one as large.

Where memories emit, stations in further switches herald their links, and no sources are needed:

    alice --- (x) station of q1 --- eL q2 eR --- (x) station of q3 --- bob

They attempt when the opener's qubits do, by one input of the first station.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import reduce
from itertools import islice, pairwise
from operator import xor
from typing import NamedTuple

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Hop, Network, directions
from controller_apps.light.routing import LightPath, Limits
from controller_apps.sessions.actions import Emit
from controller_apps.sessions.sessions import Session
from wire.analyser_frames import MAX_UNDER_WAY, AnalyserFrame, Emission
from wire.parameters.switch import (
    FIRST_EMITTER_PORT,
    FIRST_MEMORY_PORT,
    HALVES,
    INNER_PORTS,
    Kind,
    inner_port,
)

MEMORIES = 2  # of a switch that swaps: one for light of each side


class Parts(NamedTuple):
    """The inner ports of one switch that a chain takes."""

    inputs: Sequence[int]  # of an analyser
    memories: Sequence[int]  # none: light goes straight to the analyser
    source: Sequence[int]  # none: there is no free one
    emitters: Sequence[int] = ()  # of the memories; none: they do not emit

    @property
    def left(self) -> int:
        return self.memories[0] if self.memories else self.inputs[0]

    @property
    def right(self) -> int:
        return self.memories[1] if self.memories else self.inputs[1]


def parts_of(network: Network, dpid: int, limits: Limits) -> Parts | None:
    """Return parts of a switch that are free; None if there is no free analyser."""
    groups: dict[tuple[Kind, int], list[int]] = {}
    for port in sorted(network.inner.get(dpid, ())):
        inner, light = inner_port(port), directions([Hop(dpid, port, port)])
        if not any(map(limits.blocked, light)):
            groups.setdefault((inner.kind, inner.number), []).append(port)
    whole: dict[Kind, list[list[int]]] = {kind: [] for kind in Kind}
    for (kind, _number), ports in groups.items():
        if kind in (Kind.MEMORY, Kind.EMITTER) or len(ports) == HALVES:
            whole[kind].append(ports)
    if not whole[Kind.ANALYSER]:
        return None
    memories = [port for ports in whole[Kind.MEMORY] for port in ports][:MEMORIES]
    memories = memories if len(memories) == MEMORIES else []
    source = whole[Kind.SOURCE][0] if whole[Kind.SOURCE] else []
    emitting = [port + FIRST_EMITTER_PORT - FIRST_MEMORY_PORT for port in memories]
    emitters = emitting if all([port] in whole[Kind.EMITTER] for port in emitting) else []
    return Parts(whole[Kind.ANALYSER][0], memories, source, emitters)


def swapping(
    network: Network, path: LightPath, count: int, limits: Limits, heralded: bool = False
) -> tuple[LightPath, ...] | str:
    """Return the light of a chain of this many switches along a path, or why it cannot be.

    Of heralded links every second switch swaps, and those between are stations.
    """
    able = list(islice(_able(network, path, limits, None if heralded else count > 1), count))
    if heralded and count == 1:
        able = _halfway(network, path, limits)
    if len(able) < count or (heralded and count % 2 == 0):
        parts_wanted = "a free analyser and memories"
        if heralded:
            parts_wanted = "in turn a free station, or an analyser and memories that emit"
        return f"{len(able)} of {count} switches on the way have {parts_wanted}"
    for place, parts in able[:-1] if not heralded else ():
        if not parts.source:
            return f"{network.name_of(path.hops[place].dpid)} has no free source"
    budget_mdb, most_mdb = limits.loss_budget_mdb, _most_loss_mdb(network, path, able)
    if budget_mdb is not None and most_mdb > budget_mdb:
        text = f"a link of the chain loses {most_mdb / 1000:g} dB: "
        return text + f"raise --loss-budget-db ({budget_mdb / 1000:g}), or shorten its fibres"
    lit = (_heralded_light if heralded else _light)(path, able)
    paths = tuple(replace(each, rotation=_rotation(network, each.hops)) for each in lit)
    hops = [hop for each in paths for hop in each.hops]
    if any(map(limits.blocked, directions(hops))):
        return "others have light on the way"
    return paths


def _rotation(network: Network, hops: Sequence[Hop]) -> int:
    passed = (network.optics.path(*hop) for hop in hops)
    return reduce(xor, (each.rotation for each in passed if each is not None), 0)


def _able(
    network: Network, path: LightPath, limits: Limits, stores: bool | None
) -> Iterator[tuple[int, Parts]]:
    """Yield the switches along a path that can take part, which store; None: by turns they emit."""
    emits = False
    for place, hop in enumerate(path.hops):
        parts = parts_of(network, hop.dpid, limits)
        if parts is None:
            continue
        if (bool(parts.emitters) == emits) if stores is None else (parts.memories or not stores):
            emits = not emits
            yield place, parts


def _halfway(network: Network, path: LightPath, limits: Limits) -> list[tuple[int, Parts]]:
    """Return the station along a path whose farther arm loses least, if there is one."""
    able = [each for each in _able(network, path, limits, False) if not each[1].emitters]
    return sorted(able, key=lambda each: _most_loss_mdb(network, path, [each]))[:1]


def most_pairs(
    network: Network, paths: Sequence[LightPath], pairs: int, blocks: int = MAX_UNDER_WAY
) -> int:
    """Return how many pairs blocks of a chain may have: as many as all under way may be stored."""
    firsts = [SwitchPort(*path.hops[0][:2]) for path in paths]
    modes = [network.modes[at] for at in firsts if at in network.modes]
    return max(1, min([pairs, *(mode // blocks for mode in modes)]))


def _most_loss_mdb(network: Network, path: LightPath, able: Sequence[tuple[int, Parts]]) -> int:
    """Return the loss of the worst link along a path, in thousandths of a dB.

    Light of a link passes the switches at both of its ends, too.
    """
    optics, hops = network.optics, path.hops
    switches = [optics.path(*hop) for hop in hops]
    passed_mdb = [0 if switch is None else switch.loss_mdb for switch in switches]
    entered_mdb = [optics.fiber_loss_mdb(SwitchPort(hops[0].dpid, hops[0].in_port), None)]
    for place, (near, far) in enumerate(pairwise(hops)):
        start, end = SwitchPort(near.dpid, near.out_port), SwitchPort(far.dpid, far.in_port)
        fiber_mdb = optics.fiber_loss_mdb(start, end)
        entered_mdb.append(entered_mdb[-1] + passed_mdb[place] + fiber_mdb)
    places = [place for place, _parts in able]
    left_mdb = [0, *(entered_mdb[place] for place in places)]
    come_mdb = [*(entered_mdb[place] + passed_mdb[place] for place in places), path.loss_mdb]
    return max(come - left for left, come in zip(left_mdb, come_mdb, strict=True))


def _light(path: LightPath, able: Sequence[tuple[int, Parts]]) -> Iterator[LightPath]:
    """Yield the light from the opener, of each switch, of each source, and from the acceptor."""
    (first, parts), (last, last_parts) = able[0], able[-1]
    yield LightPath(
        (*path.hops[:first], path.hops[first]._replace(out_port=parts.left)), path.loss_mdb, 0
    )
    yield from _swaps(path, able)
    for (place, parts), (following, other) in pairwise(able):
        near, far = path.hops[place], path.hops[following]
        yield LightPath((Hop(near.dpid, parts.source[0], parts.right),), 0, 0)
        between = path.hops[place + 1 : following]
        start = near._replace(in_port=parts.source[1])
        yield LightPath((start, *between, far._replace(out_port=other.left)), 0, 0)
    yield _from_behind(path.hops[last:], last_parts.right)


def _heralded_light(path: LightPath, able: Sequence[tuple[int, Parts]]) -> Iterator[LightPath]:
    """Yield the light from the opener, of each switch that swaps, and from the acceptor."""
    (first, station), (last, last_station) = able[0], able[-1]
    start = path.hops[first]._replace(out_port=station.inputs[0])
    yield LightPath((*path.hops[:first], start), path.loss_mdb, 0)
    yield from _swaps(path, able[1::2])
    for (place, parts), (left, before), (right, behind) in zip(
        able[1::2], able[:-1:2], able[2::2], strict=True
    ):
        to_left, to_right = parts.emitters
        back = path.hops[left : place + 1]
        yield _from_behind((*back[:-1], back[-1]._replace(out_port=to_left)), before.inputs[1])
        end = path.hops[right]._replace(out_port=behind.inputs[0])
        begin = path.hops[place]._replace(in_port=to_right)
        yield LightPath((begin, *path.hops[place + 1 : right], end), 0, 0)
    yield _from_behind(path.hops[last:], last_station.inputs[1])


def _swaps(path: LightPath, able: Sequence[tuple[int, Parts]]) -> Iterator[LightPath]:
    for place, parts in able:
        dpid = path.hops[place].dpid
        for memory, port in zip(parts.memories, parts.inputs, strict=False):
            yield LightPath((Hop(dpid, memory, port),), 0, 0)


def _from_behind(hops: Sequence[Hop], out_port: int) -> LightPath:
    """Return light that goes these hops back, and out of a port of the first."""
    backwards = [Hop(dpid, out, into) for dpid, into, out in reversed(hops)]
    return LightPath((*backwards[:-1], backwards[-1]._replace(out_port=out_port)), 0, 0)


def emissions(session: Session, at: SwitchPort, stored: AnalyserFrame) -> list[Emit]:
    """Return what sources do when a memory holds a block; only the opener's has them emit.

    The same of memories that emit, when the opener's qubits attempt.
    """
    if not session.paths or stored.first:
        return []
    entrance = session.paths[0].hops[-1]
    if at != SwitchPort(entrance.dpid, entrance.out_port):
        return []
    rate_hz = session.requests[session.owner].granted.rate_hz
    sources = [hop for hop in session.hops if _emits(hop.in_port)]
    return [
        Emit(
            hop.dpid,
            hop.in_port,
            Emission(
                (session.number + place) % (1 << 64),
                stored.number,
                stored.pulses,
                rate_hz,
                session.frequency_mhz,
            ),
        )
        for place, hop in enumerate(sources, 1)
    ]


def _emits(port: int) -> bool:
    """Whether a source's light, or a memory's, is ordered by this port."""
    inner = inner_port(port) if port in INNER_PORTS else None
    return inner is not None and (inner.kind, inner.which) in ((Kind.SOURCE, 1), (Kind.EMITTER, 0))
