"""Framing, headers, and the messages that are alike for all; os_ken reads what the agent says."""

import openflow_messages as of
import pytest
from os_ken.ofproto import ofproto_v1_4 as ofp
from os_ken.ofproto import ofproto_v1_4_parser as parser

from qswitch_agent.openflow import messages
from qswitch_agent.openflow.messages import Framer, each_part, encode
from wire.malformed import MalformedPacket

STREAM = [messages.hello(), of.light(1, 2), of.barrier_reply(1), of.packet_in(1, of.LLDP)]


def test_stream_cut_anywhere_gives_the_same_messages() -> None:
    stream = b"".join(STREAM)
    for cut in range(len(stream) + 1):
        framer = Framer()
        assert framer.feed(stream[:cut]) + framer.feed(stream[cut:]) == STREAM


def test_byte_by_byte_gives_the_same_messages() -> None:
    framer = Framer()
    stream = b"".join(STREAM)
    pieces = [framer.feed(stream[at : at + 1]) for at in range(len(stream))]
    assert [message for piece in pieces for message in piece] == STREAM


def test_truncated_message_is_not_given_out() -> None:
    for size in range(len(STREAM[1])):
        assert Framer().feed(STREAM[1][:size]) == []


@pytest.mark.parametrize("header", ["0600000800000001", "0101000800000001"])
def test_hello_and_error_of_any_version_pass(header: str) -> None:
    message = bytes.fromhex(header)
    assert Framer().feed(message) == [message]


@pytest.mark.parametrize("header", ["0515000700000001", "0400000000000000"])
def test_bad_length_is_malformed(header: str) -> None:
    with pytest.raises(MalformedPacket):
        Framer().feed(bytes.fromhex(header))


def test_hello_offers_version_1_4_alone() -> None:
    (element,) = of.decoded(messages.hello()).elements
    assert element.versions == [ofp.OFP_VERSION]


def test_error_names_its_request_and_holds_64_bytes_of_it() -> None:
    request = of.flow_mod({"in_port": 1}, of.outputs(2, 3), xid=77)
    error = of.decoded(messages.error(ofp.OFPET_BAD_ACTION, ofp.OFPBAC_TOO_MANY, request))
    assert isinstance(error, parser.OFPErrorMsg)
    assert (error.xid, error.type, error.code) == (77, ofp.OFPET_BAD_ACTION, ofp.OFPBAC_TOO_MANY)
    assert error.data == request[:64]
    assert len(request) > 64


def test_error_code_and_role_are_read() -> None:
    assert messages.error_code(messages.error(5, 6, of.barrier_request(1))) == (5, 6)
    request = parser.OFPRoleRequest(of.DATAPATH, ofp.OFPCR_ROLE_SLAVE, 9)
    assert messages.role(of.encoded(request)) == ofp.OFPCR_ROLE_SLAVE
    for read in (messages.error_code, messages.role):
        with pytest.raises(MalformedPacket):
            read(encode(ofp.OFPT_ERROR, 1, b"abc"))


def test_message_keeps_all_but_its_body() -> None:
    other = messages.with_body(of.packet_in(1, of.LLDP), b"12")
    assert other == encode(ofp.OFPT_PACKET_IN, 0, b"12")
    assert messages.transaction_id(encode(3, 0xFEDCBA98)) == 0xFEDCBA98


def test_parts_of_a_list_are_told_apart() -> None:
    data = bytes.fromhex("0001 0008 aaaaaaaa 0002 0004")
    assert list(each_part(data, 4, "instruction")) == [(1, data[:8]), (2, data[8:])]


@pytest.mark.parametrize(
    "data", ["00", "000100", "00010000", "00010003", "00010009 aaaaaaaa", "00010004 0002"]
)
def test_part_that_is_not_whole_is_malformed(data: str) -> None:
    with pytest.raises(MalformedPacket):
        each_part(bytes.fromhex(data), 4, "instruction")
