"""Ports as bytes: descriptions, states, statistics and PORT_MOD; os_ken at the other end."""

import struct

import openflow_messages as of
import pytest
from os_ken.ofproto import ofproto_v1_4 as ofp
from os_ken.ofproto import ofproto_v1_4_parser as parser

from qswitch_agent.openflow import messages, ports
from qswitch_agent.openflow.ports import PortMod
from wire.malformed import MalformedPacket
from wire.optical import PortLight, PortOptics, PortTuning

OPTICS = PortOptics(15, 1, 2, 3, 4, 5, 6, -7, 8)
LIGHT = PortLight(15, 1, 0, 2, 1, 0, 2, -10, -305, 600, 451)


def test_os_ken_reads_a_description_with_optics() -> None:
    described = of.port(3, config=1, state=4, properties=OPTICS.encode())
    (read,) = of.decoded(messages.reply(ofp.OFPMP_PORT_DESC, 1, [described.encode()])).body
    assert (read.port_no, read.config, read.state) == (3, 1, 4)
    assert (read.hw_addr, read.name) == ("02:00:00:00:00:01", b"no-such-eth3")
    (optics,) = read.properties
    assert (optics.supported, optics.tx_min_freq_lmda, optics.rx_grid_freq_lmda) == (15, 1, 6)


def test_descriptions_and_states_are_decoded() -> None:
    both = [of.port(1), of.port(2, state=ofp.OFPPS_LINK_DOWN, properties=OPTICS.encode())]
    reply = messages.reply(ofp.OFPMP_PORT_DESC, 1, [port.encode() for port in both])
    assert ports.described_ports(reply) == both
    assert ports.described_ports(of.port_status(both[1])) == both[1:]
    assert ports.with_ports(reply, both) == reply
    assert ports.with_ports(of.port_status(both[0]), both[:1]) == of.port_status(both[0])
    for reason in (ofp.OFPPR_ADD, ofp.OFPPR_DELETE, ofp.OFPPR_MODIFY):
        assert ports.status_reason(of.port_status(both[0], reason)) == reason


def test_port_is_up_unless_it_or_its_link_is_down() -> None:
    assert of.port(1).up
    assert of.port(1, state=ofp.OFPPS_LIVE).up
    assert not of.port(1, config=ofp.OFPPC_PORT_DOWN).up
    assert not of.port(1, state=ofp.OFPPS_LINK_DOWN).up


@pytest.mark.parametrize("name", [b"sixteen-letters!", b"\xe8\x80", "q1-fibré".encode(), b""])
def test_name_comes_out_as_it_went_in(name: bytes) -> None:
    data = ports.PORT.pack(1, ports.PORT.size, bytes(6), name, 0, 0)
    (read,) = ports.described_ports(messages.reply(ofp.OFPMP_PORT_DESC, 1, [data]))
    assert read.encode() == data


def test_name_ends_at_the_first_nought() -> None:
    data = ports.PORT.pack(1, ports.PORT.size, bytes(6), b"q1\0junk", 0, 0)
    (read,) = ports.described_ports(messages.reply(ofp.OFPMP_PORT_DESC, 1, [data]))
    assert read.name == "q1"


@pytest.mark.parametrize("length", [0, 39, 41, 0xFFFF])
def test_description_of_a_wrong_length_is_malformed(length: int) -> None:
    data = ports.PORT.pack(1, length, bytes(6), b"", 0, 0)
    with pytest.raises(MalformedPacket, match=f"port 1 with length {length}"):
        ports.described_ports(messages.reply(ofp.OFPMP_PORT_DESC, 1, [data]))


def test_every_truncated_description_is_malformed() -> None:
    message = of.port_status(of.port(1))
    for size in range(17, len(message)):
        with pytest.raises(MalformedPacket):
            ports.described_ports(message[:size])
    with pytest.raises(MalformedPacket):
        ports.status_reason(message[:8])


def test_port_watch_is_what_os_ken_encodes() -> None:
    reasons = parser.OFPAsyncConfigPropReasons(
        type_=ofp.OFPACPT_PORT_STATUS_MASTER, length=8, mask=7
    )
    asynchronous = of.encoded(parser.OFPSetAsync(of.DATAPATH, [reasons]), 2)
    described = of.encoded(parser.OFPPortDescStatsRequest(of.DATAPATH), 2)
    assert ports.port_watch(2)[: len(asynchronous)] == asynchronous
    assert ports.port_watch(2)[len(asynchronous) :][:16] == described[:16]


def test_port_mod_of_os_ken_is_taken_apart() -> None:
    message = of.port_mod(2, of.tuning(193_400_000, -55), config=1, mask=5, xid=8)
    mod = PortMod.decode(message)
    assert (mod.number, mod.address, mod.config, mod.mask) == (2, of.ADDRESS, 1, 5)
    assert mod.tuning == PortTuning(15, 193_400_000, 0, 50_000, -55)
    assert mod.encode(8) == of.port_mod(2, config=1, mask=5, xid=8)


def test_other_properties_of_a_port_mod_stay() -> None:
    ethernet = parser.OFPPortModPropEthernet(type_=ofp.OFPPMPT_ETHERNET, advertise=1)
    mod = PortMod.decode(of.port_mod(2, ethernet, of.tuning(1)))
    assert mod.tuning is not None
    assert mod.encode(1) == of.port_mod(2, ethernet)


def test_two_tunings_at_once_are_malformed() -> None:
    with pytest.raises(MalformedPacket, match="2 optical properties"):
        PortMod.decode(of.port_mod(2, of.tuning(1), of.tuning(2)))


def test_every_truncated_port_mod_is_malformed() -> None:
    message = of.port_mod(2, of.tuning(1))
    whole = len(of.port_mod(2))
    for size in range(8, len(message)):
        if size != whole:
            with pytest.raises(MalformedPacket):
                PortMod.decode(message[:size])


@pytest.mark.parametrize("length", [0, 3, 16, 25, 32, 0xFFFF])
def test_property_of_a_wrong_length_is_malformed(length: int) -> None:
    message = bytearray(of.port_mod(2, of.tuning(1)))
    struct.pack_into("!H", message, len(of.port_mod(2)) + 2, length)
    with pytest.raises(MalformedPacket):
        PortMod.decode(bytes(message))


def test_statistics_of_a_fibre_are_photons_and_light() -> None:
    parts = [of.port_statistics(1, b"12345678"), of.port_statistics(9)]
    fiber, other = ports.port_statistics(messages.reply(ofp.OFPMP_PORT_STATS, 1, parts))
    assert (fiber.number, other.number) == (1, 9)
    assert (fiber.encode(), other.encode()) == tuple(parts)
    shown = fiber.shown((5, 6, 7), LIGHT.encode()).encode()
    (read,) = of.decoded(messages.reply(ofp.OFPMP_PORT_STATS, 1, [shown])).body
    assert (read.port_no, read.duration_sec) == (1, 60)
    none = (1 << 64) - 1  # OpenFlow 1.4, 5.8
    assert (read.rx_packets, read.tx_packets, read.rx_bytes, read.tx_bytes) == (5, 6, none, none)
    assert (read.rx_dropped, read.tx_dropped) == (7, none)
    assert (read.rx_errors, read.tx_errors) == (none, none)
    (light,) = read.properties
    assert (light.tx_freq_lmda, light.bias_current, light.temperature) == (1, 600, 451)


def test_every_truncated_statistic_is_malformed() -> None:
    message = messages.reply(ofp.OFPMP_PORT_STATS, 1, [of.port_statistics(1)])
    for size in range(17, len(message)):
        with pytest.raises(MalformedPacket):
            ports.port_statistics(message[:size])


def test_description_that_has_no_room_for_its_optics_is_malformed() -> None:
    message = of.port_status(of.port(1, properties=bytes(65_472)))
    (described,) = ports.described_ports(message)
    crowded = of.port(1, properties=described.properties + OPTICS.encode())
    with pytest.raises(MalformedPacket):
        ports.with_ports(message, [crowded])
