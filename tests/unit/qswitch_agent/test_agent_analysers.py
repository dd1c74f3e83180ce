"""Outcomes of a switch's analysers are sent by the entries of their port; counts are read."""

import struct
from dataclasses import replace
from typing import Any

import openflow_messages as of
from openflow_messages import FIBERS, port
from os_ken.ofproto import ofproto_v1_4 as ofp
from os_ken.ofproto import ofproto_v1_4_parser as parser
from proxy_scene import CONDITION, play, stage

from qswitch_agent.hardware.optics import Readings
from qswitch_agent.inner_ports import InnerPorts
from qswitch_agent.middleware.flow_table import FlowTable
from qswitch_agent.openflow import messages, packets
from qswitch_agent.openflow.messages import Framer
from wire import optical
from wire.analyser_frames import (
    BROADCAST,
    MOST_OUTCOMES,
    AnalyserCounts,
    AnalyserFrame,
    Emission,
    End,
    frames_of,
)
from wire.parameters.switch import inner_ports
from wire.part_descriptions import NEVER_NS

OUTCOMES = bytes([0, 1, 2, 3, 255, 255])
REPORT = AnalyserFrame(60_003, 1, End.MEASURED, 6, 0, OUTCOMES)


def test_a_report_is_a_frame_of_the_analysers_own_port() -> None:
    sent: list[tuple[int, bytes]] = []
    analysers = InnerPorts(inner_ports(2), lambda number, frame: sent.append((number, frame)))
    described = replace(port(60_003), address=b"\2\0\0\0\0\7")
    analysers.update([described])
    analysers.report(REPORT)
    ((number, frame),) = sent
    assert (number, frame[:12].hex()) == (60_003, "ffffffffffff020000000007")
    assert AnalyserFrame.decode(frame) == REPORT


def test_the_bridge_gets_it_as_a_packet_of_that_port_for_its_table() -> None:
    (message,) = Framer().feed(packets.by_the_table(60_003, of.PING, 5))
    packet = packets.PacketOut.decode(message)
    assert (packet.in_port, packet.outputs, packet.frame) == (60_003, [ofp.OFPP_TABLE], of.PING)


def test_counts_are_told_to_who_asks_for_them() -> None:
    async def scene() -> None:
        async with stage() as now:
            counts = [AnalyserCounts(60_001, closed=1), AnalyserCounts(60_003, 6, 1, 1, 1, 1, 2)]
            now.optics.readings = Readings(analysers=counts)
            body = messages.EXPERIMENT.pack(optical.EXPERIMENTER, optical.ANALYSER_COUNTS)
            now.controller.says(messages.request(ofp.OFPMP_EXPERIMENTER, 4, body))
            answer = of.decoded(await now.controller.next())
            assert answer.body.exp_type == optical.ANALYSER_COUNTS
            assert bytes(answer.body.data) == b"".join(each.encode() for each in counts)

    play(scene())


def order_of_ours(source: int, emission: Emission) -> bytes:
    head = messages.EXPERIMENT.pack(optical.EXPERIMENTER, optical.EMISSION)
    body = head + source.to_bytes(4) + emission.encode()
    return messages.encode(ofp.OFPT_EXPERIMENTER, 5, body)


def test_a_frame_into_a_source_has_it_emit() -> None:
    emission = Emission(7, 1, 100, 50_000_000, 193_400_000)

    async def scene() -> None:
        async with stage() as now:
            now.switch.paths.table = FlowTable(FIBERS, [62_001, 62_002, 63_001])
            now.controller.says(of.packet_out(emission.encode(), 62_002))
            now.controller.says(order_of_ours(62_001, emission))
            now.controller.says(of.packet_out(emission.encode(), 63_001))  # a memory that emits
            for wrong in (
                of.packet_out(of.PING, 62_001),
                of.packet_out(emission.encode(), 62_001, 1),
                order_of_ours(60_001, emission),
            ):
                now.controller.says(wrong)
                assert isinstance(of.decoded(await now.controller.next()), parser.OFPErrorMsg)
            emitted = [(port, emission) for port in (62_002, 62_001, 63_001)]
            assert now.optics.emitted == emitted

    play(scene())


def test_a_frame_into_a_memory_names_or_purifies_its_pulses_and_others_are_refused() -> None:
    herald = AnalyserFrame(61_001, 3, End.STORED, 2, 0, bytes([0, 255]))
    frame = herald.encode(BROADCAST, bytes(6))
    outcomes = replace(herald, end=End.MEASURED).encode(BROADCAST, bytes(6))
    round_ = replace(herald, end=End.PURIFY, method=4)
    of_hosts = replace(round_, method=0).encode(BROADCAST, bytes(6))
    answer = replace(herald, end=End.PURIFIED).encode(BROADCAST, bytes(6))

    async def scene() -> None:
        async with stage() as now:
            now.switch.inner = frozenset(inner_ports(1, 2))
            now.controller.says(of.packet_out(frame, 61_002))
            now.controller.says(of.packet_out(round_.encode(BROADCAST, bytes(6)), 61_002))
            for wrong in (
                of.packet_out(of_hosts, 61_002),
                of.packet_out(answer, 61_002),
                of.packet_out(frame, 60_001),
                of.packet_out(outcomes, 61_002),
                of.packet_out(frame, 61_002, 1),
                of.packet_out(frame[:-1] + b"\1", 61_002),
            ):
                now.controller.says(wrong)
                assert isinstance(of.decoded(await now.controller.next()), parser.OFPErrorMsg)
            assert now.optics.chosen == [replace(each, port=61_002) for each in (herald, round_)]

    play(scene())


def test_the_frames_of_a_block_have_the_hardware_name_its_pulses_at_once() -> None:
    whole = AnalyserFrame(61_002, 3, End.STORED, 2 * MOST_OUTCOMES, 0, bytes(2 * MOST_OUTCOMES))
    first, last = (each.encode(BROADCAST, bytes(6)) for each in frames_of(whole))

    async def scene() -> None:
        async with stage() as now:
            now.switch.inner = frozenset(inner_ports(1, 2))
            now.controller.says(of.packet_out(last, 61_002))
            assert isinstance(of.decoded(await now.controller.next()), parser.OFPErrorMsg)
            for frame, port in ((first, 61_001), (first, 61_002), (last, 61_002)):
                now.controller.says(of.packet_out(frame, port))
            now.controller.says(of.packet_out(last, 60_001))
            assert isinstance(of.decoded(await now.controller.next()), parser.OFPErrorMsg)
            assert now.optics.chosen == [whole]

    play(scene())


def test_a_part_that_fails_is_a_port_without_light_and_is_announced() -> None:
    async def scene() -> None:
        async with stage() as now:
            inner, announced = inner_ports(1), list[int]()
            parts = InnerPorts(inner, print, announced=lambda one: announced.append(one.number))
            now.switch.inner_ports, now.switch.inner = parts, frozenset(inner)
            parts.update([port(60_001), port(60_002)])
            now.switch.condition_changed(replace(CONDITION, failed=frozenset({60_001})))
            assert announced == [60_001]
            shown = [now.switch.shown(port(number, state=ofp.OFPPS_LIVE)) for number in inner]
            assert [each.state for each in shown] == [ofp.OFPPS_LINK_DOWN, ofp.OFPPS_LIVE]

    play(scene())


def test_a_memory_is_described_as_it_was_adjusted() -> None:
    """Words of 64 bits behind kind, number, modes and efficiency: T1, T2 and cut-off in ns."""

    async def scene() -> None:
        async with stage() as now:
            inner = inner_ports(0, 1)
            now.switch.inner_ports = InnerPorts(inner, print)
            now.switch.inner = frozenset(inner)
            for memory, cutoffs_s, wanted in (
                ({}, {}, (NEVER_NS, NEVER_NS)),
                ({"t2_s": 0.5, "cutoff_s": 2.0}, {}, (5 * 10**8, 2 * 10**9)),
                ({"t2_s": 0.5, "cutoff_s": 2.0}, {61_001: 3.0}, (5 * 10**8, 3 * 10**9)),
            ):
                condition = replace(CONDITION, memory=memory, cutoffs_s=cutoffs_s)
                now.switch.condition_changed(condition)
                properties = now.switch.shown(port(61_001)).properties
                assert struct.unpack("!QQ", properties[36:52]) == wanted

    play(scene())


def test_a_port_mod_sets_the_cut_off_of_a_memory_and_of_nothing_else() -> None:
    async def scene() -> None:
        async with stage() as now:
            now.switch.inner, now.switch.ports = frozenset(inner_ports(1, 1)), {1, 60_001, 61_001}
            for number, cutoff_ns in ((1, 5), (60_001, 5), (61_001, 0)):
                now.controller.says(of.port_mod(number, cut_off(cutoff_ns)))
                error = of.decoded(await now.controller.next())
                assert error.type == ofp.OFPET_BAD_PROPERTY
            now.controller.says(of.port_mod(61_001, cut_off(5_000_000)))
            await now.bridge.hears(of.port_mod(61_001))
            question = await now.bridge.next()  # whether it has taken that
            now.bridge.says(of.barrier_reply(messages.transaction_id(question)))
            now.controller.says(messages.encode(ofp.OFPT_ECHO_REQUEST, 9))
            await now.bridge.next()
            assert now.optics.cutoffs_s == {61_001: 0.005}

    play(scene())


def cut_off(nanoseconds: int) -> Any:
    """Return the property; the framework takes its data by words of 32 bits."""
    return parser.OFPPortModPropExperimenter(
        type_=ofp.OFPPMPT_EXPERIMENTER,
        experimenter=optical.EXPERIMENTER,
        exp_type=2,
        data=list(divmod(nanoseconds, 1 << 32)),
    )
