"""Frames that a classical switch takes from the ports of hosts: from their own addresses alone.

A frame with the hardware address of another host, an IPv4 packet or an ARP message with the address
of another goes no further. Ports that no host of ours is at are not looked at: behind those between
switches is everybody.
"""

from collections.abc import Iterable
from typing import Any

from controller_apps.openflow.flow_entries import (
    ETH_TYPE_IPV4,
    FILTER_TABLE,
    METADATA_TABLE,
    add,
    delete,
)
from controller_apps.openflow.framework import parser
from wire.config import Station

OWN_PRIORITY, FOREIGN_PRIORITY, STATION_PRIORITY, PORT_PRIORITY = 40, 30, 20, 10
ETH_TYPE_ARP, ETH_TYPE_IPV6 = 0x0806, 0x86DD


def filter_entries(datapath: Any, stations: Iterable[Station]) -> list[Any]:
    """Return what makes the first table of a switch let these stations speak for themselves alone.

    Of stations at other switches nothing is said. It takes the place of what was there before.
    """
    entries = [delete(datapath, FILTER_TABLE), add(datapath, FILTER_TABLE, 0, {}, _on())]
    for station in stations:
        if station.dpid == datapath.id:
            entries += _entries(datapath, station)
    return entries


def _entries(datapath: Any, station: Station) -> list[Any]:
    port = {"in_port": station.port}
    own = {**port, "eth_src": station.mac}
    arp = {"eth_type": ETH_TYPE_ARP, "arp_sha": station.mac, "arp_spa": station.address}
    ipv4 = {"eth_type": ETH_TYPE_IPV4, "ipv4_src": station.address}
    foreign = [
        add(datapath, FILTER_TABLE, FOREIGN_PRIORITY, {**port, "eth_type": kind})
        for kind in (ETH_TYPE_IPV4, ETH_TYPE_ARP, ETH_TYPE_IPV6)
    ]
    return [
        add(datapath, FILTER_TABLE, OWN_PRIORITY, {**own, **ipv4}, _on()),
        add(datapath, FILTER_TABLE, OWN_PRIORITY, {**own, **arp}, _on()),
        *foreign,
        add(datapath, FILTER_TABLE, STATION_PRIORITY, own, _on()),
        add(datapath, FILTER_TABLE, PORT_PRIORITY, port),
    ]


def _on() -> Any:
    return parser.OFPInstructionGotoTable(METADATA_TABLE)
