"""At which port of which classical switch a station was last seen."""

from dataclasses import dataclass, field

MAX_STATIONS = 4096  # for each switch; more are reached by flooding


@dataclass
class MacTable:
    """Learned ports by datapath id and hardware address (6 bytes)."""

    ports: dict[int, dict[bytes, int]] = field(default_factory=dict)

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

    def forget(self, dpid: int) -> None:
        """Drop everything learned at a switch."""
        self.ports.pop(dpid, None)
