"""LLDP (IEEE 802.1AB) on the fibres' supervisory channel: what hosts and switches say by it.

Hosts name themselves and say what they can do (wire.features), under a seal that only they can make
(wire.lldp). Switches say what the controller
has them say: chassis and port as the frameworks' own topology app writes them, and a seal that
only this controller can make. A host can therefore not invent a fibre between switches. There
remains: a host with fibres to two switches that has not announced itself can carry sealed
messages from one to the other, both ways, and so pose as the fibre that it could be.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from hashlib import blake2b
from hmac import compare_digest
from ipaddress import IPv4Address
from typing import Any

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import HostPort
from controller_apps.openflow.framework import lldp
from controller_apps.timeouts import LINK_TTL_S
from wire.features import NodeFeatures
from wire.lldp import (
    FEATURES,
    HOST_SEAL,
    IPV4,
    LOCALLY_ASSIGNED,
    OUI,
    PORT_COMPONENT,
    SWITCH_PORT,
    SWITCH_PREFIX,
    SWITCH_SEAL,
    open_seal,
)
from wire.lldp import switch_message as message_of
from wire.malformed import MalformedPacket

MAX_PORTS_OF_ONE = 1024


SEAL_LENGTH = 16


@dataclass(frozen=True)
class Announcement:
    """A host's message: a port, and whether it is up or says goodbye."""

    host_port: HostPort
    leaving: bool
    seal: bytes = b""  # of the host (wire.lldp); empty: it does not say that it is the host
    sealed: bytes = b""  # what the seal covers


@dataclass(frozen=True)
class SwitchSaid:
    """A message that a controller has sent out of a port of a switch."""

    at: SwitchPort
    seal: bytes  # empty if another controller has sent it


def parse(frame: bytes) -> Announcement | SwitchSaid:
    """Read a frame; raise MalformedPacket unless it names host, port and IPv4 address.

    A message of a switch names its datapath id and port instead.
    """
    message, _, _ = lldp.lldp.parser(frame[14:])
    if message is None or len(message.tlvs) < 3:
        raise MalformedPacket(f"LLDP of {len(frame)} bytes cannot be read")
    chassis, port, ttl = message.tlvs[:3]
    if not (
        isinstance(chassis, lldp.ChassisID)
        and isinstance(port, lldp.PortID)
        and isinstance(ttl, lldp.TTL)
    ):
        raise MalformedPacket("LLDP does not begin with chassis, port and time to live")
    if bytes(chassis.chassis_id).startswith(SWITCH_PREFIX):
        return _switch(chassis, port, message.tlvs)
    seal, sealed = _sealed(frame[14:], message.tlvs)
    return replace(_host(chassis, port, ttl, message.tlvs), seal=seal, sealed=sealed)


def _host(chassis: Any, port: Any, ttl: Any, tlvs: list[Any]) -> Announcement:
    addresses = [
        bytes(tlv.addr)
        for tlv in tlvs
        if tlv.tlv_type == lldp.LLDP_TLV_MANAGEMENT_ADDRESS
        and tlv.addr_subtype == IPV4
        and len(tlv.addr) == 4
    ]
    if not addresses:
        raise MalformedPacket("LLDP without an IPv4 management address")
    host = _name(chassis.subtype, chassis.chassis_id)
    address = str(IPv4Address(addresses[0]))
    name = _name(port.subtype, port.port_id)
    return Announcement(HostPort(host, address, name, _node_features(tlvs)), ttl.ttl == 0)


def _sealed(data: bytes, tlvs: list[Any]) -> tuple[bytes, bytes]:
    """Return the first seal of a host and the TLVs before it; nothing if there is none."""
    length = 0
    for tlv in tlvs:
        if _is_ours(tlv, HOST_SEAL):
            return bytes(tlv.info), data[:length]
        length += 2 + tlv.len
    return b"", b""


def _node_features(tlvs: list[Any]) -> NodeFeatures | None:
    """Return what a host says that it can do; None if it says nothing of it."""
    values = _ours(tlvs, FEATURES)
    if len(values) > 1:
        raise MalformedPacket(f"LLDP that tells {len(values)} times what a host can do")
    return NodeFeatures.decode(values[0]) if values else None


def _ours(tlvs: list[Any], subtype: int) -> list[bytes]:
    return [bytes(tlv.info) for tlv in tlvs if _is_ours(tlv, subtype)]


def _is_ours(tlv: Any, subtype: int) -> bool:
    ours = isinstance(tlv, lldp.OrganizationallySpecific)
    return ours and (bytes(tlv.oui), tlv.subtype) == (OUI, subtype)


def _switch(chassis: Any, port: Any, tlvs: list[Any]) -> SwitchSaid:
    digits, number = bytes(chassis.chassis_id).removeprefix(SWITCH_PREFIX), bytes(port.port_id)
    try:
        dpid = int.from_bytes(bytes.fromhex(digits.decode("ascii")), "big")
    except ValueError as error:
        raise MalformedPacket(f"LLDP of a switch with datapath id {digits!r}") from error
    if len(digits) != 16 or len(number) != SWITCH_PORT.size:
        raise MalformedPacket(f"LLDP of switch {digits!r} with port id {number!r}")
    if port.subtype != PORT_COMPONENT:
        raise MalformedPacket(f"LLDP of switch {digits!r} with port subtype {port.subtype}")
    seals = _ours(tlvs, SWITCH_SEAL)
    return SwitchSaid(SwitchPort(dpid, *SWITCH_PORT.unpack(number)), seals[0] if seals else b"")


def _name(subtype: int, value: bytes) -> str:
    if subtype != LOCALLY_ASSIGNED:
        raise MalformedPacket(f"LLDP identifier of subtype {subtype}, 7 is understood")
    try:
        name = bytes(value).decode("ascii")
    except UnicodeDecodeError as error:
        raise MalformedPacket(f"LLDP identifier {bytes(value)!r} is not ASCII") from error
    if not name or not name.isprintable():
        raise MalformedPacket(f"LLDP identifier {name!r} is not a name")
    return name


def switch_message(at: SwitchPort, address: bytes, key: bytes) -> bytes:
    return message_of(at.dpid, at.port, address, LINK_TTL_S, seal(at, key))


def seal(at: SwitchPort, key: bytes) -> bytes:
    text = b"%016x:%d" % at
    return blake2b(text, key=key, digest_size=SEAL_LENGTH).digest()


def is_genuine(message: SwitchSaid, key: bytes) -> bool:
    return compare_digest(message.seal, seal(message.at, key))


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
