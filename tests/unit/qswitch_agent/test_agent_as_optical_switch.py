"""The optical switch that an agent makes of its bridge: ports, readings and photons."""

import openflow_messages as of
import pytest
from optical_switch_scene import (
    ECHO,
    path,
)
from os_ken.ofproto import ofproto_v1_4 as ofp
from proxy_scene import play, stage

from qswitch_agent.bridge import NO_PACKETS
from qswitch_agent.hardware.optics import (
    CircuitReading,
    Condition,
    HardwareFault,
    HardwareRefusal,
    Path,
    PortReading,
    Quantity,
    Readings,
)
from qswitch_agent.openflow import flow_reports, identity, messages
from qswitch_agent.openflow.flow_reports import REMOVED
from qswitch_agent.openflow.instructions import Mark
from wire import optical


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
            report = of.decoded(await now.controller.next()).desc
            (optics,) = report.properties
            assert (report.port_no, report.config) == (2, 0)
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


def test_its_one_table_takes_output_actions_alone_by_in_port_and_ethertype() -> None:
    """By hand from OpenFlow 1.4, A.3.5.5.2: kind, length, then ids of four bytes, padded to 8."""
    features = identity.table_features(7).hex()
    for kind, ids in {
        "0000": "0003000400040004",  # WRITE_ACTIONS and APPLY_ACTIONS
        "0002": "",
        "0004": "00000004",  # OUTPUT
        "0006": "00000004",
        "0008": "8000000480000a02",
        "000a": "8000000480000a02",
        "000c": "",
        "000e": "",
    }.items():
        length = 4 + len(ids) // 2
        assert f"{kind}{length:04x}{ids}" + "00" * (-length % 8) in features
