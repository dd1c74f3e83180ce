"""Schedulers of light on a map: the controller's own arbiter in counted time, signalling and all.

Places have hosts with two fibres each, and between neighbours there are two, as in topologies/
mapped.py; the controller is where the farthest place is nearest, and messages take as long as light
in fibre does. Any two hosts ask, as a Poisson process, each request with a deadline; who asks makes
the photons. A fibre loses nothing here: what is shared is its light.
"""

from random import Random

from controller_apps.light.optics import SwitchOptics, SwitchPort
from controller_apps.light.paths import HostPort, Network
from controller_apps.policy.schedules import Queue
from controller_apps.sessions.arbiter import Arbiter
from evidence.curves.contention import FOR_EVER_S, batched
from evidence.curves.estimates import Estimate
from evidence.curves.experiment import Outcome, SweepError
from evidence.curves.parameters import Point
from evidence.traffic.counted import Asked, CountedTime, Fate
from programs.shortest_paths import Distances, shortest
from topologies.catalogue.maps import BadMap, Map, read_map
from topologies.links.copper_lengths import centre
from wire.optical import ANY_PORT, PathOptics
from wire.parameters.fiber import SPEED_IN_FIBER_M_PER_S

HOST_FIBERS = WAY_FIBERS = 2


def network_of(read: Map, way_fibers: int = WAY_FIBERS) -> tuple[Network, dict[str, int]]:
    """Return the network as it would have been discovered, and the switch of each place."""
    switches = {place.name: number for number, place in enumerate(read.places, 1)}
    network = Network(set(switches.values()))
    free = dict.fromkeys(switches.values(), HOST_FIBERS + 1)
    for name, dpid in switches.items():
        network.optics.take(dpid, SwitchOptics(PathOptics(ANY_PORT, ANY_PORT, 0, 0)))
        for port in range(1, HOST_FIBERS + 1):
            host = HostPort(name, address(dpid), f"{name}-q{port - 1}")
            network.attach(SwitchPort(dpid, port), host)
    for link in read.links:
        for _ in range(way_fibers):
            one, other = switches[link.one], switches[link.other]
            network.add_link(SwitchPort(one, free[one]), SwitchPort(other, free[other]))
            free[one], free[other] = free[one] + 1, free[other] + 1
    return network, switches


def address(dpid: int) -> str:
    return f"10.0.{dpid >> 8}.{dpid & 0xFF}"


def away(read: Map, switches: dict[str, int]) -> dict[str | int, float]:
    """Return how long a message takes between the controller and each host or switch."""
    distances: Distances = {place.name: {} for place in read.places}
    for link in read.links:
        for one, other in ((link.one, link.other), (link.other, link.one)):
            distances[one][other] = min(link.length_km, distances[one].get(other, link.length_km))
    far_km = shortest(distances, str(centre(distances, list(distances))))
    by_place: dict[str | int, float] = {}
    for name, dpid in switches.items():
        by_place[dpid] = by_place[address(dpid)] = (
            far_km.get(name, 0.0) * 1e3 / SPEED_IN_FIBER_M_PER_S
        )
    return by_place


def requests(v: Point, hosts: list[str], random: Random) -> list[Asked]:
    """Return what is asked for, the same for every order; deadlines are any from none on."""
    now, asking = 0.0, []
    for _ in range(int(v.sessions)):
        now += random.expovariate(v.rate_per_s)
        opener, acceptor = random.sample(hosts, 2)
        urgent = int(random.random() < v.urgent)
        deadline_s = max(random.uniform(0.0, v.deadline_s), 0.001)
        asking.append(Asked(now, opener, acceptor, v.holding_s, urgent, deadline_s))
    return asking


async def schedule(v: Point, seed: int) -> Outcome:
    """Ask for all of them; count who had light in time, and how long it took."""
    try:
        read = read_map(str(v["map"]))
    except BadMap as error:
        raise SweepError(str(error)) from error
    network, switches = network_of(read)
    away_s = away(read, switches) if v["signalling"] == "on" else {}
    queue = Queue(str(v["order"]), v.slot_s)
    arbiter = Arbiter(network, FOR_EVER_S, FOR_EVER_S, queues=True, order=queue)
    sessions = requests(v, [address(dpid) for dpid in switches.values()], Random(seed))  # noqa: S311
    fates = CountedTime(arbiter, lambda place: away_s.get(place, 0.0)).run(sessions)
    waits = [fate.waited_s for fate in fates if fate.waited_s is not None]  # of those with light
    return {
        "in_time": share_in_time(fates),
        "urgent_in_time": share_in_time([fate for fate in fates if fate.asked.priority]),
        "wait": batched(len(waits), dict(enumerate(waits, 1))),
    }


def share_in_time(fates: list[Fate]) -> Estimate:
    waited = ((fate.waited_s, fate.asked.deadline_s) for fate in fates)
    fit = (had is not None and had <= deadline_s for had, deadline_s in waited)
    return batched(len(fates), dict.fromkeys((n for n, fits in enumerate(fit, 1) if fits), 1.0))
