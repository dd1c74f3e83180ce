"""Checks for duplicate or unusable names and addresses, loops of copper, and unconnected fibres."""

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from ipaddress import AddressValueError, IPv4Interface, NetmaskValueError
from typing import Any

from mininet.topo import Topo

from topologies.description.checked_graph import refuse_self_link
from topologies.description.description import is_made
from topologies.links.fiber import FiberLink
from topologies.nodes import ClassicalSwitch, OpticalSwitch, QuantumHost
from topologies.nodes.classical_host import DEFAULT_PREFIX_LENGTH
from topologies.system.runs.node_names import check_name
from wire.parameters.physics import BadParameter

MAC = re.compile("[0-9a-f]{2}(:[0-9a-f]{2}){5}")
OF_GROUPS = 1  # bit of the first octet (IEEE 802-2014, 8.2.2)
MOST_LETTERS = 15  # of an interface's name: IFNAMSIZ of netdevice(7) less its end


def refuse_clashes(topo: Topo) -> None:
    """Raise BadParameter for nodes of one address or ID, bad names, loops and dark fibres."""
    for name in topo.nodes():
        check_name(name)
    nodes = {name: topo.nodeInfo(name) for name in topo.nodes()}
    addresses = {
        name: str(interface_of(name, nodes[name]["ip"]).ip)
        for name in topo.hosts()
        if nodes[name].get("ip")
    }
    _refuse_same("address", "an ip", addresses)
    macs = {name: mac for name in topo.hosts() if (mac := mac_of(name, nodes[name].get("mac")))}
    _refuse_same("MAC address", "a mac", macs)
    dpids = {
        name: f"{_dpid(name, nodes[name]):x}"
        for name in topo.switches()
        if is_made(nodes[name], ClassicalSwitch)
    }
    _refuse_same("datapath ID", "a dpid", dpids)
    for name, interface in _interfaces(topo):
        if len(interface) > MOST_LETTERS:
            raise BadParameter(
                f"{name}: its interface {interface} would have {len(interface)} letters, and "
                f"Linux takes {MOST_LETTERS}: choose a name of at most "
                f"{MOST_LETTERS - len(interface) + len(name)}"
            )
    for one, other, info in topo.links(withInfo=True):
        refuse_self_link(one, other)
        if is_made(info, FiberLink):
            _refuse_dark(f"fibre {one} to {other}", {name: nodes[name] for name in (one, other)})
    _refuse_loops(topo)


def _refuse_loops(topo: Topo) -> None:
    """Raise BadParameter for copper that closes a loop of switches without a spanning tree."""
    infos = {name: topo.nodeInfo(name) for name in topo.switches()}
    joined = {name: {name} for name, info in infos.items() if not info.get("stp")}
    for one, other, info in topo.links(withInfo=True):
        if is_made(info, FiberLink) or not {one, other} <= joined.keys():
            continue
        if other in joined[one]:
            raise BadParameter(
                f"copper {one} to {other} closes a loop of switches, in which broadcasts would "
                "circle without end: leave it out, or another link of the loop"
            )
        together = joined[one] | joined[other]
        joined |= dict.fromkeys(together, together)


def _refuse_dark(fiber: str, ends: Mapping[str, Mapping[str, Any]]) -> None:
    """Raise BadParameter for a fibre that ends at a node without light."""
    for name, info in ends.items():
        if not (is_made(info, QuantumHost) or is_made(info, OpticalSwitch)):
            raise BadParameter(
                f"{fiber}: {name} has no light; make it of cls=QuantumHost or cls=OpticalSwitch"
            )


def _refuse_same(what: str, own: str, values: Mapping[str, str]) -> None:
    """Raise BadParameter for a value that several nodes have."""
    having = defaultdict[str, list[str]](list)
    for name, value in values.items():
        having[value].append(name)
    for value, names in having.items():
        if len(names) > 1:
            raise BadParameter(f"{' and '.join(names)} have one {what}, {value}: give each {own}")


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


def _dpid(name: str, info: Mapping[str, Any]) -> int:
    dpid = info.get("dpid") or info["cls"].dpid_of(name)
    return int(str(dpid).replace(":", ""), 16)


def _interfaces(topo: Topo) -> Iterator[tuple[str, str]]:
    """Yield each node of a link with the name of its interface there, as Mininet makes it.

    Those of hosts' fibres are shorter than that of their copper.
    """
    for one, other, info in topo.links(withInfo=True):
        for name, port in ((one, info["port1"]), (other, info["port2"])):
            if topo.isSwitch(name) or not is_made(info, FiberLink):
                yield name, f"{name}-eth{port}"
