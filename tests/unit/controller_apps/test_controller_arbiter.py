"""The arbiter: who gets light when, by segments and switch events alone."""

import random
from dataclasses import replace

import pytest
from arbiter_scene import LATER, PATHS, answer, arrive, ask, cause, fin, granted, notes, opened
from metadata_scene import (
    ALICE,
    BOB,
    FRAMED,
    HOLD_S,
    ONE_PAIR,
    PAIR_SOURCE,
    PER_PAIR,
    Q1,
    S1,
    arbiter,
    frame,
    payload_of,
    rotating,
)

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Hop
from controller_apps.light.routing import Leg, Limits, cheapest_path
from controller_apps.packets import FiveTuple
from controller_apps.sessions.actions import AddBypass, ClosePaths, Forward, Note, OpenPaths
from wire.metadata.blocks import Emit
from wire.metadata.decoding import decode
from wire.metadata.header import HEADER, METADATA_PORT
from wire.metadata.setup import SETUP_LENGTH
from wire.metadata.vocabulary import Handshake, Reason, Service, UnknownService, Verdict


def test_a_framed_set_up_opens_three_paths_and_is_held() -> None:
    (action,) = ask(arbiter(), FRAMED)
    assert isinstance(action, OpenPaths)
    assert (action.dpid, action.hops, action.session) == (Q1, PATHS, 7)


def test_the_message_is_released_only_after_the_barrier_reply() -> None:
    state = arbiter(rotation=3)
    transaction = opened(ask(state, FRAMED, 1.0)).transaction
    assert state.barrier_passed(Q1, transaction + 1, 1.1) == []
    assert state.barrier_passed(Q1 + 1, transaction, 1.1) == []
    actions = state.barrier_passed(Q1, transaction, 1.25)
    # Three paths, each turned by 3: what is left of the pair is 3 ^ 3 ^ 3.
    assert answer(actions) == replace(FRAMED, verdict=Verdict.GRANTED, rotation=3)
    assert notes(actions) == ["path_ready", "granted"]
    (ready,) = [a for a in actions if isinstance(a, Note) and a.event == "path_ready"]
    assert ready.setup_ms == pytest.approx(250)
    assert state.barrier_passed(Q1, transaction, 1.3) == []


def test_with_two_switches_the_last_barrier_reply_counts() -> None:
    state = arbiter()
    state.network.optics.switches = {Q1: rotating(1), 3: rotating(2)}
    state.network.connected.add(3)
    state.network.add_link(SwitchPort(Q1, 90), SwitchPort(3, 91))
    state.network.add_link(SwitchPort(Q1, 92), SwitchPort(3, 93))
    for name, port in (("bob-q0", 2), ("bob-q1", 3)):
        host_port = next(h for h in state.network.hosts.values() if h.name == name)
        state.network.attach(SwitchPort(3, port), host_port)
    bundles = [action for action in ask(state, FRAMED) if isinstance(action, OpenPaths)]
    assert [bundle.dpid for bundle in bundles] == [Q1, 3]
    assert bundles[0].hops == (Hop(Q1, 4, 1), Hop(Q1, 1, 90), Hop(Q1, 5, 92))
    assert bundles[1].hops == (Hop(3, 91, 3), Hop(3, 93, 2))
    assert state.barrier_passed(3, bundles[1].transaction, 0.1) == []
    message = answer(state.barrier_passed(Q1, bundles[0].transaction, 0.2))
    assert (message.verdict, message.rotation) == (Verdict.GRANTED, 1 ^ 1 ^ 1 ^ 2 ^ 2)


def test_a_retransmission_while_held_is_dropped_and_starts_nothing() -> None:
    state = arbiter()
    ask(state, FRAMED)
    assert cause(ask(state, FRAMED, 0.06)) == "repeated"
    assert cause(arrive(state, frame(FRAMED.encode() + b"coalesced"), 0.2)) == "repeated"
    assert len(state.sessions.held) == 1


def test_bytes_behind_the_message_are_left_to_tcp() -> None:
    state = arbiter()
    action = opened(arrive(state, frame(FRAMED.encode() + b"behind")))
    actions = state.barrier_passed(Q1, action.transaction, 0.1)
    assert answer(actions).verdict == Verdict.GRANTED  # exactly one message, nothing behind it


def test_a_retransmission_after_release_gets_the_identical_answer() -> None:
    state = arbiter(rotation=1)
    first = granted(state)
    actions = arrive(state, frame(FRAMED.encode() + b"coalesced", window=77), 0.3)
    assert answer(actions) == first
    assert notes(actions) == []


def test_the_answer_may_come_by_at_a_second_switch() -> None:
    state = arbiter()
    released = granted(state).encode()
    (action,) = arrive(state, frame(released), dpid=9)
    assert isinstance(action, Forward)
    assert (action.dpid, payload_of(action.frame)) == (9, released)


def test_a_verdict_from_a_host_is_forged() -> None:
    for verdict in (Verdict.GRANTED, Verdict.REFUSED):
        assert cause(ask(arbiter(), replace(FRAMED, verdict=verdict))) == "forged"
    state = arbiter()
    ask(state, FRAMED)
    assert cause(ask(state, replace(FRAMED, verdict=Verdict.GRANTED))) == "forged"
    assert cause(ask(state, replace(FRAMED, rate_hz=5))) == "forged"


def test_the_bypass_comes_with_later_data_and_once() -> None:
    state = arbiter()
    granted(state)
    later = frame(b"later", seq=LATER)
    connection = FiveTuple(ALICE, 40000, BOB, METADATA_PORT)
    assert arrive(state, later, 1.0) == [AddBypass(S1, connection, 7), Forward(S1, 1, later)]
    assert arrive(state, later, 1.1) == [Forward(S1, 1, later)]


def test_sequence_numbers_wrap() -> None:
    state = arbiter()
    granted(state, seq=0xFFFFFFF0)
    later = frame(b"later", seq=(0xFFFFFFF0 + SETUP_LENGTH) & 0xFFFFFFFF)
    assert [type(action) for action in arrive(state, later)] == [AddBypass, Forward]


def test_data_before_the_answer_is_dropped() -> None:
    state = arbiter()
    ask(state, FRAMED)
    assert cause(arrive(state, frame(b"later", seq=LATER))) == "early"
    assert cause(arrive(state, frame(b"old", seq=90))) == "early"


def test_a_segment_without_payload_passes() -> None:
    data = frame(flags="PA")
    assert arrive(arbiter(), data) == [Forward(S1, 1, data)]


def test_rubbish_is_dropped_and_changes_nothing() -> None:
    state = arbiter()
    good = FRAMED.encode()
    draw = random.Random(2)
    emit = Emit(7, 1, 10, 1000).encode()
    for rubbish in (b"GET / HTTP/1.1", good[:-1], good[:10], emit, b"QM", draw.randbytes(500)):
        assert cause(arrive(state, frame(rubbish))) == "malformed"
    for _ in range(500):
        data = bytearray(good)
        data[draw.randrange(8)] ^= 1 << draw.randrange(8)
        if bytes(data[:8]) != good[:8]:
            assert cause(arrive(state, frame(bytes(data)))) == "malformed"
    assert cause(arrive(state, b"\0" * 60)) == "malformed"
    assert not state.sessions.requests
    assert not state.sessions.by_number


@pytest.mark.parametrize("verdict", list(Verdict))
def test_a_service_that_nobody_knows_is_refused_where_the_hosts_can_say_so(
    verdict: Verdict,
) -> None:
    state, asked = arbiter(), replace(FRAMED, verdict=verdict)
    data = bytearray(asked.encode())
    data[HEADER.size] = 99
    for again in range(2):  # alike for a retransmission
        note, forward = arrive(state, frame(bytes(data)), again / 10)
        assert note == Note("refused", FRAMED.session, detail="UNSUPPORTED", at=SwitchPort(S1, 1))
        assert isinstance(forward, Forward)
        answered = bytearray(payload_of(forward.frame))
        with pytest.raises(UnknownService, match="unknown service 99: choose one of"):
            decode(bytes(answered))
        answered[HEADER.size] = FRAMED.service
        refusal = replace(FRAMED, verdict=Verdict.REFUSED, reason=Reason.UNSUPPORTED)
        assert decode(bytes(answered)) == refusal
        assert arrive(state, forward.frame, dpid=9)[1] == replace(forward, dpid=9)
    assert not state.sessions.requests
    assert not state.sessions.by_number


@pytest.mark.parametrize(
    ("service", "legs"),
    [
        (Service["TELEPORT"], PATHS[:1] + PATHS[2:]),  # nothing goes from alice to bob
        (Service["BBM92"], PATHS[:1] + PATHS[2:]),
        # From alice, nothing else.
        (Service["BB84"], (Hop(Q1, PATHS[1].in_port, PATHS[2].out_port),)),
    ],
)
def test_each_service_gets_the_light_it_needs(service: Service, legs: tuple[Hop, ...]) -> None:
    (action,) = ask(arbiter(), replace(FRAMED, service=service))
    assert isinstance(action, OpenPaths)
    assert action.hops == legs


def test_refusals_name_their_reason_and_open_nothing() -> None:
    unknown_source = replace(FRAMED, source="10.0.0.9")
    from_bob = replace(FRAMED, source=ALICE)  # alice has one fibre, a source needs two
    cases = [
        (unknown_source, Reason.UNKNOWN_HOST),
        (from_bob, Reason.NO_PATH),
        (ONE_PAIR, Reason.UNKNOWN_SESSION),
        (PAIR_SOURCE, Reason.UNKNOWN_SESSION),
        (replace(FRAMED, session=0), Reason.PROTOCOL),
        (replace(unknown_source, handshake=Handshake.PER_PAIR), Reason.UNKNOWN_HOST),
        (replace(from_bob, handshake=Handshake.PER_PAIR), Reason.NO_PATH),
        # Only superdense coding knows another handshake.
        (
            replace(FRAMED, service=Service["TELEPORT"], handshake=Handshake.PER_PAIR),
            Reason.PROTOCOL,
        ),
        (replace(FRAMED, service=Service["BB84"], handshake=Handshake.ONE_PAIR), Reason.PROTOCOL),
    ]
    for setup, reason in cases:
        state = arbiter(rotation=1)
        actions = ask(state, setup)
        few = "alice has 1 fibre, SDC needs 2 there" if reason == Reason.NO_PATH else ""
        report = replace(setup, verdict=Verdict.REFUSED, reason=reason, obstacle=few)
        assert answer(actions) == report
        assert [type(action) for action in actions] == [Note, Forward]
        assert answer(ask(state, setup, 0.2)).reason == reason  # again for a retransmission
        assert not state.sessions.by_number
        assert not state.sessions.occupied


def test_taken_ports_and_taken_session_numbers_are_busy() -> None:
    state = arbiter()
    granted(state)
    other = replace(FRAMED, session=8)
    assert answer(ask(state, other, sport=40001)).reason == Reason.BUSY
    assert answer(ask(state, FRAMED, sport=40002)).reason == Reason.BUSY
    arrive(state, fin())
    assert granted(state, other, sport=40003).verdict == Verdict.GRANTED


def test_the_other_direction_of_a_fibre_is_free() -> None:
    state = arbiter()
    granted(state)
    in_use = state.sessions.occupied
    assert len(in_use) == 6
    leg = Leg(SwitchPort(Q1, 2), SwitchPort(Q1, 4))
    path = cheapest_path(state.network, leg, Limits(in_use.__contains__))
    assert path is not None
    assert path.hops == (Hop(Q1, 2, 4),)


def test_a_full_table_refuses_with_busy() -> None:
    state = arbiter()
    state.sessions.max_sessions = 1
    assert answer(ask(state, PER_PAIR)).verdict == Verdict.GRANTED
    assert answer(ask(state, replace(PER_PAIR, session=8), sport=1)).reason == Reason.BUSY
    state.sessions.max_requests = 2
    assert answer(ask(state, replace(PER_PAIR, session=9), sport=2)).reason == Reason.BUSY
    assert len(state.sessions.requests) == 2


def test_one_host_does_not_take_the_places_of_all_others() -> None:
    state = arbiter()
    state.sessions.max_of_one = 2
    for number in (1, 2):
        assert answer(ask(state, replace(PER_PAIR, session=number), sport=number)).reason == 0
    assert answer(ask(state, replace(PER_PAIR, session=3), sport=3)).reason == Reason.BUSY
    other = ask(state, replace(PER_PAIR, session=4), sport=4, source=BOB, destination=ALICE)
    assert answer(other).reason != Reason.BUSY


def test_one_host_does_not_have_all_sessions_with_few_requests() -> None:
    """Of 4,096 it has an eighth: 512 at a time, and nobody else is refused by that."""
    state = arbiter()
    assert state.sessions.max_sessions_of_one == 512
    state.sessions.max_sessions_of_one = 2
    for number in (1, 2):
        assert answer(ask(state, replace(PER_PAIR, session=number), sport=number)).reason == 0
    refused = ask(state, replace(PER_PAIR, session=3), sport=3)
    assert answer(refused).reason == Reason.BUSY
    (note,) = [action for action in refused if isinstance(action, Note)]
    assert note.detail == f"BUSY: 2 sessions of {ALICE} are under way, its share"
    other = ask(state, replace(PER_PAIR, session=4), sport=4, source=BOB, destination=ALICE)
    assert answer(other).reason != Reason.BUSY
    arrive(state, fin(seq=100 + SETUP_LENGTH, sport=2))
    assert answer(ask(state, replace(PER_PAIR, session=5), sport=5)).reason == 0


def test_the_hold_has_a_deadline() -> None:
    state = arbiter()
    transaction = opened(ask(state, FRAMED, 1.0)).transaction
    assert state.tick(1.0 + HOLD_S - 0.01) == []
    actions = state.tick(1.0 + HOLD_S)
    assert actions[0] == ClosePaths(Q1, 7)
    assert answer(actions).reason == Reason.SWITCH_TIMEOUT
    assert not state.sessions.occupied
    assert state.barrier_passed(Q1, transaction, 7.0) == []  # too late
    assert answer(ask(state, FRAMED, 7.0)).reason == Reason.SWITCH_TIMEOUT


def test_an_error_of_the_switch_refuses() -> None:
    state = arbiter()
    transaction = opened(ask(state, FRAMED)).transaction
    actions = state.switch_refused(transaction, 0.1)
    assert actions[0] == ClosePaths(Q1, 7)
    assert answer(actions).reason == Reason.SWITCH_FAILED
    assert state.switch_refused(transaction, 0.1) == []
    assert state.barrier_passed(Q1, transaction, 0.2) == []
    assert not state.sessions.by_number
