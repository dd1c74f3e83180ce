"""The proxy between a bridge and a controller: order, barriers, refusals, the end of either."""

import asyncio
import gc
import warnings
from asyncio import StreamReader
from unittest.mock import patch

import openflow_messages as of
import pytest
from os_ken.ofproto import ofproto_v1_4 as ofp
from proxy_scene import End, Listener, Stage, play, running_switch, stage

from qswitch_agent.bridge import NO_PACKETS
from qswitch_agent.hardware.optics import (
    CircuitReading,
    Condition,
    Direction,
    HardwareFault,
    HardwareRefusal,
    Path,
    PortReading,
    Quantity,
    Readings,
)
from qswitch_agent.openflow import flow_reports, matches, messages
from qswitch_agent.openflow.flow_reports import ADDED, REMOVED, FlowUpdate
from qswitch_agent.openflow.flows import FlowEntry, FlowMod
from qswitch_agent.openflow.instructions import Mark
from qswitch_agent.openflow.messages import encode, hello
from qswitch_agent.proxy.link import PRIVATE_XID
from qswitch_agent.proxy.proxy import Proxy
from topologies.system.runs.runtime import free_port
from wire import optical

ECHO = encode(ofp.OFPT_ECHO_REQUEST, 3, b"are you there?")
FLOOD = of.flow_mod({"in_port": 9}, of.outputs(ofp.OFPP_FLOOD), xid=4)
OWN_BARRIER = encode(ofp.OFPT_BARRIER_REQUEST, PRIVATE_XID)
NICIRA = bytes.fromhex("00002320 000000")
OWN_REPLY = encode(ofp.OFPT_BARRIER_REPLY, PRIVATE_XID)


def error(kind: int, code: int, request: bytes) -> bytes:
    return messages.error(kind, code, request)


def path(in_port: int, out_port: int, mark: Mark | None = None, event: int = ADDED) -> FlowUpdate:
    entry = FlowEntry(0x8000, matches.of_port(in_port), in_port, False, out_port, 0, mark)
    return FlowUpdate(event, entry)


async def heard_light(end: End) -> FlowMod:
    """Return the FLOW_MOD of a light entry that comes next, and check that it is marked."""
    mod = FlowMod.decode(await end.next())
    assert mod.instructions.mark
    return mod


async def pass_light(now: Stage, in_port: int, out_port: int, xid: int = 1) -> None:
    """Let a path be added and confirmed by the controller's barrier."""
    now.controller.says(of.light(in_port, out_port, xid), of.barrier_request(xid + 1))
    mod = await heard_light(now.bridge)
    await now.bridge.hears(of.barrier_request(xid + 1))
    now.reports.waiting.append(path(in_port, out_port, mod.instructions.mark))
    now.bridge.says(of.barrier_reply(xid + 1))
    await now.controller.hears(of.barrier_reply(xid + 1))


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


def undone(request: bytes) -> bytes:
    return error(ofp.OFPET_FLOW_MOD_FAILED, ofp.OFPFMFC_UNKNOWN, request)


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


def test_bridge_is_shown_as_an_optical_switch() -> None:
    async def scene() -> None:
        async with stage() as now:
            parts = [of.port(1).encode(), of.port(9).encode()]
            now.bridge.says(
                messages.reply(ofp.OFPMP_PORT_DESC, 1, parts),
                of.port_status(of.port(3)),  # the first half of an announcement
                of.port_status(of.port(2, config=NO_PACKETS)),
            )
            fiber, other = of.decoded(await now.controller.next()).body
            (optics,) = fiber.properties
            assert (optics.tx_min_freq_lmda, optics.tx_grid_freq_lmda) == (191_350_000, 50_000)
            assert (fiber.state & ofp.OFPPS_LIVE, other.properties) == (ofp.OFPPS_LIVE, [])
            told = of.decoded(await now.controller.next()).desc
            (optics,) = told.properties
            assert (told.port_no, told.config) == (2, 0)
            assert optics.supported == optical.TUNABLE

    play(scene())


# OpenFlow 1.4, 7.3.5.7: ofp_port_stats_optical_flags, as os-ken has them too.
RX_TUNE, TX_TUNE, TX_PWR, RX_PWR, TX_BIAS, TX_TEMP = 1, 2, 4, 16, 32, 64


def test_readings_beyond_their_fields_are_shown_as_the_nearest_value() -> None:
    async def scene() -> None:
        async with stage() as now:
            dark = PortReading(5, 6, 7, 193_400_000, 193_400_000, -1e9, -float("inf"), -1.0)
            now.optics.readings = Readings({1: dark}, temperature_c=1e9)
            parts = [of.port_statistics(1), of.port_statistics(9)]
            now.bridge.says(messages.reply(ofp.OFPMP_PORT_STATS, 1, parts))
            fiber, other = of.decoded(await now.controller.next()).body
            assert (fiber.rx_packets, fiber.tx_packets, fiber.rx_dropped) == (5, 6, 7)
            assert (other.rx_packets, other.properties) == (11, [])
            (light,) = fiber.properties
            assert (light.tx_pwr, light.rx_pwr) == (0x8000, 0x8000)
            assert light.flags & (TX_PWR | RX_PWR) == TX_PWR  # no field can say -infinity dBm
            assert (light.bias_current, light.temperature) == (0, 0x7FFF)

    play(scene())


@pytest.mark.parametrize(
    ("missing", "powers", "cut", "flags"),
    [
        (set(), (0, 0), False, RX_TUNE | TX_TUNE | TX_PWR | RX_PWR | TX_BIAS | TX_TEMP),
        ({Quantity.FREQUENCY, Quantity.BIAS, Quantity.TEMPERATURE}, (0, 0), False, TX_PWR | RX_PWR),
        ({Quantity.TX_POWER}, (0, 0), False, RX_TUNE | TX_TUNE | RX_PWR | TX_BIAS | TX_TEMP),
        (set(), (0, 0), True, RX_TUNE | TX_TUNE | TX_PWR | TX_BIAS | TX_TEMP),
        (set(), (0,), False, RX_TUNE | TX_TUNE | TX_PWR | TX_BIAS | TX_TEMP),
        (set(), (), False, RX_TUNE | TX_TUNE | TX_BIAS | TX_TEMP),
    ],
    ids=["all", "powers", "received", "cut", "none received yet", "no power"],
)
def test_flags_of_statistics_say_what_is_measured(
    missing: set[Quantity], powers: tuple[float, ...], cut: bool, flags: int
) -> None:
    async def scene() -> None:
        async with stage() as now:
            reading = PortReading(5, 6, 7, 193_400_000, 193_450_000, *powers)
            now.optics.readings = Readings({1: reading}, not_measured=frozenset(missing))
            if cut:
                now.switch._channels.update([of.port(1, state=ofp.OFPPS_LINK_DOWN)])
            now.bridge.says(messages.reply(ofp.OFPMP_PORT_STATS, 1, [of.port_statistics(1)]))
            (shown,) = of.decoded(await now.controller.next()).body
            (light,) = shown.properties
            assert light.flags == flags
            assert (light.tx_freq_lmda, light.rx_freq_lmda) == (193_400_000, 193_450_000)
            # An invalid value does not look like 0 dBm, 1 mW.
            assert light.rx_pwr == (0 if flags & RX_PWR else 0x8000)
            assert light.tx_pwr == (0 if flags & TX_PWR else 0x8000)

    play(scene())


NOT_AVAILABLE = (1 << 64) - 1  # OpenFlow 1.4, 5.8: the maximum field value


def test_counters_that_there_are_not_have_the_maximum_value() -> None:
    async def scene() -> None:
        async with stage() as now:
            now.optics.readings = Readings({1: PortReading(5, 6, 7)})
            ports = messages.reply(ofp.OFPMP_PORT_STATS, 1, [of.port_statistics(1)])
            for counted in (True, False):
                now.bridge.says(ports)
                (port,) = of.decoded(await now.controller.next()).body
                photons = (5, 6, 7) if counted else (NOT_AVAILABLE,) * 3
                assert (port.rx_packets, port.tx_packets, port.rx_dropped) == photons
                others = port.rx_bytes, port.tx_bytes, port.tx_dropped, port.rx_errors
                assert (*others, port.tx_errors) == (NOT_AVAILABLE,) * 5
                entries = [of.flow_entry(of.light(1, 2), Mark(30, 7))]
                now.bridge.says(messages.reply(ofp.OFPMP_FLOW, 5, entries))
                (light,) = of.decoded(await now.controller.next()).body
                assert light.byte_count == NOT_AVAILABLE
                assert light.packet_count == (0 if counted else NOT_AVAILABLE)
                now.optics.readings = Readings(not_measured=frozenset(Quantity))

    play(scene())


def test_photons_are_the_packets_of_light_alone() -> None:
    async def scene() -> None:
        async with stage() as now:
            now.optics.readings = Readings(circuits={7: CircuitReading(99, 0, 0)})
            noted = of.flow_mod({"in_port": 9}, of.outputs(10))
            match, instructions = of.entry_bytes(noted)
            note = Mark(0, 7).encode()
            instructions = of.light_instructions(Mark(0, 7), 10)
            length = flow_reports.STATISTICS.size + len(match) + len(instructions)
            head = flow_reports.STATISTICS.pack(length, 0, 5, 0, 0, 0, 0, 0, 0, 0, 4, 240)
            parts = [of.flow_entry(of.light(1, 2), Mark(30, 7)), head + match + instructions]
            now.bridge.says(messages.reply(ofp.OFPMP_FLOW, 5, parts))
            shown = await now.controller.next()
            light, classical = flow_reports.flow_statistics(shown)
            assert (light.packets, light.fixed[5]) == (99, 30)
            assert (classical.packets, classical.octets) == (4, 240)
            assert note in shown

            now.controller.says(of.flow_request(6, aggregate=True))
            await now.bridge.hears(of.flow_request(6))
            more = messages.reply(ofp.OFPMP_FLOW, 6, parts[:1], more=True)
            now.bridge.says(more, messages.reply(ofp.OFPMP_FLOW, 6, parts[1:]))
            total = of.decoded(await now.controller.next()).body
            assert (total.packet_count, total.byte_count, total.flow_count) == (
                103,
                NOT_AVAILABLE,
                2,
            )

    play(scene())


def test_path_that_has_gone_is_shown_with_its_photons() -> None:
    async def scene() -> None:
        async with stage() as now:
            now.optics.readings = Readings(circuits={7: CircuitReading(99, 0, 0)})
            now.switch.paths.update([path(1, 2, Mark(30, 7))])
            now.reports.waiting.append(path(1, 2, Mark(30, 7), REMOVED))
            unknown = of.flow_removed(of.light(9, 10))
            now.bridge.says(of.flow_removed(of.light(1, 2)), unknown)
            gone = of.decoded(await now.controller.next())
            assert (gone.idle_timeout, gone.packet_count) == (30, 99)
            assert gone.byte_count == NOT_AVAILABLE
            assert gone.reason == ofp.OFPRR_DELETE
            await now.controller.hears(unknown)

    play(scene())


def test_packets_from_a_fibre_are_lldp_alone() -> None:
    async def scene() -> None:
        async with stage() as now:
            lldp, other = of.packet_in(1, of.LLDP), of.packet_in(9, of.PING)
            now.bridge.says(of.packet_in(1, of.PING), lldp, other)
            await now.controller.hears(lldp, other)

    play(scene())


def test_paths_are_told_to_who_asks_for_them() -> None:
    async def scene() -> None:
        async with stage() as now:
            body = messages.EXPERIMENT.pack(optical.EXPERIMENTER, optical.PATH_OPTICS)
            now.controller.says(messages.request(ofp.OFPMP_EXPERIMENTER, 4, body))
            answer = of.decoded(await now.controller.next())
            (others,) = optical.decode_path_optics(bytes(answer.body.data))
            assert (others.in_port, others.loss_mdb, others.rotation) == (optical.ANY_PORT, 500, 1)

    play(scene())


def test_path_that_passes_no_light_is_told_as_such() -> None:
    async def scene() -> None:
        async with stage() as now:
            now.switch.condition_changed(Condition(others=Path(float("inf"))))
            (others,) = now.switch.path_optics()
            assert others.loss_mdb == 0xFFFFFFFF

    play(scene())


def test_error_in_another_version_is_dropped_and_the_connection_stays() -> None:
    async def scene() -> None:
        async with stage() as now:
            now.bridge.says(bytes.fromhex("0101000c00000009 00010002"), ECHO)
            await now.controller.hears(ECHO)

    play(scene())


@pytest.mark.parametrize("failure", [HardwareFault("it burns"), HardwareRefusal("not now")])
def test_hardware_that_cannot_be_read_ends_the_connection(failure: Exception) -> None:
    async def scene() -> None:
        async with stage() as now:
            now.optics.failure = failure
            now.bridge.says(messages.reply(ofp.OFPMP_PORT_STATS, 1, [of.port_statistics(1)]))
            await now.controller.hears_the_end()

    play(scene())


def test_message_of_another_version_is_refused_after_the_hello() -> None:
    async def scene() -> None:
        async with stage() as now:
            older = bytes.fromhex("0414000800000009")  # a BARRIER_REQUEST of OpenFlow 1.3
            now.controller.says(hello(), older, ECHO)
            await now.controller.hears(error(ofp.OFPET_BAD_REQUEST, ofp.OFPBRC_BAD_VERSION, older))
            await now.bridge.hears(hello(), ECHO)

    play(scene())


@pytest.mark.parametrize(
    ("rubbish", "talker"),
    [
        ("0115000800000001", "bridge"),
        ("0515000000000001", "bridge"),
        ("0515000000000001", "controller"),
    ],
)
def test_rubbish_closes_its_connection_alone(rubbish: str, talker: str) -> None:
    async def scene() -> None:
        async with stage() as now:
            other, other_controller = await now.connect()
            getattr(now, talker).says(bytes.fromhex(rubbish))
            await now.bridge.hears_the_end()
            await now.controller.hears_the_end()
            other.says(ECHO)
            await other_controller.hears(ECHO)
            other.writer.close()
            await other_controller.hears_the_end()
            other_controller.writer.close()

    play(scene())


@pytest.mark.parametrize("leaver", ["bridge", "controller"])
def test_end_of_one_side_ends_the_other(leaver: str) -> None:
    async def scene() -> None:
        async with stage() as now:
            getattr(now, leaver).writer.close()
            stayer = now.controller if leaver == "bridge" else now.bridge
            await stayer.hears_the_end()
            while now.switch.connections:
                await asyncio.sleep(0)

    play(scene())


def test_bridge_is_connected_when_the_controller_comes_up() -> None:
    async def scene() -> None:
        port, controller_port = free_port(), free_port()
        async with running_switch() as (switch, *_rest):
            proxy = Proxy(("127.0.0.1", controller_port), switch)
            await proxy.serve(("127.0.0.1", port))
            bridge = End(*await asyncio.open_connection("127.0.0.1", port))
            bridge.says(hello())
            late = Listener()
            await late.start(controller_port)
            controller = await late.connections.get()
            await controller.hears(hello())
            await proxy.close()
            for end in (bridge, controller):
                end.writer.close()
            late.server.close()

    play(scene())


def test_all_pieces_of_what_the_bridge_says_before_the_controller_comes_up_are_kept() -> None:
    pieces = [hello()[:3], hello()[3:] + ECHO[:9], ECHO[9:], of.packet_in(9, of.PING)]
    taken, read = bytearray(), StreamReader.read

    async def counted(self: StreamReader, most: int = -1) -> bytes:
        data = await read(self, most)
        taken.extend(data)
        return data

    async def scene() -> None:
        port, controller_port = free_port(), free_port()
        async with running_switch() as (switch, *_rest):
            proxy = Proxy(("127.0.0.1", controller_port), switch)
            await proxy.serve(("127.0.0.1", port))
            with patch.object(StreamReader, "read", counted):
                bridge = End(*await asyncio.open_connection("127.0.0.1", port))
                for number, piece in enumerate(pieces, 1):
                    bridge.says(piece)
                    while len(taken) < sum(map(len, pieces[:number])):
                        await asyncio.sleep(0)
            late = Listener()
            await late.start(controller_port)
            controller = await late.connections.get()
            await controller.hears(hello(), ECHO, pieces[-1])
            await proxy.close()
            for end in (bridge, controller):
                end.writer.close()
            late.server.close()

    play(scene())


def test_bridge_that_leaves_is_not_connected_later() -> None:
    async def scene() -> None:
        port, controller_port = free_port(), free_port()
        async with running_switch() as (switch, *_rest):
            proxy = Proxy(("127.0.0.1", controller_port), switch)
            await proxy.serve(("127.0.0.1", port))
            bridge = End(*await asyncio.open_connection("127.0.0.1", port))
            bridge.says(hello())
            bridge.writer.write_eof()
            await bridge.hears_the_end()
            bridge.writer.close()
            await proxy.close()

    play(scene())


def test_proxy_that_ends_while_it_connects_leaves_nothing_open() -> None:
    async def scene() -> None:
        async with stage():
            pass

    gc.collect()  # of what tests before it have left
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always", ResourceWarning)
        play(scene())
        gc.collect()
    assert [str(one.message) for one in warned] == []


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
