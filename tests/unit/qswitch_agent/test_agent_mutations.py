"""10,000 spoiled OpenFlow messages from either side neither stop the agent nor open a path."""

import asyncio
import gc
import struct
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from random import Random
from typing import Any

import openflow_messages as of
import pytest
from mutations import replies, requests, spoiled
from openflow_messages import FIBERS
from os_ken.ofproto import ofproto_v1_4 as ofp
from proxy_scene import End, Stage, play, stage

from qswitch_agent.middleware.flow_table import FlowTable
from qswitch_agent.openflow import (
    flow_reports,
    flows,
    instructions,
    matches,
    messages,
    packets,
    ports,
)
from qswitch_agent.openflow.flow_reports import ADDED, FlowRemoved, FlowUpdate
from qswitch_agent.openflow.flows import FlowEntry, FlowMod
from qswitch_agent.openflow.messages import HEADER, transaction_id
from qswitch_agent.openflow.packets import PacketOut
from qswitch_agent.openflow.ports import PortMod
from qswitch_agent.openflow.refusals import Refusal
from qswitch_agent.proxy.checks import is_light
from wire.malformed import MalformedPacket

COUNT = 10_000
THROUGH_THE_AGENT = pytest.mark.parametrize(
    "count", [2_000, pytest.param(4_000, marks=pytest.mark.nightly)]
)
ROUND = 20  # messages of a controller on one connection
FEW = 5  # of a bridge, whose first malformed one ends the connection
FLOW_MOD = struct.Struct("!QQBBHHHIIIHH")  # as in the specification, 7.3.4.2


def judged(message: bytes) -> None:
    mod = FlowMod.decode(message)
    reports = [mod]
    if is_light(mod, FlowTable(FIBERS)):
        table = FlowTable(FIBERS)
        for fibers in ((1, 2), (3, 4)):
            table.change(of.mod({"in_port": fibers[0]}, of.outputs(fibers[1])))
        reports = table.change(mod)
        plan_is_sound(table)
    for one in reports:
        again = FlowMod.decode(one.encode(1))
        assert (again.fields, again.instructions) == (one.fields, one.instructions)


def port_modded(message: bytes) -> None:
    mod = PortMod.decode(message)
    assert PortMod.decode(mod.encode(1)).config == mod.config


def membered(message: bytes) -> None:
    _bundle, member = packets.bundle_member(message)
    assert packets.bundle_member(packets.with_member(message, member))[1] == member


def ports_shown(message: bytes) -> None:
    described = ports.described_ports(message)
    assert ports.described_ports(ports.with_ports(message, described)) == described


def counted(message: bytes) -> None:
    statistics = ports.port_statistics(message)
    parts = [one.shown((1, 2, 3), b"").encode() for one in statistics]
    messages.rebuilt(message, parts)


def flows_shown(message: bytes) -> None:
    for one in flow_reports.flow_statistics(message):
        if mark := one.entry.mark:
            assert not one.shown(mark, 7).instructions.mark


def plan_is_sound(table: FlowTable) -> None:
    paths = table.plan().cross_connects
    assert all(path.in_port != path.out_port for path in paths)
    assert all(FIBERS.issuperset(path[:2]) for path in paths)
    assert len({path.out_port for path in paths}) == len(paths)
    assert len({path.in_port for path in paths}) == len(paths)


def updated(message: bytes) -> None:
    table = FlowTable(FIBERS)
    for update in flow_reports.flow_updates(message):
        table.apply(update)
        plan_is_sound(table)
    assert not any(update.entry and update.entry.mark for update in shown_updates(message))


def shown_updates(message: bytes) -> list[FlowUpdate]:
    shown = flow_reports.monitor_shown(message, lambda *_entry: (instructions.Mark(3, 4), False))
    return flow_reports.flow_updates(shown)


def removed(message: bytes) -> None:
    gone = FlowRemoved.decode(message)
    assert FlowRemoved.decode(gone.shown(message, instructions.Mark(3, 4), 5, 0)).key == gone.key


def packet(message: bytes) -> None:
    _port, frame = packets.packet_in(message)
    packets.is_lldp(frame)


def multipart_asked(message: bytes) -> None:
    messages.asked_of_us(message)
    messages.more_follows(message)


Reader = Callable[[bytes], object]
OF_CONTROLLER: dict[int, list[Reader]] = {
    ofp.OFPT_FLOW_MOD: [judged],
    ofp.OFPT_PORT_MOD: [port_modded],
    ofp.OFPT_GROUP_MOD: [packets.group_outputs],
    ofp.OFPT_PACKET_OUT: [lambda message: PacketOut.decode(message).outputs],
    ofp.OFPT_BUNDLE_CONTROL: [packets.bundle_control],
    ofp.OFPT_BUNDLE_ADD_MESSAGE: [membered],
    ofp.OFPT_MULTIPART_REQUEST: [multipart_asked],
    ofp.OFPT_ROLE_REQUEST: [messages.role],
}
OF_BRIDGE: dict[int, list[Reader]] = {
    ofp.OFPT_MULTIPART_REPLY: [ports_shown, counted, flows_shown, updated, multipart_asked],
    ofp.OFPT_PORT_STATUS: [ports_shown, ports.status_reason],
    ofp.OFPT_FLOW_REMOVED: [removed],
    ofp.OFPT_PACKET_IN: [packet],
    ofp.OFPT_BUNDLE_CONTROL: [packets.bundle_control],
    ofp.OFPT_ERROR: [messages.error_code],
    ofp.OFPT_ROLE_REPLY: [messages.role],
}


@pytest.mark.parametrize("side", ["controller", "bridge"])
def test_parsers_raise_nothing_but_what_they_should(side: str) -> None:
    random = Random(1604)
    readers = OF_CONTROLLER if side == "controller" else OF_BRIDGE
    text = [one for scene in requests() for one in scene] if side == "controller" else replies()
    outcomes: Counter[str] = Counter()
    text = [one for one in text if one[1] in readers]
    for message in [spoiled(random.choice(text), random) for _time in range(COUNT)]:
        for read in readers.get(message[1], []):
            try:
                read(message)
                outcomes["read"] += 1
            except (MalformedPacket, Refusal) as refusal:
                outcomes[type(refusal).__name__] += 1
    assert outcomes["read"] > COUNT / 10
    assert outcomes["MalformedPacket"] > COUNT / 10


def test_matches_raise_nothing_but_what_they_should_and_cover_what_they_say() -> None:
    random = Random(1276)
    wholes = [FlowMod.decode(scene[0]) for scene in requests() if scene[0][1] == ofp.OFPT_FLOW_MOD]
    read = []
    for _time in range(COUNT):
        data = spoiled(bytes(HEADER.size) + random.choice(wholes).match, random)[HEADER.size :]
        with suppress(MalformedPacket):
            read.append(matches.parse(data))
    assert len(read) > COUNT / 10
    for one in read:
        matches.in_port(one)
        matches.is_of_type(one, matches.LLDP)
        assert matches.covers(one, one)
        other = random.choice(read)
        # The packet with just the values that the narrower one asks for meets the wider one, too.
        assert not matches.covers(one, other) or meets(other, one)


def meets(packet: matches.Fields, match: matches.Fields) -> bool:
    """Return whether a packet with these values has all bits that a match asks for."""
    return all(
        key in packet and number(packet[key][0]) & number(mask) == number(value) & number(mask)
        for key, (value, mask) in match.items()
    )


def number(data: bytes) -> int:
    return int.from_bytes(data, "big")


class Bridge:
    """A bridge that answers, takes whatever is sent, and remembers the paths it has had."""

    def __init__(self, now: Stage, end: End) -> None:
        self._now, self._end = now, end
        self.taken: Counter[int] = Counter()
        self.paths: set[tuple[int, int]] = set()  # that it ever had
        self._entries: dict[tuple[int, bytes], FlowEntry] = {}  # of light
        self._bundles: dict[int, list[bytes]] = {}

    async def run(self) -> None:
        """Answer until the agent closes the connection."""
        while True:
            try:
                message = await self._end.next()
            except (AssertionError, ConnectionError):
                return
            self.taken[message[1]] += 1
            self._take(message)

    def _take(self, message: bytes) -> None:
        kind = message[1]
        if kind == ofp.OFPT_BARRIER_REQUEST:
            self._end.says(of.barrier_reply(transaction_id(message)))
        elif kind == ofp.OFPT_BUNDLE_CONTROL and len(message) >= 16:
            self._control(message)
        elif kind == ofp.OFPT_BUNDLE_ADD_MESSAGE:
            number, member = packets.bundle_member(message)
            require_sound(member)
            self._bundles.setdefault(number, []).append(member)
        else:
            require_sound(message)
            self._change(message)

    def _control(self, message: bytes) -> None:
        number, kind, _flags = packets.bundle_control(message)
        members = [] if kind == ofp.OFPBCT_OPEN_REQUEST else self._bundles.pop(number, [])
        if kind == ofp.OFPBCT_COMMIT_REQUEST:
            for member in members:
                self._change(member)
        self._end.says(of.bundle_control(number, kind + 1 & 0xFFFF, transaction_id(message)))

    def _change(self, message: bytes) -> None:
        if message[1] != ofp.OFPT_FLOW_MOD:
            return
        report = FlowMod.decode(message)
        if report.deletes:
            self._delete(report)
        elif (path := light_path(message)) is not None:
            self._open(report, path)

    def _open(self, report: FlowMod, path: tuple[int, int]) -> None:
        entry = flows.entry(report.priority, report.match, report.instructions, report.cookie)
        if report.command != ofp.OFPFC_ADD and entry.key not in self._entries:
            # The agent names each light entry that it lets be modified.
            assert report.strict or report.match not in {
                match for _priority, match in self._entries
            }
            return
        assert entry.mark
        self._entries[entry.key] = entry
        self.paths.add(path)
        self._now.reports.waiting.append(FlowUpdate(ADDED, entry))

    def _delete(self, report: FlowMod) -> None:
        """Delete what the agent's own table would; its tests establish what that is."""
        table = FlowTable(FIBERS)
        for entry in self._entries.values():
            table.apply(FlowUpdate(ADDED, entry))
        table.change(report)
        for key, entry in list(self._entries.items()):
            if table.find(*key) is None:
                del self._entries[key]
                self._now.reports.waiting.append(FlowUpdate(flow_reports.REMOVED, entry))


def parts(data: bytes) -> list[tuple[int, bytes]]:
    """Return type and body of each part of a list of instructions or actions."""
    found = []
    while data:
        kind, length = struct.unpack_from("!HH", data)
        assert 4 <= length <= len(data)
        found.append((kind, data[4:length]))
        data = data[length:]
    return found


def output_ports(data: bytes) -> list[int]:
    return [struct.unpack_from("!I", body)[0] for kind, body in parts(data) if kind == 0]


def flow_mod_parts(message: bytes) -> tuple[tuple[int, ...], bytes, list[tuple[int, bytes]]]:
    """Return the fixed fields, the match without padding, and the instructions."""
    fixed = FLOW_MOD.unpack_from(message, 8)
    kind, length = struct.unpack_from("!HH", message, 48)
    assert kind == 1
    return fixed, message[52 : 48 + length], parts(message[48 + length + -length % 8 :])


def light_path(message: bytes) -> tuple[int, int] | None:
    """Return the path that a FLOW_MOD opens if it is a light entry that outputs."""
    if message[1] != ofp.OFPT_FLOW_MOD or message[25] in (3, 4):
        return None
    _fixed, match, instructions = flow_mod_parts(message)
    outputs = [
        one for kind, body in instructions if kind in (3, 4) for one in output_ports(body[4:])
    ]
    for port in outputs:
        if port in FIBERS:
            return int.from_bytes(match[4:], "big"), port
    return None


def require_sound(message: bytes) -> None:
    """Check that a message asks the bridge for no light but as the agent writes it."""
    kind = message[1]
    if kind == ofp.OFPT_FLOW_MOD and message[25] not in (3, 4):  # adds or modifies
        require_sound_entry(message)
    elif kind == ofp.OFPT_GROUP_MOD:
        assert not FIBERS.intersection(packets.group_outputs(message))
    elif kind == ofp.OFPT_PACKET_OUT:
        assert not FIBERS.intersection(PacketOut.decode(message).outputs)


def require_sound_entry(message: bytes) -> None:
    fixed, match, instructions = flow_mod_parts(message)
    lists = [body[4:] for kind, body in instructions if kind in (3, 4)]
    ports = [port for data in lists for port in output_ports(data)]
    alone = len(match) == 8 and match[:4] == bytes.fromhex("80000004")
    in_port = int.from_bytes(match[4:], "big") if alone else None
    if in_port not in FIBERS:
        assert not FIBERS.intersection(ports), message.hex()
        return
    table, command, idle_timeout_s = fixed[2:5]
    assert table == 0
    assert len(instructions) == len(lists) <= 2
    assert len(ports) <= 1
    kinds = [kind for data in lists for kind, _body in parts(data)]
    if command == ofp.OFPFC_ADD or 0xFFFF in kinds:
        assert idle_timeout_s == 0
        assert parts(lists[0])[0][1][:6] == bytes.fromhex("000023200008")
        assert kinds.pop(0) == 0xFFFF
    assert kinds in ([], [ofp.OFPAT_OUTPUT])
    assert FIBERS.issuperset(ports)
    assert in_port not in ports


async def hear_out(end: End) -> list[bytes]:
    """Return everything that comes until the connection ends; all of it is framed."""
    heard = []
    while True:
        try:
            heard.append(await end.next())
        except (AssertionError, ConnectionError):
            return heard


def watched(failures: list[Any]) -> None:
    """Collect errors that no task has caught."""
    asyncio.get_running_loop().set_exception_handler(lambda _loop, what: failures.append(what))


@THROUGH_THE_AGENT
def test_spoiled_requests_open_no_path_and_stop_nothing(count: int) -> None:
    taken: Counter[int] = Counter()
    reports: Counter[int] = Counter()
    opened = 0

    async def one_round(random: Random) -> None:
        nonlocal opened
        async with stage() as now:
            bridge = Bridge(now, now.bridge)
            running = asyncio.create_task(bridge.run())
            hearing = asyncio.create_task(hear_out(now.controller))
            text = 0
            while text < ROUND:
                scene = random.choice(requests_of_a_controller)
                spoil = random.randrange(len(scene))
                for number, message in enumerate(scene):
                    now.controller.says(spoiled(message, random) if number == spoil else message)
                text += 1
            now.controller.writer.write_eof()
            await running
            reports.update(message[1] for message in await hearing)
            await now.switch.synchronise()
            await now.switch.paths.ready()
            taken.update(bridge.taken)
            opened += bool(bridge.paths)
            assert now.optics.paths <= bridge.paths

    async def scene() -> None:
        failures: list[Any] = []
        watched(failures)
        random = Random(2026)
        for _round in range(count // ROUND):
            await one_round(random)
            assert failures == []
        gc.collect()
        await asyncio.sleep(0)
        assert failures == []

    requests_of_a_controller = requests()
    play(scene())
    assert taken[ofp.OFPT_FLOW_MOD] > count / 20
    assert taken[ofp.OFPT_BUNDLE_ADD_MESSAGE] > count / 20
    assert reports[ofp.OFPT_ERROR] > count / 20
    assert opened > count / 1000


@THROUGH_THE_AGENT
def test_spoiled_replies_open_no_path_and_stop_nothing(count: int) -> None:
    reports: Counter[int] = Counter()

    async def one_connection(now: Stage, random: Random) -> None:
        bridge, controller = await now.connect()
        hearing = asyncio.create_task(hear_out(controller))
        controller.says(of.flow_request(10, aggregate=True), of.barrier_request(8))
        # A connection that is closed before all of it was read takes along the messages on it.
        while (await bridge.next())[1] != ofp.OFPT_BARRIER_REQUEST:
            pass
        asking = asyncio.create_task(hear_out(bridge))
        for _message in range(FEW):
            bridge.says(spoiled(random.choice(replies_of_a_bridge), random))
        bridge.writer.write_eof()
        reports.update(message[1] for message in await hearing)
        await asking
        for end in (bridge, controller):
            end.writer.close()

    async def scene() -> None:
        failures: list[Any] = []
        watched(failures)
        random = Random(2027)
        async with stage() as now:
            for _connection in range(count // FEW // 2):
                await one_connection(now, random)
                assert failures == []
            gc.collect()
            await asyncio.sleep(0)
            assert failures == []
            assert now.optics.paths == set()

    replies_of_a_bridge = replies()
    play(scene())
    assert reports[ofp.OFPT_MULTIPART_REPLY] > count * 0.015
    assert reports[ofp.OFPT_PACKET_IN] > count * 0.015
