"""The nodes and links of a topology, read once: with their classes, addresses and ends.

Ours, one of a user's own file and what `mn --custom` is given are Mininet's Topo, all alike.
"""

import re
import string
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from ipaddress import AddressValueError, IPv4Interface, NetmaskValueError
from typing import Any, NamedTuple

from mininet.topo import Topo

from topologies.links.fiber import FiberLink
from topologies.nodes import ClassicalSwitch
from topologies.nodes.classical_host import DEFAULT_PREFIX_LENGTH
from wire.parameters.physics import BadParameter

Info = dict[str, Any]  # keywords of a node or link, as Mininet keeps them
MAC = re.compile("[0-9a-f]{2}(:[0-9a-f]{2}){5}")
OF_GROUPS = 1  # bit of the first octet (IEEE 802-2014, 8.2.2)
DPID_DIGITS = 16  # of OpenFlow's 64 bits


@dataclass(frozen=True)
class Node:
    """A node; `kind` is its class, object if it names none."""

    name: str
    kind: type
    is_switch: bool
    info: Info
    address: IPv4Interface | None = None  # of a host that has one
    mac: str = ""  # of a host that has one of its own
    dpid: int | None = None  # of a switch of ours

    @property
    def passes_packets(self) -> bool:
        """Whether it passes packets on: a switch, or a host of a user's own class, as a router."""
        return self.is_switch or not is_ours(self.kind)


class Link(NamedTuple):
    a: Node
    b: Node
    a_port: int
    b_port: int
    is_fiber: bool
    info: Info

    def __str__(self) -> str:
        return f"{'fibre' if self.is_fiber else 'copper'} {self.a.name} to {self.b.name}"

    def given(self, names: Collection[str]) -> dict[str, Any]:
        return {name: self.info[name] for name in names if name in self.info}

    @property
    def ends(self) -> tuple[tuple[Node, int, Node], tuple[Node, int, Node]]:
        """Each node with its port, and the node at the other end."""
        return (self.a, self.a_port, self.b), (self.b, self.b_port, self.a)


@dataclass(frozen=True)
class Content:
    """All nodes by name, in the order of their names, and all links."""

    nodes: Mapping[str, Node]
    links: list[Link]

    def of(self, kind: type) -> list[Node]:
        return [node for node in self.nodes.values() if issubclass(node.kind, kind)]


def content_of(topo: Topo) -> Content:
    """Return the content of a topology; raise BadParameter for an address that cannot be."""
    nodes = {name: _node(name, topo.nodeInfo(name)) for name in topo.nodes()}
    links = [
        Link(nodes[a], nodes[b], info["port1"], info["port2"], is_made(info, FiberLink), info)
        for a, b, info in topo.links(withInfo=True)
    ]
    return Content(nodes, links)


def _node(name: str, info: Info) -> Node:
    kind = info.get("cls")
    kind = kind if isinstance(kind, type) else object
    if info.get("isSwitch"):
        of_ours = issubclass(kind, ClassicalSwitch)
        return Node(name, kind, True, info, dpid=dpid_of(name, info) if of_ours else None)
    address = interface_of(name, info["ip"]) if info.get("ip") else None
    return Node(name, kind, False, info, address, mac_of(name, info.get("mac")))


def is_made(info: Mapping[str, Any], kind: type) -> bool:
    made = info.get("cls")
    return isinstance(made, type) and issubclass(made, kind)


def is_ours(kind: object) -> bool:
    """Whether a class of nodes or links is of this program, and not of a user or of Mininet."""
    return isinstance(kind, type) and kind.__module__.split(".")[0] == "topologies"


def interface_of(name: str, text: str) -> IPv4Interface:
    """Return a host's address, with its network; raise BadParameter for what is none."""
    try:
        return IPv4Interface(text if "/" in text else f"{text}/{DEFAULT_PREFIX_LENGTH}")
    except (AddressValueError, NetmaskValueError) as error:
        text = f"{name}: ip {text!r} is not an address: write ADDRESS/BITS"
        raise BadParameter(f"{text} ({error})") from error


def mac_of(name: str, text: object) -> str:
    """Return a host's hardware address, "" if it has none of its own; raise BadParameter."""
    if text is None:
        return ""
    digits = str(text).lower()
    if not MAC.fullmatch(digits) or int(digits[:2], 16) & OF_GROUPS:
        raise BadParameter(
            f"{name}: mac {text!r} is not that of one host: write six pairs of hexadecimal digits, "
            "as 02:00:00:00:00:01"
        )
    return digits


def dpid_of(name: str, info: Mapping[str, Any]) -> int:
    """Return the datapath ID of a switch of ours; raise BadParameter for what is none."""
    dpid = info.get("dpid") or info["cls"].dpid_of(name)
    if not dpid:
        raise BadParameter(f'{name} has no dpid: give one of its own, as dpid="1"')
    digits = dpid.replace(":", "") if isinstance(dpid, str) else ""
    if not 0 < len(digits) <= DPID_DIGITS or not set(digits) <= set(string.hexdigits):
        raise BadParameter(
            f"{name}: dpid {dpid!r} is not 1 to {DPID_DIGITS} hexadecimal digits in quotes"
        )
    return int(digits, 16)
