"""Where OpenFlow 1.4 says what a switch answers: section by section, on a real bridge.

docs/openflow.md has a table of it; the numbers are of the specification's version 1.4.0.
"""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from agent_scene import (
    DATAPATH,
    FLAGS,
    LLDP,
    WRITE,
    Controller,
    Switch,
    accepted,
    actions,
    entries,
    flow_mod,
    flows,
    light,
    needs_open_vswitch,
    outputs,
    refused,
    running_switch,
    tuning,
    wait_until,
)
from os_ken.ofproto import ofproto_v1_4 as ofp
from os_ken.ofproto import ofproto_v1_4_parser as parser

from wire import dispatcher_pb2 as pb
from wire import optical

pytestmark = needs_open_vswitch
BEGIN = bytes.fromhex("80000004 00000001")  # OXM: in_port 1
OUTPUT_2 = bytes.fromhex("0000 0010 00000002 0000 000000000000")


def raw_flow_mod(oxm: bytes, instructions: bytes, **more: int) -> bytes:
    """Return the body of a FLOW_MOD (7.3.4.1) as it is on the wire."""
    length = more.get("match_length", 4 + len(oxm))
    match = struct.pack("!HH", more.get("match_type", 1), length) + oxm
    match += bytes(-len(match) % 8)
    fixed = struct.pack("!QQBBHHHIIIHH", 0, 0, 0, 0, 0, 0, 1, 0xFFFFFFFF, *[0xFFFFFFFF] * 2, 0, 0)
    return fixed + match + instructions


def instruction(kind: int, body: bytes, length: int | None = None) -> bytes:
    return struct.pack("!HH4x", kind, 8 + len(body) if length is None else length) + body


def apply(body: bytes) -> bytes:
    return instruction(ofp.OFPIT_APPLY_ACTIONS, body)


def say(controller: Controller, kind: int, body: bytes, xid: int, version: int = 5) -> None:
    controller.socket.sendall(struct.pack("!BBHI", version, kind, 8 + len(body), xid) + body)


MATCH, INSTRUCTION, ACTION = ofp.OFPET_BAD_MATCH, ofp.OFPET_BAD_INSTRUCTION, ofp.OFPET_BAD_ACTION
BAD_FLOW_MODS = {
    "7.5.4.3: a match of an unknown type": (
        raw_flow_mod(BEGIN, apply(OUTPUT_2), match_type=0),
        (MATCH, ofp.OFPBMC_BAD_TYPE),
    ),
    "7.5.4.3: a match longer than its message": (
        raw_flow_mod(BEGIN, b"", match_length=400),
        (MATCH, ofp.OFPBMC_BAD_LEN),
    ),
    "7.5.4.3: a field twice": (
        raw_flow_mod(BEGIN * 2, apply(OUTPUT_2)),
        (MATCH, ofp.OFPBMC_DUP_FIELD),
    ),
    "7.5.4.3: a field of a wrong length": (
        raw_flow_mod(bytes.fromhex("80000006 000000000001"), apply(OUTPUT_2)),
        (MATCH, ofp.OFPBMC_BAD_LEN),
    ),
    "7.5.4.4: an instruction longer than its message": (
        raw_flow_mod(BEGIN, instruction(4, OUTPUT_2, length=400)),
        (INSTRUCTION, ofp.OFPBIC_BAD_LEN),
    ),
    "7.5.4.4: an instruction without a header": (
        raw_flow_mod(BEGIN, instruction(4, b"", length=2)),
        (INSTRUCTION, ofp.OFPBIC_BAD_LEN),
    ),
    "7.5.4.4: goto of a wrong length": (
        raw_flow_mod(BEGIN, instruction(1, bytes(8))),
        (INSTRUCTION, ofp.OFPBIC_BAD_LEN),
    ),
    "7.5.4.4: an instruction twice": (
        raw_flow_mod(BEGIN, apply(OUTPUT_2) * 2),
        (INSTRUCTION, ofp.OFPBIC_DUP_INST),
    ),
    "7.5.4.4: an unknown instruction": (
        raw_flow_mod(BEGIN, instruction(77, b"")),
        (INSTRUCTION, ofp.OFPBIC_UNKNOWN_INST),
    ),
    "7.5.4.4: an instruction that light cannot do": (
        raw_flow_mod(BEGIN, instruction(ofp.OFPIT_CLEAR_ACTIONS, b"")),
        (INSTRUCTION, ofp.OFPBIC_UNSUP_INST),
    ),
    "7.5.4.5: an action longer than its instruction": (
        raw_flow_mod(BEGIN, apply(b"\0\0\0\x40" + OUTPUT_2[4:])),
        (ACTION, ofp.OFPBAC_BAD_LEN),
    ),
    "7.5.4.5: an action of no length": (
        raw_flow_mod(BEGIN, apply(b"\0\0\0\0" + OUTPUT_2[4:])),
        (ACTION, ofp.OFPBAC_BAD_LEN),
    ),
    "7.5.4.5: an output of a wrong length": (
        raw_flow_mod(BEGIN, apply(b"\0\0\0\x08" + OUTPUT_2[4:8])),
        (ACTION, ofp.OFPBAC_BAD_LEN),
    ),
    "7.5.4.5: an unknown action": (
        raw_flow_mod(BEGIN, apply(bytes.fromhex("0077 0008 00000000"))),
        (ACTION, ofp.OFPBAC_BAD_TYPE),
    ),
    "7.5.4.5: a port that is not there": (
        raw_flow_mod(BEGIN, apply(OUTPUT_2.replace(b"\0\0\0\2", b"\0\0\0\x63"))),
        (ACTION, ofp.OFPBAC_BAD_OUT_PORT),
    ),
}


def test_bad_flow_mods_get_the_error_of_their_bad_part(switch: Switch) -> None:
    for number, (name, (body, error)) in enumerate(BAD_FLOW_MODS.items()):
        say(switch.controller, ofp.OFPT_FLOW_MOD, body, 1000 + number)
        answer = switch.controller.answer(1000 + number)
        assert (answer.type, answer.code) == error, name
        # 7.5.4: the data is at least 64 bytes of the message that failed.
        assert answer.data[8:64] == body[:56], name
    accepted(switch.controller, light(1, 2))
    assert flows("dump-flows").count("in_port") == 1


def test_overlap_is_an_error_with_check_overlap_alone(switch: Switch) -> None:
    # 6.4: entries of one priority overlap if a packet may match both.
    accepted(switch.controller, light(1, 2, priority=5))
    accepted(switch.controller, flow_mod(None, outputs(ofp.OFPP_CONTROLLER), priority=5), 610)
    check = {"priority": 5, "flags": ofp.OFPFF_CHECK_OVERLAP}
    overlap = ofp.OFPET_FLOW_MOD_FAILED, ofp.OFPFMFC_OVERLAP
    assert refused(switch.controller, light(3, 4, **check)) == overlap
    accepted(switch.controller, light(3, 4, priority=5), 620)
    # A taken output overlaps nothing; 6.4 has BAD_OUT_PORT for what may be valid later.
    taken = ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_OUT_PORT
    assert refused(switch.controller, light(2, 4, priority=5)) == taken


def test_message_of_another_version_is_a_bad_version(switch: Switch) -> None:
    # 6.3.3 and 7.5.4.2: all but HELLO carries the version that was agreed on.
    say(switch.controller, ofp.OFPT_BARRIER_REQUEST, b"", 77, version=4)
    wrong = switch.controller.answer(77)
    assert (wrong.type, wrong.code) == (ofp.OFPET_BAD_REQUEST, ofp.OFPBRC_BAD_VERSION)
    accepted(switch.controller, light(1, 2))


def test_entries_are_reported_as_they_were_sent(switch: Switch) -> None:
    # 7.3.5.2: ofp_flow_stats has the instructions of the entry.
    sent = {
        1: [outputs(2)],
        2: [actions(parser.OFPActionOutput(3, max_len=128))],
        3: [parser.OFPInstructionActions(WRITE, [parser.OFPActionOutput(4, max_len=7)])],
        4: [],
    }
    for number, instructions in sent.items():
        accepted(switch.controller, flow_mod(number, *instructions), 600 + 2 * number)
    assert switch.dispatcher.sets[-1] == [(1, 2), (2, 3), (3, 4)]
    reported = {entry.match["in_port"]: entry.instructions for entry in entries(switch.controller)}
    for number, instructions in sent.items():
        assert described(reported[number]) == described(instructions), number
    modified = parser.OFPInstructionActions(WRITE, [parser.OFPActionOutput(1, max_len=9)])
    accepted(switch.controller, flow_mod(4, modified, command=ofp.OFPFC_MODIFY), 690)
    (entry,) = [one for one in entries(switch.controller) if one.match["in_port"] == 4]
    assert described(entry.instructions) == described([modified])


def described(instructions: Any) -> list[tuple[int, list[tuple[int, int]]]]:
    return [
        (one.type, [(action.port, action.max_len) for action in one.actions])
        for one in instructions
    ]


IDLE_ALONE = 1 << ofp.OFPRR_IDLE_TIMEOUT


def test_controller_that_wants_idle_removals_alone_gets_them_alone(own_switch: Switch) -> None:
    # 7.3.10: a set bit enables the message, a cleared one disables it.
    mask = parser.OFPAsyncConfigPropReasons(ofp.OFPACPT_FLOW_REMOVED_MASTER, 8, IDLE_ALONE)
    own_switch.controller.send(parser.OFPSetAsync(DATAPATH, [mask]), 5)
    own_switch.controller.send(parser.OFPGetAsyncRequest(DATAPATH), 6)
    reports = {one.type: one.mask for one in own_switch.controller.answer(6).properties}
    assert reports[ofp.OFPACPT_FLOW_REMOVED_MASTER] == IDLE_ALONE
    flags = {"flags": ofp.OFPFF_SEND_FLOW_REM}
    accepted(own_switch.controller, light(1, 2, **flags))
    accepted(own_switch.controller, light(3, 4, idle_timeout=1, **flags), 610)
    own_switch.controller.send(light(1, 2, command=ofp.OFPFC_DELETE), 620)  # heard of by nobody
    while not isinstance(gone := own_switch.controller.next(), parser.OFPFlowRemoved):
        pass
    assert (gone.match["in_port"], gone.reason) == (3, ofp.OFPRR_IDLE_TIMEOUT)
    assert own_switch.controller.silent()


def test_flow_monitor_tells_idle_time_outs_as_such(own_switch: Switch) -> None:
    # 7.3.5.17: ofp_flow_update_full has the reason of a removal, and the idle time-out.
    wanted = ofp.OFPFMF_ADD | ofp.OFPFMF_REMOVED
    request = parser.OFPFlowMonitorRequest(
        DATAPATH, 0, 9, ofp.OFPP_ANY, ofp.OFPG_ANY, wanted, 0, ofp.OFPFMC_ADD, parser.OFPMatch()
    )
    own_switch.controller.send(request, 5)
    own_switch.controller.send(light(3, 4, idle_timeout=1), 610)
    removed = None
    while removed is None:
        message = own_switch.controller.next_bytes()
        if message[1] == ofp.OFPT_MULTIPART_REPLY:
            for update in each_update(message[16:]):
                # Changes made on the monitor's own connection are abbreviated.
                if int.from_bytes(update[2:4], "big") == ofp.OFPFME_REMOVED:
                    removed = update
    fixed = struct.unpack_from(ofp.OFP_FLOW_UPDATE_FULL_0_PACK_STR, removed)
    assert fixed[3:5] == (ofp.OFPRR_IDLE_TIMEOUT, 1)
    assert removed[28:36] == bytes.fromhex("80000004 00000003")  # in_port 3


def each_update(data: bytes) -> Iterator[bytes]:
    while data:
        length = int.from_bytes(data[:2], "big")
        yield data[:length]
        data = data[length:]


def port_mod(switch: Switch, port: int, config: int, mask: int, properties: bytes = b"") -> bytes:
    address = bytes.fromhex(tuning(switch, port, 0).hw_addr.replace(":", ""))
    return struct.pack("!I4x6s2xII", port, address, config, mask) + properties


def optical_property(configure: int, length: int = 24) -> bytes:
    return struct.pack("!HHIIiII", 1, length, configure, 193_500_000, 0, 0, 0)


PROPERTY, CONFIG = ofp.OFPET_BAD_PROPERTY, (ofp.OFPET_PORT_MOD_FAILED, ofp.OFPPMFC_BAD_CONFIG)
FREQ = optical.USE_FREQ


def test_bad_port_mods_get_the_error_of_their_bad_part(switch: Switch) -> None:
    both = optical_property(optical.RX_TUNE | FREQ) + optical_property(optical.TX_TUNE | FREQ)
    cases = {
        "7.3.4.3: an unknown bit of configure": (
            port_mod(switch, 2, 0, 0, optical_property(optical.TUNABLE | 16)),
            (PROPERTY, ofp.OFPBPC_BAD_VALUE),
        ),
        "7.5.4.15: a property of a wrong length": (
            port_mod(switch, 2, 0, 0, optical_property(FREQ, 16)[:16]),
            (PROPERTY, ofp.OFPBPC_BAD_LEN),
        ),
        "7.5.4.15: a property longer than its message": (
            port_mod(switch, 2, 0, 0, optical_property(FREQ, 400)),
            (PROPERTY, ofp.OFPBPC_BAD_LEN),
        ),
        "7.5.4.15: a property twice": (
            port_mod(switch, 2, 0, 0, both),
            (PROPERTY, ofp.OFPBPC_DUP_TYPE),
        ),
        "7.5.4.8: an unknown bit of the mask": (port_mod(switch, 2, 0, 1 << 9), CONFIG),
        "7.5.4.8: an unknown bit of config": (port_mod(switch, 2, 1 << 1, 1), CONFIG),
    }
    for number, (name, (body, error)) in enumerate(cases.items()):
        say(switch.controller, ofp.OFPT_PORT_MOD, body, 1000 + number)
        answer = switch.controller.answer(1000 + number)
        assert (answer.type, answer.code) == error, name
    say(switch.controller, ofp.OFPT_PORT_MOD, struct.pack("!I4x6s2xII", 99, bytes(6), 0, 0), 90)
    answer = switch.controller.answer(90)
    missing = ofp.OFPET_PORT_MOD_FAILED, ofp.OFPPMFC_BAD_PORT
    assert (answer.type, answer.code) == missing
    assert switch.dispatcher.tuned == []


def test_what_is_not_configured_stays(switch: Switch) -> None:
    # 7.3.4.3: the bits of configure say what is to be configured.
    directions = {
        optical.TX_TUNE: pb.TunePortRequest.TRANSMIT,
        optical.RX_TUNE: pb.TunePortRequest.RECEIVE,
        optical.RX_TUNE | optical.TX_TUNE: pb.TunePortRequest.BOTH,
    }
    for configure, direction in directions.items():
        body = port_mod(switch, 2, 0, 0, optical_property(configure | FREQ))
        say(switch.controller, ofp.OFPT_PORT_MOD, body, 90)
        accepted(switch.controller, light(1, 2))
        tuned = switch.dispatcher.tuned.pop()
        assert (tuned.frequency_mhz, tuned.direction) == (193_500_000, direction)
        assert not tuned.HasField("power_dbm")
        assert switch.dispatcher.tuned == []


def test_a_fault_announces_each_port_once(own_switch: Switch) -> None:
    # 7.4.3: PORT_STATUS reports changes alone.
    stuck = pb.SwitchCondition()
    stuck.CopyFrom(own_switch.dispatcher.condition)
    stuck.stuck.add(in_port=1, out_port=3)
    own_switch.dispatcher.changes(stuck)
    reports = [own_switch.controller.next() for _port in range(2)]
    assert {one.desc.port_no for one in reports} == {1, 3}
    for one in reports:
        assert (one.reason, one.desc.state & ofp.OFPPS_BLOCKED) == (
            ofp.OFPPR_MODIFY,
            ofp.OFPPS_BLOCKED,
        )
        assert one.desc.config == 0
    assert own_switch.controller.silent()


def test_bundle_member_that_cannot_be_is_refused_when_it_is_added(switch: Switch) -> None:
    # 7.3.9.7: validated when it is added; the error has the xid of the message itself.
    control = parser.OFPBundleCtrlMsg
    switch.controller.send(control(DATAPATH, 7, ofp.OFPBCT_OPEN_REQUEST, FLAGS, []), 50)
    assert switch.controller.answer(50).type == ofp.OFPBCT_OPEN_REPLY
    members = {51: light(1, 2), 52: flow_mod(3, outputs(1, 4)), 53: light(2, 1)}
    for xid, member in members.items():
        member.set_xid(xid)
        switch.controller.send(parser.OFPBundleAddMsg(DATAPATH, 7, FLAGS, member, []), xid)
    wrong = switch.controller.next()
    assert (wrong.xid, wrong.type, wrong.code) == (
        52,
        ofp.OFPET_BAD_ACTION,
        ofp.OFPBAC_TOO_MANY,
    )
    assert wrong.data[1] == ofp.OFPT_FLOW_MOD
    switch.controller.send(control(DATAPATH, 7, ofp.OFPBCT_COMMIT_REQUEST, FLAGS, []), 54)
    assert switch.controller.answer(54).type == ofp.OFPBCT_COMMIT_REPLY
    wait_until(lambda: switch.dispatcher.sets[-1] == [(1, 2), (2, 1)], "the others to be connected")


def test_stale_role_request_leaves_a_slave_a_slave(tmp_path: Path) -> None:
    # 6.3.4: a stale request is refused and changes nothing.
    with running_switch(tmp_path, controllers=2) as switch:
        master, slave = switch.controllers

        def ask_role(controller: Controller, role: int, generation: int, xid: int) -> Any:
            controller.send(parser.OFPRoleRequest(DATAPATH, role, generation), xid)
            return controller.answer(xid)

        ask_role(master, ofp.OFPCR_ROLE_MASTER, 7, 1)
        ask_role(slave, ofp.OFPCR_ROLE_SLAVE, 7, 2)
        stale = ask_role(slave, ofp.OFPCR_ROLE_MASTER, 3, 3)
        assert (stale.type, stale.code) == (ofp.OFPET_ROLE_REQUEST_FAILED, ofp.OFPRRFC_STALE)
        is_slave = ofp.OFPET_BAD_REQUEST, ofp.OFPBRC_IS_SLAVE
        lldp = parser.OFPPacketOut(
            DATAPATH,
            ofp.OFP_NO_BUFFER,
            ofp.OFPP_CONTROLLER,
            [parser.OFPActionOutput(1)],
            LLDP,
        )
        assert refused(slave, lldp, 10) == is_slave
        assert refused(slave, light(1, 2), 20) == is_slave
        granted = ask_role(slave, ofp.OFPCR_ROLE_MASTER, 8, 30)
        assert granted.role == ofp.OFPCR_ROLE_MASTER
        accepted(slave, light(1, 2), 40)
        assert "in_port=1" in flows("dump-flows")


def test_switch_tells_what_it_is(switch: Switch) -> None:
    # 7.3.5.1, 7.3.1, 7.3.5.8 and 7.3.5.12: a switch of light alone has no groups and no meters.
    switch.controller.send(parser.OFPDescStatsRequest(DATAPATH, 0), 5)
    report = switch.controller.answer(5).body
    assert report.mfr_desc == b"qmn"
    assert report.hw_desc == b"optical cross-connect, 4 fibre ports"
    assert report.dp_desc == b"q1"
    switch.controller.send(parser.OFPFeaturesRequest(DATAPATH), 6)
    features = switch.controller.answer(6)
    assert features.n_tables == 1
    assert not features.capabilities & ofp.OFPC_GROUP_STATS
    switch.controller.send(parser.OFPGroupFeaturesStatsRequest(DATAPATH, 0), 7)
    groups = switch.controller.answer(7).body
    assert (groups.types, groups.max_groups) == (0, [0, 0, 0, 0])
    switch.controller.send(parser.OFPMeterFeaturesStatsRequest(DATAPATH, 0), 8)
    (meters,) = switch.controller.answer(8).body
    assert (meters.max_meter, meters.max_bands) == (0, 0)
    bands = [parser.OFPMeterBandDrop(rate=9, burst_size=9)]
    meter = parser.OFPMeterMod(DATAPATH, ofp.OFPMC_ADD, ofp.OFPMF_KBPS, 1, bands)
    none = ofp.OFPET_METER_MOD_FAILED, ofp.OFPMMFC_OUT_OF_METERS
    assert refused(switch.controller, meter) == none


def test_its_table_has_what_light_can_do(switch: Switch) -> None:
    # 7.3.5.5: what a table does not tell of, it cannot do.
    switch.controller.send(parser.OFPTableFeaturesStatsRequest(DATAPATH, 0, []), 5)
    (table,) = switch.controller.answer(5).body
    assert (table.table_id, table.name) == (0, b"light")
    reports = {one.type: one for one in table.properties}
    inst, match = reports[ofp.OFPTFPT_INSTRUCTIONS], reports[ofp.OFPTFPT_MATCH]
    assert [one.type for one in inst.instruction_ids] == [WRITE, ofp.OFPIT_APPLY_ACTIONS]
    assert reports[ofp.OFPTFPT_NEXT_TABLES].table_ids == []
    for kind in (ofp.OFPTFPT_WRITE_ACTIONS, ofp.OFPTFPT_APPLY_ACTIONS):
        assert [one.type for one in reports[kind].action_ids] == [ofp.OFPAT_OUTPUT]
    assert [one.type for one in match.oxm_ids] == ["in_port", "eth_type"]
    for kind in (ofp.OFPTFPT_WRITE_SETFIELD, ofp.OFPTFPT_APPLY_SETFIELD):
        assert reports[kind].oxm_ids == []


def test_fibre_ports_are_of_fibre(switch: Switch) -> None:
    # 7.2.1.1: OFPPF_FIBER is the medium; light has no bit rate.
    switch.controller.send(parser.OFPPortDescStatsRequest(DATAPATH, 0), 5)
    ports = {port.port_no: port for port in switch.controller.answer(5).body}
    for number in (1, 2, 3, 4):
        (link,) = [one for one in ports[number].properties if one.type == ofp.OFPPDPT_ETHERNET]
        assert (link.curr, link.supported) == (ofp.OFPPF_FIBER, ofp.OFPPF_FIBER)
        assert (link.curr_speed, link.max_speed) == (0, 0)


def test_echo_comes_back_with_its_data(switch: Switch) -> None:
    # 7.5.2, 7.5.3: the reply has the unmodified data of the request, whatever length that has.
    for number, data in enumerate((b"", b"light", bytes(range(256)) * 16)):
        say(switch.controller, ofp.OFPT_ECHO_REQUEST, data, 800 + number)
        answer = switch.controller.answer(800 + number)
        assert isinstance(answer, parser.OFPEchoReply)
        assert answer.data == data


def test_there_are_no_queues(switch: Switch) -> None:
    # 7.3.5.9, 7.3.5.10, 7.5.4.10: light waits nowhere, so no port has one.
    for request in (parser.OFPQueueStatsRequest, parser.OFPQueueDescStatsRequest):
        switch.controller.send(request(DATAPATH, 0, ofp.OFPP_ANY, ofp.OFPQ_ALL), 5)
        assert switch.controller.answer(5).body == []
    failed = ofp.OFPET_QUEUE_OP_FAILED
    missing = {(99, ofp.OFPQ_ALL): ofp.OFPQOFC_BAD_PORT, (1, 7): ofp.OFPQOFC_BAD_QUEUE}
    for (port, queue), code in missing.items():
        switch.controller.send(parser.OFPQueueStatsRequest(DATAPATH, 0, port, queue), 6)
        answer = switch.controller.answer(6)
        assert (answer.type, answer.code) == (failed, code)
