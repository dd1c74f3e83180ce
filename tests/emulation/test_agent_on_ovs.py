"""The agent's light paths over a real bridge: in time, restored, refused, cut."""

from collections.abc import Iterator
from pathlib import Path

import grpc
import pytest
from agent_scene import (
    BRIDGE,
    DATAPATH,
    TOKEN,
    Switch,
    flows,
    needs_open_vswitch,
    run,
    running_switch,
    veth_names,
    wait_until,
)
from os_ken.ofproto import ofproto_v1_4 as ofp
from os_ken.ofproto import ofproto_v1_4_parser as parser

from qswitch_agent.openflow.messages import HEADER

pytestmark = needs_open_vswitch


@pytest.fixture
def switch(tmp_path: Path) -> Iterator[Switch]:
    """A switch of four fibre ports with its controller."""
    with running_switch(tmp_path) as switch:
        yield switch


def test_a_cut_fibre_is_dark_also_for_an_agent_that_starts_later(switch: Switch) -> None:
    switch.controller.add_paths(10, (1, 3), (3, 1), (4, 2))
    switch.connects((1, 3), (3, 1), (4, 2))
    run("ip", "link", "set", veth_names()[0], "down")  # its peer, port 2, loses its carrier
    switch.connects()
    assert switch.end_agent() == 0
    switch.start_agent()
    assert switch.dispatcher.sets[-1] == []
    run("ip", "link", "set", veth_names()[0], "up")
    switch.connects((1, 3), (3, 1), (4, 2))


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


def test_restarted_agent_restores_the_paths(switch: Switch) -> None:
    switch.controller.add_paths(10, (1, 2), (4, 3))
    switch.controller.answer(11)
    assert switch.end_agent() == 0
    flows("del-flows", "in_port=4")
    switch.start_agent()
    switch.connects((1, 2))
    switch.controller.accept()


def test_paths_survive_the_controller(switch: Switch) -> None:
    switch.controller.add_paths(10, (1, 2))
    switch.controller.answer(11)
    switch.controller.socket.close()
    switch.controller.accept()
    switch.controller.add_paths(20, (3, 4))
    switch.controller.answer(21)
    assert switch.dispatcher.sets == [[], [(1, 2)], [(1, 2), (3, 4)]]


def test_refusal_of_the_hardware_answers_the_barrier_with_an_error(switch: Switch) -> None:
    switch.dispatcher.failure = grpc.StatusCode.INVALID_ARGUMENT
    switch.controller.add_paths(10, (1, 2))
    error = switch.controller.answer(11)
    assert (error.msg_type, error.type) == (ofp.OFPT_ERROR, ofp.OFPET_FLOW_MOD_FAILED)
    assert HEADER.unpack(error.data)[1::2] == (ofp.OFPT_BARRIER_REQUEST, 11)
    switch.dispatcher.failure = None
    switch.controller.add_paths(20, (1, 3))
    assert isinstance(switch.controller.answer(21), parser.OFPBarrierReply)
    assert switch.dispatcher.sets[-1] == [(1, 3)]


def test_two_paths_into_one_port_that_came_by_hand_fail_the_barrier(switch: Switch) -> None:
    flows("add-flow", "in_port=1,actions=output:3")
    flows("add-flow", "in_port=2,actions=output:3")
    switch.controller.send(parser.OFPBarrierRequest(DATAPATH), 9)
    assert switch.controller.answer(9).msg_type == ofp.OFPT_ERROR
    assert switch.dispatcher.sets[-1] == [(1, 3)]


def test_failing_dispatcher_ends_the_agent_after_an_error(switch: Switch) -> None:
    switch.dispatcher.failure = grpc.StatusCode.UNAVAILABLE
    switch.controller.add_paths(10, (1, 2))
    assert switch.controller.answer(11).msg_type == ofp.OFPT_ERROR
    assert switch.ended() == 1
    assert "does not answer" in switch.log.read_text().splitlines()[-1]


def test_lost_dispatcher_ends_the_idle_agent(switch: Switch) -> None:
    switch.dispatcher.stop()
    assert switch.ended() == 1
    assert "dispatcher at" in switch.log.read_text().splitlines()[-1]


def test_lost_bridge_ends_the_agent(switch: Switch) -> None:
    run("ovs-vsctl", "del-br", BRIDGE)
    assert switch.ended() == 1
    assert f"{BRIDGE}.mgmt is gone" in switch.log.read_text().splitlines()[-1]


def test_thousands_of_entries_at_once_are_all_seen(switch: Switch, tmp_path: Path) -> None:
    entries = [f"priority={number},in_port=1,actions=output:2\n" for number in range(1, 20001)]
    (tmp_path / "flows").write_text("".join(entries) + "priority=1,in_port=3,actions=output:4\n")
    run("ovs-ofctl", "-O", "OpenFlow14", "--bundle", "add-flows", BRIDGE, str(tmp_path / "flows"))
    switch.controller.send(parser.OFPBarrierRequest(DATAPATH), 9)
    assert isinstance(switch.controller.answer(9), parser.OFPBarrierReply)
    assert switch.dispatcher.sets[-1] == [(1, 2), (3, 4)]
    flows("del-flows", "in_port=1")
    switch.connects((3, 4))
