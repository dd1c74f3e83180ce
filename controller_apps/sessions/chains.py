"""Which repeaters join two hosts: the fewest, each with light from the one before it.

A link leaves a host by its last fibre and comes to the next one by its first (wire.services).
"""

from collections import deque
from collections.abc import Iterator

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Network
from controller_apps.light.routing import Leg, Limits, cheapest_path
from controller_apps.sessions.actions import SwapsOrdered
from wire.device import MAX_REPEATERS, NOBODY, SwapOrder

REPEATER_FIBERS = 2

Chain = tuple[str, ...]  # addresses, from the opener's to the acceptor's


def find_chain(network: Network, opener: str, acceptor: str, limits: Limits) -> Chain | None:
    """Return the shortest chain with a repeater at least; None if there is none."""
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
    rights = [*ordered.chain[1:], NOBODY]
    return {
        address: SwapOrder(number, ordered.session, place, right)
        for place, (address, right) in enumerate(zip(ordered.chain, rights, strict=True))
    }
