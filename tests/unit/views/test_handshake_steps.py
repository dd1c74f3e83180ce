"""The steps of a handshake, from captures and events of both layers."""

from dataclasses import replace
from pathlib import Path

import pytest
from recorded_run import (
    ALICE,
    ANSWER,
    BOB,
    GRANTED,
    MS,
    NETWORK,
    SETUP,
    START_NS,
    capture,
    captures,
    events,
    segment,
)

from qmn.results.timeline import timeline_of_run
from views.report.packets import Flight, flights, messages
from views.report.sequence import (
    METADATA,
    OPENFLOW,
    QUANTUM,
    Step,
    describe,
    handshake,
    lanes,
    switches_lane,
    together,
)
from wire import typed_json
from wire.dispatcher_pb2 import Event
from wire.leaps import LEAP, LEAPS
from wire.malformed import MalformedPacket
from wire.metadata.blocks import Block, Emission, Emit, Emitted, Finish, Frame, Report
from wire.metadata.decoding import KINDS
from wire.metadata.header import Message
from wire.metadata.values import Envelope, Topic, Values
from wire.results.run_result import NetworkFacts

THERE = (ALICE, BOB)


def test_what_happens_in_parts_of_a_switch_is_in_the_column_of_switches(tmp_path: Path) -> None:
    switches = [replace(each, memories=1, analysers=1) for each in NETWORK.switches]
    network = replace(NETWORK, switches=switches)
    captures(tmp_path)
    sent, stored = (event for event in events() if event.kind in ("send", "arrive"))
    sent.node, sent.port, stored.node, stored.port = "q1-memory1", "61001", "q2-analyser1", "60001"
    measured = next(event for event in events() if event.kind == "bell-measure")
    measured.node = "q2-analyser1"
    fault = Event(time_ns=measured.time_ns, node="q1", kind="fault", detail="stuck 1 -> 2")
    steps, _more = handshake(tmp_path, network, [sent, stored, measured, fault], 6653)
    inside = [(step.lane, step.to_lane, step.text) for step in steps if step.layer == QUANTUM]
    column = switches_lane(network)
    assert inside == [
        (column, "", "q1-memory1→q2-analyser1 100 photons, 40 lost"),
        (column, "", "q2-analyser1 bell-measure 100 Phi+=60"),
        (column, "", "q1 fault stuck 1→2"),
    ]


def test_a_message_leaves_one_host_and_reaches_the_other(tmp_path: Path) -> None:
    captures(tmp_path)
    setup, answer = flights(tmp_path, NETWORK, limit=10)
    # A retransmission is not a second message, and the message that arrived has the verdict.
    assert setup == Flight(GRANTED, "alice", "bob", START_NS, START_NS + 4 * MS)
    # It came out of bob in two segments.
    assert answer == Flight(ANSWER, "bob", "alice", START_NS + 5 * MS + 1, START_NS + 6 * MS)


def test_a_message_has_the_same_times_before_and_after_its_captures_get_them(
    tmp_path: Path,
) -> None:
    captures(tmp_path)
    leaps = ((1, 70), (2, 500), (5, 900))  # ms: by the wall, and to which instant
    packed = (LEAP.pack(START_NS + wall * MS, START_NS + to * MS) for wall, to in leaps)
    (tmp_path / LEAPS).write_bytes(b"".join(packed))
    before = flights(tmp_path, NETWORK, limit=10)
    assert [flight.arrived_ns for flight in before] == [START_NS + to * MS for to in (500, 900)]
    kept = (tmp_path / "s1-eth1.pcap").read_bytes()
    timeline_of_run(tmp_path)
    assert (tmp_path / "s1-eth1.pcap").read_bytes() != kept
    assert flights(tmp_path, NETWORK, limit=10) == before


def test_messages_are_put_together_and_taken_apart(tmp_path: Path) -> None:
    data = SETUP.encode() + ANSWER.encode()
    cut = len(SETUP.encode()) + 5
    sequence = 2**32 - 10  # it begins again at 0
    packets = [
        (0, segment(THERE, sequence, data[:cut])),
        (1, segment(THERE, (sequence + cut) % 2**32, data[cut:])),
        (2, segment(THERE, (sequence + cut) % 2**32, data[cut:])),
    ]
    capture(tmp_path / "a.pcap", packets)
    found = list(messages(tmp_path / "a.pcap"))
    assert [message for _time, _flow, _sequence, message in found] == [SETUP, ANSWER]
    assert [place for _time, _flow, place, _message in found] == [sequence, cut - 5 - 10]


def test_a_switch_may_change_the_order_of_segments(tmp_path: Path) -> None:
    data = (SETUP.encode() + ANSWER.encode()) * 3
    cuts = [*range(0, len(data), 20), len(data)]
    parts = [(cuts[n], data[cuts[n] : cuts[n + 1]]) for n in range(len(cuts) - 1)]
    # The first begins the stream; one comes again, with more behind it.
    order = [parts[0], parts[4], parts[2], parts[1], (0, data[:50]), *parts[5:], parts[3]]
    packets = [(time, segment(THERE, 7 + place, part)) for time, (place, part) in enumerate(order)]
    capture(tmp_path / "a.pcap", packets)
    found = list(messages(tmp_path / "a.pcap"))
    assert [message for *_where, message in found] == [SETUP, ANSWER] * 3
    length = len(SETUP.encode())
    assert [place - 7 for _time, _flow, place, _message in found][:2] == [0, length]


def test_rubbish_and_gaps_hide_no_later_message(tmp_path: Path) -> None:
    packets = [
        (0, segment(THERE, 1, b"rubbish")),
        (1, segment(THERE, 1000, ANSWER.encode()[:9])),
        (2, segment(THERE, 2000, SETUP.encode())),
        (3, segment(THERE, 2000 + len(SETUP.encode()), ANSWER.encode())[:-4]),  # cut
        (4, b"\0" * 60),
        (5, b""),
    ]
    capture(tmp_path / "a.pcap", packets)
    assert [message for *_where, message in messages(tmp_path / "a.pcap")] == [SETUP]


@pytest.mark.parametrize("length", range(20, 41))
def test_a_packet_that_says_it_ends_in_its_headers_has_no_message(
    tmp_path: Path, length: int
) -> None:
    """Its length by IP; with 20 bytes there is no TCP in it, with 40 no data."""
    whole = segment(THERE, 1, ANSWER.encode())
    short = whole[:16] + length.to_bytes(2) + whole[18:]
    for number, data in enumerate((short, short[: 14 + length])):
        capture(tmp_path / f"{number}.pcap", [(0, data), (1, segment(THERE, 1, SETUP.encode()))])
        assert [each for *_where, each in messages(tmp_path / f"{number}.pcap")] == [SETUP]


def test_a_capture_that_is_none_is_refused(tmp_path: Path) -> None:
    (tmp_path / "s1-eth1.pcap").write_bytes(b"no capture at all, but long enough for its header")
    with pytest.raises(MalformedPacket, match="not a pcap file"):
        flights(tmp_path, NETWORK, limit=10)


def test_both_layers_are_on_one_clock(tmp_path: Path) -> None:
    captures(tmp_path)
    steps, more = handshake(tmp_path, NETWORK, events(), 6653)
    assert [(step.time_ns - START_NS, step.lane, step.to_lane, step.text) for step in steps] == [
        (0, "alice", "bob", "Setup SDC, code none: GRANTED"),
        (MS, "s1", "c0", "packet-in: set-up held"),
        (MS + 1, "q1 … q2", "c0", "packet-in: set-up seen"),
        (2 * MS, "q1 … q2", "", "q1 open 2→3"),
        (2 * MS, "q1 … q2", "", "q2 open 1→2"),
        (2 * MS, "c0", "q1 … q2", "FLOW_MOD"),  # that to s1 is none of the path's
        (2 * MS, "c0", "q1 … q2", "barrier"),
        (3 * MS, "alice", "", "create 100"),
        (3 * MS, "alice", "bob", "100 photons, 40 lost"),
        (3 * MS, "q1 … q2", "c0", "barrier reply: path ready"),
        (4 * MS - 1, "c0", "s1", "packet-out: set-up released"),
        (5 * MS, "bob", "", "bell-measure 100 Phi+=60"),
        (5 * MS + 1, "bob", "alice", "Answer OK"),
    ]
    assert more == 0
    assert [step.arrival_ns and step.arrival_ns - START_NS for step in steps if step.to_lane] == [
        4 * MS, None, None, None, None, 4 * MS, None, None, 6 * MS,
    ]  # fmt: skip
    assert lanes(steps, NETWORK) == ["alice", "bob", "s1", "c0", "q1 … q2"]


@pytest.mark.parametrize(("names", "lane"), [(["hub"], "hub"), (["east", "west"], "east … west")])
def test_switches_of_copper_have_any_names(tmp_path: Path, names: list[str], lane: str) -> None:
    captures(tmp_path)
    network = replace(NETWORK, copper_switches=names)
    steps, _more = handshake(tmp_path, network, events(), 6653)
    held = [(step.lane, step.to_lane) for step in steps if "set-up" in step.text]
    assert held == [(lane, "c0"), ("q1 … q2", "c0"), ("c0", lane)]
    assert lanes(steps, network) == ["alice", "bob", lane, "c0", "q1 … q2"]


def test_a_result_of_earlier_does_not_name_its_switch_of_copper() -> None:
    facts = NETWORK.to_dict()
    del facts["copper_switches"]
    assert typed_json.read(NetworkFacts, facts).copper_switches == ["s1"]
    facts["copper_switches"] = ["hub"]
    assert typed_json.read(NetworkFacts, facts).copper_switches == ["hub"]


def test_what_happens_at_one_time_is_one_step() -> None:
    ways = [Step(QUANTUM, "q1", 5, f"q1 open {way}") for way in ("2→4", "5→2 X", "6→3")]
    other = Step(QUANTUM, "q1", 5, "q2 open 1→2")
    flows = [Step(OPENFLOW, "c0", 6, "FLOW_MOD", "q1")] * 3
    barrier = Step(OPENFLOW, "c0", 6, "barrier", "q1")
    answers = [Step(METADATA, "bob", time, "Answer OK", "alice", 9) for time in (7, 8)]
    assert together([*ways, other, *flows, barrier, *answers]) == [
        Step(QUANTUM, "q1", 5, "q1 open 2→4, 5→2 X, 6→3"),
        other,
        Step(OPENFLOW, "c0", 6, "FLOW_MOD × 3", "q1"),  # noqa: RUF001
        barrier,
        *answers,
    ]


def test_without_captures_quantum_events_alone_are_shown(tmp_path: Path) -> None:
    steps, more = handshake(tmp_path, NETWORK, events() * 20, 6653)
    assert {step.layer for step in steps} == {"quantum"}
    assert sum(step.moments for step in steps) <= 64
    assert more > 0


@pytest.mark.parametrize("kind", KINDS.values())
def test_every_kind_of_metadata_has_words(kind: type[Message]) -> None:
    examples = (
        SETUP,
        ANSWER,
        Emit(1, 1, 400, 5),
        Emission(1, 1, 400, 5),
        Emitted(1, 1),
        Block(1, 1, 4, 0, 0, (Frame(0, 1, 0),)),
        Report(1, 1, 4, 2, 3),
        Finish(1, 37, b"\0" * 32),
        Values(1, Topic.BASES, 2, 3, 4, b"\0"),
        Envelope(1, 200, b"own"),
    )
    (example,) = (each for each in examples if type(each) is kind)
    assert describe(example).startswith(kind.__name__)


def test_light_that_never_arrives_is_still_sent(tmp_path: Path) -> None:
    dark = [event for event in events() if event.kind != "arrive"]
    steps, _more = handshake(tmp_path, NETWORK, dark, 6653)
    assert Step("quantum", "alice", START_NS + 3 * MS, "send 100") in steps
