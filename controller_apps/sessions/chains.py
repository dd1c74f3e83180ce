"""Which repeaters join two hosts: the fewest, each with light from the one before it.

A link leaves a host by its last fibre and comes to the next one by its first (wire.services).
"""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Network
from controller_apps.light.routing import Leg, Limits, cheapest_path
from controller_apps.sessions.actions import SwapsOrdered
from controller_apps.sessions.schedules import schedule
from controller_apps.sessions.segments import FiveTuple
from controller_apps.sessions.sessions import Chain, Session, Sessions
from wire.device import MAX_REPEATERS, NOBODY, SwapOrder
from wire.metadata import Service, Setup

REPEATER_FIBERS = 2


def find_chain(
    network: Network,
    opener: str,
    acceptor: str,
    limits: Limits,
    unable: Callable[[str], object] = lambda _address: None,
) -> Chain | None:
    """Return the shortest chain with a repeater at least; None if there is none.

    `unable` says what a host lacks to be a repeater.
    """
    ports = {host.address: network.ports_of(host.address) for host in network.hosts.values()}
    waiting: deque[Chain] = deque([(opener,)])
    seen = {opener, acceptor}
    while waiting:
        chain = waiting.popleft()
        if len(chain) > 1 and _reaches(network, ports, chain[-1], acceptor, limits):
            return (*chain, acceptor)
        if len(chain) <= MAX_REPEATERS:
            for repeater in _next(network, ports, chain[-1], seen, limits):
                seen.add(repeater)
                if not unable(repeater):
                    waiting.append((*chain, repeater))
    return None


def _next(
    network: Network,
    ports: dict[str, list[SwitchPort]],
    at: str,
    seen: set[str],
    limits: Limits,
) -> Iterator[str]:
    for address in sorted(ports.keys() - seen):
        enough = len(ports[address]) >= REPEATER_FIBERS
        if enough and _reaches(network, ports, at, address, limits):
            yield address


def _reaches(
    network: Network, ports: dict[str, list[SwitchPort]], one: str, other: str, limits: Limits
) -> bool:
    leg = Leg(ports[one][-1], ports[other][0])
    return cheapest_path(network, leg, limits) is not None


def orders(ordered: SwapsOrdered, number: int) -> dict[str, SwapOrder]:
    """Return what each node of a chain is told, by its address; the messages have this number."""
    told = [
        SwapOrder(number, ordered.session, place, right)
        for place, right in enumerate((*ordered.chain[1:], NOBODY))
    ]
    turns = schedule(ordered.schedule, len(ordered.chain) - 2)
    tells = {turn.after_right: place for place, turn in turns.items() if turn.after_right}
    for place, turn in turns.items():
        told[place] = replace(
            told[place],
            after_left=turn.after_left,
            after_right=turn.after_right,
            tell_left=tells.get(place, 0),
            notices=sum(waiting <= place < teller for teller, waiting in tells.items()),
        )
    return dict(zip(ordered.chain, told, strict=True))


def chain_of_link(setup: Setup, five_tuple: FiveTuple, sessions: Sessions) -> Session | None:
    """Return the session whose chain has this very link; None if there is none.

    It joins the two neighbours by the session that they were ordered to open, with the light that
    was granted to the whole chain.
    """
    for place in range(MAX_REPEATERS + 1):
        session = sessions.by_number.get((setup.session - 1 - place) % (1 << 64))
        if session is not None and session.open and place + 1 < len(session.chain):
            ends = session.chain[place], session.chain[place + 1]
            wanted = replace(
                session.requests[session.owner].granted,
                session=setup.session,
                service=Service.LINK,
                source=ends[0],
                fidelity_ppm=0,
            )
            if ends == (five_tuple.source, five_tuple.destination) and setup == wanted:
                return session
    return None


def links_of(session: Session, sessions: Sessions) -> list[Session]:
    """Return the links of a chain that are registered."""
    numbers = ((session.number + 1 + place) % (1 << 64) for place in range(len(session.chain) - 1))
    found = (sessions.by_number.get(number) for number in numbers)
    return [link for link in found if link and link.setup.service == Service.LINK]
