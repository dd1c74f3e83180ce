"""The optical network as discovered: switches, hosts at their ports, fibres between them."""

import re
from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass, field
from functools import lru_cache, reduce
from typing import Any, Generic, NamedTuple, TypeVar

from controller_apps.light.optics import Optics
from controller_apps.light.optics import SwitchPort as SwitchPort
from wire.features import NodeFeatures

MAX_PORTS = 4096


class Hop(NamedTuple):
    """One cross-connect: light that enters a switch at in_port leaves at out_port."""

    dpid: int
    in_port: int
    out_port: int


class Direction(NamedTuple):
    """A port in one direction: a fibre carries light both ways independently."""

    dpid: int
    port: int
    inward: bool  # into the switch

    @property
    def opposite(self) -> "Direction":
        return Direction(self.dpid, self.port, not self.inward)


@dataclass(frozen=True)
class HostPort:
    host: str
    address: str  # IPv4, of its classical interface
    name: str  # of the port
    node_features: NodeFeatures | None = None  # None: it says nothing of them


def directions(hops: Iterable[Hop]) -> list[Direction]:
    """Return what the hops occupy, each of which carries one path only."""
    return [
        direction
        for hop in hops
        for direction in (
            Direction(hop.dpid, hop.in_port, True),
            Direction(hop.dpid, hop.out_port, False),
        )
    ]


def switches(hops: Iterable[Hop]) -> list[int]:
    """Return the datapath ids that the hops cross, each once, in order."""
    return list(dict.fromkeys(hop.dpid for hop in hops))


@lru_cache(MAX_PORTS)
def natural_order(name: str) -> tuple[tuple[int, str], ...]:
    parts = re.split(r"([0-9]+)", name)
    return tuple((int(part), "") if part.isdecimal() else (0, part) for part in parts)


@dataclass(frozen=True)
class HostIndex:
    """The ports of hosts, and what hosts can do, by address."""

    hosts: dict[SwitchPort, HostPort]  # of which it is
    ports: dict[str, list[SwitchPort]]
    node_features: dict[str, NodeFeatures]

    @classmethod
    def of(cls, hosts: dict[SwitchPort, HostPort]) -> "HostIndex":
        """Build it, ports in order of their names."""
        ports: defaultdict[str, list[SwitchPort]] = defaultdict(list)
        announced: defaultdict[str, list[NodeFeatures]] = defaultdict(list)
        for at, host in sorted(hosts.items(), key=lambda item: natural_order(item[1].name)):
            ports[host.address].append(at)
            if host.node_features is not None:
                announced[host.address].append(host.node_features)
        can = {
            address: reduce(NodeFeatures.both, features) for address, features in announced.items()
        }
        return cls(hosts, dict(ports), can)


Key = TypeVar("Key", bound=Hashable)
Value = TypeVar("Value")


@dataclass
class Kept(Generic[Key, Value]):
    """Results that hold until the state they follow from changes."""

    most: int = 1024
    _state: object = None
    _known: dict[Key, Value] = field(default_factory=dict)

    def found(self, state: object, key: Key, find: Callable[[], Value]) -> Value:
        if self._state != state or (len(self._known) >= self.most and key not in self._known):
            self._state = state
            self._known.clear()
        if key not in self._known:
            self._known[key] = find()
        return self._known[key]


Bound = tuple[int, int]  # loss in thousandths of a dB, switches
Ends = tuple[tuple[SwitchPort, SwitchPort], ...]  # of fibres, the near one first


@dataclass
class Network:
    """Quantum switches that are connected, hosts at their ports, fibres between them."""

    connected: set[int] = field(default_factory=set)
    hosts: dict[SwitchPort, HostPort] = field(default_factory=dict)  # another one if it changes
    links: dict[SwitchPort, SwitchPort] = field(default_factory=dict)
    cut: set[SwitchPort] = field(default_factory=set)  # ports whose fibre is down
    optics: Optics = field(default_factory=Optics)
    broken: dict[SwitchPort, SwitchPort] = field(default_factory=dict)  # links before they were cut
    names: dict[int, str] = field(default_factory=dict)  # of switches, for people
    inner: dict[int, frozenset[int]] = field(default_factory=dict)  # inner ports, by switch
    modes: dict[SwitchPort, int] = field(default_factory=dict)  # qubits that memories there take
    closed: frozenset[frozenset[str]] = frozenset()  # switches, by name, between which none may go
    wiring: int = field(default=0, init=False, compare=False)  # another one if links change
    _bounds: Kept[SwitchPort, dict[int, Bound]] = field(
        default_factory=Kept, init=False, compare=False, repr=False
    )
    _free: Kept[Hashable, Any] = field(default_factory=Kept, init=False, compare=False, repr=False)
    _index: HostIndex | None = field(default=None, init=False, compare=False, repr=False)
    _near: dict[int, Ends] = field(default_factory=dict, init=False, compare=False, repr=False)

    def attach(self, at: SwitchPort, host_port: HostPort) -> bool:
        """Note which host's port a fibre leads to; tell whether that is news."""
        if self.hosts.get(at) == host_port or len(self.hosts) >= MAX_PORTS:
            return False
        self.hosts = {
            place: other
            for place, other in self.hosts.items()
            if (other.host, other.name) != (host_port.host, host_port.name)
        }
        self.hosts[at] = host_port
        self.remove_link(at)
        self._forget_broken(at)
        return True

    def detach(self, at: SwitchPort) -> bool:
        """Forget what a fibre leads to; tell whether anything was known."""
        attached = at in self.hosts
        if attached:
            self.hosts = {place: host for place, host in self.hosts.items() if place != at}
        return attached

    def set_fiber(self, at: SwitchPort, whole: bool) -> bool:
        """Note whether the fibre at a port is whole; tell whether that is news."""
        if whole != (at in self.cut):
            return False
        self.cut ^= {at}
        self.optics.forget_light(at)
        if not whole and (other := self.remove_link(at)) is not None:
            self.broken |= {at: other, other: at}
        return True

    def add_link(self, one: SwitchPort, other: SwitchPort) -> bool:
        """Note a fibre between two switches; tell whether that is news.

        A port that a host has announced is not an end of such a fibre.
        """
        if one == other or {one, other} & self.hosts.keys() or self.links.get(one) == other:
            return False
        for end in (one, other):
            self.remove_link(end)
            self._forget_broken(end)
        self.links[one] = other
        self.links[other] = one
        self._rewired()
        return True

    def remove_link(self, end: SwitchPort) -> SwitchPort | None:
        """Forget the fibre between switches that ends here; return its other end if known."""
        other = self.links.pop(end, None)
        if other is not None:
            del self.links[other]
            self._rewired()
        return other

    def _rewired(self) -> None:
        self.wiring += 1
        self._near.clear()

    def bounds(self, end: SwitchPort, find: Callable[[], dict[int, Bound]]) -> dict[int, Bound]:
        """Return the bounds to a port, found out once for these links and losses."""
        return self._bounds.found((self.wiring, self.optics.changes), end, find)

    def if_all_were_free(self, key: Hashable, find: Callable[[], Value]) -> Value:
        """Return what is found of light paths whatever others have, once for this network."""
        parts = frozenset(self.connected), frozenset(self.cut), self.closed
        value: Value = self._free.found((self.wiring, self.optics.changes, *parts), key, find)
        return value

    def _forget_broken(self, end: SwitchPort) -> None:
        other = self.broken.pop(end, None)
        if other is not None:
            del self.broken[other]

    def name_of(self, dpid: int) -> str:
        """Return a switch's name, or its datapath id where it is not known."""
        return self.names.get(dpid, f"switch {dpid:#x}")

    def _hosts_by_address(self) -> HostIndex:
        if self._index is None or self._index.hosts is not self.hosts:
            self._index = HostIndex.of(self.hosts)
        return self._index

    def ports_of(self, address: str) -> list[SwitchPort]:
        """Return where the ports of a host are, in order of their names; empty if unknown."""
        return self._hosts_by_address().ports.get(address, [])

    def channel_ports_of(self, address: str, frequency_mhz: int | None) -> list[SwitchPort]:
        """Return the same of one channel, and ports that are of no channel; None: of any."""
        ports = self.ports_of(address)
        if frequency_mhz is None:
            return ports
        return [at for at in ports if self.optics.is_of_channel(at, frequency_mhz)]

    def node_features_of(self, address: str) -> NodeFeatures | None:
        return self._hosts_by_address().node_features.get(address)

    def links_from(self, dpid: int) -> list[tuple[SwitchPort, SwitchPort]]:
        """Return the whole fibres from a switch to others: its port, and the far port."""
        connected, cut = self.connected, self.cut
        return [
            (near, far)
            for near, far in self.fibers_from(dpid)
            if far.dpid in connected
            and near not in cut
            and far not in cut
            and not self.is_closed(near)
        ]

    def is_closed(self, at: SwitchPort) -> bool:
        far = self.links.get(at) if self.closed else None
        return far is not None and {self.name_of(at.dpid), self.name_of(far.dpid)} in self.closed

    def fibers_from(self, dpid: int) -> Ends:
        """Return the fibres from a switch to others, whole or cut: its port, and the far port."""
        if not self._near:
            ends: defaultdict[int, list[tuple[SwitchPort, SwitchPort]]] = defaultdict(list)
            for near, far in self.links.items():
                ends[near.dpid].append((near, far))
            self._near.update((switch, tuple(fibers)) for switch, fibers in ends.items())
        return self._near.get(dpid, ())

    def is_whole(self, hops: Iterable[Hop]) -> bool:
        """Tell whether light can take these hops: switches there, fibres not cut nor closed."""
        hops = list(hops)
        ports = {SwitchPort(hop.dpid, port) for hop in hops for port in hop[1:]}
        if not self.connected.issuperset(switches(hops)) or self.cut & ports:
            return False
        return not any(map(self.is_closed, ports))
