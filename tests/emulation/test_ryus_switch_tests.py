"""Ryu's 1,003 OpenFlow 1.4 switch tests, as os-ken's package has them and its tester reads them.

On copper ports a quantum switch answers as plain Open vSwitch does, to requests and to packets; on
fibres, light does what it can and refuses the rest. Tests of throughput, which take half a minute
each, send no packets here.
"""

import json
import logging
import socket
import struct
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from agent_scene import (
    BRIDGE,
    DATAPATH,
    DEADLINE_S,
    FIBER_PORTS,
    Controller,
    actions,
    ask,
    needs_open_vswitch,
    running_switch,
)
from copper_scene import PLAIN, copper, far_end, plain_open_vswitch
from os_ken.ofproto import ofproto_v1_4 as ofp
from os_ken.ofproto import ofproto_v1_4_parser as parser
from os_ken.tests.switch import tester

pytestmark = needs_open_vswitch
IN, OUT, OTHER = 1, 2, 3  # the ports that the tests name
FIBERS = (11, 12, 13, 14)
ETH_P_ALL = 0x0003
PACKET_AUXDATA, VLAN_VALID = 8, 1 << 4
AUXDATA = struct.Struct("=IIIHHHH")  # struct tpacket_auxdata of the kernel
IPV6_GROUP = bytes.fromhex("3333")  # what interfaces say of themselves goes there
TRIES = 3  # of packets, which may be lost
LAST = bytes.fromhex("02000000fefe 02000000feff 88b5") + bytes(46)  # behind it nothing comes
MARK = 1 << 63  # cookie of the entry that brings it


def ryus_tests() -> Iterator[tuple[str, Any]]:
    """Yield each test by its name."""
    tester.OfTester.target_ver = tester.OfTester.tester_ver = ofp.OFP_VERSION
    folder = Path(tester.__file__).parent / "of14"
    files = tester.TestPatterns(str(folder), logging.getLogger(__name__))
    for name, file in sorted(files.items()):
        for number, test in enumerate(file.tests):
            yield f"{name} {number}: {test.description}", test


def clearing() -> list[Any]:
    """Return what empties a switch: meters, groups, entries."""
    return [
        parser.OFPMeterMod(DATAPATH, ofp.OFPMC_DELETE, 0, ofp.OFPM_ALL),
        parser.OFPGroupMod(DATAPATH, ofp.OFPGC_DELETE, 0, ofp.OFPG_ALL),
        parser.OFPFlowMod(
            DATAPATH,
            cookie_mask=MARK,  # all but the one with this mark
            table_id=ofp.OFPTT_ALL,
            command=ofp.OFPFC_DELETE,
            out_port=ofp.OFPP_ANY,
            out_group=ofp.OFPG_ANY,
        ),
    ]


def packets(test: Any) -> list[bytes]:
    return [one["ingress"] for one in test.tests if "ingress" in one]


def forget_packets() -> None:
    """Have Open vSwitch forget how it has treated packets, which it keeps for half a second."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as daemon:
        daemon.settimeout(DEADLINE_S)
        pid = Path("/var/run/openvswitch/ovs-vswitchd.pid").read_text().strip()
        daemon.connect(f"/var/run/openvswitch/ovs-vswitchd.{pid}.ctl")
        daemon.sendall(json.dumps({"id": 0, "method": "revalidator/purge", "params": []}).encode())
        assert json.loads(daemon.recv(65536))["error"] is None


def asked(controller: Controller, message: Any) -> tuple[int, int] | None:
    """Return the error that answers a message, if any."""
    message.xid = None
    answer = ask(controller, message, 500)
    return (answer.type, answer.code) if isinstance(answer, parser.OFPErrorMsg) else None


def replies(controller: Controller, request: Any, hidden: int | None = None) -> list[str]:
    """Return a multipart reply in words, but for how old, and how much used, entries are."""
    controller.send(request, 700)
    lines = []
    more = True
    while more:
        reply = controller.answer(700)
        more = bool(reply.flags & ofp.OFPMPF_REPLY_MORE)
        for one in reply.body:
            kept = one.to_jsondict()[type(one).__name__]
            for aged in ("duration_sec", "duration_nsec", "byte_count", "packet_count"):
                kept.pop(aged, None)
            lines += [str(kept)] if hidden is None or one.cookie != hidden else []
    return sorted(lines)


class Bench:
    """A switch with its controller, and the far ends of its copper ports."""

    def __init__(self, bridge: str, controller: Controller, stack: ExitStack) -> None:
        self._controller = controller
        self._ends = {
            port: stack.enter_context(listening(bridge, port)) for port in (IN, OUT, OTHER)
        }
        self._bring_last()

    def _bring_last(self) -> None:
        last = actions(
            *(parser.OFPActionOutput(port) for port in (OUT, OTHER, ofp.OFPP_CONTROLLER))
        )
        match = parser.OFPMatch(eth_src="02:00:00:00:fe:ff", eth_type=0x88B5)
        entry = parser.OFPFlowMod(
            DATAPATH, cookie=MARK, priority=0xFFFF, match=match, instructions=[last]
        )
        assert asked(self._controller, entry) is None

    def set_up(self, test: Any) -> dict[str, object]:
        """Send what a test wants to be there; return what the switch says, and has then."""
        for message in clearing():
            assert asked(self._controller, message) is None
        answers = [asked(self._controller, message) for message in test.prerequisite]
        every = ofp.OFPTT_ALL, ofp.OFPP_ANY, ofp.OFPG_ANY, 0, 0, parser.OFPMatch()
        entries = parser.OFPFlowStatsRequest(DATAPATH, 0, *every)
        return {
            "answers": answers,
            "entries": replies(self._controller, entries, MARK),
            "groups": replies(self._controller, parser.OFPGroupDescStatsRequest(DATAPATH, 0)),
            "meters": replies(self._controller, parser.OFPMeterConfigStatsRequest(DATAPATH, 0)),
        }

    def sent(self, test: Any) -> list[dict[str, list[object]]]:
        """Send a test's packets; return where each came out."""
        return [self._sent(packet) for packet in packets(test)]

    def _sent(self, packet: bytes) -> dict[str, list[object]]:
        """Send a packet, and one that shows that all has come; return where the first came out."""
        for each in (packet, LAST):
            self._ends[IN].send(each)
        came: dict[str, list[object]] = {"controller": self._packets_in()}
        for port in (OUT, OTHER):
            came[f"port {port}"] = self._received(self._ends[port])
        return came

    def _packets_in(self) -> list[object]:
        found: list[object] = []
        while True:
            message = self._controller.next()
            if not isinstance(message, parser.OFPPacketIn):
                continue
            if message.data == LAST:
                return found
            if message.data[:2] != IPV6_GROUP:
                where = message.match["in_port"], message.table_id
                found.append((message.reason, *where, message.cookie, message.data.hex()))

    def _received(self, end: socket.socket) -> list[object]:
        found: list[object] = []
        while (frame := read(end)) != LAST:
            if frame and frame[:2] != IPV6_GROUP:
                found.append(frame.hex())
        return found


def listening(bridge: str, port: int) -> socket.socket:
    """Return a socket at the far end of a port."""
    end = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ETH_P_ALL))
    end.bind((far_end(bridge, port), ETH_P_ALL))
    end.settimeout(DEADLINE_S)
    end.setsockopt(263, PACKET_AUXDATA, 1)  # SOL_PACKET
    return end


def read(end: socket.socket) -> bytes:
    """Return the next frame with its VLAN tag, which the kernel keeps beside it; b"" if sent."""
    frame, extra, _flags, address = end.recvmsg(65536, socket.CMSG_SPACE(AUXDATA.size))
    if address[2] == socket.PACKET_OUTGOING:
        return b""
    for _level, _kind, data in extra:
        status, _length, _captured, _mac, _net, tag, kind = AUXDATA.unpack(data[: AUXDATA.size])
        if status & VLAN_VALID:
            frame = frame[:12] + struct.pack("!HH", kind or 0x8100, tag) + frame[12:]
    return frame


@pytest.mark.nightly
@pytest.mark.waits
@pytest.mark.timeout(600)
def test_copper_does_what_open_vswitch_does(tmp_path: Path) -> None:
    differing, seen, passed = {}, 0, 0
    with (
        running_switch(tmp_path, fiber_ports=FIBERS) as switch,
        plain_open_vswitch() as plain,
        copper((IN, OUT, OTHER), BRIDGE, PLAIN),
        ExitStack() as stack,
    ):
        ours, theirs = Bench(BRIDGE, switch.controller, stack), Bench(PLAIN, plain, stack)
        for name, test in ryus_tests():
            seen += 1
            one, other = ours.set_up(test), theirs.set_up(test)
            for _attempt in range(TRIES):
                forget_packets()
                one["packets"], other["packets"] = ours.sent(test), theirs.sent(test)
                if one["packets"] == other["packets"]:
                    break
            passed += as_the_test_wants(test, other)
            if one != other:
                differing[name] = {
                    key: (one[key], other[key]) for key in one if one[key] != other[key]
                }
    assert differing == {}
    assert (seen, passed > 500) == (1003, True), passed


def as_the_test_wants(test: Any, outcome: dict[str, Any]) -> bool:
    """Whether nothing was refused, and each packet came out where the test says, as it says."""
    wanted = [one for one in test.tests if "ingress" in one]
    return not any(outcome["answers"]) and all(
        packets["port 2"] == ([one["egress"].hex()] if "egress" in one else [])
        and bool(packets["controller"]) == ("PACKET_IN" in one)
        for one, packets in zip(wanted, outcome["packets"], strict=True)
    )


Error = tuple[int, int]
FLOWING = ofp.OFPIT_APPLY_ACTIONS, ofp.OFPIT_WRITE_ACTIONS
TO_NO_PORT = ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_OUT_PORT


def reasons(message: Any) -> set[Error | None]:
    """Return why a switch of light alone refuses a message: what docs/openflow.md says.

    Nothing: it concerns packets alone, of which none comes, or it is what light can do.
    """
    if isinstance(message, parser.OFPGroupMod):
        return {(ofp.OFPET_GROUP_MOD_FAILED, ofp.OFPGMFC_OUT_OF_GROUPS)}
    if isinstance(message, parser.OFPMeterMod):
        return {(ofp.OFPET_METER_MOD_FAILED, ofp.OFPMMFC_OUT_OF_METERS)}
    found = set[Error | None]()
    if message.table_id:
        found.add((ofp.OFPET_FLOW_MOD_FAILED, ofp.OFPFMFC_BAD_TABLE_ID))
    kinds = {instruction.type for instruction in message.instructions}
    if ofp.OFPIT_GOTO_TABLE in kinds:
        found.add((ofp.OFPET_BAD_INSTRUCTION, ofp.OFPBIC_UNSUP_INST))
    fields, done = dict(message.match.items()), actions_of(message)
    outputs = {action.port for action in done if action.type == ofp.OFPAT_OUTPUT}
    if "in_port" not in fields:
        return found | ({TO_NO_PORT} if outputs & set(FIBER_PORTS) else set())
    if set(fields) != {"in_port"}:
        found.add((ofp.OFPET_BAD_MATCH, ofp.OFPBMC_BAD_FIELD))
    if not kinds <= set(FLOWING):
        found.add((ofp.OFPET_BAD_INSTRUCTION, ofp.OFPBIC_UNSUP_INST))
    others = {action.type for action in done} - {ofp.OFPAT_OUTPUT}
    if ofp.OFPAT_GROUP in others:
        found.add((ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_OUT_GROUP))
    if others - {ofp.OFPAT_GROUP}:
        found.add((ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_TYPE))
    if not outputs <= set(FIBER_PORTS) - {fields["in_port"]}:
        found.add(TO_NO_PORT)
    if len(outputs) > 1:
        found.add((ofp.OFPET_BAD_ACTION, ofp.OFPBAC_TOO_MANY))
    return found


def actions_of(message: Any) -> list[Any]:
    listed = [each for each in message.instructions if each.type in FLOWING]
    return [action for instruction in listed for action in instruction.actions]


@pytest.mark.timeout(600)
def test_light_does_what_it_can_and_refuses_the_rest_of_them(tmp_path: Path) -> None:
    wrong, lit, counts = list[object](), 0, Counter[str]()
    with (
        running_switch(tmp_path) as switch,
        plain_open_vswitch() as plain,
        copper((IN, OUT, OTHER), PLAIN),
    ):
        for name, test in ryus_tests():
            for controller in (switch.controller, plain):
                for message in clearing():
                    assert asked(controller, message) is None, name  # nothing to delete is no fault
            for message in test.prerequisite:
                answer, as_packets = asked(switch.controller, message), asked(plain, message)
                legitimate = reasons(message) or {as_packets}
                wrong += [(name, answer, legitimate)] if answer not in legitimate else []
                counts["refused" if answer else "taken"] += 1
            (first, *more) = test.prerequisite
            if not more and not reasons(first) and "in_port" in first.match:
                switch.connects((IN, OUT))
                lit += 1
        assert wrong == []
    assert lit == 3  # `in_port=1,actions=output:2`, for three kinds of packets: light has none
    assert min(counts.values()) > 100, counts
