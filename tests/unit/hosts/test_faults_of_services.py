"""Each fault in each service: an error for the one who asked, and nothing left on any node."""

import asyncio
from collections.abc import Callable
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest
from fault_scene import (
    DATA,
    NOBODY,
    SERVICES,
    Last,
    Once,
    Outcome,
    Raw,
    Sockets,
    running,
    session,
    takes_part,
)

from applications.key_distribution import light
from hosts import network_loop
from hosts.middleware.session import protocol
from hosts.middleware.session.options import MAX_BLOCK_PAIRS, MAX_BLOCK_PULSES
from wire.device import DeviceReport
from wire.metadata.blocks import Block, Emit, Finish, Frame, Report
from wire.metadata.header import HEADER, Message
from wire.metadata.setup import Answer, Setup
from wire.metadata.values import Envelope, Topic, Values
from wire.metadata.vocabulary import Reason, Service, Verdict
from wire.parameters.physics import Device, Memory, PairSource

services = pytest.mark.parametrize("service", SERVICES)
Fits = Callable[[str, Message], bool]


def happens(
    folder: Path, service: str, options: dict[str, Any] | None = None, **physics: Any
) -> tuple[Outcome, Outcome]:
    """Have one session; return the results of alice and bob."""

    async def run() -> tuple[Outcome, Outcome]:
        async with running(folder, service, **physics):
            return await asyncio.to_thread(session, folder, service, **(options or {}))

    return network_loop.run(run())


def broken(
    folder: Path, service: str, change: Once, sockets: Sockets | None = None, **physics: Any
) -> tuple[Outcome, Outcome]:
    """Have a session that a change breaks, then one of the same kind that works."""

    async def run() -> tuple[Outcome, Outcome]:
        async with running(folder, service, change=change, **physics):
            report = await asyncio.to_thread(session, folder, service, sockets)
            assert change.done
            again = await asyncio.to_thread(session, folder, service)
            assert [each.text for each in again] == ["", ""]
            return report

    return network_loop.run(run())


@pytest.mark.by_day(every=2)
@services
def test_a_host_that_hears_late_of_its_light_does_not_take_it_for_lost(
    tmp_path: Path, service: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As if it had been too busy for its whole patience: the dispatcher knows what has come."""
    monkeypatch.setattr(protocol, "GRACE_S", -1.0)
    monkeypatch.setattr(light, "KEY_GRACE_S", -1.0)
    alice, bob = happens(tmp_path, service)
    assert (alice.text, bob.text) == ("", "")


def first_answer(way: str, _message: Message) -> bool:
    return way == "back"


def first_message(way: str, _message: Message) -> bool:
    return way == "forth"


def first_report(way: str, message: Message) -> bool:
    """The acceptor, whose application has accepted, tells something of the light."""
    able = getattr(message, "topic", 0) == Topic.NODE_FEATURES
    return way == "back" and not isinstance(message, Answer) and not able


def request_of_light(_way: str, message: Message) -> bool:
    return isinstance(message, Emit) or getattr(message, "topic", 0) == Topic.COMING


def light_is_there(way: str, message: Message) -> bool:
    """Photons are in memories, or measured."""
    report = getattr(message, "topic", 0) in (Topic.ARRIVED, Topic.OVER)
    return way == "forth" and (report or isinstance(message, Block))


def third_block(_way: str, message: Message) -> bool:
    return getattr(message, "block", 0) >= 3


def last_message(way: str, message: Message) -> bool:
    return way == "forth" and isinstance(message, Finish)


MOMENTS = [
    first_answer,
    first_message,
    first_report,
    request_of_light,
    light_is_there,
    last_message,
]
moments = pytest.mark.parametrize("moment", MOMENTS, ids=lambda moment: moment.__name__)


@pytest.mark.by_day(every=6)
@services
@moments
def test_a_peer_that_is_gone_is_named_at_both_ends(
    tmp_path: Path, service: str, moment: Fits
) -> None:
    sockets: Sockets = {}

    async def cut(_message: Message) -> None:
        if moment is not first_answer:  # by then bob's stack has been asked
            await takes_part("bob", sockets)

    alice, bob = broken(tmp_path, service, Once(moment, cut), sockets)
    assert "is gone: " in alice.text
    assert "bob (127." in alice.text or "charlie (127." in alice.text
    if moment is not first_answer:
        assert "gone" in bob.text


class LastWord:
    """Fits the answer to the last message."""

    def __init__(self) -> None:
        self._finished = False

    def __call__(self, way: str, message: Message) -> bool:
        self._finished = self._finished or last_message(way, message)
        return self._finished and way == "back"


@pytest.mark.by_day(every=2)
@services
def test_without_the_last_answer_nobody_takes_the_session_for_ended_well(
    tmp_path: Path, service: str
) -> None:
    alice, _bob = broken(tmp_path, service, Once(LastWord(), lambda _message: None))
    assert "is gone" in alice.text


@pytest.mark.parametrize(
    "wrong",
    [{"sha256": sha256(DATA[::-1]).digest()}, {"size": len(DATA) - 1}],
    ids=["digest", "size"],
)
def test_bytes_that_are_not_those_that_were_sent_are_told_to_both_ends(
    tmp_path: Path, wrong: dict[str, Any]
) -> None:
    """The last message has the right size with the digest of other bytes, or the reverse."""
    change = Once(last_message, lambda message: replace(message, **wrong))
    for report in broken(tmp_path, "sdc", change):
        assert report.error is not None
        assert report.error.reason == Reason.WRONG_DIGEST
        size = wrong.get("size", len(DATA))
        assert report.text == f"{len(DATA)} of {size} bytes arrived, or their SHA-256 differs"


def of_another_session(message: Message) -> Message:
    return replace(message, session=message.session ^ 1)


@pytest.mark.by_day(every=6)
@services
@moments
def test_a_message_of_another_session_is_refused_by_its_number(
    tmp_path: Path, service: str, moment: Fits
) -> None:
    alice, bob = broken(tmp_path, service, Once(moment, of_another_session))
    assert "over a connection of session" in alice.text + bob.text
    assert "was it made up, or sent again?" in alice.text


FORGED: dict[str, Callable[[Message], Any]] = {
    "set-up": lambda message: Setup(message.session, Service.SDC, 1, "10.0.0.3", 1, 1, 1),
    "emit": lambda message: Emit(message.session, 1, 10, 1000),
    "block": lambda message: Block(message.session, 9, 4, 0, 1, (Frame(9, 1, 0),)),
    "report": lambda message: Report(message.session, 9, 10),
    "values": lambda message: Values(message.session, 200, 8, 9, 1, b"\1"),
    "envelope": lambda message: Envelope(message.session, Topic.KEYS, b"GET / HTTP/1.1\r\n"),
    "refusal": lambda message: Answer(message.session, Reason.TOO_NOISY, "too noisy: go away"),
    "device report": lambda message: DeviceReport(message.session),
    "rubbish": lambda _message: Raw(b"GET / HTTP/1.1\r\n\r\n"),
    "unknown kind": lambda message: Raw(message.encode()[:3] + b"\x63" + message.encode()[4:]),
    "too long": lambda message: Raw(message.encode()[:4] + b"\xff" * 4 + message.encode()[8:]),
}


@pytest.mark.by_day(every=12)
@services
@pytest.mark.parametrize("moment", [first_message, first_report], ids=lambda m: m.__name__)
@pytest.mark.parametrize("forged", list(FORGED))
def test_what_has_no_place_in_a_session_ends_it(
    tmp_path: Path, service: str, moment: Fits, forged: str
) -> None:
    alice, bob = broken(tmp_path, service, Once(moment, FORGED[forged]))
    assert alice.text
    assert bob.text
    for report in (alice, bob):
        assert report.error is not None
        assert report.error.reason != Reason.OK


@pytest.mark.by_day(every=6)
@services
@pytest.mark.parametrize("size", [1, HEADER.size, -1])
@pytest.mark.parametrize("moment", [first_message, first_report], ids=lambda m: m.__name__)
def test_a_connection_that_ends_within_a_message_is_told(
    tmp_path: Path, service: str, moment: Fits, size: int
) -> None:
    sockets: Sockets = {}

    async def end_within(message: Message) -> Last:
        await takes_part("bob", sockets)  # who would hear of no session if it were over before
        return Last(message.encode()[:size])

    for report in broken(tmp_path, service, Once(moment, end_within), sockets):
        assert "is gone: " in report.text


@pytest.mark.parametrize(
    ("service", "node"),
    [
        ("sdc", "charlie"),
        ("teleport", "charlie"),
        ("distribute", "charlie"),
        ("bbm92", "charlie"),
    ],
)
def test_a_source_that_is_too_slow_is_named_with_its_rate(
    tmp_path: Path, service: str, node: str
) -> None:
    devices = {node: Device(source=PairSource(max_rate_hz=1e6))}
    alice, bob = happens(tmp_path, service, devices=devices)
    for report in (alice, bob):
        assert "rate_hz 50000000 is more than the source" in report.text
        assert "max_rate_hz 1e+06; lower the rate" in report.text
    assert alice.error is not None
    assert alice.error.reason == Reason.HARDWARE
    slower = {"rate_hz": 1_000_000}
    other = tmp_path / "2"  # a socket has a short name
    other.mkdir()
    assert [report.text for report in happens(other, service, slower, devices=devices)] == ["", ""]


@pytest.mark.by_day(every=3)
@services
@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"block_pairs": MAX_BLOCK_PAIRS + 1}, ": choose "),
        ({"block_pairs": 0}, "block_pairs 0: choose "),
        ({"rate_hz": 1, "block_pairs": 500, "count": 500}, "take more than 5 s: choose smaller"),
        ({"rate_hz": 1 << 32}, "rate_hz 4294967296: choose 1 to 4000000000"),
    ],
)
def test_more_than_any_source_makes_is_refused_before_anything_is_sent(
    tmp_path: Path, service: str, options: dict[str, Any], words: str
) -> None:
    if service == "sdc":
        options = {name: value for name, value in options.items() if name != "count"}
    if service in ("bb84", "bbm92") and "count" not in options and options.get("block_pairs"):
        options = {"block_pairs": MAX_BLOCK_PULSES + 1}
    alice, bob = happens(tmp_path, service, options)
    assert words in alice.text
    assert bob.text == NOBODY


@pytest.mark.parametrize(
    ("service", "node", "words", "reason"),
    [
        ("teleport", "alice", "exceed the capacity of alice's memory, 100", Reason.HARDWARE),
        ("teleport", "bob", "exceed the capacity of bob's memory, 100", Reason.HARDWARE),
        # Pairs that stay in memory are counted before there is any light.
        ("distribute", "alice", "memory of alice, 100 qubits", Reason.UNSUPPORTED),
        ("distribute", "bob", "memory of bob, 100 qubits", Reason.UNSUPPORTED),
    ],
)
def test_a_full_memory_is_told_at_both_ends_by_node_and_capacity(
    tmp_path: Path, service: str, node: str, words: str, reason: Reason
) -> None:
    devices = {node: Device(memory=Memory(capacity=100))}
    for outcomes in happens(tmp_path, service, devices=devices):
        assert words in outcomes.text
        assert outcomes.error is not None
        assert outcomes.error.reason == reason


@pytest.mark.parametrize("service", ["sdc", "bb84", "bbm92"])
def test_what_stores_nothing_needs_no_memory(tmp_path: Path, service: str) -> None:
    devices = {name: Device(memory=Memory(capacity=0)) for name in ("alice", "bob")}
    assert [outcomes.text for outcomes in happens(tmp_path, service, devices=devices)] == ["", ""]


ASKED: list[tuple[dict[str, Any], str]] = [
    ({"verdict": Verdict.PENDING}, "no controller has granted the light path; is c0 running"),
    ({"verdict": Verdict.REFUSED, "reason": Reason.BUSY}, "another session uses these fibres"),
    ({"verdict": Verdict.REFUSED, "reason": Reason.NOT_ALLOWED}, "policy does not allow"),
    ({"port": 8}, "no application listens on port 8; start it first"),
    ({"wavelength_pm": 1}, "wavelength 1 pm"),
    ({"memory": 3}, "memory 3 for "),
    ({"polarization": 4}, "polarisation basis 4: only 0 is offered"),
    ({"phase_mrad": -5}, "phase -5: only 0 is offered"),
    ({"pairs": (1 << 32) - 1}, "4294967295 pairs"),
]


@pytest.mark.by_day(every=9)
@services
@pytest.mark.parametrize(("asked", "words"), ASKED)
def test_a_set_up_that_cannot_be_served_is_refused_by_its_value(
    tmp_path: Path, service: str, asked: dict[str, Any], words: str
) -> None:
    def judge(setup: Setup) -> Setup:
        opening = setup.service != Service.PAIR_SOURCE
        return replace(setup, **{"verdict": Verdict.GRANTED, **(asked if opening else {})})

    alice, bob = happens(tmp_path, service, judge=judge)
    assert words in alice.text
    assert bob.text == NOBODY


@pytest.mark.parametrize(
    "service", sorted({*SERVICES} - {"bb84", "conference", "ghz", "graph", "sense"})
)
def test_a_source_that_is_refused_is_told_to_both_ends(tmp_path: Path, service: str) -> None:
    def judge(setup: Setup) -> Setup:
        if setup.service == Service.PAIR_SOURCE:
            return replace(setup, verdict=Verdict.REFUSED, reason=Reason.UNKNOWN_SESSION)
        return replace(setup, verdict=Verdict.GRANTED)

    for outcomes in happens(tmp_path, service, judge=judge):
        assert "the controller knows no such session" in outcomes.text


@pytest.mark.by_day(every=6)
@services
@pytest.mark.parametrize("gone", ["alice", "bob"])
@pytest.mark.parametrize("moment", [first_message, first_report, third_block])
def test_an_application_that_goes_in_mid_session_ends_it_for_both(
    tmp_path: Path, service: str, gone: str, moment: Fits
) -> None:
    sockets: Sockets = {}

    async def close(message: Message) -> Message:
        # In a thread: it waits for the stack, which is of this loop.
        await asyncio.to_thread((await takes_part(gone, sockets)).close)
        return message

    async def run() -> tuple[Outcome, Outcome]:
        change = Once(moment, close)
        longer = {"data": DATA * 20} if service == "sdc" else {"count": 30_000}
        async with running(tmp_path, service, change=change):
            report = await asyncio.to_thread(session, tmp_path, service, sockets, **longer)
            assert change.done
            again = await asyncio.to_thread(session, tmp_path, service)
            assert [each.text for each in again] == ["", ""]
            return report

    alice, bob = network_loop.run(run())
    assert alice.text
    assert bob.text
    if gone == "bob":
        assert "the receiving application has ended" in alice.text
