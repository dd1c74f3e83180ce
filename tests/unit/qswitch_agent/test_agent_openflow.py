"""OpenFlow bytes: what Open vSwitch 3.1 sends, and os_ken as the independent encoder."""

from typing import Any

import pytest
from os_ken.ofproto import ofproto_v1_4 as ofp
from os_ken.ofproto import ofproto_v1_4_parser as parser
from os_ken.ofproto.ofproto_parser import msg as parse
from os_ken.ofproto.ofproto_protocol import ProtocolDesc

from qswitch_agent import openflow
from qswitch_agent.openflow import FlowEntry, FlowUpdate, Framer
from wire.metadata import MalformedPacket

DATAPATH = ProtocolDesc(version=ofp.OFP_VERSION)
# Recorded: hard_timeout=1,in_port=1,actions=output:2 is added.
ADDED = bytes.fromhex(
    "05130050000000000010000000000000"
    "004000010000000000018000000000000000000000000000"
    "0001000c800000040000000100000000"
    "000400180000000000000010000000020000000000000000"
)
PATH = FlowEntry(0x8000, bytes.fromhex("8000000400000001"), 1, False, 2)
# Recorded: in_port=2,actions=learn(table=1,in_port=5),output:1 is deleted.
REMOVED = bytes.fromhex(
    "05130080000000000010000000000000"
    "007000020002000000008000000000000000000000000000"
    "0001000c800000040000000200000000"
    "0004004800000000ffff0030000023200010000000008000000000000000000000000100000000002010"
    "000500000002000000000000000000000010000000010000000000000000"
)


def encoded(message: Any, xid: int) -> bytes:
    message.set_xid(xid)
    message.serialize()
    return bytes(message.buf)


def decoded(message: bytes) -> Any:
    version, kind, length, xid = openflow.HEADER.unpack_from(message)
    return parse(DATAPATH, version, kind, length, xid, message)


def update_of(match: Any, instructions: list[Any]) -> bytes:
    """Return a flow monitor's reply that adds an entry, encoded by os_ken but for its header."""
    body = bytearray()
    match.serialize(body, 0)
    for instruction in instructions:
        instruction.serialize(body, len(body))
    header = openflow.UPDATE.pack(openflow.UPDATE.size + len(body), 1, 0, 0, 0, 0, 7, 0)
    reply = openflow.MULTIPART.pack(ofp.OFPMP_FLOW_MONITOR, 0) + header + bytes(body)
    return openflow.encode(ofp.OFPT_MULTIPART_REPLY, 0, reply)


def entry_of(match: Any, *instructions: Any) -> FlowEntry:
    (update,) = openflow.flow_updates(update_of(match, list(instructions)))
    assert update.entry is not None
    return update.entry


def apply(*actions: Any) -> Any:
    return parser.OFPInstructionActions(ofp.OFPIT_APPLY_ACTIONS, list(actions))


def test_recorded_path_is_decoded() -> None:
    assert openflow.flow_updates(ADDED) == [FlowUpdate(openflow.ADDED, PATH)]


def test_entry_with_other_actions_has_no_output() -> None:
    (update,) = openflow.flow_updates(REMOVED)
    assert update.event == openflow.REMOVED
    assert update.entry is not None
    assert (update.entry.in_port, update.entry.out_port) == (2, None)


def test_several_updates_in_one_message_keep_their_order() -> None:
    both = ADDED[16:] + bytes.fromhex("0008000500000000") + REMOVED[16:]
    message = openflow.encode(ofp.OFPT_MULTIPART_REPLY, 0, ADDED[8:16] + both)
    events = [update.event for update in openflow.flow_updates(message)]
    assert events == [openflow.ADDED, openflow.PAUSED, openflow.REMOVED]


@pytest.mark.parametrize("message", [ADDED, REMOVED])
def test_every_truncated_update_is_malformed(message: bytes) -> None:
    for size in [*range(8, 16), *range(17, len(message))]:
        with pytest.raises(MalformedPacket):
            openflow.flow_updates(message[:size])


def test_other_multipart_replies_hold_no_updates() -> None:
    body = openflow.MULTIPART.pack(ofp.OFPMP_DESC, 0) + bytes(1056)
    assert openflow.flow_updates(openflow.encode(ofp.OFPT_MULTIPART_REPLY, 0, body)) == []


def test_path_encoded_by_os_ken_is_recognised() -> None:
    entry = entry_of(parser.OFPMatch(in_port=3), apply(parser.OFPActionOutput(4, 65509)))
    assert (entry.in_port, entry.other_fields, entry.out_port) == (3, False, 4)


def test_match_for_more_than_the_port_is_seen() -> None:
    entry = entry_of(parser.OFPMatch(in_port=3, eth_type=0x88CC), apply(parser.OFPActionOutput(4)))
    assert (entry.in_port, entry.other_fields) == (3, True)


def test_match_for_anything_has_no_port() -> None:
    entry = entry_of(parser.OFPMatch(), apply(parser.OFPActionOutput(4)))
    assert (entry.in_port, entry.other_fields, entry.out_port) == (None, False, 4)


@pytest.mark.parametrize(
    "instructions",
    [
        [],
        [apply()],
        [apply(parser.OFPActionOutput(1), parser.OFPActionOutput(2))],
        [apply(parser.OFPActionGroup(2))],
        [apply(parser.OFPActionSetField(eth_type=2))],
        [apply(parser.OFPActionOutput(2)), parser.OFPInstructionGotoTable(1)],
        [parser.OFPInstructionWriteMetadata(1, 1)],
        [parser.OFPInstructionMeter(1), apply(parser.OFPActionOutput(2))],
    ],
)
def test_anything_but_one_output_is_no_output(instructions: list[Any]) -> None:
    assert entry_of(parser.OFPMatch(in_port=1), *instructions).out_port is None


def test_monitor_request_is_what_os_ken_encodes() -> None:
    request = parser.OFPFlowMonitorRequest(DATAPATH, monitor_id=1, monitor_flags=0x1F, table_id=0)
    assert openflow.flow_monitor_request(5) == encoded(request, 5)


def test_hello_offers_version_1_4_alone() -> None:
    (element,) = decoded(openflow.hello()).elements
    assert element.versions == [ofp.OFP_VERSION]


def test_barrier_error_names_its_request() -> None:
    error = decoded(openflow.barrier_error(openflow.encode(ofp.OFPT_BARRIER_REPLY, 77)))
    assert isinstance(error, parser.OFPErrorMsg)
    assert (error.xid, error.type, error.code) == (77, ofp.OFPET_FLOW_MOD_FAILED, 0)
    assert error.data == encoded(parser.OFPBarrierRequest(DATAPATH), 77)


def test_stream_cut_anywhere_gives_the_same_messages() -> None:
    messages = [openflow.hello(), ADDED, openflow.encode(ofp.OFPT_BARRIER_REPLY, 1), REMOVED]
    stream = b"".join(messages)
    for cut in range(len(stream) + 1):
        framer = Framer()
        assert framer.feed(stream[:cut]) + framer.feed(stream[cut:]) == messages


def test_byte_by_byte_gives_the_same_messages() -> None:
    framer = Framer()
    stream = ADDED + REMOVED
    pieces = [framer.feed(stream[at : at + 1]) for at in range(len(stream))]
    assert [message for piece in pieces for message in piece] == [ADDED, REMOVED]


def test_truncated_message_is_not_given_out() -> None:
    for size in range(len(ADDED)):
        assert Framer().feed(ADDED[:size]) == []


def test_hello_of_any_version_passes() -> None:
    hello = bytes.fromhex("0600000800000001")
    assert Framer().feed(hello) == [hello]


@pytest.mark.parametrize("header", ["0115000800000001", "0515000700000001", "0400000000000000"])
def test_bad_version_or_length_is_malformed(header: str) -> None:
    with pytest.raises(MalformedPacket):
        Framer().feed(bytes.fromhex(header))
