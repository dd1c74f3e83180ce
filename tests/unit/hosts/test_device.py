"""The counts and settings of a device, and its node agent over real datagrams."""

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import pytest
from limits import SOON_S
from stacks_scene import OWN_ADDRESS

from hosts import network_loop, node_agent
from hosts.hardware.ports import read_ports
from hosts.middleware.device import Device, changed
from hosts.middleware.session.ends import Watched
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.options import overridden
from hosts.middleware.session.session import OpeningSession
from hosts.node_agent import start_node_agent
from hosts.serving.link_monitors import LinkMonitors
from hosts.timeouts import CHECK_PERIOD_S
from wire.config import HostConfig
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
    open_sealed,
)
from wire.metadata.header import Message
from wire.metadata.setup import Answer, Setup
from wire.metadata.vocabulary import Fec, Handshake, Reason, Service
from wire.monitor_messages import MonitorCommand, PreemptMonitor, Quantity, SessionEstimate
from wire.network_time import NetworkTime

KEY = "00112233445566778899aabbccddeeff"
SETUP = Setup(7, Service.SDC, Handshake.FRAMED, "10.0.0.3", 65_536, 256, 50_000_000)
CONTROLLER, HOST = OWN_ADDRESS["alice"], OWN_ADDRESS["bob"]
LIVING = 0x11  # the session that the host is in


@dataclass
class Session:
    """A session that has used something."""

    counts: dict[str, int]
    setup: Setup = SETUP
    watched: Watched | None = None
    wanted_back: bool = False
    summary: dict[str, Any] = field(default_factory=dict)

    def preempt(self) -> None:
        self.wanted_back = True


def sending(pairs: int, lost: int = 0, errors: int = 0, repeated: int = 0) -> Session:
    counts = {"pairs_lost": lost, "symbol_errors": errors, "repeated_frames": repeated}
    return Session({"pairs_sent": pairs, **counts})


def receiving(symbols: int, lost: int) -> Session:
    counts = {"pairs_lost": lost, "symbol_errors": 1, "repeated_frames": 2}
    return Session({"pairs_received": symbols, **counts})


class Fibers:
    """Ports that the test can cut."""

    def __init__(self) -> None:
        self.up = True

    def __call__(self) -> tuple[DevicePort, ...]:
        return (DevicePort("bob-q0", self.up),)


def test_overrides_take_the_place_of_what_was_asked_for() -> None:
    settings = DeviceSettings(rate_hz=1_000_000, wavelength_pm=1_551_720)
    assert overridden(SETUP, settings) == replace(SETUP, rate_hz=1_000_000, wavelength_pm=1_551_720)
    assert overridden(SETUP, DeviceSettings()) == SETUP
    coded = overridden(SETUP, DeviceSettings(fec=Fec.GOLAY, interleave=1))
    assert coded == replace(SETUP, fec=Fec.GOLAY, interleave=1)
    assert overridden(coded, DeviceSettings(fec=0)) == replace(SETUP, interleave=1)


def test_a_low_rate_makes_blocks_smaller() -> None:
    assert overridden(SETUP, DeviceSettings(rate_hz=1000)).pairs == 5000
    assert overridden(SETUP, DeviceSettings(rate_hz=1)).pairs == 5


def test_what_is_not_offered_is_refused_and_changes_nothing() -> None:
    device = Device(Fibers())
    with pytest.raises(SessionError, match="fec 5 is not known: choose one of none, repetition"):
        device.set(DeviceSettings(fec=5))
    assert device.settings == DeviceSettings()
    device.set(DeviceSettings(fec=3, interleave=1))
    assert device.report().settings == DeviceSettings(fec=3, interleave=1)


def test_sessions_are_counted_while_they_run_and_after() -> None:
    device = Device(Fibers())
    one, two = sending(100, lost=3, errors=5, repeated=1), sending(10)
    device.override(SETUP)
    with device.opens(two):
        with (
            device.opens(one),
            device.accepts(receiving(40, lost=4)),
            device.serves(SETUP),
        ):
            device.made(70)
            report = device.report(9)
        two.counts["pairs_sent"] = 11
        left = device.report(9)
    assert report == DeviceReport(
        9,
        sending=2,
        receiving=1,
        serving=1,
        pairs_sent=110,
        pairs_made=70,
        pairs_received=40,
        pairs_lost=7,
        symbol_errors=6,
        repeated_frames=3,
        rate_hz=50_000_000,
        frame_bytes=256,
        wavelength_pm=1_550_120,
        ports=(DevicePort("bob-q0", True),),
    )
    assert left == replace(report, sending=1, receiving=0, serving=0, pairs_sent=111)


def test_the_alarm_of_a_seal_is_told_when_it_is_over_and_stays() -> None:
    device = Device(Fibers())
    watching = replace(SETUP, session=9, service=Service["SEAL"])
    seal = Session({}, watching, Watched(65, 13, 4, True, Reason.OK))
    with device.opens(seal):
        before = device.report()
        assert before.alarm == 0
    report = device.report()
    assert (report.alarm, report.monitor, report.monitor_compared) == (9, 9, 65)
    assert (report.monitor_errors, report.monitor_tests, report.monitor_end) == (13, 4, Reason.OK)
    assert changed(replace(before, sending=0), report)
    later = replace(watching, session=10)
    for other in (sending(1), Session({}, later, Watched(8, 0, 0, False, Reason.BUSY))):
        with device.opens(other):
            pass
    report = device.report()
    assert (report.alarm, report.monitor, report.monitor_compared, report.monitor_end) == (
        9,
        10,
        8,
        Reason.BUSY,
    )


def test_a_seal_that_runs_here_is_given_back_and_nothing_else() -> None:
    device = Device(Fibers())
    seal, other = Session({}, replace(SETUP, session=9, service=Service["SEAL"])), sending(1)
    with device.opens(seal), device.opens(other):
        assert not device.preempt(10)
        assert not device.preempt(other.setup.session)
        assert device.preempt(9)
    assert (seal.wanted_back, other.wanted_back) == (True, False)
    assert not device.preempt(9)  # which is over


def test_counts_alone_are_no_change_but_ports_and_settings_are() -> None:
    fibers = Fibers()
    device = Device(fibers)
    before = device.report()
    device.made(5)
    assert not changed(before, device.report(3))
    fibers.up = False
    assert changed(before, device.report())


@pytest.mark.parametrize(("lost", "errors", "alarming"), [(10, 0, False), (11, 0, True), (0, 21, True), (0, 20, False)])  # fmt: skip  # noqa: E501
def test_losses_and_errors_alarm_above_their_thresholds(
    lost: int, errors: int, alarming: bool
) -> None:
    device = Device(Fibers(), subscription=Subscribe(0, 1000, 10_000, 20_000))
    before = DeviceReport(0, pairs_sent=500, pairs_lost=100)
    now = DeviceReport(0, pairs_sent=1500, pairs_lost=100 + lost, symbol_errors=errors)
    assert device.alarming(before, now) == alarming
    assert not device.alarming(now, now)


class Peer(asyncio.DatagramProtocol):
    """The controller's end, on a loopback address of its own."""

    def __init__(self) -> None:
        self.heard: asyncio.Queue[Datagram] = asyncio.Queue()

    def connection_made(self, transport: Any) -> None:
        self.transport = transport

    def datagram_received(self, data: bytes, _address: Any) -> None:
        self.heard.put_nowait(open_sealed(data, KEY, Datagram.FROM_HOST))

    def send(self, message: Message, number: int, host: str = "bob", key: str = KEY) -> None:
        data = Datagram(message, host, number).seal(key, Datagram.FROM_CONTROLLER)
        self.transport.sendto(data, (HOST, DEVICE_PORT))

    async def next(self) -> Message:
        async with asyncio.timeout(SOON_S):
            return (await self.heard.get()).message

    async def silent(self) -> bool:
        await asyncio.sleep(2 * CHECK_PERIOD_S)
        return self.heard.empty()


Request = Callable[[dict[str, Any], int], OpeningSession]


def nothing(_fields: dict[str, Any], _number: int) -> OpeningSession:
    """Refuse a session."""
    raise SessionError(Reason.UNSUPPORTED, "none in this test")


@pytest.fixture(autouse=True)
def reports_unasked_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no second report come between a request and its answer, however busy the machine is."""
    monkeypatch.setattr(node_agent, "FASTEST_ANNOUNCEMENTS_S", 1000.0)


@asynccontextmanager
async def agent(device: Device, request: Request | None = None) -> AsyncIterator[Peer]:
    """Run a node agent and the peer that it reports to."""
    config = HostConfig(
        name="bob",
        address=HOST,
        qnics=[],
        dispatcher="",
        token="",
        socket="",
        hosts_file="",
        source="",
        seed=1,
        report_to=CONTROLLER,
        device_key=KEY,
    )
    loop = asyncio.get_running_loop()
    transport, peer = await loop.create_datagram_endpoint(
        Peer, local_addr=(CONTROLLER, DEVICE_PORT)
    )
    seals = LinkMonitors("bob", HOST, request or nothing, device.opens, device.preempt)
    node = await start_node_agent(config, device, seals, lambda session: session == LIVING)
    running = asyncio.create_task(node.run())
    try:
        yield peer
        assert not running.done()
    finally:
        running.cancel()
        node._transport.close()
        transport.close()
        await asyncio.sleep(0)


def test_the_agent_answers_is_set_and_reports_changes() -> None:
    async def scene() -> None:
        fibers = Fibers()
        device = Device(fibers)
        async with agent(device) as peer:
            assert (await peer.next()).session == 0  # by itself: nobody has asked
            now = time.time_ns()
            peer.send(DeviceQuery(41), now)
            assert await peer.next() == device.report(41)
            peer.send(Subscribe(42, 60_000, 10_000, 10_000), now + 1)
            subscribed = await peer.next()
            assert isinstance(subscribed, DeviceReport)
            assert (subscribed.session, subscribed.period_ms) == (42, 60_000)
            peer.send(SetDevice(43, DeviceSettings(rate_hz=1000)), now + 2)
            assert await peer.next() == Answer(43, Reason.OK)
            assert await peer.next() == device.report()
            assert device.settings == DeviceSettings(rate_hz=1000)
            peer.send(SetDevice(44, DeviceSettings(fec=9)), now + 3)
            refused = await peer.next()
            assert isinstance(refused, Answer)
            assert (refused.session, refused.reason) == (44, Reason.UNSUPPORTED)
            assert device.settings == DeviceSettings(rate_hz=1000)
            assert await peer.silent()
            fibers.up = False
            device.changed()  # as the kernel would say
            cut = await peer.next()
            assert isinstance(cut, DeviceReport)
            assert cut.ports == (DevicePort("bob-q0", False),)

    network_loop.run(scene())


def test_the_agent_reports_at_once_where_the_clock_has_just_begun(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A network cannot start before each host is found; stepped time begins at 0."""
    monkeypatch.setattr(NetworkTime, "background_s", lambda _: 0.0)

    async def scene() -> None:
        async with agent(Device(Fibers())) as peer, asyncio.timeout(SOON_S):
            assert isinstance(await peer.next(), DeviceReport)

    network_loop.run(scene())


def test_the_agent_takes_commands_for_link_monitors() -> None:
    asked: list[tuple[dict[str, Any], int]] = []

    def request(fields: dict[str, Any], number: int) -> OpeningSession:
        asked.append((fields, number))
        return nothing(fields, number)

    async def scene() -> None:
        async with agent(Device(Fibers()), request=request) as peer:
            await peer.next()
            command = MonitorCommand(
                45, 7, HOST, "10.0.0.9", 200, 100, 5000, 0.01, 0.25, 1e-6, 0.02
            )
            peer.send(command, time.time_ns())
            assert await peer.next() == Answer(45, Reason.UNSUPPORTED, "none in this test")
            ((fields, number),) = asked
            assert number == 7
            assert (fields["service"], fields["host"], fields["source"]) == (
                "seal",
                "10.0.0.9",
                "bob",
            )
            assert (fields["count"], fields["block_pairs"], fields["rate_hz"]) == (200, 100, 5000)
            chances = [fields[name] for name in ("whole_error", "fraction", "false_alarm")]
            assert chances == [0.01, 0.25, 1e-6]
            assert fields["missed"] == 0.02
            peer.send(PreemptMonitor(46, 7), time.time_ns())
            assert await peer.next() == Answer(46, Reason.UNKNOWN_SESSION)

    network_loop.run(scene())


def test_an_alarm_is_told_at_once_though_the_device_is_at_work(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(node_agent, "CHECK_PERIOD_S", 1000.0)  # after which the rest is reported
    device = Device(Fibers())
    watching = replace(SETUP, session=9, service=Service["SEAL"])

    async def scene() -> None:
        async with agent(device) as peer:
            await peer.next()
            with device.opens(Session({}, watching, Watched(65, 13, 4, True, Reason.OK))):
                pass
            report = await peer.next()
            assert isinstance(report, DeviceReport)
            assert (report.session, report.alarm) == (0, 9)

    with device.opens(sending(1000)):
        network_loop.run(scene())


def test_the_agent_says_in_which_sessions_its_host_is() -> None:
    async def scene() -> None:
        async with agent(Device(Fibers())) as peer:
            await peer.next()
            for request, about in ((51, LIVING), (52, LIVING + 1)):
                peer.send(SessionQuery(request, about), time.time_ns())
            assert await peer.next() == Answer(51, Reason.OK)
            assert await peer.next() == Answer(52, Reason.UNKNOWN_SESSION)

    network_loop.run(scene())


def test_the_agent_reports_losses_above_the_threshold_by_itself() -> None:
    device, session = Device(Fibers()), sending(1000)

    async def scene() -> None:
        async with agent(device) as peer:
            await peer.next()
            peer.send(Subscribe(1, 1000, 10_000, 1_000_000), time.time_ns())
            await peer.next()
            session.counts["pairs_sent"], session.counts["pairs_lost"] = 2000, 10
            assert await peer.silent()
            session.counts["pairs_lost"] = 11
            async with asyncio.timeout(2.0):  # long before it would report unasked
                alarm = await peer.next()
            assert isinstance(alarm, DeviceReport)
            assert (alarm.session, alarm.pairs_lost) == (0, 11)

    with device.opens(session):
        network_loop.run(scene())


def test_what_is_old_foreign_or_for_another_host_changes_nothing() -> None:
    async def scene() -> None:
        device = Device(Fibers())
        async with agent(device) as peer:
            await peer.next()
            now = time.time_ns()
            peer.send(Subscribe(1, 60_000, 0, 0), now)
            await peer.next()
            wanted = SetDevice(2, DeviceSettings(rate_hz=1000))
            peer.send(wanted, now)  # the number was used
            peer.send(wanted, now - 1)
            peer.send(wanted, now + 1, key="ff" * 16)
            peer.send(wanted, now + 1, host="alice")
            peer.send(device.report(), now + 1)  # not for an agent
            peer.transport.sendto(b"rubbish", (HOST, DEVICE_PORT))
            assert await peer.silent()
            assert device.settings == DeviceSettings()

    network_loop.run(scene())


def test_a_port_has_light_that_is_up_or_cannot_tell() -> None:
    """Of loopback, as of VXLAN, the kernel says "unknown" (Linux, operstates.rst)."""
    assert read_ports(["lo", "gone"]) == (DevicePort("lo", True), DevicePort("gone", False))


def test_what_a_session_has_found_out_is_told_while_it_lasts_and_in_the_end() -> None:
    device = Device(Fibers())

    async def scene() -> None:
        async with agent(device) as peer:
            await peer.next()
            session = Session({})
            with device.opens(session):
                assert isinstance(await peer.next(), DeviceReport)
                session.summary = {"fidelity": 0.9, "fidelity_low": 0.85, "fidelity_high": 0.94}
                first = SessionEstimate(0, 7, Quantity.FIDELITY, 0.9, 0.85, 0.94)
                assert await peer.next() == first
                session.summary |= {"fidelity": 0.91}
            reports = [await peer.next(), await peer.next()]
            assert SessionEstimate(0, 7, Quantity.FIDELITY, 0.91, 0.85, 0.94) in reports

    network_loop.run(scene())
