"""Checks whether a network can have the light that a job needs: who makes its pairs, and ways.

And how much of it arrives, which is what a block of weak pulses costs.

charlie ===== q1 ===== bob      sdc: a source that is neither end, two fibres at bob, and ways of
              `------- alice    fibres and quantum switches between all three
"""

import math
from collections.abc import Collection, Iterator, Sequence
from itertools import pairwise

from dispatcher.fiber import fiber_noise
from programs.shortest_paths import Distances, shortest
from qmn.options import BadInput
from topologies.description.description import Description
from wire.light import Role
from wire.metadata.vocabulary import Service
from wire.services import (
    REGISTERED,
    Making,
    beams,
    fibers_needed,
    is_heralded,
    uses_source,
)

SOURCE = "a third host that makes pairs"


def check_light(
    service: str, hosts: Sequence[str], parts: Description, source: str = "", named: bool = False
) -> None:
    """Raise BadInput if light cannot be had for a service between these hosts, each and the next.

    `source` makes the pairs, if a user names it, which `named` says that one can.
    """
    kind = Service[service.upper()]
    for opener, acceptor in pairwise(hosts):
        maker = source or parts.source_for(opener)
        by = making(kind, opener, source, parts)
        ends = {Role.OPENER: opener, Role.ACCEPTOR: acceptor}
        if uses_source(kind, by):
            _refuse_source(service, ends.values(), maker, named)
            ends[Role.SOURCE] = maker
        for role, host in ends.items():
            _refuse_too_few(service, host, fibers_needed(kind, role, by), parts)
        for start, end in beams(kind, by):
            _refuse_dark(service, ends[start.role], ends[end.role], parts)
        if by == Making.STATION and not analysers_from(opener, parts).get(acceptor):
            raise BadInput(
                f"{service}: {opener} has a memory that emits, and no quantum switch on the way to "
                f"{acceptor} has a station: give one to a switch (--switch q1.parts=station)"
            )


def check_source(service: str, parts: Description) -> None:
    """Raise BadInput if nobody makes the pairs of a service that needs a third host for them."""
    if uses_source(Service[service.upper()]):
        _refuse_source(service, (), next(reversed(parts.sources), ""), True)


def making(service: Service, opener: str, source: str, parts: Description) -> Making:
    """Return who makes the pairs of a session, as its opener's stack chooses.

    `source` does if a user names it.
    """
    if is_heralded(service, parts.hosts[opener].features, source):
        return Making.STATION
    return Making.OPENER if opener == (source or parts.source_for(opener)) else Making.SOURCE


def _refuse_source(service: str, ends: Collection[str], source: str, named: bool) -> None:
    """Raise BadInput for no source, and for one that is an end of the session."""
    other = ", or name another, --source" if named else ""
    kind = Service[service.upper()]
    needed = REGISTERED[kind].third if kind in REGISTERED else SOURCE
    remedy = f"source=True and two fibres, on a map by sources_at{other}"
    if not source:
        raise BadInput(f"{service} needs {needed}, and none is one here: give a host {remedy}")
    if source in ends:
        text = f"{service} needs {needed}, and {source} is one of its ends"
        raise BadInput(f"{text}: give another host {remedy}")


def _refuse_too_few(service: str, host: str, needed: int, parts: Description) -> None:
    """Raise BadInput for a host with fewer fibres than its role takes."""
    count = sum(host in (fiber.a, fiber.b) for fiber in parts.fibers)
    if count < needed:
        fibers = "1 fibre" if count == 1 else f"{count} fibres"
        raise BadInput(
            f"{host} has {fibers}, and {service} needs {needed} there: lay more (alice has two in "
            "a ready topology with both_ways)"
        )


def analysers_from(begin: str, parts: Description) -> dict[str, float]:
    """Return in how many switches with an analyser light has been at least, by where it comes."""
    distances: Distances = {}
    for fiber in parts.fibers:
        for near, far in ((fiber.a, fiber.b), (fiber.b, fiber.a)):
            if near == begin or near in parts.switches:  # other hosts pass nothing on
                able = far in parts.switches and parts.switches[far].analysers > 0
                distances.setdefault(near, {})[far] = float(able)
    return shortest(distances, begin)


def _refuse_dark(service: str, one: str, other: str, parts: Description) -> None:
    """Raise BadInput if light cannot come from one host to another over quantum switches."""
    if other not in analysers_from(one, parts):
        raise BadInput(
            f"{service} needs light between {one} and {other}, and no way of fibres and quantum "
            f"switches leads there: join {_beside(one, parts)} and {_beside(other, parts)}, as by "
            "addFibers"
        )


def _beside(host: str, parts: Description) -> str:
    ends = ({fiber.a, fiber.b} - {host} for fiber in parts.fibers if host in (fiber.a, fiber.b))
    return min(next(ends, {host}))


BLOCK_PHOTONS = 50_000  # of weak light that may click at one host


def weak_pulses(maker: str, ends: Collection[str], parts: Description, rate_hz: int) -> int:
    """Return how many pulses of weak light make a good block, of one second at most.

    0: all of them have to be simulated.
    """
    source = parts.hosts[maker].source
    heralded = source.heralding_efficiency and len(ends) == 1  # of pairs no half heralds the other
    weak = source.statistics == "poisson" and not heralded and not source.noise
    noises = (parts.hosts[end].detectors.noise for end in ends)
    if not weak or any(noises) or any(_draws_all(source.encoding, parts)):
        return 0
    least_db = min(loss_to_click(maker, end, parts) for end in ends)
    photons = source.mean_pairs * 10 ** (-least_db / 10)
    return int(min(rate_hz, BLOCK_PHOTONS / photons if photons else math.inf))


def _draws_all(encoding: str, parts: Description) -> Iterator[bool]:
    """Yield of each part of the network whether all pulses are simulated that meet it."""
    for fiber in parts.fibers:
        yield fiber.optics.channel_crosstalk_db is not None
        yield bool(fiber_noise.obstacle(encoding, fiber_noise.models(fiber.optics).values()))
    for switch in parts.switches.values():
        yield switch.crosstalk_db is not None


def loss_to_click(begin: str, end: str, parts: Description) -> float:
    """Return what light loses at least by fibres, switches and detectors, from host to host (dB).

    That is infinity if none comes there.
    """
    distances: Distances = {}
    for fiber in parts.fibers:
        for node, far in ((fiber.a, fiber.b), (fiber.b, fiber.a)):
            if node == begin or node in parts.switches:  # other hosts pass nothing on
                passing = parts.switches[node].insertion_loss_db if node in parts.switches else 0.0
                there = distances.setdefault(node, {})
                there[far] = min(passing + fiber.optics.loss_db, there.get(far, math.inf))
    efficiency = parts.hosts[end].detectors.efficiency
    clicks_db = -10 * math.log10(efficiency) if efficiency else math.inf
    return shortest(distances, begin).get(end, math.inf) + clicks_db
