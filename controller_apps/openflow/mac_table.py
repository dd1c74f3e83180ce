"""Where the stations of classical switches are, and which frames are taken from their ports.

Frames that a classical switch takes from the ports of hosts: from their own addresses alone.

A frame with the hardware address of another host, an IPv4 packet or an ARP message with the address
of another goes no further. Ports that no host of ours is at are not looked at: behind those between
switches is everybody.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from ipaddress import IPv4Address
from typing import Any

from controller_apps.openflow.flow_entries import (
    ETH_TYPE_IPV4,
    FILTER_TABLE,
    METADATA_TABLE,
    add,
    delete,
)
from controller_apps.openflow.framework import Datapath, parser
from wire.config import Station

ETHER_TYPE, OPERATION, TARGET = slice(12, 14), slice(20, 22), slice(38, 42)
ARP, REQUEST = b"\x08\x06", b"\x00\x01"
MAX_STATIONS = 4096  # for each switch; more are reached by flooding
OWN_PRIORITY, FOREIGN_PRIORITY, STATION_PRIORITY, PORT_PRIORITY = 40, 30, 20, 10
ETH_TYPE_ARP, ETH_TYPE_IPV6 = 0x0806, 0x86DD


@dataclass
class MacTable:
    """Learned ports by datapath id and hardware address (6 bytes)."""

    ports: dict[int, dict[bytes, int]] = field(default_factory=dict)
    # Of stations that can be nowhere else, by datapath id and IPv4 address.
    places: dict[tuple[int, bytes], int] = field(default_factory=dict)

    def learn(self, dpid: int, station: bytes, port: int) -> bool:
        """Note where a station is; tell whether it has moved there from another port."""
        stations = self.ports.setdefault(dpid, {})
        before = stations.get(station)
        group_address = bool(station[0] & 1)
        if not group_address and (before is not None or len(stations) < MAX_STATIONS):
            stations[station] = port
        return before is not None and before != port

    def port_of(self, dpid: int, station: bytes) -> int | None:
        return self.ports.get(dpid, {}).get(station)

    def place(self, stations: Iterable[Station]) -> None:
        self.places = {
            (station.dpid, IPv4Address(station.address).packed): station.port
            for station in stations
        }

    def asked_at(self, dpid: int, in_port: int, frame: bytes) -> int | None:
        """Return the port of the station that a request of ARP is for, None if it is for all.

        All others would be silent: in a large network most of what copper carries would be these.
        """
        if (frame[ETHER_TYPE], frame[OPERATION]) != (ARP, REQUEST):
            return None
        port = self.places.get((dpid, frame[TARGET]))
        return None if port == in_port else port  # who tells of itself tells all

    def forget(self, dpid: int) -> None:
        self.ports.pop(dpid, None)


def filter_entries(datapath: Datapath, stations: Iterable[Station]) -> list[Any]:
    """Return entries of the first table that let these stations speak for themselves alone.

    They replace earlier entries; stations at other switches are left out.
    """
    entries = [delete(datapath, FILTER_TABLE), add(datapath, FILTER_TABLE, 0, {}, _on())]
    for station in stations:
        if station.dpid == datapath.id:
            entries += _entries(datapath, station)
    return entries


def _entries(datapath: Datapath, station: Station) -> list[Any]:
    port = {"in_port": station.port}
    source = {**port, "eth_src": station.mac}
    arp = {"eth_type": ETH_TYPE_ARP, "arp_sha": station.mac, "arp_spa": station.address}
    ipv4 = {"eth_type": ETH_TYPE_IPV4, "ipv4_src": station.address}
    foreign = [
        add(datapath, FILTER_TABLE, FOREIGN_PRIORITY, {**port, "eth_type": kind})
        for kind in (ETH_TYPE_IPV4, ETH_TYPE_ARP, ETH_TYPE_IPV6)
    ]
    return [
        add(datapath, FILTER_TABLE, OWN_PRIORITY, {**source, **ipv4}, _on()),
        add(datapath, FILTER_TABLE, OWN_PRIORITY, {**source, **arp}, _on()),
        *foreign,
        add(datapath, FILTER_TABLE, STATION_PRIORITY, source, _on()),
        add(datapath, FILTER_TABLE, PORT_PRIORITY, port),
    ]


def _on() -> Any:
    return parser.OFPInstructionGotoTable(METADATA_TABLE)
