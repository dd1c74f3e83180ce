"""The agent's light paths over a real bridge: in time, restored, refused, cut."""

import os
import signal
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import grpc
import pytest
from agent_scene import (
    BRIDGE,
    DATAPATH,
    TOKEN,
    Switch,
    accepted,
    bundle,
    flows,
    light,
    needs_open_vswitch,
    refused,
    run,
    veth_names,
    wait_until,
)
from os_ken.ofproto import ofproto_v1_4 as ofp
from os_ken.ofproto import ofproto_v1_4_parser as parser

from topologies.system.open_vswitch import openvswitch
from wire import dispatcher_pb2 as pb

pytestmark = needs_open_vswitch


def test_a_cut_fibre_is_dark_also_for_an_agent_that_starts_later(own_switch: Switch) -> None:
    own_switch.controller.add_paths(10, (1, 3), (3, 1), (4, 2))
    own_switch.connects((1, 3), (3, 1), (4, 2))
    run("ip", "link", "set", veth_names()[0], "down")  # its peer, port 2, loses its carrier
    own_switch.connects()
    assert own_switch.end_agent() == 0
    own_switch.start_agent()
    assert own_switch.dispatcher.sets[-1] == []
    run("ip", "link", "set", veth_names()[0], "up")
    own_switch.connects((1, 3), (3, 1), (4, 2))


def test_barrier_is_answered_after_the_hardware(switch: Switch) -> None:
    switch.dispatcher.open.clear()
    switch.controller.add_paths(10, (1, 2), (3, 4))
    wait_until(lambda: switch.dispatcher.asked == 2, "the agent to ask for cross-connects")
    assert switch.controller.answer(10).type == ofp.OFPBCT_OPEN_REPLY
    assert switch.controller.answer(10).type == ofp.OFPBCT_COMMIT_REPLY
    assert switch.controller.silent()
    switch.dispatcher.open.set()
    assert isinstance(switch.controller.answer(11), parser.OFPBarrierReply)
    assert switch.dispatcher.sets == [[], [(1, 2), (3, 4)]]
    assert switch.dispatcher.tokens == {TOKEN}


def test_each_bundle_is_in_place_when_its_barrier_is_answered(switch: Switch) -> None:
    for turn in range(200):
        path = (1, 2 + turn % 3)
        switch.controller.add_paths(2 * turn + 100, path)
        assert isinstance(switch.controller.answer(2 * turn + 101), parser.OFPBarrierReply)
        assert switch.dispatcher.sets[-1] == [path]


def test_hard_timeout_closes_the_path(switch: Switch) -> None:
    switch.controller.add_paths(10, (1, 2), hard_timeout=1)
    switch.controller.answer(11)
    switch.connects((1, 2))
    switch.connects()


def test_entries_deleted_by_hand_close_their_path(switch: Switch) -> None:
    switch.controller.add_paths(10, (1, 2), (2, 1))
    switch.controller.answer(11)
    flows("del-flows", "in_port=1")
    switch.connects((2, 1))


def test_entry_modified_by_hand_moves_its_path(switch: Switch) -> None:
    flows("add-flow", "in_port=1,actions=output:2")
    flows("mod-flows", "in_port=1,actions=output:3")
    switch.connects((1, 3))


def test_restarted_agent_restores_the_paths(own_switch: Switch) -> None:
    own_switch.controller.add_paths(10, (1, 2), (4, 3))
    own_switch.controller.answer(11)
    assert own_switch.end_agent() == 0
    flows("del-flows", "in_port=4")
    own_switch.start_agent()
    own_switch.connects((1, 2))
    own_switch.controller.accept()


def test_no_path_is_dark_while_an_agent_that_starts_again_waits_for_the_entries(
    own_switch: Switch,
) -> None:
    dispatcher, daemon = own_switch.dispatcher, openvswitch.switch_daemon_pid()
    own_switch.controller.add_paths(10, (1, 2))
    own_switch.controller.answer(11)
    assert own_switch.end_agent() == 0
    with ThreadPoolExecutor(1) as threads:
        os.kill(daemon, signal.SIGSTOP)
        try:
            starting = threads.submit(own_switch.start_agent)
            wait_until(lambda: dispatcher.watched == 2, "the agent is here, the bridge silent")
        finally:
            os.kill(daemon, signal.SIGCONT)
        starting.result()
    assert dispatcher.sets == [[], [(1, 2)], [(1, 2)]]


def test_paths_survive_the_controller(own_switch: Switch) -> None:
    own_switch.controller.add_paths(10, (1, 2))
    own_switch.controller.answer(11)
    own_switch.controller.socket.close()
    own_switch.controller.accept()
    own_switch.controller.add_paths(20, (3, 4))
    own_switch.controller.answer(21)
    assert own_switch.dispatcher.sets == [[], [(1, 2)], [(1, 2), (3, 4)]]


def test_one_entry_that_the_hardware_refuses_does_not_block_the_switch(switch: Switch) -> None:
    # OpenFlow 1.4, 7.3.8: errors of what was asked before come before the barrier's reply.
    switch.dispatcher.refused = {(1, 2)}
    for xid, one in ((10, light(1, 2)), (11, light(3, 4))):
        switch.controller.send(one, xid)
    switch.controller.send(parser.OFPBarrierRequest(DATAPATH), 12)
    answers = [switch.controller.next() for _ in range(2)]
    assert [(one.xid, one.msg_type) for one in answers] == [
        (10, ofp.OFPT_ERROR),
        (12, ofp.OFPT_BARRIER_REPLY),
    ]
    assert (answers[0].type, answers[0].code) == (ofp.OFPET_FLOW_MOD_FAILED, ofp.OFPFMFC_UNKNOWN)
    assert switch.dispatcher.sets[-1] == [(3, 4)]
    wait_until(lambda: "in_port=1" not in flows("dump-flows"), "the refused entry to be deleted")
    accepted(switch.controller, light(1, 4, command=ofp.OFPFC_DELETE))
    accepted(switch.controller, light(2, 1))
    assert switch.dispatcher.sets[-1] == [(2, 1), (3, 4)]


def test_what_is_stuck_is_refused_with_the_xid_of_its_message(own_switch: Switch) -> None:
    stuck = pb.SwitchCondition()
    stuck.CopyFrom(own_switch.dispatcher.condition)
    stuck.stuck.add(in_port=1, out_port=3)
    own_switch.dispatcher.changes(stuck)
    assert isinstance(own_switch.controller.next(), parser.OFPPortStatus)  # blocked, from now on
    cannot = ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_OUT_PORT
    assert refused(own_switch.controller, light(1, 2)) == cannot
    bundle(own_switch.controller, 50, light(2, 4), light(4, 3))
    wrong = own_switch.controller.answer(52)  # that of the second member
    assert (wrong.type, wrong.code) == cannot
    assert own_switch.controller.answer(50).code == ofp.OFPBFC_MSG_FAILED
    accepted(own_switch.controller, light(2, 4), 60)
    assert "in_port=1" not in flows("dump-flows")
    assert own_switch.dispatcher.sets[-1] == [(2, 4)]


def test_two_paths_into_one_port_that_came_by_hand_do_not_fail_the_barrier(switch: Switch) -> None:
    flows("add-flow", "in_port=1,actions=output:3")
    flows("add-flow", "in_port=2,actions=output:3")
    accepted(switch.controller, light(4, 2))
    assert switch.dispatcher.sets[-1] == [(1, 3), (4, 2)]


def test_failing_dispatcher_ends_the_agent_after_an_error(own_switch: Switch) -> None:
    own_switch.dispatcher.failure = grpc.StatusCode.UNAVAILABLE
    own_switch.controller.send(light(1, 2), 10)
    own_switch.controller.send(parser.OFPBarrierRequest(DATAPATH), 11)
    assert own_switch.controller.answer(10).msg_type == ofp.OFPT_ERROR
    assert own_switch.ended() == 1
    assert "does not answer" in own_switch.log.read_text().splitlines()[-1]


def test_lost_dispatcher_ends_the_idle_agent(own_switch: Switch) -> None:
    own_switch.dispatcher.stop()
    assert own_switch.ended() == 1
    assert "dispatcher at" in own_switch.log.read_text().splitlines()[-1]


def test_lost_bridge_ends_the_agent(own_switch: Switch) -> None:
    run("ovs-vsctl", "del-br", BRIDGE)
    assert own_switch.ended() == 1
    assert f"{BRIDGE}.mgmt is gone" in own_switch.log.read_text().splitlines()[-1]


@pytest.mark.parametrize("count", [4_000, pytest.param(20_000, marks=pytest.mark.nightly)])
def test_thousands_of_entries_at_once_are_all_seen(
    own_switch: Switch, tmp_path: Path, count: int
) -> None:
    entries = [f"priority={number},in_port=1,actions=output:2\n" for number in range(1, count + 1)]
    (tmp_path / "flows").write_text("".join(entries) + "priority=1,in_port=3,actions=output:4\n")
    run("ovs-ofctl", "-O", "OpenFlow14", "--bundle", "add-flows", BRIDGE, str(tmp_path / "flows"))
    own_switch.controller.send(parser.OFPBarrierRequest(DATAPATH), 9)
    assert isinstance(own_switch.controller.answer(9), parser.OFPBarrierReply)
    assert own_switch.dispatcher.sets[-1] == [(1, 2), (3, 4)]
    flows("del-flows", "in_port=1")
    own_switch.connects((3, 4))
