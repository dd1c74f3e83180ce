"""At which port of which classical switch a station was last seen, or is known to be."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from ipaddress import IPv4Address

from wire.config import Station

ETHER_TYPE, OPERATION, TARGET = slice(12, 14), slice(20, 22), slice(38, 42)
ARP, REQUEST = b"\x08\x06", b"\x00\x01"
MAX_STATIONS = 4096  # for each switch; more are reached by flooding


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
        """Return the learned port, None if there is none."""
        return self.ports.get(dpid, {}).get(station)

    def place(self, stations: Iterable[Station]) -> None:
        """Take stations whose ports let nobody else speak in their names, in place of others."""
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
        """Drop everything learned at a switch."""
        self.ports.pop(dpid, None)
