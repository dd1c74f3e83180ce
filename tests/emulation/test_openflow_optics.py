"""To a controller the bridge with its agent is an optical switch: OpenFlow 1.4, word by word."""

import re

from agent_scene import (
    DATAPATH,
    FLAGS,
    LLDP,
    PING,
    Controller,
    Switch,
    accepted,
    actions,
    bundle,
    committed,
    entries,
    flow_mod,
    flows,
    light,
    needs_open_vswitch,
    outputs,
    refused,
    run,
    tuning,
    veth_names,
    wait_until,
)
from os_ken.ofproto import ofproto_v1_4 as ofp
from os_ken.ofproto import ofproto_v1_4_parser as parser

from wire import dispatcher_pb2 as pb
from wire import optical

pytestmark = needs_open_vswitch
BAD_PORT = ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_OUT_PORT


def test_fibres_are_described_as_optical_ports(switch: Switch) -> None:
    switch.controller.send(parser.OFPPortDescStatsRequest(DATAPATH, 0), 5)
    ports = {port.port_no: port for port in switch.controller.answer(5).body}
    assert set(ports) == {1, 2, 3, 4, ofp.OFPP_LOCAL}
    for number, port in ports.items():
        found = [one for one in port.properties if one.type == ofp.OFPPDPT_OPTICAL]
        assert bool(found) == (number != ofp.OFPP_LOCAL)
        for one in found:
            assert one.supported == optical.TUNABLE
            assert (one.tx_min_freq_lmda, one.rx_max_freq_lmda) == (191_350_000, 196_100_000)
            assert (one.tx_grid_freq_lmda, one.tx_pwr_max) == (50_000, 0)
            assert one.tx_pwr_min == -200 & 0xFFFF
        assert port.config == 0 or number == ofp.OFPP_LOCAL


def test_port_statistics_count_photons_and_show_the_light(switch: Switch) -> None:
    reading = pb.SwitchStatisticsReply.Port(
        port=2,
        photons_in=5_000_000_000,
        photons_out=70,
        photons_lost=9,
        frequency_mhz=193_500_000,
        rx_frequency_mhz=193_550_000,
        power_dbm=-1.5,
        rx_power_dbm=-12.3,
        bias_ma=8.5,
    )
    switch.dispatcher.readings = pb.SwitchStatisticsReply(ports=[reading], temperature_c=31.5)
    switch.controller.send(parser.OFPPortStatsRequest(DATAPATH, 0, 2), 5)
    (port,) = switch.controller.answer(5).body
    assert (port.rx_packets, port.tx_packets, port.rx_dropped) == (5_000_000_000, 70, 9)
    (shown,) = port.properties
    assert shown.type == ofp.OFPPSPT_OPTICAL
    assert (shown.tx_freq_lmda, shown.rx_freq_lmda) == (193_500_000, 193_550_000)
    assert shown.flags == (
        ofp.OFPOSF_RX_TUNE
        | ofp.OFPOSF_TX_TUNE
        | ofp.OFPOSF_TX_PWR
        | ofp.OFPOSF_RX_PWR
        | ofp.OFPOSF_TX_BIAS
        | ofp.OFPOSF_TX_TEMP
    )
    assert (shown.tx_pwr, shown.rx_pwr) == (-15 & 0xFFFF, -123 & 0xFFFF)
    assert (shown.bias_current, shown.temperature) == (85, 315)


def test_a_cut_fibre_has_no_light(own_switch: Switch) -> None:
    reading = pb.SwitchStatisticsReply.Port(port=2, rx_power_dbm=-0.0)
    own_switch.dispatcher.readings = pb.SwitchStatisticsReply(ports=[reading])
    run("ip", "link", "set", veth_names()[0], "down")  # its peer, port 2, loses its carrier
    while own_switch.controller.next().desc.port_no != 2:
        pass
    own_switch.controller.send(parser.OFPPortStatsRequest(DATAPATH, 0, 2), 5)
    (port,) = own_switch.controller.answer(5).body
    assert not port.properties[0].flags & ofp.OFPOSF_RX_PWR
    assert port.properties[0].rx_pwr == 0x8000


def test_port_is_tuned(switch: Switch) -> None:
    accepted(switch.controller, tuning(switch, 2, 193_500_000, power=-30))
    (tuned,) = switch.dispatcher.tuned
    assert (tuned.port, tuned.frequency_mhz, tuned.power_dbm) == (2, 193_500_000, -3.0)


def test_tuning_out_of_range_is_refused(switch: Switch) -> None:
    within = 193_500_000
    beyond = [(191_300_000, 0), (196_150_000, 0), (193_510_000, 0), (within, 10), (within, -201)]
    for frequency_mhz, power in beyond:
        wrong = refused(switch.controller, tuning(switch, 2, frequency_mhz, power))
        assert wrong == (ofp.OFPET_BAD_PROPERTY, ofp.OFPBPC_BAD_VALUE), (frequency_mhz, power)
    assert switch.dispatcher.tuned == []


def test_tuning_that_the_bridge_refuses_does_not_happen(switch: Switch) -> None:
    wrong = tuning(switch, 2, 193_500_000, address="02:00:00:00:00:99")
    error = ofp.OFPET_PORT_MOD_FAILED, ofp.OFPPMFC_BAD_HW_ADDR
    assert refused(switch.controller, wrong) == error
    assert switch.dispatcher.tuned == []


def test_tuning_in_a_bundle_waits_for_commit(switch: Switch) -> None:
    control = parser.OFPBundleCtrlMsg
    open_ = control(DATAPATH, 7, ofp.OFPBCT_OPEN_REQUEST, FLAGS, [])
    discard = control(DATAPATH, 7, ofp.OFPBCT_DISCARD_REQUEST, FLAGS, [])
    member = tuning(switch, 1, 193_500_000)
    member.set_xid(8)
    switch.controller.send(open_, 7)
    switch.controller.send(parser.OFPBundleAddMsg(DATAPATH, 7, FLAGS, member, []), 8)
    switch.controller.send(discard, 9)
    assert switch.controller.answer(9).type == ofp.OFPBCT_DISCARD_REPLY
    assert switch.dispatcher.tuned == []
    committed(switch.controller, 20, tuning(switch, 1, 193_600_000), light(1, 3))
    assert [one.frequency_mhz for one in switch.dispatcher.tuned] == [193_600_000]
    assert switch.dispatcher.sets[-1] == [(1, 3)]


def test_flow_statistics_count_photons(switch: Switch) -> None:
    accepted(switch.controller, light(1, 3, cookie=77, idle_timeout=40, priority=9))
    accepted(switch.controller, flow_mod(None, outputs(ofp.OFPP_CONTROLLER), priority=0), 610)
    switch.dispatcher.passed(123_456, 1, 3)
    found = {entry.priority: entry for entry in entries(switch.controller)}
    path = found[9]
    assert (path.packet_count, path.byte_count) == (123_456, (1 << 64) - 1)
    assert path.idle_timeout == 40
    assert path.cookie == 77
    assert [one.port for one in path.instructions[0].actions] == [3]
    assert found[0].packet_count == 0
    request = parser.OFPAggregateStatsRequest(
        DATAPATH, 0, ofp.OFPTT_ALL, ofp.OFPP_ANY, ofp.OFPG_ANY, 0, 0, parser.OFPMatch()
    )
    switch.controller.send(request, 5)
    total = switch.controller.answer(5).body
    assert (total.packet_count, total.flow_count) == (123_456, 2)


def test_bridge_never_expires_light_by_itself(switch: Switch) -> None:
    """To it the entry is idle from the start; light, which the agent sees, keeps passing."""
    accepted(switch.controller, light(1, 3, idle_timeout=1))
    switch.dispatcher.passed(1, 1, 3, ahead_s=60)
    stands = r"duration=(\d+).*in_port=1\b"
    wait_until(
        lambda: any(int(age) > 2 for age in re.findall(stands, flows("dump-flows"))),
        "the entry of light is over two seconds old",
    )
    assert switch.dispatcher.sets[-1] == [(1, 3)]
    assert "idle_timeout" not in flows("dump-flows")


def test_idle_entry_is_removed_and_its_photons_told(switch: Switch) -> None:
    notify = ofp.OFPFF_SEND_FLOW_REM
    accepted(switch.controller, light(1, 3, idle_timeout=1, cookie=5, flags=notify))
    accepted(switch.controller, light(2, 4, flags=notify))
    switch.dispatcher.passed(42, 1, 3)
    switch.connects((2, 4))
    while not isinstance(gone := switch.controller.next(), parser.OFPFlowRemoved):
        pass
    assert (gone.reason, gone.idle_timeout) == (ofp.OFPRR_IDLE_TIMEOUT, 1)
    assert (gone.packet_count, gone.cookie) == (42, 5)
    gone_by_hand = flow_mod(2, command=ofp.OFPFC_DELETE)
    switch.controller.send(gone_by_hand, 30)
    while not isinstance(gone := switch.controller.next(), parser.OFPFlowRemoved):
        pass
    assert gone.reason == ofp.OFPRR_DELETE


def test_idle_timeout_outlives_the_agent(own_switch: Switch) -> None:
    accepted(own_switch.controller, light(1, 3, idle_timeout=2, cookie=5))
    circuit = own_switch.dispatcher.circuits[1, 3]
    assert own_switch.end_agent() == 0
    own_switch.start_agent()
    own_switch.controller.accept()
    assert own_switch.dispatcher.circuits[1, 3] == circuit
    own_switch.dispatcher.passed(3, 1, 3)
    (entry,) = entries(own_switch.controller)
    assert (entry.idle_timeout, entry.packet_count) == (2, 3)
    own_switch.connects()


def test_bundle_with_a_member_that_the_bridge_refuses_changes_nothing(switch: Switch) -> None:
    unknown_group = flow_mod(ofp.OFPP_LOCAL, actions(parser.OFPActionGroup(9)))
    bundle(switch.controller, 50, light(3, 4), unknown_group)
    assert switch.controller.answer(52).type == ofp.OFPET_BAD_ACTION
    assert switch.controller.answer(50).code == ofp.OFPBFC_MSG_FAILED
    assert entries(switch.controller) == []
    assert switch.dispatcher.sets == [[]]


def test_output_that_is_taken_is_refused(switch: Switch) -> None:
    accepted(switch.controller, light(1, 3, priority=5))
    taken = ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_OUT_PORT
    assert refused(switch.controller, light(2, 3)) == taken
    bundle(switch.controller, 50, light(4, 2), light(2, 3))
    assert switch.controller.answer(52).code == ofp.OFPBAC_BAD_OUT_PORT
    assert switch.controller.answer(50).code == ofp.OFPBFC_MSG_FAILED
    assert switch.dispatcher.sets[-1] == [(1, 3)]
    assert len(entries(switch.controller)) == 1


def test_only_entries_that_light_meets_take_an_output(switch: Switch) -> None:
    accepted(switch.controller, light(1, 3, priority=5))
    accepted(switch.controller, light(1, 4, priority=6))
    accepted(switch.controller, light(2, 3))
    assert switch.dispatcher.sets[-1] == [(1, 4), (2, 3)]


def test_requests_that_nobody_waited_for_are_judged_together(switch: Switch) -> None:
    controller = switch.controller
    controller.send(light(1, 3), 1)
    controller.send(flow_mod(1, command=ofp.OFPFC_DELETE), 2)
    controller.send(light(2, 3), 3)
    controller.send(light(4, 3), 4)
    wrong = controller.answer(4)
    assert (wrong.type, wrong.code) == (ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_OUT_PORT)
    accepted(controller, parser.OFPBarrierRequest(DATAPATH), 90)
    assert switch.dispatcher.sets[-1] == [(2, 3)]


def test_outputs_change_hands_within_a_bundle(switch: Switch) -> None:
    committed(switch.controller, 50, light(1, 3), light(2, 4))
    committed(switch.controller, 60, light(1, 4), light(2, 3))
    assert switch.dispatcher.sets == [[], [(1, 3), (2, 4)], [(1, 4), (2, 3)]]


def test_modify_keeps_counters_and_timeout(switch: Switch) -> None:
    accepted(switch.controller, light(1, 3, idle_timeout=60, cookie=5))
    switch.dispatcher.passed(10, 1, 3)
    circuit = switch.dispatcher.circuits[1, 3]
    accepted(switch.controller, light(1, 2, command=ofp.OFPFC_MODIFY))
    assert switch.dispatcher.circuits == {(1, 2): circuit}
    (entry,) = entries(switch.controller)
    assert (entry.idle_timeout, entry.packet_count, entry.cookie) == (60, 10, 5)


def test_paths_are_swapped_by_modify_in_a_bundle(switch: Switch) -> None:
    committed(switch.controller, 50, light(1, 3), light(2, 4))
    modify = ofp.OFPFC_MODIFY_STRICT
    swap = light(1, 4, command=modify), light(2, 3, command=modify)
    committed(switch.controller, 60, *swap)
    assert switch.dispatcher.sets[-1] == [(1, 4), (2, 3)]
    bundle(switch.controller, 70, light(1, 3, command=modify))
    assert switch.controller.answer(71).code == ofp.OFPBAC_BAD_OUT_PORT
    assert switch.controller.answer(70).code == ofp.OFPBFC_MSG_FAILED


def test_modifying_everything_does_not_touch_light(switch: Switch) -> None:
    accepted(switch.controller, light(1, 3))
    everything = flow_mod(None, outputs(ofp.OFPP_LOCAL), command=ofp.OFPFC_MODIFY)
    assert refused(switch.controller, everything) == BAD_PORT
    assert switch.dispatcher.sets[-1] == [(1, 3)]


def test_entry_without_output_is_darkness(switch: Switch) -> None:
    accepted(switch.controller, light(1, 3, priority=5))
    accepted(switch.controller, flow_mod(1, priority=9))
    assert switch.dispatcher.sets[-1] == []


def test_all_paths_of_a_bundle_switch_at_once(switch: Switch) -> None:
    members = [light(1 + number % 4, 1 + (number + 1) % 4, priority=number) for number in range(99)]
    committed(switch.controller, 500, *members)
    assert switch.dispatcher.sets == [[], [(1, 2), (2, 3), (3, 4), (4, 1)]]


def test_lldp_is_all_that_passes_a_supervisory_channel(switch: Switch) -> None:
    controller = switch.controller
    lldp_up = flow_mod(None, outputs(ofp.OFPP_CONTROLLER), fields={"eth_type": 0x88CC})
    accepted(controller, lldp_up)
    accepted(controller, flow_mod(1, outputs(ofp.OFPP_CONTROLLER), fields={"eth_type": 0x88CC}))
    accepted(controller, flow_mod(None, outputs(ofp.OFPP_CONTROLLER), priority=0))
    accepted(controller, light(2, 3))
    out = parser.OFPPacketOut
    no_buffer = ofp.OFP_NO_BUFFER
    for frame, ports in ((PING, [1]), (LLDP, [1, 3])):
        where = [parser.OFPActionOutput(port) for port in ports]
        wrong = out(DATAPATH, no_buffer, ofp.OFPP_CONTROLLER, where, frame)
        assert refused(controller, wrong) == BAD_PORT
    for port in (ofp.OFPP_FLOOD, ofp.OFPP_ALL):
        everywhere = [parser.OFPActionOutput(port)]
        accepted(controller, out(DATAPATH, no_buffer, ofp.OFPP_CONTROLLER, everywhere, LLDP))
    assert controller.silent()
    where = [parser.OFPActionOutput(1)]
    controller.send(out(DATAPATH, no_buffer, ofp.OFPP_CONTROLLER, where, LLDP), 8)
    heard = controller.next()  # port 1's veth leads to port 2
    assert isinstance(heard, parser.OFPPacketIn)
    assert (heard.match["in_port"], bytes(heard.data)) == (2, LLDP)


def test_packets_that_come_out_of_a_fibre_go_nowhere(switch: Switch) -> None:
    accepted(switch.controller, flow_mod(None, outputs(ofp.OFPP_CONTROLLER), priority=0))
    code = (
        "import socket; s = socket.socket(socket.AF_PACKET, socket.SOCK_RAW); "
        f"s.bind(({veth_names()[0]!r}, 0)); s.send(bytes.fromhex({PING.hex()!r})); "
        f"s.send(bytes.fromhex({LLDP.hex()!r}))"
    )
    run("python3", "-c", code)
    heard = switch.controller.next()
    assert (heard.match["in_port"], bytes(heard.data)) == (2, LLDP)
    assert switch.controller.silent()


def test_slave_changes_nothing(own_switch: Switch) -> None:
    controller = own_switch.controller
    controller.send(parser.OFPRoleRequest(DATAPATH, ofp.OFPCR_ROLE_SLAVE, 1), 3)
    assert controller.answer(3).role == ofp.OFPCR_ROLE_SLAVE
    slave = ofp.OFPET_BAD_REQUEST, ofp.OFPBRC_IS_SLAVE
    assert refused(controller, light(1, 3)) == slave
    assert refused(controller, light(1, ofp.OFPP_FLOOD)) == slave
    assert refused(controller, tuning(own_switch, 2, 193_500_000)) == slave
    where = [parser.OFPActionOutput(1)]
    lldp = parser.OFPPacketOut(DATAPATH, ofp.OFP_NO_BUFFER, ofp.OFPP_CONTROLLER, where, LLDP)
    assert refused(controller, lldp) == slave
    assert (own_switch.dispatcher.sets, own_switch.dispatcher.tuned) == ([[]], [])
    controller.send(parser.OFPRoleRequest(DATAPATH, ofp.OFPCR_ROLE_MASTER, 2), 4)
    accepted(controller, light(1, 3))
    assert own_switch.dispatcher.sets[-1] == [(1, 3)]


def port_status(controller: Controller, *states: int) -> set[int]:
    """Return the ports of which the next messages tell this state, until there are no more."""
    reports: dict[int, int] = {}
    while not controller.silent():
        message = controller.next()
        assert isinstance(message, parser.OFPPortStatus)
        assert any(one.type == ofp.OFPPDPT_OPTICAL for one in message.desc.properties)
        reports[message.desc.port_no] = message.desc.state
    return {port for port, state in reports.items() if state in states}


def test_stuck_cross_connect_is_told(own_switch: Switch) -> None:
    accepted(own_switch.controller, parser.OFPBarrierRequest(DATAPATH))  # the bridge knows us
    stuck = pb.SwitchCondition()
    stuck.CopyFrom(own_switch.dispatcher.condition)
    stuck.stuck.add(in_port=1, out_port=3)
    own_switch.dispatcher.changes(stuck)
    wait_until(lambda: not own_switch.controller.silent(), "PORT_STATUS")
    blocked = ofp.OFPPS_BLOCKED, ofp.OFPPS_BLOCKED | ofp.OFPPS_LIVE
    assert port_status(own_switch.controller, *blocked) == {1, 3}


def test_hot_device_is_told(own_switch: Switch) -> None:
    own_switch.controller.send(parser.OFPPortDescStatsRequest(DATAPATH, 0), 5)
    ports = {port.port_no: port.state for port in own_switch.controller.answer(5).body}
    assert [ports[number] for number in (1, 2, 3, 4)] == 4 * [ofp.OFPPS_LIVE]
    hot = pb.SwitchCondition()
    hot.CopyFrom(own_switch.dispatcher.condition)
    hot.hot = True
    own_switch.dispatcher.changes(hot)
    wait_until(lambda: not own_switch.controller.silent(), "PORT_STATUS")
    assert port_status(own_switch.controller, 0) == {1, 2, 3, 4}


def test_cut_fibre_is_told_with_its_optics(own_switch: Switch) -> None:
    run("ip", "link", "set", veth_names()[0], "down")
    wait_until(lambda: not own_switch.controller.silent(), "PORT_STATUS")
    assert port_status(own_switch.controller, ofp.OFPPS_LINK_DOWN) == {1, 2}


def test_paths_tell_their_loss_and_rotation(own_switch: Switch) -> None:
    condition = pb.SwitchCondition()
    condition.CopyFrom(own_switch.dispatcher.condition)
    condition.paths.add(in_port=2, out_port=4, loss_db=1.25, rotation=3)
    condition.stuck.add(in_port=1, out_port=3)
    own_switch.dispatcher.changes(condition)
    port_status(own_switch.controller)
    ask_ = parser.OFPExperimenterStatsRequest(
        DATAPATH, 0, optical.EXPERIMENTER, optical.PATH_OPTICS, b""
    )
    own_switch.controller.send(ask_, 5)
    body = own_switch.controller.answer(5).body
    assert (body.experimenter, body.exp_type) == (optical.EXPERIMENTER, optical.PATH_OPTICS)
    any_port = optical.ANY_PORT
    assert optical.decode_path_optics(bytes(body.data)) == [
        optical.PathOptics(any_port, any_port, 500, 1),
        optical.PathOptics(1, 3, 500, 1, stuck=True),
        optical.PathOptics(2, 4, 1250, 3),
    ]
