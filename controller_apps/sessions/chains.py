"""The repeaters that join two hosts: the fewest, each with light from the one before it.

Light leaves a host by another fibre than it comes by.
"""

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Network
from controller_apps.light.routing import Leg, Limits, cheapest_path
from controller_apps.packets.segments import FiveTuple
from controller_apps.policy.schedules import schedule
from controller_apps.sessions.actions import SwapsOrdered
from controller_apps.sessions.sessions import Chain, Session, Sessions, Stop
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
    waiting: deque[Chain] = deque([(Stop(opener),)])
    seen: set[tuple[str, int]] = set()  # repeaters, and by which fibre light comes to them
    while waiting:
        chain = waiting.popleft()
        for right, left in _links(network, ports, chain, acceptor, limits) if chain[1:] else ():
            return _extended(chain, acceptor, right, left)
        if len(chain) > MAX_REPEATERS:
            continue
        passed = {acceptor, *(stop.address for stop in chain)}
        for address in sorted(ports.keys() - passed):
            if len(ports[address]) < REPEATER_FIBERS or unable(address):
                continue
            for right, left in _links(network, ports, chain, address, limits):
                if (address, left) not in seen:
                    seen.add((address, left))
                    waiting.append(_extended(chain, address, right, left))
    return None


def _extended(chain: Chain, address: str, right: int, left: int) -> Chain:
    return (*chain[:-1], chain[-1]._replace(right=right), Stop(address, left))


def _links(
    network: Network,
    ports: Mapping[str, list[SwitchPort]],
    chain: Chain,
    address: str,
    limits: Limits,
) -> Iterator[tuple[int, int]]:
    """Yield by which fibres light goes from the end of a chain to a host: out of one, into one."""
    last = chain[-1]
    taken = set() if len(chain) == 1 else {last.left}
    for right in sorted(set(range(len(ports[last.address]))) - taken, reverse=True):
        for left, port in enumerate(ports[address]):
            if cheapest_path(network, Leg(ports[last.address][right], port), limits) is not None:
                yield right, left


def repeaters_of(chain: Chain) -> list[str]:
    """Return the addresses of the repeaters of a chain."""
    return [stop.address for stop in chain[1:-1]]


def orders(ordered: SwapsOrdered, number: int) -> dict[str, SwapOrder]:
    """Return what each node of a chain is told, by its address; the messages have this number."""
    chain = ordered.chain
    told = [
        SwapOrder(number, ordered.session, place, right, stop.left, stop.right)
        for place, (stop, right) in enumerate(
            zip(chain, [*(stop.address for stop in chain[1:]), NOBODY], strict=True)
        )
    ]
    turns = schedule(ordered.schedule, len(chain) - 2)
    tells = {turn.after_right: place for place, turn in turns.items() if turn.after_right}
    for place, turn in turns.items():
        told[place] = replace(
            told[place],
            after_left=turn.after_left,
            after_right=turn.after_right,
            tell_left=tells.get(place, 0),
            notices=sum(waiting <= place < teller for teller, waiting in tells.items()),
        )
    return {stop.address: order for stop, order in zip(chain, told, strict=True)}


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
            wanted = replace(
                session.requests[session.owner].granted,
                session=setup.session,
                service=Service.LINK,
                source=left.address,
                fidelity_ppm=0,
            )
            joined = five_tuple.source, five_tuple.destination
            if joined == (left.address, right.address) and setup == wanted:
                return ends
    return None


def links_of(session: Session, sessions: Sessions) -> list[Session]:
    """Return the links of a chain that are registered."""
    numbers = ((session.number + 1 + place) % (1 << 64) for place in range(len(session.chain) - 1))
    found = (sessions.by_number.get(number) for number in numbers)
    return [link for link in found if link and link.setup.service == Service.LINK]
