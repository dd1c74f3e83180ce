"""Applications that want packets of pairs, one after the other, each by its deadline.

The model of Tran, Cicconetti, Conti and Passarella, arXiv:2605.28795: in each slot of time every
link of the shortest path makes a pair or not, and swaps join them or not; a packet is some pairs
out of a window of slots, in which most packets are made. Links of a path belong to one packet.

    released |--- waits ---|#### window, given back as soon as all pairs are there ####|    deadline

Applications ask the controller's own arbiter, in counted time. Times are seconds of the network.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from ipaddress import IPv4Address
from itertools import pairwise

import networkx
import numpy as np

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import HostPort
from controller_apps.policy.schedules import Queue
from controller_apps.sessions.arbiter import Arbiter
from evidence.curves.contention import FOR_EVER_S
from evidence.curves.estimates import Estimate, mean_of_draws, proportion
from evidence.curves.scheduling import away, network_of
from evidence.traffic.counted import Asked, CountedTime, Fate
from topologies.catalogue.maps import Map
from wire.results.run_result import ACCEPTED, LoadSession

ROUNDING_S = 1e-9
MOST = 10_000
FIRST_PORT = 1_000  # of a switch, to those hosts
GRID_PM = 200  # between the wavelengths of applications, each of which has one of its own


@dataclass(frozen=True)
class Pairs:
    trials: int = 1000  # of each link in a slot
    made: float = 1e-3  # chance of a trial
    swapped: float = 0.6  # chance of a swap
    slot_s: float = 1e-4
    packet: int = 2  # pairs
    share: float = 0.9  # of the packets that are to be there within their window
    period_s: float = 1.0  # from release to deadline

    def chance(self, links: int) -> float:
        link: float = 1 - (1 - self.made) ** self.trials
        return link**links * self.swapped ** (links - 1)

    def window(self, links: int) -> int:
        from scipy.stats import nbinom  # takes a second, which few need

        return self.packet + int(nbinom.ppf(self.share, self.packet, self.chance(links)))


@dataclass
class Application:
    """Two places that want packets."""

    path: list[str]  # places
    chance: float  # of a pair in a slot
    window: int  # slots
    releases: int = 0
    released_s: float = 0.0  # the last of them
    packets: int = 0  # that were made
    succeeds: bool = False  # the attempt that is under way


def addresses(number: int) -> tuple[str, str]:
    return f"10.1.{number >> 8}.{number & 0xFF}", f"10.2.{number >> 8}.{number & 0xFF}"


def application_of(demand: Asked) -> int:
    return int(IPv4Address(demand.opener)) & 0xFFFF


def graph_of(read: Map) -> "networkx.Graph[str]":
    return networkx.Graph([(link.one, link.other) for link in read.links])


def tree_of(read: Map, centre: str) -> Map:
    """Return the map with the links that lead soonest to its centre: one for any two places."""
    edges = {frozenset(ends) for ends in networkx.bfs_tree(graph_of(read), centre).edges()}
    return replace(read, links=[link for link in read.links if {link.one, link.other} in edges])


def drawn(read: Map, pairs: Pairs, count: int, seed: int) -> list[Application]:
    """Return as many applications as the program of the paper's authors draws with this seed."""
    graph, names = graph_of(read), [place.name for place in read.places]
    random, applications = np.random.default_rng(seed), []
    for _ in range(count):
        one, other = random.choice(names, 2, replace=False).tolist()
        random.uniform(), random.choice(1, 1, replace=False)  # a period, and a policy
        path = networkx.shortest_path(graph, one, other)
        links = len(path) - 1
        applications.append(Application(path, pairs.chance(links), pairs.window(links)))
    return applications


def timetable(applications: Sequence[Application], pairs: Pairs) -> list[float] | None:
    """Return when in each period windows begin, one behind the other where they share links.

    None: one of them ends behind the period. All have the same deadline, so that this is by
    earliest deadline.
    """
    free: defaultdict[frozenset[str], float] = defaultdict(float)
    starts = []
    for application in applications:
        links = [frozenset(ends) for ends in pairwise(application.path)]
        starts.append(max(free[link] for link in links))
        free.update(dict.fromkeys(links, starts[-1] + application.window * pairs.slot_s))
    return starts if max(free.values()) <= pairs.period_s + ROUNDING_S else None


@dataclass
class Requests:
    """Requests of applications until each has its packets.

    Online packets are released as a Poisson process each, and tried again while there is time; by
    a timetable they are released in each period, and tried once.
    """

    applications: Sequence[Application]
    pairs: Pairs
    wanted: int  # packets of each
    rate_per_s: float
    random: np.random.Generator
    starts: Sequence[float] | None = None  # of the timetable
    most: int = MOST  # releases of each, whatever becomes of them
    turnarounds_s: list[float] = field(default_factory=list)  # from release on, of those made

    @property
    def released(self) -> int:
        return sum(application.releases for application in self.applications)

    @property
    def share(self) -> float:
        return len(self.turnarounds_s) / self.released

    def begin(self) -> list[Asked]:
        requests = (self._released(number, 0.0) for number in range(len(self.applications)))
        return [request for request in requests if request is not None]

    def then(self, fate: Fate, now: float) -> Asked | None:
        number = application_of(fate.asked)
        application = self.applications[number]
        if fate.used and application.succeeds:
            application.packets += 1
            self.turnarounds_s.append(now - application.released_s)
        elif fate.used and self.starts is None:
            again = self._attempt(number, now + ROUNDING_S)  # behind those that wait already
            if again is not None:
                return again
        return self._released(number, now)

    def _released(self, number: int, now: float) -> Asked | None:
        """Return the request for its next packet that can be there by its deadline."""
        application = self.applications[number]
        while application.packets < self.wanted and application.releases < self.most:
            if self.starts is None:
                application.released_s += self.random.exponential(1 / self.rate_per_s)
                begin_s = application.released_s
            else:
                application.released_s = application.releases * self.pairs.period_s
                begin_s = application.released_s + self.starts[number]
            application.releases += 1
            request = self._attempt(number, max(now, begin_s))
            if request is not None:
                return request
        return None

    def _attempt(self, number: int, at_s: float) -> Asked | None:
        """Return the request, None if its window would end behind the deadline."""
        application, pairs = self.applications[number], self.pairs
        window_s = application.window * pairs.slot_s
        left_s = application.released_s + pairs.period_s - window_s - at_s
        if left_s < -ROUNDING_S:
            return None
        needed = pairs.packet + int(self.random.negative_binomial(pairs.packet, application.chance))
        application.succeeds = needed <= application.window
        return Asked(
            at_s,
            *addresses(number),
            min(needed, application.window) * pairs.slot_s,
            deadline_s=left_s + window_s,
            wavelength_pm=Asked.wavelength_pm + GRID_PM * number,
            useful_s=left_s + ROUNDING_S,
        )


@dataclass(frozen=True)
class Drawn:
    count: int
    seed: int  # as their program has it
    packets: int  # of each that are wanted
    rate_per_s: float  # of each, where they come as a Poisson process
    by_timetable: bool
    most: int  # releases of each, whatever becomes of them


def ask_in_counted_time(read: Map, asking: Requests, queue: Queue, signalling: float) -> None:
    """Have applications ask the controller of a map until all have their packets.

    Each has two hosts of its own, and a wavelength, so that it has the fibres of its path alone, of
    which there is one for each way. Messages take `signalling` times as long as light in fibre.
    """
    network, switches = network_of(read, 1)
    away_s = {place: signalling * far_s for place, far_s in away(read, switches).items()}
    for number, each in enumerate(asking.applications):
        ends = zip(addresses(number), (each.path[0], each.path[-1]), strict=True)
        for side, (address, place) in enumerate(ends):
            at = SwitchPort(switches[place], FIRST_PORT + 2 * number + side)
            network.attach(at, HostPort(address, address, f"{address}-q0"))
            away_s[address] = away_s[switches[place]]
    arbiter = Arbiter(network, FOR_EVER_S, FOR_EVER_S, queues=True, order=queue)
    CountedTime(arbiter, away_s.__getitem__, asking.then).run(asking.begin())


def measured(
    read: Map, draw: Drawn, queue: Queue, signalling: float, random: np.random.Generator
) -> dict[str, float]:
    """Have applications ask in counted time; return their share, and their mean turnaround in s."""
    applications = drawn(read, Pairs(), draw.count, draw.seed)
    starts = timetable(applications, Pairs()) if draw.by_timetable else None
    asking = Requests(
        applications, Pairs(), draw.packets, draw.rate_per_s, random, starts, draw.most
    )
    ask_in_counted_time(read, asking, queue, signalling)
    return {"share": asking.share, "turnaround": float(np.mean(asking.turnarounds_s))}


def of_emulated(sessions: Sequence[LoadSession]) -> tuple[Estimate, Estimate]:
    """Return which share of packets was made in a network, and in what time from release on (s)."""
    took_s = [
        each.setup_s + each.holding_s
        for each in sessions
        if each.outcome == ACCEPTED and each.setup_s is not None
    ]
    return proportion(len(took_s), len(sessions)), mean_of_draws(took_s)
