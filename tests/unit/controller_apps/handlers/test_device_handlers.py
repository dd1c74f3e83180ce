"""The device monitor on one framework: hosts, switches, orders and overrides."""

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from handlers_scene import Datapath, packet_out
from metadata_scene import Q1, S1
from scapy.layers.inet import IP, TCP, UDP
from scapy.layers.l2 import Ether
from scapy.packet import Packet

from controller_apps.apps.device_monitor import DeviceMonitor
from controller_apps.apps.host_commands import (
    EventAlarm,
    EventCommand,
    EventEstimate,
    EventMonitorOver,
    EventSessionReported,
)
from controller_apps.console.questions import EventQuestion, Refused
from controller_apps.openflow import framework
from controller_apps.openflow.framework import ofp_event, ofproto, parser
from controller_apps.packets import Frame
from controller_apps.policy.policy import Policy
from controller_apps.record import Record
from controller_apps.sessions.actions import Command
from controller_apps.timeouts import NODE_TIMEOUT_S, SET_TIMEOUT_S
from wire.config import ControllerConfig
from wire.device import (
    DEVICE_PORT,
    Datagram,
    DevicePort,
    DeviceQuery,
    DeviceReport,
    DeviceSettings,
    SessionQuery,
    SetDevice,
    Subscribe,
    host_of,
    open_sealed,
)
from wire.metadata.header import Message
from wire.metadata.setup import Answer
from wire.metadata.vocabulary import Reason
from wire.monitor_messages import MonitorCommand, PreemptMonitor, Quantity, SessionEstimate
from wire.optical import ALL_VALID, TUNABLE, PortLight, PortOptics

KEYS = {"alice": "aa" * 16, "bob": "bb" * 16}
CONTROLLER, ALICE = "10.0.0.254", "10.0.0.1"
SET = DeviceReport(0, period_ms=1000, lost_ppm=10_000, symbol_error_ppm=10_000)  # as the policy


class Scene:
    """The monitor, a classical and a quantum switch, and a clock that the test moves."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.record_path = folder / "record.jsonl"
        config = ControllerConfig(
            "127.0.0.1:1", framework.NAME, {"q1": Q1}, address=CONTROLLER, device_keys=KEYS
        )
        self.now = 100.0
        clock = SimpleNamespace(monotonic=lambda: self.now, time_ns=lambda: 5_000)
        for module in ("controller_apps.apps.device_monitor", "wire.network_time"):
            monkeypatch.setattr(f"{module}.time", clock)
        self.monitor = DeviceMonitor(config, Record(str(self.record_path)))
        self.s1, self.q1 = Datapath(S1), Datapath(Q1)
        self.number = 0
        for datapath in (self.s1, self.q1):
            state = SimpleNamespace(datapath=datapath, state=framework.MAIN)
            self.monitor.switch_changed(state)

    def says(self, message: Message, host: str = "alice", key: str = "", port: int = 3) -> None:
        """Let a host say something behind a port of s1."""
        self.number += 1
        data = Datagram(message, host, self.number).seal(key or KEYS[host], Datagram.FROM_HOST)
        self.hears(data, port)

    def hears(self, data: bytes, port: int = 3) -> None:
        segment = UDP(sport=DEVICE_PORT, dport=DEVICE_PORT) / data
        self.monitor.packet_arrived(self.packet_in(segment, port))

    def packet_in(self, segment: Packet, port: int = 3, table: int = 1) -> Any:
        ends = Ether(src="02:00:00:00:00:01", dst="ff:ff:ff:ff:ff:ff")
        frame = ends / IP(src=ALICE, dst="10.0.0.255") / segment
        message = parser.OFPPacketIn(
            self.s1, table_id=table, match=parser.OFPMatch(in_port=port), data=bytes(frame)
        )
        return ofp_event.EventOFPPacketIn(message)

    def datagrams(self, host: str = "alice") -> list[Message]:
        """Return the packets that s1 had to send to a host, checked by scapy."""
        messages = []
        for sent in self.s1.take():
            assert (sent.in_port, sent.port) == (ofproto.OFPP_CONTROLLER, 3)
            packet = Ether(sent.frame)
            assert (packet.dst, packet[IP].src, packet[IP].dst) == (
                "02:00:00:00:00:01",
                CONTROLLER,
                ALICE,
            )
            data = bytes(packet[UDP].payload)
            messages.append(open_sealed(data, KEYS[host], Datagram.FROM_CONTROLLER).message)
        return messages

    def ask(self, name: str, **fields: Any) -> Any:
        """Ask, and return the question."""
        question = EventQuestion(name, fields)
        self.monitor.asked(question)
        return question

    def devices(self) -> dict[str, Any]:
        return {device["name"]: device for device in self.ask("devices").wait()}

    def tick(self, seconds: float) -> None:
        self.now += seconds
        self.monitor.time_passed(None)


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Scene:
    return Scene(tmp_path, monkeypatch)


def test_an_app_is_not_woken_for_packets_of_others(scene: Scene) -> None:
    queued = scene.monitor.events
    for segment, table in ((TCP(), 1), (UDP(), 2)):
        scene.monitor._send_event(scene.packet_in(segment, table=table), framework.MAIN)
    assert queued.empty()
    scene.monitor._send_event(scene.packet_in(UDP()), framework.MAIN)
    assert queued.qsize() == 1


SEAL = MonitorCommand(0, 7, ALICE, "10.0.0.2", 2000, 1000, 100_000, 0.01, 0.25, 1e-6, 0.01)
ORDER = EventCommand(Command(ALICE, SEAL))


def answers(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, int, str, Reason]]:
    """Return the answers to orders that other apps will have seen."""
    reports: list[tuple[str, int, str, Reason]] = []
    monkeypatch.setattr(
        scene.monitor,
        "send_event",
        lambda app, event: reports.append((app, event.session, event.node, event.reason)),
    )
    return reports


def test_an_order_is_sent_again_until_it_is_answered(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    reports = answers(scene, monkeypatch)
    scene.says(SET)
    scene.datagrams()
    scene.monitor.ordered(ORDER)
    (order,) = scene.datagrams()
    assert order == replace(SEAL, session=order.session)
    scene.tick(0.1)
    assert order in scene.datagrams()
    assert reports == []
    scene.says(Answer(order.session, Reason.OK))
    scene.says(Answer(order.session, Reason.OK))  # to the order that was sent again
    assert reports == [("QuantumMetadata", 7, ALICE, Reason.OK)]
    scene.datagrams()
    scene.tick(0.1)
    assert order not in scene.datagrams()


def test_a_refused_order_is_told_to_the_one_that_asked_for_it(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    reports = answers(scene, monkeypatch)
    scene.says(SET)
    scene.datagrams()
    scene.monitor.ordered(ORDER)
    (order,) = scene.datagrams()
    scene.says(Answer(order.session, Reason.UNSUPPORTED, "no"))
    assert reports == [("QuantumMetadata", 7, ALICE, Reason.UNSUPPORTED)]


def test_a_node_that_is_heard_in_time_gets_its_order_then(scene: Scene) -> None:
    scene.monitor.ordered(ORDER)
    assert not any(isinstance(message, MonitorCommand) for message in scene.datagrams())
    scene.says(SET)
    scene.tick(0.1)
    assert any(isinstance(message, MonitorCommand) for message in scene.datagrams())


def test_an_order_that_nobody_answers_is_given_up(scene: Scene) -> None:
    scene.says(SET)
    scene.monitor.ordered(ORDER)
    scene.datagrams()
    scene.tick(NODE_TIMEOUT_S)
    assert not any(isinstance(message, MonitorCommand) for message in scene.datagrams())


def test_a_seal_is_ordered_and_its_answer_told_to_the_one_that_asked_for_it(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    reports = answers(scene, monkeypatch)
    scene.says(SET)
    scene.datagrams()
    scene.monitor.ordered(EventCommand(Command(ALICE, SEAL)))
    (order,) = scene.datagrams()
    assert order.session > 0
    assert order == replace(SEAL, session=order.session)
    scene.says(Answer(order.session, Reason.OK))
    assert reports == [("QuantumMetadata", 7, ALICE, Reason.OK)]
    scene.monitor.ordered(EventCommand(Command(ALICE, PreemptMonitor(0, 7))))
    (back,) = scene.datagrams()
    assert back == PreemptMonitor(back.session, 7)
    assert back.session != order.session
    scene.says(Answer(back.session, Reason.UNKNOWN_SESSION))  # it was over already
    assert len(reports) == 1
    scene.tick(0.1)
    assert not any(isinstance(message, PreemptMonitor) for message in scene.datagrams())


def test_what_a_host_says_of_a_session_is_told_as_that(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    reports: list[Any] = []
    monkeypatch.setattr(scene.monitor, "send_event", lambda _app, event: reports.append(event))
    scene.monitor.ordered(EventCommand(Command(ALICE, SessionQuery(0, 7))))
    scene.says(SET)  # it was not heard before
    scene.datagrams()
    scene.tick(0.1)
    (question,) = (each for each in scene.datagrams() if isinstance(each, SessionQuery))
    assert question.about == 7
    scene.says(Answer(question.session, Reason.UNKNOWN_SESSION))
    (event,) = reports
    assert type(event) is EventSessionReported
    assert (event.session, event.node, event.reason) == (7, ALICE, Reason.UNKNOWN_SESSION)


def test_what_a_seal_has_found_is_told_once(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    reports: list[tuple[str, Any]] = []
    monkeypatch.setattr(
        scene.monitor, "send_event", lambda app, event: reports.append((app, event))
    )
    scene.says(SET)
    report = replace(
        SET, monitor=7, monitor_compared=65, monitor_errors=13, monitor_tests=4, alarm=7
    )
    for _again in range(2):
        scene.says(report)
    (_app, alarm), (app, over) = reports
    assert isinstance(alarm, EventAlarm)
    assert isinstance(over, EventMonitorOver)
    assert (app, over.host, over.address, over.report) == (
        "QuantumMetadata",
        "alice",
        ALICE,
        report,
    )


def test_a_host_that_is_heard_is_subscribed_and_polled(scene: Scene) -> None:
    assert scene.devices()["alice"] == {"name": "alice", "kind": "host", "state": "never heard"}
    scene.says(DeviceReport(0, pairs_sent=7, ports=(DevicePort("alice-q0", True),)))
    (subscribe,) = scene.datagrams()
    assert isinstance(subscribe, Subscribe)
    assert (subscribe.period_ms, subscribe.lost_ppm) == (1000, 10_000)
    scene.says(replace(SET, pairs_sent=8))
    assert scene.datagrams() == []
    scene.tick(1.0)
    (query,) = scene.datagrams()
    assert isinstance(query, DeviceQuery)
    alice = scene.devices()["alice"]
    assert (alice["state"], alice["pairs_sent"], alice["address"]) == ("up", 8, ALICE)


def test_a_silent_host_is_shown_with_its_last_state(scene: Scene) -> None:
    scene.says(replace(SET, pairs_sent=8))
    scene.tick(3.4)
    assert scene.devices()["alice"]["state"] == "up"
    scene.tick(1.2)
    alice = scene.devices()["alice"]
    assert (alice["state"], alice["heard_s_ago"], alice["pairs_sent"]) == ("silent", 4.6, 8)
    scene.says(SET)
    assert scene.devices()["alice"]["state"] == "up"
    states = [json.loads(line)["state"] for line in scene.record_path.read_text().splitlines()]
    assert states == ["heard", "silent", "heard"]


def test_forged_repeated_and_strange_datagrams_change_nothing(scene: Scene) -> None:
    scene.says(replace(SET, pairs_sent=8))
    before = scene.devices()
    scene.says(replace(SET, pairs_sent=9), key=KEYS["bob"])
    scene.number -= 2
    scene.says(replace(SET, pairs_sent=9))  # a number that was used
    scene.number += 5
    scene.says(replace(SET, pairs_sent=9), host="eve", key=KEYS["bob"])
    scene.says(DeviceQuery(1))
    scene.says(Answer(1, Reason.OK), host="bob")  # never heard before
    own = Datagram(SET, "alice", 99).seal(KEYS["alice"], Datagram.FROM_CONTROLLER)
    scene.hears(own)
    scene.hears(b"rubbish")
    assert scene.devices() == before


def test_of_a_flood_of_rubbish_five_lines_are_logged_and_then_how_many_more(
    scene: Scene, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", scene.monitor.logger.name)
    for _ in range(20):
        scene.hears(b"rubbish")
    assert len(caplog.messages) == 5
    scene.tick(1.1)
    assert caplog.messages[5:] == ["switch 0x1 port 3: 15 more lines, which are left out"]


def test_an_override_is_sent_until_it_is_in_force(scene: Scene) -> None:
    scene.says(SET)
    question = scene.ask("set", device="alice", settings={"rate_hz": 1000})
    assert [type(message) for message in scene.datagrams()] == [DeviceQuery]
    wanted = DeviceSettings(rate_hz=1000)
    for _ in range(2):  # the first is lost
        scene.says(SET)
        (order,) = scene.datagrams()
        assert isinstance(order, SetDevice)
        assert order.settings == wanted
    scene.says(Answer(order.session, Reason.OK))
    scene.says(replace(SET, settings=wanted))
    assert scene.datagrams() == []
    assert question.wait()["overrides"] == {"rate_hz": 1000}
    scene.says(SET)  # it has started again
    assert [type(message) for message in scene.datagrams()] == [SetDevice]


def test_a_host_that_refuses_is_left_as_it_is(scene: Scene) -> None:
    scene.says(SET)
    question = scene.ask("set", device="alice", settings={"fec": 9})
    scene.says(Answer(1, Reason.UNSUPPORTED, "fec 9 is not known"))
    with pytest.raises(Refused, match="alice: fec 9 is not known"):
        question.wait()
    scene.datagrams()
    scene.says(SET)
    assert scene.datagrams() == []


def test_a_host_that_does_not_answer_is_named_in_time(scene: Scene) -> None:
    scene.says(SET)
    question = scene.ask("set", device="alice", settings={"fec": 0})
    scene.tick(SET_TIMEOUT_S)
    with pytest.raises(Refused, match="alice has not answered in 3 s"):
        question.wait()


@pytest.mark.parametrize(
    ("device", "settings", "words"),
    [
        ("eve", {"fec": 0}, "no device 'eve'; hosts with a node agent: alice, bob"),
        ("bob", {"fec": 0}, "bob has sent no report yet"),
        ("alice", {"speed": 0}, "no setting 'speed'"),
        ("alice", {"rate_hz": 0}, "rate_hz 0: choose 1"),
    ],
)
def test_what_cannot_be_set_is_named(
    scene: Scene, device: str, settings: dict[str, int], words: str
) -> None:
    scene.says(SET)
    with pytest.raises(Refused, match=words):
        scene.ask("set", device=device, settings=settings).wait()
    assert scene.datagrams() == []


def test_a_policy_that_sets_an_unknown_host_is_refused(scene: Scene, tmp_path: Path) -> None:
    file = tmp_path / "policy.toml"
    file.write_text("[device.alise]\nfec = 0")
    scene.monitor.policy_path = str(file)
    with pytest.raises(Refused, match="device 'alise' is not a host; hosts are alice, bob"):
        scene.ask("reload").wait()
    file.write_text("[device.alice]\nfec = 0")
    assert scene.ask("reload").wait() == str(file)
    scene.says(SET)
    assert [type(message) for message in scene.datagrams()] == [SetDevice, Subscribe]


def described(*properties: bytes, state: int = 0) -> bytes:
    """Return the description of port 3 with properties, OpenFlow 1.4 section 7.2.1."""
    body = b"".join(properties)
    fixed = (3).to_bytes(4, "big") + (40 + len(body)).to_bytes(2, "big") + bytes(2)
    return (
        fixed + bytes(8) + b"q1-eth3".ljust(16, b"\0") + bytes(4) + state.to_bytes(4, "big") + body
    )


def test_optical_ports_counters_and_paths_are_read(scene: Scene) -> None:
    scene.tick(0.0)
    kinds = [int.from_bytes(bytes([message.kind]), "big") for message in scene.q1.take()]
    assert kinds == [ofproto.OFPT_MULTIPART_REQUEST] * 3
    optics = PortOptics(TUNABLE, 191_350_000, 196_100_000, 50_000, 1, 2, 3, -200, 0)
    ethernet = bytes.fromhex("00000020") + bytes(28)
    port = parser.OFPPort.parser(described(ethernet, optics.encode()), 0)
    message = SimpleNamespace(datapath=scene.q1, body=[port])
    scene.monitor.ports_described(SimpleNamespace(msg=message))
    light = PortLight(ALL_VALID, 193_400_000, 0, 0, 193_400_000, 0, 0, -15, -234, 1234, 251)
    counts = (3, 0, 0, 100, 90, 0, 0, 7, 0, 0, 0)
    body = light.encode()
    fixed = (80 + len(body)).to_bytes(2, "big") + bytes(2) + counts[0].to_bytes(4, "big") + bytes(8)
    data = fixed + b"".join(count.to_bytes(8, "big") for count in counts[3:]) + body
    statistics = parser.OFPPortStats.parser(data, 0)
    scene.monitor.ports_counted(
        SimpleNamespace(msg=SimpleNamespace(datapath=scene.q1, body=[statistics]))
    )
    (shown,) = scene.devices()[f"{Q1:016x}"]["ports"]
    assert shown == {
        "port": 3,
        "name": "q1-eth3",
        "up": True,
        "tuning": {
            "min_frequency_mhz": 191_350_000,
            "max_frequency_mhz": 196_100_000,
            "grid_mhz": 50_000,
            "min_power_dbm": -20.0,
            "max_power_dbm": 0.0,
        },
        "photons_in": 100,
        "photons_out": 90,
        "photons_lost": 7,
        "light": {
            "frequency_mhz": 193_400_000,
            "tx_power_dbm": -1.5,
            "rx_power_dbm": -23.4,
            "bias_ma": 123.4,
            "temperature_c": 25.1,
        },
    }
    cut = parser.OFPPort.parser(described(state=1), 0)
    status = SimpleNamespace(datapath=scene.q1, reason=ofproto.OFPPR_MODIFY, desc=cut)
    scene.monitor.port_changed(SimpleNamespace(msg=status))
    (shown,) = scene.devices()[f"{Q1:016x}"]["ports"]
    assert (shown["up"], shown["photons_in"]) == (False, 100)


def entry(in_port: int, out_port: int, cookie: int = 7, **match: int) -> SimpleNamespace:
    actions = [parser.OFPActionOutput(out_port)]
    return SimpleNamespace(
        cookie=cookie,
        packet_count=11,
        duration_sec=2,
        duration_nsec=500_000_000,
        match=parser.OFPMatch(in_port=in_port, **match),
        instructions=[parser.OFPInstructionActions(ofproto.OFPIT_APPLY_ACTIONS, actions)],
    )


def test_only_light_paths_are_shown_and_only_whole_replies(scene: Scene) -> None:
    def reply(more: int, *entries: SimpleNamespace) -> None:
        message = SimpleNamespace(datapath=scene.q1, flags=more, body=list(entries))
        scene.monitor.flows_listed(SimpleNamespace(msg=message))

    reply(ofproto.OFPMPF_REPLY_MORE, entry(1, 2))
    assert scene.devices()[f"{Q1:016x}"]["paths"] == []
    up = entry(3, ofproto.OFPP_CONTROLLER)
    reply(0, entry(2, 4), up, entry(5, 6, eth_type=0x88CC))
    paths = scene.devices()[f"{Q1:016x}"]["paths"]
    assert [(path["in_port"], path["out_port"]) for path in paths] == [(1, 2), (2, 4)]
    assert paths[0] == {
        "in_port": 1,
        "out_port": 2,
        "session": f"{7:016x}",
        "photons": 11,
        "duration_s": 2.5,
    }


def test_a_switch_that_is_gone_or_silent_is_shown_so(scene: Scene) -> None:
    scene.now += 5
    assert scene.devices()[f"{Q1:016x}"]["state"] == "silent"
    gone = SimpleNamespace(datapath=scene.q1, state=framework.DEAD)
    scene.monitor.switch_changed(gone)
    assert scene.devices()[f"{Q1:016x}"]["state"] == "disconnected"
    scene.q1.take()
    scene.tick(2.0)
    assert scene.q1.take() == []


def test_the_frame_that_is_sent_can_be_read_back() -> None:
    frame = Frame(b"\2" * 6, b"\4" * 6, CONTROLLER, ALICE, 1, 2, b"x")
    out = parser.OFPPacketOut(
        Datapath(S1),
        buffer_id=ofproto.OFP_NO_BUFFER,
        in_port=ofproto.OFPP_CONTROLLER,
        actions=[parser.OFPActionOutput(1)],
        data=frame.encode(),
    )
    out.set_xid(1)
    out.serialize()
    assert Frame.decode(bytes(packet_out(bytes(out.buf), 1).frame)) == frame


def test_a_thousand_hosts_are_polled_one_after_the_other_each_once_a_period(scene: Scene) -> None:
    """At most 100 devices a second, whatever the policy asks: 1,000 and q1 take 10.01 s."""
    scene.says(SET)
    scene.s1.take()
    state = scene.monitor.hosts.states["alice"]
    names = [f"h{number}" for number in range(1000)]
    scene.monitor.hosts.keys = dict.fromkeys(names, KEYS["alice"])
    scene.monitor.hosts.states = dict.fromkeys(names, state)
    scene.monitor._take_policy(Policy())
    assert scene.monitor.hosts.reporting.period_s == pytest.approx(10.01)
    polled: Counter[str] = Counter()
    for _tick in range(100):
        scene.tick(0.1)
        sent = scene.s1.take()
        assert len(sent) <= 15
        polled.update(host_of(bytes(Ether(each.frame)[UDP].payload)) for each in sent)
    assert polled == Counter(names)


def test_what_a_host_has_found_out_of_a_session_is_passed_on(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent: list[tuple[str, Any]] = []
    monkeypatch.setattr(scene.monitor, "send_event", lambda app, event: sent.append((app, event)))
    estimate = SessionEstimate(0, 7, Quantity.FIDELITY, 0.9, 0.8, 0.95)
    scene.says(estimate)  # nobody has heard of the host yet
    assert sent == []
    scene.says(SET)
    scene.says(estimate)
    ((app, event),) = sent
    assert isinstance(event, EventEstimate)
    assert (app, event.host, event.address, event.estimate) == (
        "QuantumMetadata",
        "alice",
        ALICE,
        estimate,
    )
