"""Blocking in a network: sessions that need several fibres, by the controller in counted time.

    a --- q1 ===== q2 ===== q3 ===== q4 --- b        some sessions pass one link, some all of them

    a, source --- q1 ===== q2 --- b, b'              some need one fibre of the link, some two

Sessions of each class come as a Poisson process. In the chain each needs a fibre of every link on
its way. In the trunk a key needs one; a pair that is made at one side for two hosts of the other
needs two. Hosts that take part are idle ones, and switches take no time.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from random import Random

from controller_apps.light.optics import SwitchOptics, SwitchPort
from controller_apps.light.paths import HostPort, Network
from controller_apps.sessions.arbiter import Arbiter
from evidence.curves.contention import FOR_EVER_S, batched
from evidence.curves.estimates import Estimate
from evidence.curves.experiment import Outcome
from evidence.curves.parameters import Point
from evidence.traffic.counted import Asked, CountedTime, Fate
from evidence.traffic.erlang import blocked_on_links, kaufman_roberts
from wire.metadata.vocabulary import Service
from wire.optical import ANY_PORT, PathOptics

HOSTS = 128  # of a class at each end: who asks has been idle for long when its turn comes again
FIBERS = 2  # of a host
WIDE = 2  # fibres of the trunk that a pair for two hosts needs


@dataclass(frozen=True)
class Class:
    """Sessions that are alike: where they begin and end, and how many come in a holding time."""

    begin: int  # switches, counted from 1
    end: int
    load: float
    service: Service = Service["BB84"]


def chain(switches: int, channels: int) -> Network:
    """Return switches in a row as discovered, with `fibers` fibres between."""
    network = Network(set(range(1, switches + 1)))
    for dpid in range(1, switches + 1):
        network.optics.take(dpid, SwitchOptics(PathOptics(ANY_PORT, ANY_PORT, 0, 0)))
    ports = dict.fromkeys(range(1, switches + 1), 0)

    def port(dpid: int) -> SwitchPort:
        ports[dpid] += 1
        return SwitchPort(dpid, ports[dpid])

    for dpid in range(1, switches):
        for _ in range(channels):
            network.add_link(port(dpid), port(dpid + 1))
    return network


def attached(network: Network, dpid: int, place: int) -> str:
    """Add a host at a switch if it is not there; return its address."""
    address = f"10.{dpid}.{place >> 8}.{place & 0xFF}"
    if not network.ports_of(address):
        taken = [at.port for at in (*network.links, *network.hosts) if at.dpid == dpid]
        for fiber in range(FIBERS):
            host = HostPort(address, address, f"{address}-q{fiber}")
            network.attach(SwitchPort(dpid, max(taken, default=0) + 1 + fiber), host)
    return address


def contend(network: Network, classes: Sequence[Class], count: int, seed: int) -> list[list[Fate]]:
    """Ask for `count` sessions; return the fate of each, by class in order of time."""
    random, now = Random(seed), 0.0  # noqa: S311
    requests: list[tuple[int, Asked]] = []
    for turn in range(count):
        now += random.expovariate(sum(each.load for each in classes))
        (kind,) = random.choices(range(len(classes)), [each.load for each in classes])
        hosts = hosts_of(network, classes, kind, turn % HOSTS)
        requests.append((kind, asked(classes[kind], hosts, now, random.expovariate(1.0))))
    arbiter = Arbiter(network, FOR_EVER_S, FOR_EVER_S)
    fates = CountedTime(arbiter).run([each for _kind, each in requests])
    by_class: list[list[Fate]] = [[] for _ in classes]
    for (kind, _asked), each in zip(requests, fates, strict=True):
        by_class[kind].append(each)
    return by_class


def hosts_of(network: Network, classes: Sequence[Class], kind: int, turn: int) -> tuple[str, ...]:
    """Return opener, acceptor and source of a session that nobody else has just then."""
    kind_of_sessions, wide = classes[kind], classes[kind].service == Service.DISTRIBUTE
    first = 1 + 3 * (kind * HOSTS + turn)
    begin, end = (
        attached(network, kind_of_sessions.begin, first),
        attached(network, kind_of_sessions.end, first + 1),
    )
    return (
        (end, attached(network, kind_of_sessions.end, first + 2), begin)
        if wide
        else (begin, end, begin)
    )


def asked(sessions: Class, hosts: tuple[str, ...], now: float, holding_s: float) -> Asked:
    opener, acceptor, source = hosts
    return Asked(now, opener, acceptor, holding_s, source=source, service=sessions.service)


def blocked(fates: Sequence[Fate]) -> Estimate:
    """Return the share of a class that is refused."""
    return batched(len(fates), {place: 1.0 for place, each in enumerate(fates, 1) if each.reason})


def classes_of_chain(v: Point) -> list[Class]:
    links, load = int(v.links), v.load / 2
    alone = [Class(link, link + 1, load) for link in range(1, links + 1)]
    return [Class(1, links + 1, load), *alone]


def routes(v: Point) -> tuple[list[float], list[Sequence[int]], list[int]]:
    """Return the chain as theory takes it: loads, the links of each class, their fibres."""
    classes = classes_of_chain(v)
    ways: list[Sequence[int]] = [range(kind.begin - 1, kind.end - 1) for kind in classes]
    return [kind.load for kind in classes], ways, [int(v.channels)] * int(v.links)


async def over_links(v: Point, seed: int) -> Outcome:
    """Count who is blocked on a chain: those that pass all of it, and those of its first link."""
    network = chain(int(v.links) + 1, int(v.channels))
    through, first, *_others = contend(network, classes_of_chain(v), int(v.sessions), seed)
    return {"through": blocked(through), "one_link": blocked(first)}


def of_chain(v: Point) -> dict[str, float]:
    through, first, *_others = blocked_on_links(*routes(v))
    return {"through": through, "one_link": first}


async def several_fibers(v: Point, seed: int) -> Outcome:
    """Count who is blocked on a trunk: keys, and pairs for two hosts, of as many fibres each."""
    network = chain(2, int(v.channels))
    narrow, wide = contend(network, classes_of_trunk(v), int(v.sessions), seed)
    return {"narrow": blocked(narrow), "wide": blocked(wide)}


def classes_of_trunk(v: Point) -> list[Class]:
    """Return sessions of one fibre, and of two: half of the fibres are asked for by either."""
    return [Class(1, 2, v.load / 2), Class(1, 2, v.load / 2 / WIDE, Service.DISTRIBUTE)]


def of_several_fibers(v: Point) -> dict[str, float]:
    loads = [kind.load for kind in classes_of_trunk(v)]
    narrow, wide = kaufman_roberts(loads, [1, WIDE], int(v.channels))
    return {"narrow": narrow, "wide": wide}
