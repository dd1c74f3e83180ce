"""Analysers, memories and sources of a switch: what OpenFlow answers, and who may have them."""

import re
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from agent_scene import (
    DATAPATH,
    PING,
    Operator,
    accepted,
    entries,
    flow_mod,
    light,
    outputs,
    refused,
)
from agent_scene import run as execute
from conftest import nothing_left, wait_until
from fabric_scene import Line, restarted_agent, running
from limits import SOON_S
from os_ken.ofproto import ofproto_v1_4 as ofp
from os_ken.ofproto import ofproto_v1_4_parser as parser
from test_switch_swaps import BOB, require_nothing_left, swapping

from hosts.client import blocking_session
from hosts.stack_socket import QuantumSocketError
from qmn.changes.fault import Failed, Repair, inject
from qmn.running.dispatcher_calls import status
from qmn.running.network import dispatcher_of_running_network
from topologies.chain import ChainTopo
from topologies.networks.network import Network
from wire import optical
from wire.analyser_frames import AnalyserCounts, Emission, MemoryCounts
from wire.parameters.physics import BellAnalyser, Detectors, Emitter, Gates, Memory, PairSource
from wire.parameters.switch import FIRST_INNER_PORT, INNER_PORTS

ALICE, MEMORY, ANALYSER, SOURCE = 2, 61_001, 60_001, 62_001  # ports of q1
PAIRS, SWITCHING_S = 100, 0.5
SLOWER = 5  # seconds here of a second of the network, where light waits for programs
EMISSION = Emission(7, 1, PAIRS, 50_000_000, 193_400_000)
TOP = 0xFF00  # ports of the bridge itself begin there
OUT_PORT = ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_OUT_PORT


# Words of 32 bits, as docs/inner-ports.md has them: kind and input or half, number, parameters.
LINEAR, GATES, HALF, NEVER = (2, 800_000, 950_000, 0, 1000), 10_000, 500_000, (0xFFFFFFFF,) * 2
ANSWERS = {
    "q1": {
        60_001: (1 << 16 | 1, 1, 3, 10**6, 10**6, GATES, 1000, 0, 0),
        60_002: (1 << 16 | 2, 1, 3, 10**6, 10**6, GATES, 1000, 0, 0),
        61_001: (2 << 16, 1, 50, HALF, *NEVER, 0, 10**8, *NEVER),
        62_001: (3 << 16 | 1, 1, 1, 10**6, 970_000, *(10_000,) * 3, 0, 4 * 10**9),
        62_002: (3 << 16 | 2, 1, 1, 10**6, 970_000, *(10_000,) * 3, 0, 4 * 10**9),
    },
    "q2": {
        60_001: (5 << 16 | 1, 1, *LINEAR, 0, 100_000),
        60_002: (5 << 16 | 2, 1, *LINEAR, 0, 100_000),
        61_001: (2 << 16, 1, 4_000_000, 10**6, *NEVER * 3),
        63_001: (4 << 16, 1, 2, 20, HALF, 50_000, 900_000, 0, 5500),
    },
}
NAMES = {
    "q1": ["q1-bell1a", "q1-bell1b", "q1-memory1", "q1-pair1a", "q1-pair1b"],
    "q2": ["q2-bell1a", "q2-bell1b", "q2-memory1", "q2-memory1e"],
}


class Parts(ChainTopo):
    """q1 has parts that store and swap, q2 a station and a memory that emits."""

    def build(self, switches: int = 2, fibers: int = 1, **fiber: Any) -> None:
        """Lay the network."""
        super().build(switches, fibers, **fiber)
        detectors = Detectors(efficiency=0.8, dark_count_hz=100.0)
        emitter = Emitter("single-click", 0.5, fidelity=0.9, modes=20, preparation_s=5.5e-6)
        parts = {
            "q1": {
                "analyser": BellAnalyser("gates"),
                "gates": Gates(two_qubit_depolarizing=0.01),
                "memory": Memory(t2_s=0.1, efficiency=0.5, capacity=50),
                "sources": 1,
                "source": PairSource(fidelity=0.97),
            },
            "q2": {
                "analyser": BellAnalyser("linear", visibility=0.95),
                "detectors": detectors,
                "memory": Memory(kind="emissive"),
                "emitter": emitter,
            },
        }
        for name, more in parts.items():
            self.setNodeInfo(name, {**self.nodeInfo(name), "analysers": 1, "memories": 1, **more})


def session(network: Network, ends: tuple[str, str], port: int, **options: Any) -> dict[str, Any]:
    """Have pairs of two hosts; return what the opener learns."""
    with blocking_session(
        network.runtime.socket, "swap", ends, port, limit_s=60.0, **options
    ) as asked:
        asked.results()
        asked.end()
        return dict(asked.summary)


def test_memories_and_sources_answer_as_openflow_says(tmp_path: Path) -> None:
    with nothing_left(), running(lambda: Line(1), tmp_path) as network, Operator("q1") as operator:
        require_refusals(operator)
        for entry in (light(SOURCE, MEMORY), light(MEMORY, ALICE, priority=1, cookie=7)):
            accepted(operator, entry)
        accepted(operator, packet_out(SOURCE, EMISSION.encode()))
        # Half 0 is stored and leaves for alice at once; half 1 has no entry.
        wait_until(lambda: counts(operator).released == PAIRS, "memory releases the block")
        assert counts(operator) == MemoryCounts(MEMORY, 0, 0, PAIRS, PAIRS, 0, 0)
        accepted(operator, flow_mod(MEMORY, command=ofp.OFPFC_DELETE))
        accepted(operator, cut_off(operator, 500_000_000))
        accepted(operator, packet_out(SOURCE, replace(EMISSION, number=2).encode()))
        wait_until(lambda: counts(operator).cut_off, "memory lets go of the next", 10)
        assert counts(operator) == MemoryCounts(MEMORY, 0, 0, 2 * PAIRS, PAIRS, PAIRS, 0)
        assert status(network).pairs_created == 2 * PAIRS


def test_ports_say_to_which_parts_they_lead(tmp_path: Path) -> None:
    with nothing_left(), running(Parts, tmp_path):
        for name, text in ANSWERS.items():
            with Operator(name) as operator:
                ports = {port.port_no: port.properties for port in described(operator)}
            assert {number for number in ports if FIRST_INNER_PORT <= number < TOP} == {*text}
            for number, words in text.items():
                (part,) = ports[number]
                assert (part.experimenter, part.exp_type) == (0x00514D4E, 1)
                assert tuple(part.data) == words
            skipped = execute("ovs-ofctl", "-O", "OpenFlow14", "dump-ports-desc", name)
            assert re.findall(rf"6[0-3]\d\d\d\(({name}-\w+)\)", skipped) == NAMES[name]


def described(operator: Operator) -> list[Any]:
    operator.send(parser.OFPPortDescStatsRequest(DATAPATH, 0, ofp.OFPP_ANY), 901)
    return list(operator.answer(901).body)


class SlowLine(Line):
    """q1 takes long to open a path."""

    def build(
        self, switches: int = 1, fibers: int = 1, switching_s: float = SWITCHING_S, **line: Any
    ) -> None:
        """Lay it."""
        super().build(switches, fibers, **line)
        self.setNodeInfo("q1", {**self.nodeInfo("q1"), "switching_time_s": switching_s})


def test_a_barrier_is_answered_when_inner_paths_pass_and_outcomes_are_counted(
    tmp_path: Path,
) -> None:
    """Ideal pairs are in Phi+: each that comes to both inputs of an analyser is measured so."""
    with nothing_left(), running(SlowLine, tmp_path), Operator("q1") as operator:
        began_s = time.monotonic()
        for half, port in enumerate((ANALYSER, ANALYSER + 1)):
            operator.send(light(SOURCE + half, port), 700 + half)
        operator.send(parser.OFPBarrierRequest(DATAPATH), 702)
        assert isinstance(operator.answer(702), parser.OFPBarrierReply)
        assert time.monotonic() - began_s >= SWITCHING_S
        accepted(operator, packet_out(SOURCE, EMISSION.encode()))
        wait_until(lambda: operator.analysers()[0].pulses, "all have met")
        assert operator.analysers() == [AnalyserCounts(ANALYSER, PAIRS, phi_plus=PAIRS)]


def test_an_agent_that_starts_again_finds_ports_entries_counts_and_light_as_they_were(
    tmp_path: Path,
) -> None:
    """One half waits in a memory, the other at the analyser; an entry has them meet afterwards."""
    line = partial(SlowLine, switching_s=SWITCHING_S / SLOWER)
    with nothing_left(), running(line, tmp_path, time_scale=SLOWER) as network:
        with Operator("q1") as operator:
            accepted(operator, cut_off(operator, 3_000_000_000))
            for half, port in enumerate((ANALYSER, ANALYSER + 1)):
                accepted(operator, light(SOURCE + half, port, cookie=7))
            accepted(operator, packet_out(SOURCE, EMISSION.encode()))
            wait_until(lambda: operator.analysers()[0].pulses, "all have met")
            accepted(operator, light(SOURCE, MEMORY, cookie=8, priority=0xFFFF))
            accepted(operator, packet_out(SOURCE, replace(EMISSION, number=2).encode()))
            wait_until(lambda: counts(operator).held, "the next are stored")
            before = seen(operator)
        with restarted_agent(network, "q1"):
            pass
        with Operator("q1") as operator:
            assert seen(operator) == before
            began_s = time.monotonic()
            accepted(operator, light(MEMORY, ANALYSER))
            assert time.monotonic() - began_s >= SWITCHING_S
            wait_until(lambda: operator.analysers()[0].pulses > PAIRS, "these have met, too")
            met = AnalyserCounts(ANALYSER, 2 * PAIRS, phi_plus=2 * PAIRS)
            assert operator.analysers() == [met]
            assert counts(operator) == MemoryCounts(MEMORY, 0, 0, PAIRS, PAIRS, 0, 0)
        require_nothing_left(network)


def seen(operator: Operator) -> list[Any]:
    """Return what a controller sees of inner ports: entries, descriptions and all counts."""
    ports = {each.port_no: each.to_jsondict() for each in described(operator)}
    operator.send(parser.OFPPortStatsRequest(DATAPATH, 0, ofp.OFPP_ANY), 902)
    sent = {each.port_no: each.tx_packets for each in operator.answer(902).body}
    stood = [
        (each.match["in_port"], each.priority, each.cookie, each.packet_count, each.instructions)
        for each in entries(operator)
        if each.match.get("in_port") in ports and each.match["in_port"] in INNER_PORTS
    ]
    held = [replace(each, oldest_ns=0) for each in operator.memories()]
    inner = [(port, ports[port], sent[port]) for port in sorted(ports) if port in INNER_PORTS]
    return [operator.analysers(), held, inner, sorted(map(str, stood))]


def test_inner_ports_that_are_set_down_or_fail_are_announced(tmp_path: Path) -> None:
    with (
        nothing_left(),
        running(lambda: Line(1), tmp_path),
        Operator("q1") as operator,
        Operator("q1") as other,
    ):
        other.socket.settimeout(20)
        wanted = {ofp.OFPACPT_PORT_STATUS_MASTER: 7, ofp.OFPACPT_PACKET_IN_MASTER: 0}
        masks = [parser.OFPAsyncConfigPropReasons(kind, 8, mask) for kind, mask in wanted.items()]
        accepted(other, parser.OFPSetAsync(DATAPATH, masks))
        accepted(operator, light(SOURCE, MEMORY))
        for number, down in enumerate((ofp.OFPPC_PORT_DOWN, 0), 1):
            accepted(operator, port_mod(operator, down))
            ((port, part),) = statuses(other, 1).items()
            assert (port, part.config & ofp.OFPPC_PORT_DOWN) == (MEMORY, down)
            assert part.properties[0].data[:2] == [2 << 16, 1]
            accepted(operator, packet_out(SOURCE, replace(EMISSION, number=number).encode()))
        wait_until(lambda: counts(operator).stored, "the second block is stored")
        assert counts(operator).stored == PAIRS  # and the first was not
        require_failed_analyser(operator, other)


def require_failed_analyser(operator: Operator, other: Operator) -> None:
    """Fail unless an analyser that fails has no link, and counts light that comes to it."""
    config = dispatcher_of_running_network()
    for fault, down in ((Failed(ANALYSER), ofp.OFPPS_LINK_DOWN), (Repair(), 0)):
        inject(config, "q1", fault)
        seen = statuses(other, 2)
        states = {port: each.state & ofp.OFPPS_LINK_DOWN for port, each in seen.items()}
        assert states == dict.fromkeys((ANALYSER, ANALYSER + 1), down)
        if down:
            accepted(operator, light(SOURCE, ANALYSER))
            accepted(operator, packet_out(SOURCE, replace(EMISSION, number=3).encode()))
            wait_until(lambda: operator.analysers()[0].failed, "light came in vain")
    assert operator.analysers() == [AnalyserCounts(ANALYSER, failed=1)]


def statuses(operator: Operator, count: int) -> dict[int, Any]:
    """Return the ports that `count` messages describe; fail if another message comes."""
    messages = [operator.next() for _ in range(count)]
    assert {type(each) for each in messages} == {parser.OFPPortStatus}, messages
    assert operator.silent()
    return {each.desc.port_no: each.desc for each in messages}


def port_mod(operator: Operator, config: int) -> object:
    address = next(each.hw_addr for each in described(operator) if each.port_no == MEMORY)
    return parser.OFPPortMod(DATAPATH, MEMORY, address, config, ofp.OFPPC_PORT_DOWN, [])


def counts(operator: Operator) -> MemoryCounts:
    return operator.memories()[0]


def packet_out(port: int, frame: bytes) -> object:
    out = [parser.OFPActionOutput(port)]
    return parser.OFPPacketOut(DATAPATH, ofp.OFP_NO_BUFFER, ofp.OFPP_CONTROLLER, out, frame)


def cut_off(operator: Operator, nanoseconds: int) -> object:
    """Return the PORT_MOD of a memory; the framework takes data of properties by 32 bits."""
    (port,) = [each for each in described(operator) if each.port_no == MEMORY]
    limit = parser.OFPPortModPropExperimenter(
        type_=ofp.OFPPMPT_EXPERIMENTER,
        experimenter=optical.EXPERIMENTER,
        exp_type=2,
        data=list(divmod(nanoseconds, 1 << 32)),
    )
    return parser.OFPPortMod(DATAPATH, MEMORY, port.hw_addr, 0, 0, [limit])


def require_refusals(operator: Operator) -> None:
    """Fail unless what inner ports cannot do is an error of OpenFlow's own."""
    assert refused(operator, light(ALICE, SOURCE)) == OUT_PORT
    assert refused(operator, flow_mod(1, outputs(MEMORY))) == OUT_PORT
    assert refused(operator, packet_out(MEMORY, PING)) == OUT_PORT
    assert refused(operator, packet_out(SOURCE, PING))[0] == ofp.OFPET_BAD_REQUEST
    headers = flow_mod(MEMORY, outputs(ANALYSER), fields={"eth_type": 0x0800})
    assert refused(operator, headers) == (ofp.OFPET_BAD_MATCH, ofp.OFPBMC_BAD_FIELD)


def test_who_lacks_an_analyser_is_refused_and_who_has_it_goes_on(chain_network: Network) -> None:
    network, before = chain_network, status(chain_network).pairs_created
    with ThreadPoolExecutor(1) as threads:
        asked = {"count": 60_000, "block_pairs": 1000, "sample": 0.1, "swaps": 2}
        first = threads.submit(session, network, ("alice", "bob"), 9, **asked)
        wait_until(lambda: status(network).pairs_created > before + 5000, "it goes on", 20)
        with pytest.raises(QuantumSocketError, match="another session uses"):
            session(network, ("charlie", "dave"), 10, count=PAIRS, swaps=1)
        assert not first.done()
        figures = first.result(SOON_S)
    assert (figures["pairs"], figures["fidelity"]) == (60_000, 1)
    require_nothing_left(network)
    assert session(network, ("charlie", "dave"), 10, count=PAIRS, swaps=1)["pairs"] == PAIRS
    require_nothing_left(network)


def test_two_sessions_that_entries_lead_to_one_analyser_are_told_apart(tmp_path: Path) -> None:
    """By entries of nobody's session; which of the two ends is by chance."""
    with swapping(tmp_path) as (network, curl):
        with ThreadPoolExecutor(2) as threads:
            asked = {"block_pairs": 1000, "sample": 0.1}
            ends, shorter = ("alice", "bob"), {"count": 60_000, **asked}
            long = threads.submit(session, network, ends, 9, count=1_000_000, **asked)
            wait_until(lambda: status(network).pairs_created > 4000, "it goes on", 20)
            errors = [threads.submit(session, network, ends, 10, **shorter).exception(60)]
            curl("flowentry/delete", {"match": {"in_port": BOB}})
            errors.append(long.exception(60))
        assert any("heard of other blocks at analysers" in str(error) for error in errors), errors
        require_nothing_left(network)
