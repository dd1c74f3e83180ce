"""The links that key managers have reported, and the route that keys take over them.

No socket, no clock. A route has as few hops as can be, because every host between its ends knows
the keys; of those it is the one whose poorest link has most. Only hosts that the policy trusts
with keys of these two ends are between them.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from applications.keys.route_messages import MAX_HOPS, KeyRouteRequest, LinkState
from controller_apps.policy.policy import Policy
from controller_apps.timeouts import SILENT_S

MAX_APPLICATIONS = 4096  # the oldest is forgotten


@dataclass(frozen=True)
class Report:
    links: dict[str, LinkState]  # by address of the other end
    heard: float


@dataclass(frozen=True)
class Application:
    """A master and a slave that keys were asked for, and by whom they go."""

    master: str
    slave: str
    nodes: tuple[str, ...]  # addresses


class Stores(NamedTuple):
    """The stores of a link, and whether relays are kept out of it."""

    mine: int
    theirs: int
    withheld: bool


def stores_of(link: LinkState) -> Stores:
    return Stores(link.mine, link.theirs, link.withheld)


class NoRoute(Exception):
    """Keys cannot go to that host; the text says why, and what would help."""


@dataclass
class KeyNetwork:
    """All key links; hosts are known by their addresses, `names` has their names."""

    names: dict[str, str]
    policy: Policy = field(default_factory=Policy)
    hosts: dict[str, Report] = field(default_factory=dict)
    applications: dict[tuple[str, str], Application] = field(default_factory=dict)

    def take(self, host: str, links: tuple[LinkState, ...], now: float) -> None:
        """Take in what a host says; links to what is not a host are passed over."""
        peers = {link.peer: link for link in links if link.peer in self.names}
        self.hosts[host] = Report(peers, now)

    def stores(self, host: str) -> dict[str, Stores]:
        report = self.hosts.get(host)
        return {peer: stores_of(link) for peer, link in report.links.items()} if report else {}

    def serve(self, host: str, request: KeyRouteRequest, now: float) -> tuple[tuple[str, ...], int]:
        """Return the addresses that keys of an application go by, and the keys of the poorest link.

        Raise NoRoute if they cannot.
        """
        nodes, stored = self.route(host, request, now)
        master, slave = request.master, request.slave
        self.applications.pop((master, slave), None)
        self.applications[master, slave] = Application(master, slave, nodes)
        while len(self.applications) > MAX_APPLICATIONS:
            del self.applications[next(iter(self.applications))]
        return nodes, stored

    def route(self, host: str, request: KeyRouteRequest, now: float) -> tuple[tuple[str, ...], int]:
        """Return the route for a request, and the keys of its poorest link; or raise NoRoute."""
        target = request.target
        if target not in self.names or target == host:
            raise NoRoute(f"{target} is not another host with a key manager")
        ends = frozenset((self.names[host], self.names[target]))

        def may_pass(node: str) -> bool:
            return self.policy.trusts(self.names[node], ends)

        path = self._widest(host, target, request.stored, now, may_pass)
        if path is None:
            raise NoRoute(self._why_not(host, request, now))
        return path

    def links_of(self, host: str, now: float) -> Iterator[tuple[LinkState, bool]]:
        report = self.hosts.get(host)
        for link in report.links.values() if report else ():
            yield link, self._alive(host, now) and not link.withheld

    def _alive(self, host: str, now: float) -> bool:
        return now - self.hosts[host].heard <= SILENT_S

    def _widest(
        self, start: str, end: str, stored: int, now: float, may_pass: Callable[[str], bool]
    ) -> tuple[tuple[str, ...], int] | None:
        """Return the route of fewest hops, and of those the one with most at its poorest link."""
        layer: dict[str, tuple[tuple[str, ...], int]] = {start: ((start,), 1 << 32)}
        seen = {start}
        for _hop in range(MAX_HOPS - 1):
            following: dict[str, tuple[tuple[str, ...], int]] = {}
            for node, (nodes, least) in layer.items():
                for link, usable in self.links_of(node, now):
                    if not usable or link.mine < stored or link.peer in seen:
                        continue
                    if link.peer != end and not may_pass(link.peer):
                        continue
                    wide = min(least, link.mine)
                    if link.peer not in following or wide > following[link.peer][1]:
                        following[link.peer] = (*nodes, link.peer), wide
            if end in following:
                return following[end]
            if not following:
                return None
            seen |= following.keys()
            layer = following
        return None

    def _why_not(self, host: str, request: KeyRouteRequest, now: float) -> str:
        ends = f"{self.names[host]} and {self.names[request.target]}"
        anybody = self._widest(host, request.target, request.stored, now, lambda _node: True)
        if anybody is not None:
            nodes = ", ".join(self.names[node] for node in anybody[0][1:-1])
            return (
                f"no host that the policy trusts joins {ends}: {nodes} could, if [[trusted]] of "
                "the policy names it"
            )
        if self._widest(host, request.target, 0, now, lambda _node: True) is not None:
            return f"too few keys are stored between {ends} for {request.stored} now: ask later"
        return f"no chain of key links that are in use joins {ends}"
