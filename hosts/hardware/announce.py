"""LLDP announcements on the fibres' supervisory channel, by which a controller finds hosts.

IEEE 802.1AB: chassis id = host name, port id = interface name (both locally assigned),
management address = IPv4 address of the host's CNIC; what the host can do: wire.features.
"""

import asyncio
import socket
from contextlib import suppress
from ipaddress import IPv4Address

from os_ken.lib.packet import ethernet, lldp, packet

from wire.features import OUI, SUBTYPE, Abilities

TTL_S = 30
PERIOD_S = 5.0
FAST_START = (0.2,) * 50  # pauses before the period begins, while the network starts


def announcement(name: str, port: str, address: str, mac: str, abilities: Abilities) -> bytes:
    """Return the LLDP frame of one fibre port."""
    management = lldp.ManagementAddress(
        addr_subtype=1,  # IPv4 (IANA address family numbers)
        addr=IPv4Address(address).packed,
        intf_subtype=1,  # unknown
        intf_num=0,
        oid=b"",
    )
    tlvs = (
        lldp.ChassisID(
            subtype=lldp.ChassisID.SUB_LOCALLY_ASSIGNED,
            chassis_id=name.encode(),
        ),
        lldp.PortID(subtype=lldp.PortID.SUB_LOCALLY_ASSIGNED, port_id=port.encode()),
        lldp.TTL(ttl=TTL_S),
        management,
        lldp.OrganizationallySpecific(oui=OUI, subtype=SUBTYPE, info=abilities.encode()),
        lldp.End(),
    )
    frame = packet.Packet()
    frame.add_protocol(
        ethernet.ethernet(dst=lldp.LLDP_MAC_NEAREST_BRIDGE, src=mac, ethertype=0x88CC)
    )
    frame.add_protocol(lldp.lldp(tlvs=tlvs))
    frame.serialize()
    return bytes(frame.data)


async def announce(name: str, address: str, ports: list[str], abilities: Abilities) -> None:
    """Announce every fibre port for ever, quickly at first (802.1AB fast start)."""
    channels = [_open(port) for port in ports]
    macs = [channel.getsockname()[4].hex(":") for channel in channels]
    frames = [
        announcement(name, port, address, mac, abilities)
        for port, mac in zip(ports, macs, strict=True)
    ]
    try:
        pauses = iter(FAST_START)
        while True:
            for channel, frame in zip(channels, frames, strict=True):
                with suppress(OSError):  # a fibre that is set down says nothing
                    channel.send(frame)
            await asyncio.sleep(next(pauses, PERIOD_S))
    finally:
        for channel in channels:
            channel.close()


def _open(port: str) -> socket.socket:
    channel = socket.socket(socket.AF_PACKET, socket.SOCK_RAW)
    channel.bind((port, 0))
    return channel
