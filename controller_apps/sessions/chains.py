"""The repeaters that join two hosts: the fewest, each with light from the one before it.

Light leaves a host by another fibre than it comes by.
"""

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Network
from controller_apps.light.routing import Leg, Limits, cheapest_path, route
from controller_apps.packets import FiveTuple
from controller_apps.policy.schedules import PROTOCOLS, spans
from controller_apps.sessions.actions import SwapsOrdered
from controller_apps.sessions.sessions import Chain, Session, Sessions, Stop
from wire.device import MAX_REPEATERS, NOBODY, SwapOrder
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Service

REPEATER_FIBERS = STATION_FIBERS = 2


def find_chain(
    network: Network,
    opener: str,
    acceptor: str,
    limits: Limits,
    unable: Callable[[str], object] = lambda _address: None,
    stations: Callable[[str], bool] | None = None,
) -> Chain | None:
    """Return the shortest chain with a repeater at least; None if there is none.

    `unable` says what a host lacks to be a repeater; `stations` which hosts herald, where each link
    has one between its ends.
    """
    frequency = limits.frequency_mhz
    ports = {
        host.address: network.channel_ports_of(host.address, frequency)
        for host in network.hosts.values()
    }
    joins = Joins(network, ports, limits, stations)
    waiting: deque[Chain] = deque([(Stop(opener),)])
    seen: set[tuple[str, int]] = set()  # repeaters, and by which fibre light comes to them
    while waiting:
        chain = waiting.popleft()
        for join in joins.of(chain, acceptor) if chain[1:] else ():
            return join.extended(chain, acceptor)
        if len(chain) > MAX_REPEATERS:
            continue
        passed = {acceptor, *(stop.address for stop in chain), *(stop.station for stop in chain)}
        for address in sorted(ports.keys() - passed):
            if len(ports[address]) < REPEATER_FIBERS or unable(address):
                continue
            for join in joins.of(chain, address):
                if (address, join.left) not in seen:
                    seen.add((address, join.left))
                    waiting.append(join.extended(chain, address))
    return None


class Join(NamedTuple):
    """How a chain goes on to a host: out of one fibre, into one, perhaps by way of a station."""

    right: int
    left: int
    station: str = ""

    def extended(self, chain: Chain, address: str) -> Chain:
        last = chain[-1]._replace(right=self.right, station=self.station)
        return (*chain[:-1], last, Stop(address, self.left))


class Joins(NamedTuple):
    """Finds how chains can go on."""

    network: Network
    ports: Mapping[str, list[SwitchPort]]
    limits: Limits
    stations: Callable[[str], bool] | None

    def of(self, chain: Chain, address: str) -> Iterator[Join]:
        """Yield how light can join the end of a chain and a host."""
        last, ports = chain[-1], self.ports
        taken = set() if len(chain) == 1 else {last.left}
        for right in sorted(set(range(len(ports[last.address]))) - taken, reverse=True):
            for left, port in enumerate(ports[address]):
                leg = Leg(ports[last.address][right], port)
                if self.stations is not None:
                    yield from self._heralded(chain, right, left, leg)
                elif cheapest_path(self.network, leg, self.limits) is not None:
                    yield Join(right, left)

    def _heralded(self, chain: Chain, right: int, left: int, leg: Leg) -> Iterator[Join]:
        """Yield the same by way of each station that no other link of the chain has."""
        assert self.stations is not None
        taken = {stop.station for stop in chain}
        for station in sorted(self.ports.keys() - taken):
            if not self.stations(station):
                continue
            legs = heralded_legs(leg, self.ports[station])
            if legs is not None and route(self.network, legs, self.limits) is not None:
                yield Join(right, left, station)


def heralded_legs(link: Leg, station: Sequence[SwitchPort]) -> list[Leg] | None:
    """Return legs from both ends of a link to a station; None if that has too few fibres."""
    if len(station) < STATION_FIBERS:
        return None
    return [Leg(link.start, station[0]), Leg(link.end, station[1])]


def legs_of_chain(network: Network, chain: Chain, limits: Limits) -> list[Leg]:
    """Return the legs between the neighbours of a chain, or from them to stations."""
    legs: list[Leg] = []
    for left, right in pairwise(chain):
        ports = (
            network.channel_ports_of(address, limits.frequency_mhz)
            for address in (left.address, right.address, left.station)
        )
        start, end, station = map(list, ports)
        leg = Leg(start[left.right], end[right.left])
        legs += (heralded_legs(leg, station) or []) if left.station else [leg]
    return legs


def repeaters_of(chain: Chain) -> list[str]:
    return [stop.address for stop in chain[1:-1]]


def orders(ordered: SwapsOrdered, number: int) -> dict[str, SwapOrder]:
    """Return the order to each node of a chain, by its address; the messages have this number."""
    chain = ordered.chain
    swap_orders = [
        SwapOrder(
            number,
            ordered.session,
            place,
            right,
            stop.left,
            stop.right,
            station=stop.station or NOBODY,
            blocks=ordered.blocks,
        )
        for place, (stop, right) in enumerate(
            zip(chain, [*(stop.address for stop in chain[1:]), NOBODY], strict=True)
        )
    ]
    if ordered.purification.rounds:
        swap_orders = [_purifying(order, ordered, len(chain) - 2) for order in swap_orders]
        return {stop.address: order for stop, order in zip(chain, swap_orders, strict=True)}
    return {stop.address: order for stop, order in zip(chain, swap_orders, strict=True)}


def _purifying(order: SwapOrder, ordered: SwapsOrdered, repeaters: int) -> SwapOrder:
    """Return an order with what its node purifies, and what it passes on when it has swapped.

    A node swaps after its purification; it need not hear of others' swaps.
    """
    purified, made = spans(ordered.schedule, repeaters)
    rounds, place = ordered.purification.rounds, order.place
    over = sum(span.passes(place) for span in purified)
    bits = sum(swapped < place < span.right for swapped, span in made)
    if order.last:
        bits = sum(span.left == 0 and span.right == place for _swapped, span in made)
    return replace(
        order,
        protocol=PROTOCOLS[ordered.purification.protocol],
        rounds=rounds,
        spans_left=sum(span.right == place for span in purified),
        spans_right=sum(span.left == place for span in purified),
        to_right=over * rounds + bits,
        to_left=over * (1 + rounds),
    )


def ordered_link(
    setup: Setup, five_tuple: FiveTuple, sessions: Sessions
) -> tuple[Stop, Stop] | None:
    """Return between which stops of a chain this very link is; None if no chain has it.

    It joins the two neighbours by the session that they were ordered to open, with the light that
    was granted to the whole chain.
    """
    for place in range(MAX_REPEATERS + 1):
        session = sessions.by_number.get((setup.session - 1 - place) % (1 << 64))
        if session is not None and session.open and place + 1 < len(session.chain):
            ends = left, right = session.chain[place], session.chain[place + 1]
            expected = replace(
                session.requests[session.owner].granted,
                session=setup.session,
                service=Service.LINK,
                source=left.station or left.address,
                fidelity_ppm=0,
            )
            joined = five_tuple.source, five_tuple.destination
            if joined == (left.address, right.address) and setup == expected:
                return ends
    return None


def links_of(session: Session, sessions: Sessions) -> list[Session]:
    numbers = ((session.number + 1 + place) % (1 << 64) for place in range(len(session.chain) - 1))
    links = (sessions.by_number.get(number) for number in numbers)
    return [link for link in links if link and link.setup.service == Service.LINK]


def beside(link: Session, sessions: Sessions) -> list[Session]:
    """Return the links of the chain that a session is a link of, itself too; [] for others."""
    if link.setup.service != Service.LINK:
        return []
    for place in range(MAX_REPEATERS + 1):
        whole = sessions.by_number.get((link.number - 1 - place) % (1 << 64))
        if whole is not None and place + 1 < len(whole.chain):
            return links_of(whole, sessions)
    return []
