"""What hosts say of their fibres: LLDP (IEEE 802.1AB) that a quantum switch received."""

from dataclasses import dataclass
from ipaddress import IPv4Address

from controller_apps.framework import lldp
from controller_apps.paths import HostPort
from wire.metadata import MalformedPacket

IPV4_ADDRESS = 1  # IANA address family number


@dataclass(frozen=True)
class Announcement:
    """One LLDP message: a port, and whether it is there or says goodbye."""

    host_port: HostPort
    leaving: bool


def parse(frame: bytes) -> Announcement:
    """Read a frame; raise MalformedPacket unless it names host, port and IPv4 address."""
    message, _, _ = lldp.lldp.parser(frame[14:])
    if message is None:
        raise MalformedPacket(f"LLDP of {len(frame)} bytes cannot be read")
    chassis, port, ttl = message.tlvs[:3]
    addresses = [
        bytes(tlv.addr)
        for tlv in message.tlvs
        if tlv.tlv_type == lldp.LLDP_TLV_MANAGEMENT_ADDRESS
        and tlv.addr_subtype == IPV4_ADDRESS
        and len(tlv.addr) == 4
    ]
    if not addresses:
        raise MalformedPacket("LLDP without an IPv4 management address")
    host = _name(chassis.subtype, chassis.chassis_id)
    address = str(IPv4Address(addresses[0]))
    return Announcement(HostPort(host, address, _name(port.subtype, port.port_id)), ttl.ttl == 0)


def _name(subtype: int, value: bytes) -> str:
    if subtype != lldp.ChassisID.SUB_LOCALLY_ASSIGNED:  # 7, for ports as well
        raise MalformedPacket(f"LLDP identifier of subtype {subtype}, 7 is understood")
    try:
        name = bytes(value).decode("ascii")
    except UnicodeDecodeError as error:
        raise MalformedPacket(f"LLDP identifier {bytes(value)!r} is not ASCII") from error
    if not name or not name.isprintable():
        raise MalformedPacket(f"LLDP identifier {name!r} is not a name")
    return name
