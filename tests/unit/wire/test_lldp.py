"""The frames by which hosts and switches name their ports."""

from ipaddress import IPv4Address

import pytest
from scapy.contrib.lldp import LLDPDUGenericOrganisationSpecific, LLDPDUManagementAddress
from scapy.layers.l2 import Ether

from wire.features import EMIT, EVERYTHING, STORE, NodeFeatures
from wire.lldp import announcement, open_seal, seal, switch_message
from wire.malformed import MalformedPacket

MAC = bytes.fromhex("020000000100")
KEY = "00112233445566778899aabbccddeeff"
ABLE = NodeFeatures(EMIT | STORE, 32)
GOLDEN = (
    "0180c200000e 020000000100 88cc"
    "0206 07 616c696365"  # alice
    "0409 07 616c6963652d7130"  # alice-q0
    "0602 001e"
    "100c 05 01 0a000001 01 00000000 00"
    "fe09 02514d 02 03 00000020"
    "0000"
)


def test_a_frame_has_these_bytes_and_the_length_that_ethernet_wants() -> None:
    frame = announcement("alice", "alice-q0", "10.0.0.1", MAC, 30, ABLE)
    assert frame == bytes.fromhex(GOLDEN)
    assert len(announcement("a", "a", "10.0.0.1", MAC, 30, ABLE)) == 60


def test_a_sealed_frame_has_these_bytes() -> None:
    # The HMAC was computed by openssl over "fibre", the number and the TLVs before.
    frame = announcement("alice", "alice-q0", "10.0.0.1", MAC, 30, ABLE, KEY, 0x0102030405060708)
    sealed = "fe1c 02514d 03 0102030405060708 b5ef4ffafcf3aca9c4b6f81f0c6323e8 0000"
    assert frame == bytes.fromhex(GOLDEN.removesuffix("0000") + sealed)


def test_a_seal_is_opened_whole_by_its_key_alone() -> None:
    tlvs, number = b"whatever was announced", 0x0102030405060708
    sealed = seal(tlvs, KEY, number)
    assert open_seal(sealed, tlvs, KEY) == number
    for data, covered, key in (
        (sealed[:-1], tlvs, KEY),
        (sealed + b"\0", tlvs, KEY),
        (bytes(7) + sealed[7:], tlvs, KEY),
        (sealed, tlvs[1:], KEY),
        (sealed, tlvs, KEY[::-1]),
    ):
        with pytest.raises(MalformedPacket, match="seal of an announcement"):
            open_seal(data, covered, key)


def test_what_a_switch_says_has_these_bytes() -> None:
    # Type and length by IEEE 802.1AB; the frameworks' topology app writes such ids.
    expected = (
        "0180c200000e 020000000100 88cc"
        "0216 07 647069643a 30303030303030303030303031303031"  # dpid:0000000000001001
        "0405 02 00000006"
        "0602 0078"
        "fe14 02514d 01 000102030405060708090a0b0c0d0e0f"
        "0000"
    )
    assert switch_message(0x1001, 6, MAC, 120, bytes(range(16))) == bytes.fromhex(expected)


def test_os_ken_reads_what_was_meant() -> None:
    able = NodeFeatures(EVERYTHING, 1 << 31)
    from os_ken.lib.packet import ethernet, lldp, packet  # all protocols there are: half a second

    read = packet.Packet(announcement("bob", "b" * 255, "10.0.1.255", MAC, 65_535, able))
    assert read.get_protocol(ethernet.ethernet).src == "02:00:00:00:01:00"
    host, port, ttl, management, ours, end = read.get_protocol(lldp.lldp).tlvs
    assert (host.subtype, host.chassis_id) == (lldp.ChassisID.SUB_LOCALLY_ASSIGNED, b"bob")
    assert (port.subtype, port.port_id) == (lldp.PortID.SUB_LOCALLY_ASSIGNED, b"b" * 255)
    assert ttl.ttl == 65_535
    assert IPv4Address(management.addr) == IPv4Address("10.0.1.255")
    assert (management.addr_subtype, management.intf_subtype, management.oid) == (1, 1, b"")
    assert (ours.oui, ours.subtype, NodeFeatures.decode(ours.info)) == (b"\x02QM", 2, able)
    assert isinstance(end, lldp.End)


def test_scapy_reads_what_the_host_can_do() -> None:
    frame = Ether(announcement("alice", "alice-q0", "10.0.0.1", MAC, 30, ABLE))
    assert frame[LLDPDUManagementAddress].management_address == bytes([10, 0, 0, 1])
    ours = frame[LLDPDUGenericOrganisationSpecific]
    assert (ours.org_code, ours.subtype, ours.data.hex()) == (0x02514D, 2, "0300000020")
