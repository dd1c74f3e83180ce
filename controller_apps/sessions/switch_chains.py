"""Chains of quantum switches that swap: the hops of light through their memories and analysers.

    alice --- mL q1 mR <-- source 1 of q1 --> mL q2 mR --- bob
              |     |                         |     |
              +-[x]-+                         +-[x]-+

Light of a memory goes on to an analyser of its switch: swaps are as soon as possible. A switch
without memories, alone between two hosts, has their light meet in its analyser.

When the first memory holds a block of the opener's, all sources emit one as large.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Hop, Network, directions
from controller_apps.light.routing import LightPath, Limits
from controller_apps.sessions.actions import Emit
from controller_apps.sessions.sessions import Session
from wire.analyser_frames import AnalyserFrame, Emission
from wire.device import MAX_UNDER_WAY
from wire.parameters.switch import HALVES, INNER_PORTS, Kind, inner_port

MEMORIES = 2  # of a switch that swaps: one for light of each side


class Parts(NamedTuple):
    """The inner ports of one switch that a chain takes."""

    inputs: Sequence[int]  # of an analyser
    memories: Sequence[int]  # none: light goes straight to the analyser
    source: Sequence[int]  # none: there is no free one

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
        if kind == Kind.MEMORY or len(ports) == HALVES:
            whole[kind].append(ports)
    if not whole[Kind.ANALYSER]:
        return None
    memories = [port for ports in whole[Kind.MEMORY] for port in ports][:MEMORIES]
    source = whole[Kind.SOURCE][0] if whole[Kind.SOURCE] else []
    return Parts(whole[Kind.ANALYSER][0], memories if len(memories) == MEMORIES else [], source)


def swapping(
    network: Network, path: LightPath, count: int, limits: Limits
) -> tuple[LightPath, ...] | str:
    """Return the light of a chain of this many switches along a path, or why it cannot be."""
    able: list[tuple[int, Parts]] = []
    for place, hop in enumerate(path.hops):
        parts = parts_of(network, hop.dpid, limits)
        if parts is not None and (count == 1 or parts.memories):
            able.append((place, parts))
    able = able[:count]
    if len(able) < count:
        return f"{len(able)} of {count} switches on the way have a free analyser and memories"
    for place, parts in able[:-1]:
        if not parts.source:
            return f"{network.name_of(path.hops[place].dpid)} has no free source"
    budget_mdb, most_mdb = limits.loss_budget_mdb, _most_loss_mdb(network, path, able)
    if budget_mdb is not None and most_mdb > budget_mdb:
        text = f"a link of the chain loses {most_mdb / 1000:g} dB, "
        return text + f"more than the loss budget of {budget_mdb / 1000:g} dB"
    paths = tuple(_light(path, able))
    hops = [hop for each in paths for hop in each.hops]
    if any(map(limits.blocked, directions(hops))):
        return "others have light on the way"
    return paths


def most_pairs(network: Network, paths: Sequence[LightPath], wanted: int) -> int:
    """Return how many pairs blocks of a chain may have: as many as all under way may be stored."""
    lasts = [SwitchPort(path.hops[-1].dpid, path.hops[-1].out_port) for path in paths]
    modes = [network.modes[at] for at in lasts if at in network.modes]
    return max(1, min([wanted, *(each // MAX_UNDER_WAY for each in modes)]))


def _most_loss_mdb(network: Network, path: LightPath, able: Sequence[tuple[int, Parts]]) -> int:
    """Return the loss of the worst link along a path, in thousandths of a dB.

    Light of a link passes the switches at both of its ends, too.
    """
    optics, hops = network.optics, path.hops
    switches = [optics.path(*hop) for hop in hops]
    passed_mdb = [0 if each is None else each.loss_mdb for each in switches]
    entered_mdb = [optics.fiber_loss_mdb(SwitchPort(hops[0].dpid, hops[0].in_port), None)]
    for place, (near, far) in enumerate(pairwise(hops)):
        ends = SwitchPort(near.dpid, near.out_port), SwitchPort(far.dpid, far.in_port)
        entered_mdb.append(entered_mdb[-1] + passed_mdb[place] + optics.fiber_loss_mdb(*ends))
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
    for place, parts in able:
        dpid = path.hops[place].dpid
        for memory, port in zip(parts.memories, parts.inputs, strict=False):
            yield LightPath((Hop(dpid, memory, port),), 0, 0)
    for (place, parts), (following, other) in pairwise(able):
        near, far = path.hops[place], path.hops[following]
        yield LightPath((Hop(near.dpid, parts.source[0], parts.right),), 0, 0)
        between = path.hops[place + 1 : following]
        start = near._replace(in_port=parts.source[1])
        yield LightPath((start, *between, far._replace(out_port=other.left)), 0, 0)
    behind = [Hop(dpid, out, into) for dpid, into, out in reversed(path.hops[last + 1 :])]
    end = Hop(path.hops[last].dpid, path.hops[last].out_port, last_parts.right)
    yield LightPath((*behind, end), 0, 0)


def emissions(session: Session, at: SwitchPort, stored: AnalyserFrame) -> list[Emit]:
    """Return what sources do when a memory holds a block; only the opener's has them emit."""
    if not session.paths or stored.first:
        return []
    entrance = session.paths[0].hops[-1]
    if at != SwitchPort(entrance.dpid, entrance.out_port):
        return []
    rate_hz = session.requests[session.owner].granted.rate_hz
    sources = [hop for hop in session.hops if _begins_source(hop.in_port)]
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


def _begins_source(port: int) -> bool:
    inner = inner_port(port) if port in INNER_PORTS else None
    return inner is not None and (inner.kind, inner.which) == (Kind.SOURCE, 1)
