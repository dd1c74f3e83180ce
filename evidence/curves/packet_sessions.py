"""Packets of pairs as sessions that hosts of a map ask for once, for `qmn run load`.

The applications are those of evidence.curves.packets; each is a client of the network here. A
client that waits is not asked again; a packet holds its light as long as all its attempts take.
"""

from collections.abc import Iterable, Sequence
from math import inf

import numpy as np

from controller_apps.policy.schedules import Queue
from controller_apps.sessions.arbiter import Arbiter
from evidence.curves.contention import FOR_EVER_S
from evidence.curves.estimates import Estimate, mean_of_draws, proportion
from evidence.curves.packets import Application, Pairs
from evidence.curves.scheduling import address, away, network_of
from evidence.traffic.counted import Asked, CountedTime, Fate
from evidence.traffic.plan import Planned
from topologies.catalogue.maps import Map
from wire.results.run_result import ACCEPTED, LoadSession


def as_sessions(
    applications: Sequence[Application],
    pairs: Pairs,
    packets: int,
    rate_per_s: float,
    random: np.random.Generator,
) -> list[Planned]:
    """Return packets as sessions that are asked for once, for `qmn run load`; in order of time.

    Each holds its light as long as all attempts take until it is made, one behind the other, and is
    given up where the window of the last could not end by the deadline.
    """
    sessions = []
    for application in applications:
        released_s = 0.0
        for _ in range(packets):
            released_s += random.exponential(1 / rate_per_s)
            held, needed = 0, application.window + 1
            while needed > application.window:
                needed = pairs.packet + int(
                    random.negative_binomial(pairs.packet, application.chance)
                )
                held += min(needed, application.window)
            left_s = pairs.period_s - application.window * pairs.slot_s
            sessions.append(
                Planned(
                    released_s,
                    application.path[0],
                    application.path[-1],
                    held * pairs.slot_s,
                    left_s,
                )
            )
    return sorted(sessions, key=lambda each: each.at_s)


def counted(read: Map, planned: Sequence[Planned], queue: Queue, signalling: float) -> list[Fate]:
    """Return what becomes of sessions in counted time, of hosts as topologies/mapped.py has them.

    Messages take `signalling` times as long as light in the map's fibres.
    """
    network, switches = network_of(read)
    away_s = {place: signalling * far_s for place, far_s in away(read, switches).items()}
    requests = [
        Asked(
            each.at_s,
            address(switches[each.opener]),
            address(switches[each.acceptor]),
            each.holding_s,
            deadline_s=each.deadline_s or 0.0,
            useful_s=inf if each.deadline_s is None else each.deadline_s,
        )
        for each in planned
    ]
    arbiter = Arbiter(network, FOR_EVER_S, FOR_EVER_S, queues=True, order=queue)
    return CountedTime(arbiter, away_s.__getitem__).run(requests)


def of_counted(fates: Iterable[Fate]) -> tuple[Estimate, Estimate]:
    """Return which share was made, and how long that took from release on (s)."""
    waits = [(each.waited_s if each.used else None, each.asked.holding_s) for each in fates]
    return _outcome(waits)


def of_emulated(sessions: Iterable[LoadSession]) -> tuple[Estimate, Estimate]:
    lit = [(each.setup_s if each.outcome == ACCEPTED else None, each) for each in sessions]
    return _outcome([(setup_s, each.holding_s) for setup_s, each in lit])


def _outcome(waits: Sequence[tuple[float | None, float]]) -> tuple[Estimate, Estimate]:
    took_s = [waited_s + held_s for waited_s, held_s in waits if waited_s is not None]
    return proportion(len(took_s), len(waits)), mean_of_draws(took_s)
