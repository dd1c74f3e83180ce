"""Flow entries as bytes: what Open vSwitch 3.1 sends, and os_ken as independent encoder."""

from typing import Any

import openflow_messages as of
import pytest
from os_ken.ofproto import ofproto_v1_4 as ofp
from os_ken.ofproto import ofproto_v1_4_parser as parser

from qswitch_agent.openflow import flow_reports, flows, instructions, matches, messages
from qswitch_agent.openflow.flow_reports import FlowRemoved, FlowUpdate
from qswitch_agent.openflow.flows import FlowEntry, FlowMod
from qswitch_agent.openflow.instructions import Mark
from qswitch_agent.openflow.messages import encode
from wire.malformed import MalformedPacket

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
MARK = Mark(30, 0x01020304)
APPLY, WRITE = ofp.OFPIT_APPLY_ACTIONS, ofp.OFPIT_WRITE_ACTIONS


def entry_of(fields: dict[str, Any], *instructions: Any) -> FlowEntry:
    message = of.monitor_reply(
        of.flow_update(flow_reports.ADDED, of.flow_mod(fields, *instructions))
    )
    (update,) = flow_reports.flow_updates(message)
    assert update.entry is not None
    return update.entry


def test_recorded_path_is_decoded() -> None:
    assert flow_reports.flow_updates(ADDED) == [FlowUpdate(flow_reports.ADDED, PATH)]


def test_entry_with_other_actions_has_no_output() -> None:
    (update,) = flow_reports.flow_updates(REMOVED)
    assert update.event == flow_reports.REMOVED
    assert update.entry is not None
    assert (update.entry.in_port, update.entry.out_port) == (2, None)


def test_several_updates_in_one_message_keep_their_order() -> None:
    both = ADDED[16:] + bytes.fromhex("0008000500000000") + REMOVED[16:]
    message = encode(ofp.OFPT_MULTIPART_REPLY, 0, ADDED[8:16] + both)
    events = [update.event for update in flow_reports.flow_updates(message)]
    assert events == [flow_reports.ADDED, flow_reports.PAUSED, flow_reports.REMOVED]


@pytest.mark.parametrize("message", [ADDED, REMOVED])
def test_every_truncated_update_is_malformed(message: bytes) -> None:
    for size in [*range(8, 16), *range(17, len(message))]:
        with pytest.raises(MalformedPacket):
            flow_reports.flow_updates(message[:size])


def test_other_multipart_replies_hold_no_updates() -> None:
    assert flow_reports.flow_updates(messages.reply(ofp.OFPMP_DESC, 0, [bytes(1056)])) == []


def test_match_for_more_than_the_port_is_seen() -> None:
    entry = entry_of({"in_port": 3, "eth_type": 0x88CC}, of.outputs(4))
    assert (entry.in_port, entry.other_fields, entry.out_port) == (3, True, 4)


def test_match_for_anything_has_no_port() -> None:
    entry = entry_of({}, of.outputs(4))
    assert (entry.in_port, entry.other_fields, entry.out_port) == (None, False, 4)


@pytest.mark.parametrize(
    "instructions",
    [
        [],
        [of.actions()],
        [of.outputs(1, 2)],
        [of.actions(parser.OFPActionGroup(2))],
        [of.actions(parser.OFPActionSetField(eth_type=2))],
        [of.outputs(2), parser.OFPInstructionGotoTable(1)],
        [parser.OFPInstructionWriteMetadata(1, 1)],
        [parser.OFPInstructionMeter(1), of.outputs(2)],
    ],
)
def test_anything_but_one_output_is_no_output(instructions: list[Any]) -> None:
    assert entry_of({"in_port": 1}, *instructions).out_port is None


def test_monitor_request_is_what_os_ken_encodes() -> None:
    request = parser.OFPFlowMonitorRequest(
        of.DATAPATH, monitor_id=1, monitor_flags=0x1F, table_id=0
    )
    assert flow_reports.flow_monitor_request(5) == of.encoded(request, 5)


def test_mark_is_a_note_of_open_vswitch() -> None:
    golden = bytes.fromhex("ffff0010 00002320 0008 001e 01020304")
    assert MARK.encode() == golden
    assert Mark.decode(golden) == MARK
    for other in (golden[:-1], golden + b"\0", golden[:9] + b"\7" + golden[10:], bytes(16)):
        assert Mark.decode(other) is None


def test_flow_mod_of_os_ken_is_decoded_and_encoded_again() -> None:
    message = of.flow_mod(
        {"in_port": 1, "eth_type": 0x88CC},
        of.outputs(2),
        parser.OFPInstructionGotoTable(4),
        xid=9,
        cookie=2**63,
        cookie_mask=7,
        table_id=3,
        command=ofp.OFPFC_MODIFY,
        idle_timeout=1,
        hard_timeout=2,
        priority=3,
        out_port=4,
        out_group=5,
        flags=ofp.OFPFF_SEND_FLOW_REM,
        importance=6,
    )
    mod = FlowMod.decode(message)
    assert (mod.cookie, mod.cookie_mask, mod.table, mod.command) == (2**63, 7, 3, 1)
    assert (mod.idle_timeout_s, mod.hard_timeout_s, mod.priority) == (1, 2, 3)
    assert (mod.out_port, mod.out_group, mod.flags, mod.importance) == (4, 5, 1, 6)
    assert (mod.instructions.kinds, mod.instructions.outputs) == ((4, 1), (2,))
    assert mod.encode(9) == message


def test_every_truncated_flow_mod_is_malformed() -> None:
    message = of.light(1, 2)
    whole = len(of.flow_mod({"in_port": 1}))
    for size in range(8, len(message)):
        if size not in (whole - 4, whole - 3, whole - 2, whole - 1, whole):
            with pytest.raises(MalformedPacket):
                FlowMod.decode(message[:size])


@pytest.mark.parametrize(
    "instructions",
    ["00", "0004 0004", "0004 0010 00000000 0000 0008 00000002", "0004 0018 00000000 0000 0010"],
)
def test_instructions_that_are_not_whole_are_malformed(instructions: str) -> None:
    message = of.flow_mod({"in_port": 1}) + bytes.fromhex(instructions)
    with pytest.raises(MalformedPacket):
        FlowMod.decode(message)


def test_malformed_match_of_a_delete_is_malformed() -> None:
    message = of.flow_mod({"in_port": 1}, command=ofp.OFPFC_DELETE)
    with pytest.raises(MalformedPacket, match="twice"):
        FlowMod.decode(message[:48] + matches.join(2 * matches.of_port(1)))


def test_bridge_is_told_the_mark_in_place_of_the_idle_time_out() -> None:
    asked = of.mod({"in_port": 1}, of.outputs(2), idle_timeout=30, hard_timeout=9, priority=5)
    read = of.decoded(asked.marked(MARK).encode(3))
    assert (read.idle_timeout, read.hard_timeout, read.priority) == (0, 9, 5)
    assert read.match["in_port"] == 1
    (apply,) = read.instructions
    note, output = apply.actions
    assert (note.experimenter, output.port) == (0x2320, 2)
    (data,) = [body for kind, body in asked.marked(MARK).instructions.actions if kind == 0xFFFF]
    assert data == MARK.encode()
    assert asked.marked(MARK).instructions.mark == MARK


def test_older_name_of_the_port_is_told_as_the_bridge_reports_it() -> None:
    message = of.light(1, 2)
    older = matches.join(bytes.fromhex("00000002 0001"))
    mod = FlowMod.decode(message[:48] + older + message[64:])
    assert mod.marked(MARK).match == matches.of_port(1)


def test_dark_entry_has_its_mark_alone() -> None:
    marked = of.mod({"in_port": 1}).marked(MARK)
    assert marked.instructions.outputs == ()
    assert marked.instructions.data == of.light_instructions(MARK, None)


@pytest.mark.parametrize("ports", [(), (2,), (2, 3)])
@pytest.mark.parametrize("kinds", [(), (APPLY,), (WRITE,), (APPLY, WRITE), (WRITE, APPLY)])
def test_marked_instructions_are_as_the_bridge_reports_them(
    ports: tuple[int, ...], kinds: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    outputs = [parser.OFPActionOutput(port) for port in ports]
    asked = of.mod({"in_port": 1}, *(of.actions(*outputs, kind=kind) for kind in kinds))
    made = asked.instructions.with_mark(MARK)
    monkeypatch.setattr(instructions, "_remembered", {})
    assert instructions.parse(made.data) == made


def test_controllers_see_no_mark() -> None:
    plain = of.mod({"in_port": 1}, of.outputs(2)).instructions
    marked = of.light_instructions(MARK, 2)
    assert instructions.parse(marked).without_mark()[:8] == plain.data[:8]
    assert instructions.parse(instructions.parse(marked).without_mark()).outputs == (2,)
    assert instructions.parse(plain.data).without_mark() == plain.data


def test_flow_statistics_show_photons_and_the_idle_time_out_that_was_asked_for() -> None:
    parts = [of.flow_entry(of.light(1, 2, cookie=8), MARK, 5)]
    parts.append(of.flow_entry(of.light(9, 10), packet_count=6))
    light, other = flow_reports.flow_statistics(messages.reply(ofp.OFPMP_FLOW, 4, parts))
    assert (light.entry.mark, light.packets, other.entry.mark, other.packets) == (MARK, 5, None, 6)
    shown = [light.shown(MARK, 77).encode(), other.encode()]
    first, second = of.decoded(messages.reply(ofp.OFPMP_FLOW, 4, shown)).body
    assert (first.idle_timeout, first.packet_count) == (30, 77)
    assert first.byte_count == (1 << 64) - 1  # OpenFlow 1.4, 5.8: not available
    assert (first.cookie, first.match["in_port"]) == (8, 1)
    assert [one.port for one in first.instructions[0].actions] == [2]
    assert (second.packet_count, second.byte_count) == (6, 360)


def test_monitors_of_controllers_see_no_mark() -> None:
    update = of.flow_update(flow_reports.ADDED, of.light(1, 2, hard_timeout=4), MARK)
    pause = bytes.fromhex("0008000500000000")
    plain = of.flow_update(flow_reports.ADDED, of.light(9, 10))

    def known(_priority: int, match: bytes, _cookie: int, gone: bool) -> tuple[Mark, bool] | None:
        return (MARK, gone) if match == matches.of_port(1) else None

    shown = flow_reports.monitor_shown(of.monitor_reply(update, pause, plain), known)
    assert shown.endswith(pause + plain)
    added = flow_reports.flow_updates(shown)[0].entry
    assert added is not None
    assert (added.mark, added.in_port, added.out_port) == (None, 1, 2)
    assert flow_reports.UPDATE.unpack_from(shown, messages.BODY)[4:6] == (30, 4)


def test_removal_is_shown_as_light_knows_it() -> None:
    message = of.flow_removed(of.light(1, 2, priority=5, cookie=6))
    gone = FlowRemoved.decode(message)
    assert (gone.table, gone.key) == (0, (5, matches.of_port(1), 6))
    read = of.decoded(gone.shown(message, MARK, 77, ofp.OFPRR_IDLE_TIMEOUT))
    assert (read.reason, read.idle_timeout) == (ofp.OFPRR_IDLE_TIMEOUT, 30)
    assert (read.packet_count, read.byte_count) == (77, (1 << 64) - 1)
    assert read.match["in_port"] == 1
    read = of.decoded(gone.shown(message, MARK, 77, ofp.OFPRR_DELETE))
    assert (read.reason, read.priority, read.cookie) == (ofp.OFPRR_DELETE, 5, 6)


def test_every_truncated_removal_or_statistic_is_malformed() -> None:
    removed = of.flow_removed(of.light(1, 2))
    statistics = messages.reply(ofp.OFPMP_FLOW, 4, [of.flow_entry(of.light(1, 2), MARK)])
    for size in range(8, len(removed) - 4):
        with pytest.raises(MalformedPacket):
            FlowRemoved.decode(removed[:size])
    for size in range(17, len(statistics)):
        with pytest.raises(MalformedPacket):
            flow_reports.flow_statistics(statistics[:size])


def test_strict_delete_names_one_entry() -> None:
    read = of.decoded(flows.delete_strict(FlowEntry(7, matches.of_port(1), 1, False, 2, 9), 3))
    assert (read.command, read.priority, read.match["in_port"]) == (ofp.OFPFC_DELETE_STRICT, 7, 1)
    assert (read.cookie, read.cookie_mask, read.table_id) == (9, 2**64 - 1, 0)
    assert (read.out_port, read.out_group) == (ofp.OFPP_ANY, ofp.OFPG_ANY)
