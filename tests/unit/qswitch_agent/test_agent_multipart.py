"""Multipart messages: long replies take several messages; our experimenter's request and reply."""

import openflow_messages as of
import pytest
from os_ken.ofproto import ofproto_v1_4 as ofp
from os_ken.ofproto import ofproto_v1_4_parser as parser

from qswitch_agent.openflow import messages
from qswitch_agent.openflow.messages import Framer, encode
from wire import optical
from wire.malformed import MalformedPacket
from wire.optical import PathOptics


def test_short_reply_is_one_message() -> None:
    parts = [of.port(1).encode(), of.port(2).encode()]
    reply = messages.reply(ofp.OFPMP_PORT_DESC, 7, parts)
    assert [one.port_no for one in of.decoded(reply).body] == [1, 2]
    assert (messages.multipart_type(reply), messages.more_follows(reply)) == (13, False)


def test_long_reply_takes_several_messages_in_order() -> None:
    ports = [of.port(number).encode() for number in range(1, 2000)]
    replies = Framer().feed(messages.reply(ofp.OFPMP_PORT_DESC, 7, ports))
    assert len(replies) > 1
    assert [messages.more_follows(one) for one in replies] == [True] * (len(replies) - 1) + [False]
    numbers = [port.port_no for one in replies for port in of.decoded(one).body]
    assert numbers == list(range(1, 2000))


def test_rebuilt_reply_tells_as_before_whether_more_follows() -> None:
    for more in (False, True):
        reply = messages.reply(ofp.OFPMP_PORT_DESC, 7, [b"12345678"], more)
        assert messages.rebuilt(reply, [b"12345678"]) == reply


def test_request_of_our_experimenter_is_told_from_others() -> None:
    ours = parser.OFPExperimenterStatsRequest(
        of.DATAPATH, 0, optical.EXPERIMENTER, optical.PATH_OPTICS, b""
    )
    assert messages.asked_of_us(of.encoded(ours)) == optical.PATH_OPTICS
    other = messages.EXPERIMENT.pack(optical.EXPERIMENTER + 1, optical.PATH_OPTICS)
    assert messages.asked_of_us(messages.request(0xFFFF, 1, other)) is None
    assert messages.asked_of_us(messages.request(ofp.OFPMP_DESC, 1)) is None
    with pytest.raises(MalformedPacket):
        messages.asked_of_us(messages.request(0xFFFF, 1, other[:7]))


@pytest.mark.parametrize("count", [0, 1, 5000])
def test_path_optics_come_back_whole(count: int) -> None:
    paths = [PathOptics(number, number + 1, 500, 1) for number in range(count)]
    body = optical.encode_path_optics(paths)
    replies = Framer().feed(messages.reply_of_ours(9, optical.PATH_OPTICS, body))
    assert len(replies) == (2 if count == 5000 else 1)
    read = [of.decoded(one).body for one in replies]
    assert {(one.experimenter, one.exp_type) for one in read} == {(optical.EXPERIMENTER, 1)}
    data = b"".join(bytes(one.data) for one in read)
    assert optical.decode_path_optics(data) == paths


def test_cut_header_is_malformed() -> None:
    for size in range(8):
        message = encode(ofp.OFPT_MULTIPART_REPLY, 1, bytes(size))
        for read in (messages.multipart_type, messages.more_follows):
            with pytest.raises(MalformedPacket):
                read(message)
