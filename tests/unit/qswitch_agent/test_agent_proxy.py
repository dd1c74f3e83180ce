"""The proxy between a bridge and a controller: order, barriers, refusals, the end of either."""

import asyncio

import openflow_messages as of
import pytest
from optical_switch_scene import (
    ECHO,
    FLOOD,
    OWN_BARRIER,
    OWN_REPLY,
    error,
    heard_light,
    pass_light,
    path,
    undone,
)
from os_ken.ofproto import ofproto_v1_4 as ofp
from proxy_scene import play, stage
from stepping import stepping

from qswitch_agent.hardware.optics import (
    Condition,
    Direction,
)
from qswitch_agent.openflow import matches, messages
from qswitch_agent.openflow.flows import FlowMod
from qswitch_agent.openflow.messages import encode, hello
from qswitch_agent.proxy.link import PRIVATE_XID
from wire import optical
from wire.network_time import SteppedTime


def test_messages_pass_both_ways_unchanged() -> None:
    async def scene() -> None:
        async with stage() as now:
            both = [hello(), ECHO, of.packet_in(9, of.PING)]
            for one, other in ((now.bridge, now.controller), (now.controller, now.bridge)):
                one.says(*both)
                await other.hears(*both)
            requests = [FLOOD, of.group_mod(9), of.packet_out(of.PING, 9), of.port_mod(9)]
            now.controller.says(*requests)
            await now.bridge.hears(*requests)
            assert now.reports.asked == 0

    play(scene())


def test_light_is_added_with_a_mark_of_its_own() -> None:
    async def scene() -> None:
        async with stage() as now:
            now.controller.says(of.light(1, 2, idle_timeout=30, hard_timeout=9), of.light(3, 4))
            first = await heard_light(now.bridge)
            now.bridge.says(OWN_REPLY)
            await now.bridge.hears(OWN_BARRIER)
            second = await heard_light(now.bridge)
            marks = [mod.instructions.mark for mod in (first, second)]
            assert [mark.idle_timeout_s for mark in marks if mark] == [30, 0]
            assert len({mark.circuit for mark in marks if mark}) == 2
            assert (first.idle_timeout_s, first.hard_timeout_s) == (0, 9)

    play(scene())


def test_held_reply_keeps_its_place() -> None:
    async def scene() -> None:
        async with stage() as now:
            now.optics.free.clear()
            now.reports.waiting.append(path(1, 2))
            now.controller.says(of.barrier_request(7), of.barrier_request(8))
            await now.bridge.hears(of.barrier_request(7), of.barrier_request(8))
            packet = of.packet_in(9, of.PING)
            now.bridge.says(packet, of.barrier_reply(7), ECHO, of.barrier_reply(8), packet)
            await now.controller.hears(packet)
            now.controller.says(ECHO)
            await now.bridge.hears(ECHO)
            await now.controller.hears_nothing()
            now.optics.free.set()
            await now.controller.hears(of.barrier_reply(7), ECHO, of.barrier_reply(8), packet)
            assert now.optics.paths == {(1, 2)}

    play(scene())


def test_reply_waits_for_a_barrier_on_the_agents_own_connection() -> None:
    async def scene() -> None:
        async with stage() as now:
            now.reports.open.clear()
            now.controller.says(of.barrier_request(7))
            await now.bridge.hears(of.barrier_request(7))
            assert now.reports.asked == 0
            now.bridge.says(of.barrier_reply(7))
            await now.controller.hears_nothing()
            assert now.reports.asked == 1
            now.reports.waiting.append(path(1, 2))
            now.reports.open.set()
            await now.controller.hears(of.barrier_reply(7))
            assert now.optics.paths == {(1, 2)}

    play(scene())


def test_own_barriers_are_not_for_the_controller() -> None:
    async def scene() -> None:
        async with stage() as now:
            now.controller.says(of.light(1, 2), of.barrier_request(PRIVATE_XID), of.light(3, 4))
            await heard_light(now.bridge)
            await now.bridge.hears(of.barrier_request(PRIVATE_XID), OWN_BARRIER)
            now.bridge.says(OWN_REPLY, OWN_REPLY)
            await heard_light(now.bridge)
            now.bridge.says(ECHO)
            await now.controller.hears(of.barrier_reply(PRIVATE_XID), ECHO)

    play(scene())


def test_malformed_barrier_is_not_waited_for() -> None:
    async def scene() -> None:
        async with stage() as now:
            bad = encode(ofp.OFPT_BARRIER_REQUEST, 7, b"more")
            now.controller.says(bad, of.light(1, 2), of.light(3, 4))
            await now.controller.hears(error(ofp.OFPET_BAD_REQUEST, ofp.OFPBRC_BAD_LEN, bad))
            await heard_light(now.bridge)
            await now.bridge.hears(OWN_BARRIER)
            now.bridge.says(OWN_REPLY)
            await heard_light(now.bridge)
            now.bridge.says(ECHO)
            await now.controller.hears(ECHO)

    play(scene())


def test_what_the_hardware_turns_out_to_refuse_is_an_error_before_the_barriers_reply() -> None:
    async def scene() -> None:
        async with stage() as now:
            now.optics.refused = {(1, 2)}
            bad = of.light(1, 2, xid=5)
            now.controller.says(bad, of.light(3, 4, xid=6), of.barrier_request(7))
            first = await heard_light(now.bridge)
            await now.bridge.hears(OWN_BARRIER)
            now.bridge.says(OWN_REPLY)
            second = await heard_light(now.bridge)
            await now.bridge.hears(of.barrier_request(7))
            now.reports.waiting += [
                path(1, 2, first.instructions.mark),
                path(3, 4, second.instructions.mark),
            ]
            now.bridge.says(of.barrier_reply(7), ECHO)
            await now.controller.hears(undone(bad), of.barrier_reply(7), ECHO)
            assert now.optics.paths == {(3, 4)}
            deleted = FlowMod.decode(await now.commanded.next())
            assert (deleted.command, deleted.match) == (
                ofp.OFPFC_DELETE_STRICT,
                matches.of_port(1),
            )

    play(scene())


def test_what_the_hardware_turns_out_to_refuse_is_told_without_a_barrier() -> None:
    async def scene() -> None:
        async with stage() as now:
            now.optics.refused = {(1, 2)}
            bad = of.light(1, 2, xid=5)
            now.controller.says(bad)
            mod = await heard_light(now.bridge)
            now.switch.paths.update([path(1, 2, mod.instructions.mark)])
            await now.controller.hears(undone(bad))

    play(scene())


def test_entry_that_was_confirmed_is_not_refused_when_its_path_gets_stuck() -> None:
    async def scene() -> None:
        async with stage() as now:
            await pass_light(now, 1, 2)
            now.optics.refused = {(1, 2)}
            now.switch.paths.update_stuck(frozenset({(1, 3)}))
            now.bridge.says(of.barrier_reply(7))
            await now.controller.hears(of.barrier_reply(7))
            assert now.optics.paths == set()

    play(scene())


@pytest.mark.parametrize("request_", [of.light(1, 2, xid=9), of.light(4, 3, xid=9)])
def test_what_is_stuck_is_refused_before_the_bridge_hears_of_it(request_: bytes) -> None:
    async def scene() -> None:
        async with stage() as now:
            now.switch.condition_changed(Condition(stuck=frozenset({(1, 3)})))
            now.controller.says(request_, request_, of.light(1, 3), of.barrier_request(10))
            refused = error(ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_OUT_PORT, request_)
            await now.controller.hears(refused, refused)
            mod = await heard_light(now.bridge)  # what is stuck may be asked for
            await now.bridge.hears(of.barrier_request(10))
            now.reports.waiting.append(path(1, 3, mod.instructions.mark))
            now.bridge.says(of.barrier_reply(10))
            await now.controller.hears(of.barrier_reply(10))
            assert now.optics.paths == {(1, 3)}

    play(scene())


def test_entry_whose_path_is_stuck_by_now_cannot_be_added_again() -> None:
    async def scene() -> None:
        async with stage() as now:
            await pass_light(now, 1, 2)
            now.switch.condition_changed(Condition(stuck=frozenset({(1, 3)})))
            again = of.light(1, 2, xid=9)
            now.controller.says(again)
            await now.controller.hears(error(ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_OUT_PORT, again))

    play(scene())


def test_hold_has_a_deadline(caplog: pytest.LogCaptureFixture) -> None:
    async def scene() -> None:
        async with stage(hold_deadline_s=0.05) as now:
            now.reports.open.clear()
            asked = of.light(1, 2, xid=6)
            now.controller.says(asked, of.barrier_request(7))
            await heard_light(now.bridge)
            await now.bridge.hears(of.barrier_request(7))
            now.bridge.says(of.barrier_reply(7))
            await now.controller.hears(undone(asked), of.barrier_reply(7))

    play(scene())
    assert "light paths were not ready in 0.05 s" in caplog.text


def test_a_reply_is_held_for_time_of_the_network_however_long_the_wall_takes() -> None:
    """In place of an hour the clock leaps, as nothing else waits for an instant."""

    async def scene(time: SteppedTime) -> None:
        async with stage(3600, time) as now:
            now.reports.open.clear()
            asked = of.light(1, 2, xid=6)
            now.controller.says(asked, of.barrier_request(7))
            await heard_light(now.bridge)
            await now.bridge.hears(of.barrier_request(7))
            now.bridge.says(of.barrier_reply(7))
            await now.controller.hears(undone(asked), of.barrier_reply(7))
            assert time.now_s() == 3600

    with stepping() as gate:
        play(scene(gate.time))


def test_taken_output_is_refused_before_the_bridge_hears_of_it() -> None:
    async def scene() -> None:
        async with stage() as now:
            await pass_light(now, 1, 2)
            second = of.light(3, 2, xid=9)
            now.controller.says(second, ECHO)
            taken = error(ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_OUT_PORT, second)
            await now.controller.hears(taken)
            await now.bridge.hears(ECHO)

    play(scene())


def test_change_that_the_monitor_has_not_reported_yet_is_judged_too() -> None:
    async def scene() -> None:
        async with stage() as now:
            bridge, other = await now.connect()
            now.reports.open.clear()
            now.controller.says(of.light(1, 2), of.barrier_request(7))
            mod = await heard_light(now.bridge)
            await now.bridge.hears(of.barrier_request(7))
            now.bridge.says(of.barrier_reply(7))
            while not now.reports.asked:
                await asyncio.sleep(0)
            second = of.light(3, 2, xid=9)
            other.says(second)
            await other.hears_nothing()
            now.reports.waiting.append(path(1, 2, mod.instructions.mark))
            now.reports.open.set()
            await other.hears(error(ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_OUT_PORT, second))
            await now.controller.hears(of.barrier_reply(7))
            for end in (bridge, other):
                end.writer.close()

    play(scene())


def test_change_that_is_reported_is_not_asked_for_again() -> None:
    async def scene() -> None:
        async with stage() as now:
            await pass_light(now, 1, 2)
            asked = now.reports.asked
            now.controller.says(of.light(3, 4))
            await heard_light(now.bridge)
            assert now.reports.asked == asked

    play(scene())


def test_answer_of_the_agent_comes_behind_what_the_bridge_has_said() -> None:
    async def scene() -> None:
        async with stage() as now:
            now.optics.free.clear()
            now.reports.waiting.append(path(1, 2))
            now.bridge.says(of.barrier_reply(7), ECHO)
            while not now.reports.asked:
                await asyncio.sleep(0)
            bad = of.flow_mod({"in_port": 1}, of.outputs(1), xid=9)
            now.controller.says(bad)
            await now.controller.hears_nothing()
            now.optics.free.set()
            refused = error(ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_OUT_PORT, bad)
            await now.controller.hears(of.barrier_reply(7), ECHO, refused)

    play(scene())


def test_slave_is_refused_as_such() -> None:
    async def scene() -> None:
        async with stage() as now:
            bad = of.flow_mod({"in_port": 1}, of.outputs(1), xid=9)
            lldp = of.packet_out(of.LLDP, 1, xid=10)
            member = of.bundle_add(5, of.light(1, 2, 11))
            discard = of.bundle_control(5, ofp.OFPBCT_DISCARD_REQUEST, 12)
            now.bridge.says(encode(ofp.OFPT_ROLE_REPLY, 1, messages.ROLE.pack(3, 1)))
            await now.controller.next()
            now.controller.says(bad, lldp, member, discard)
            for request in (bad, lldp, member, discard):
                slave = error(ofp.OFPET_BAD_REQUEST, ofp.OFPBRC_IS_SLAVE, request)
                await now.controller.hears(slave)
            master = encode(ofp.OFPT_ROLE_REQUEST, 1, messages.ROLE.pack(2, 2))
            # A stale request does not lift the guard (OpenFlow 1.4, 6.3.4).
            stale = error(ofp.OFPET_ROLE_REQUEST_FAILED, ofp.OFPRRFC_STALE, master)
            now.controller.says(master, bad, lldp)
            await now.bridge.hears(master, OWN_BARRIER)
            now.bridge.says(stale, OWN_REPLY)
            await now.controller.hears(stale)
            for request in (bad, lldp):
                await now.controller.hears(
                    error(ofp.OFPET_BAD_REQUEST, ofp.OFPBRC_IS_SLAVE, request)
                )
            granted = encode(ofp.OFPT_ROLE_REPLY, 1, messages.ROLE.pack(2, 2))
            now.controller.says(master, bad, lldp, ECHO)
            await now.bridge.hears(master, OWN_BARRIER)
            now.bridge.says(granted, OWN_REPLY)
            await now.bridge.hears(ECHO)
            await now.controller.hears(
                granted, error(ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_OUT_PORT, bad)
            )

    play(scene())


@pytest.mark.parametrize(
    ("request_", "kind", "code"),
    [
        (of.group_mod(9, 2), ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_OUT_PORT),
        (of.packet_out(of.PING, 2), ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_OUT_PORT),
        (of.packet_out(of.LLDP, 2, 9), ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_OUT_PORT),
        (of.port_mod(9, of.tuning(1)), ofp.OFPET_BAD_PROPERTY, ofp.OFPBPC_BAD_TYPE),
        (of.port_mod(2, of.tuning(1)), ofp.OFPET_BAD_PROPERTY, ofp.OFPBPC_BAD_VALUE),
        (
            of.port_mod(2, of.tuning(193_400_000, configure=optical.TX_TUNE)),
            ofp.OFPET_BAD_PROPERTY,
            ofp.OFPBPC_BAD_VALUE,
        ),
        (
            of.port_mod(2, of.tuning(193_400_000, power=1)),
            ofp.OFPET_BAD_PROPERTY,
            ofp.OFPBPC_BAD_VALUE,
        ),
        (of.port_mod(2, mask=ofp.OFPPC_NO_FWD), ofp.OFPET_PORT_MOD_FAILED, ofp.OFPPMFC_BAD_CONFIG),
        *(
            (
                encode(
                    ofp.OFPT_EXPERIMENTER, 1, bytes.fromhex("00002320") + bytes([0, 0, 0, kind])
                ),
                ofp.OFPET_BAD_REQUEST,
                ofp.OFPBRC_BAD_EXP_TYPE,
            )
            for kind in (13, 28, 31)
        ),
        (encode(ofp.OFPT_PORT_MOD, 1, b"abc"), ofp.OFPET_BAD_REQUEST, ofp.OFPBRC_BAD_LEN),
        (encode(ofp.OFPT_MULTIPART_REQUEST, 1), ofp.OFPET_BAD_REQUEST, ofp.OFPBRC_BAD_LEN),
    ],
)
def test_request_that_is_refused_does_not_reach_the_bridge(
    request_: bytes, kind: int, code: int
) -> None:
    async def scene() -> None:
        async with stage() as now:
            now.controller.says(request_, ECHO)
            await now.controller.hears(error(kind, code, request_))
            await now.bridge.hears(ECHO)
            assert now.optics.tuned == []

    play(scene())


def test_port_is_tuned_when_the_bridge_has_taken_the_rest() -> None:
    async def scene() -> None:
        async with stage() as now:
            request = of.port_mod(2, of.tuning(193_400_000, -50), xid=9)
            now.controller.says(request)
            await now.bridge.hears(of.port_mod(2, xid=9), OWN_BARRIER)
            assert now.optics.tuned == []
            now.bridge.says(OWN_REPLY)
            while not now.optics.tuned:
                await asyncio.sleep(0)
            assert now.optics.tuned == [(2, 193_400_000, -5.0, Direction.BOTH)]
            now.controller.says(request)
            await now.bridge.hears(of.port_mod(2, xid=9), OWN_BARRIER)
            wrong = error(ofp.OFPET_PORT_MOD_FAILED, ofp.OFPPMFC_BAD_HW_ADDR, request)
            now.bridge.says(wrong, OWN_REPLY)
            await now.controller.hears(wrong)
            now.controller.says(ECHO)
            await now.bridge.hears(ECHO)
            assert len(now.optics.tuned) == 1

    play(scene())


def test_held_reply_is_decided_before_the_end() -> None:
    async def scene() -> None:
        async with stage() as now:
            now.reports.open.clear()
            now.bridge.says(of.barrier_reply(7))
            while not now.reports.asked:
                await asyncio.sleep(0)
            closing = asyncio.create_task(now.proxy.close())
            await asyncio.sleep(0)
            now.reports.open.set()
            await closing
            await now.controller.hears(of.barrier_reply(7))

    play(scene())
