"""Packets, groups and bundles as bytes; os_ken at the other end."""

import asyncio
import struct
from types import SimpleNamespace
from typing import Any

import openflow_messages as of
import pytest
from os_ken.ofproto import ofproto_v1_4 as ofp
from os_ken.ofproto import ofproto_v1_4_parser as parser
from scapy.layers.inet import IP, TCP, IPOption_NOP
from scapy.layers.l2 import Ether

from qswitch_agent.openflow import packets
from qswitch_agent.openflow.packets import PacketOut
from qswitch_agent.proxy.replies import Replies
from wire.malformed import MalformedPacket
from wire.metadata.header import QUANTUM_SWITCHES
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Handshake, Service


def test_packet_out_of_os_ken_is_decoded() -> None:
    packet = PacketOut.decode(of.packet_out(of.LLDP, 1, 9))
    assert (packet.in_port, packet.outputs) == (ofp.OFPP_CONTROLLER, [1, 9])
    assert packet.frame == of.LLDP


def test_actions_that_do_not_fit_are_malformed() -> None:
    message = of.packet_out(b"", 1)
    for length in (8, 15, 17, 0xFFFF):
        bad = message[:16] + struct.pack("!H", length) + message[18:]
        with pytest.raises(MalformedPacket):
            PacketOut.decode(bad).outputs  # noqa: B018
    for size in range(8, len(message)):
        with pytest.raises(MalformedPacket):
            PacketOut.decode(message[:size])


def test_lldp_is_told_by_its_ethertype() -> None:
    assert packets.is_lldp(of.LLDP)
    assert not packets.is_lldp(of.PING)
    assert not packets.is_lldp(of.LLDP[:13])
    tagged = of.LLDP[:12] + bytes.fromhex("81000001") + of.LLDP[12:]
    assert not packets.is_lldp(tagged)


def test_packet_in_tells_its_port_and_frame() -> None:
    message = of.packet_in(3, of.LLDP)
    assert packets.packet_in(message) == (3, of.LLDP)
    assert of.decoded(message).match["in_port"] == 3
    for size in range(8, len(message) - len(of.LLDP) - 6):
        with pytest.raises(MalformedPacket):
            packets.packet_in(message[:size])


SETUP = Setup(7, Service.SDC, Handshake.FRAMED, "10.0.0.3", 1000, 100, 1_000_000)
SEGMENT = IP(src="10.0.0.1", dst="10.0.0.2", options=[IPOption_NOP()] * 4) / TCP(dport=9010)
COPY = bytes(Ether(dst=QUANTUM_SWITCHES) / SEGMENT / SETUP.encode())


def test_a_copy_is_known_by_its_address_its_reason_and_its_message() -> None:
    message = of.packet_in(9, COPY)
    assert packets.copied_setup(message) == SETUP
    reason = 8 + struct.calcsize("!IH")
    by_packet_out = message[:reason] + bytes([ofp.OFPR_PACKET_OUT]) + message[reason + 1 :]
    to_bob = Ether(dst="02:00:00:00:00:02") / SEGMENT / SETUP.encode()
    data = Ether(dst=QUANTUM_SWITCHES) / SEGMENT / b"behind a set-up"
    others = [of.packet_in(9, bytes(frame)) for frame in (to_bob, data)]
    for other in (by_packet_out, *others):
        assert packets.copied_setup(other) is None
    for size in range(len(COPY)):
        assert packets.copied_setup(of.packet_in(9, COPY[:size])) is None


@pytest.mark.parametrize("needs_copies", [False, True])
def test_a_copy_is_read_only_if_light_waits_for_it(needs_copies: bool) -> None:
    sessions: list[int] = []
    switch: Any = SimpleNamespace(fibers=(), needs_copies=needs_copies, setup_came=sessions.append)
    link: Any = None
    message = of.packet_in(9, COPY)
    assert asyncio.run(Replies(switch, link, 1.0).shown(message, 0)) == message
    assert sessions == [SETUP.session] * needs_copies


def test_ports_of_all_buckets_are_found() -> None:
    assert packets.group_outputs(of.group_mod(3, 1, 9)) == [3, 1, 9]
    assert packets.group_outputs(of.group_mod()) == []


def test_every_truncated_group_is_malformed() -> None:
    message = of.group_mod(1, 2)
    bucket = (len(message) - 16) // 2
    for size in range(17, len(message)):
        if size != 16 + bucket:
            with pytest.raises(MalformedPacket):
                packets.group_outputs(message[:size])
    for length in (0, 15, bucket + 1, 0xFFFF):
        with pytest.raises(MalformedPacket):
            packets.group_outputs(message[:16] + struct.pack("!H", length) + message[18:])


def test_bundle_control_of_os_ken_is_decoded() -> None:
    commit = parser.OFPBundleCtrlMsg(of.DATAPATH, 7, ofp.OFPBCT_COMMIT_REQUEST, of.ATOMIC, [])
    message = of.encoded(commit)
    assert packets.bundle_control(message) == (7, 4, of.ATOMIC)
    assert of.bundle_control(7, 4, 1) == message
    for size in range(8, 16):
        with pytest.raises(MalformedPacket):
            packets.bundle_control(message[:size])


def test_bundle_member_of_os_ken_is_taken_out_and_replaced() -> None:
    inner = parser.OFPGroupMod(of.DATAPATH, ofp.OFPGC_ADD, ofp.OFPGT_ALL, 1, [])
    message = of.encoded(parser.OFPBundleAddMsg(of.DATAPATH, 7, of.ATOMIC, inner, []), 5)
    number, member = packets.bundle_member(message)
    assert (number, member[1]) == (7, ofp.OFPT_GROUP_MOD)
    assert packets.with_member(message, member) == message
    other = packets.with_member(message, of.light(1, 2))
    assert packets.bundle_member(other) == (7, of.light(1, 2))
    assert int.from_bytes(other[2:4], "big") == len(other)


def test_member_that_is_not_whole_is_malformed() -> None:
    message = of.bundle_add(7, of.light(1, 2))
    for size in range(8, len(message)):
        with pytest.raises(MalformedPacket):
            packets.bundle_member(message[:size])
    for header in ("0410", "050e0007", "050effff"):
        bad = bytes.fromhex(header)
        with pytest.raises(MalformedPacket):
            packets.bundle_member(message[:16] + bad + message[16 + len(bad) :])
