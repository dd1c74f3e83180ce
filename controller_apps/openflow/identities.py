"""Who hosts are that announce fibres: those of this network prove it, by their device keys."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from controller_apps.openflow.discovery import Announcement
from wire.announcement import open_seal
from wire.malformed import MalformedPacket

MAX_PORTS_OF_ONE = 1024


@dataclass
class Identities:
    """The device keys and IPv4 addresses of the hosts of this network, by name."""

    keys: Mapping[str, str]
    addresses: Mapping[str, str]
    _numbers: dict[str, dict[str, int]] = field(default_factory=dict)  # the last, by host and port

    def check(self, announcement: Announcement) -> None:
        """Raise MalformedPacket for what somebody else says in the name of a host of this network.

        A host that is not of this network, in name or address, is taken at its word.
        """
        host_port = announcement.host_port
        host, address, port = host_port.host, host_port.address, host_port.name
        if host not in self.keys:
            if address in self.addresses.values():
                raise MalformedPacket(f"LLDP of {host} with the address {address} of another host")
            return
        if not announcement.seal:
            raise MalformedPacket(f"LLDP in the name of {host} without its seal")
        if address != self.addresses.get(host, address):
            raise MalformedPacket(
                f"LLDP of {host} with the address {address}, which is not its own"
            )
        number = open_seal(announcement.seal, announcement.sealed, self.keys[host])
        numbers = self._numbers.setdefault(host, {})
        if number <= numbers.get(port, 0):
            raise MalformedPacket(f"LLDP of {host} for {port} that was heard before")
        if port not in numbers and len(numbers) >= MAX_PORTS_OF_ONE:
            raise MalformedPacket(f"LLDP of {host} for {port}: {len(numbers)} ports are its most")
        numbers[port] = number
