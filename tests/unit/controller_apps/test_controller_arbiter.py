"""The arbiter: who gets light when, by segments and switch events alone."""

import random
from dataclasses import replace
from typing import Any

import pytest
from metadata_scene import (
    ALICE,
    BOB,
    CHARLIE,
    FRAMED,
    HOLD_S,
    IDLE_S,
    ONE_PAIR,
    PAIR_SOURCE,
    PER_PAIR,
    Q1,
    S1,
    arbiter,
    frame,
    from_bob,
    is_live,
    payload_of,
    rotating,
)

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Hop
from controller_apps.light.routing import Leg, Limits, cheapest_path
from controller_apps.packets.segments import FiveTuple
from controller_apps.sessions.actions import (
    Action,
    AddBypass,
    ClosePaths,
    Drop,
    Forget,
    Forward,
    Keep,
    Note,
    OpenPaths,
    RemoveBypass,
)
from controller_apps.sessions.arbiter import Arbiter
from controller_apps.timeouts import SWITCH_GRACE_S
from wire.metadata.blocks import Emit
from wire.metadata.decoding import decode
from wire.metadata.header import HEADER, METADATA_PORT
from wire.metadata.setup import SETUP_LENGTH, Setup
from wire.metadata.vocabulary import Handshake, Reason, Service, UnknownService, Verdict

PATHS = (Hop(Q1, 4, 1), Hop(Q1, 1, 3), Hop(Q1, 5, 2))
LATER = 100 + SETUP_LENGTH  # sequence number of what follows the set-up


def arrive(state: Arbiter, data: bytes, now: float = 0.0, dpid: int = S1) -> list[Action]:
    return state.segment_arrived(dpid, 1, data, now)


def ask(state: Arbiter, setup: Setup, now: float = 0.0, **tcp: Any) -> list[Action]:
    return arrive(state, frame(setup.encode(), **tcp), now)


def opened(actions: list[Action]) -> OpenPaths:
    (action,) = [action for action in actions if isinstance(action, OpenPaths)]
    return action


def answer(actions: list[Action]) -> Setup:
    (sent,) = [action for action in actions if isinstance(action, Forward)]
    message = decode(payload_of(sent.frame))
    assert isinstance(message, Setup)
    return message


def cause(actions: list[Action]) -> str:
    (dropped,) = actions
    assert isinstance(dropped, Drop)
    return dropped.cause


def notes(actions: list[Action]) -> list[str]:
    return [action.event for action in actions if isinstance(action, Note)]


def granted(state: Arbiter, setup: Setup = FRAMED, now: float = 0.0, **tcp: Any) -> Setup:
    transaction = opened(ask(state, setup, now, **tcp)).transaction
    return answer(state.barrier_passed(Q1, transaction, now))


def fin(seq: int = LATER, sport: int = 40000, destination: str = BOB) -> bytes:
    return frame(flags="FA", seq=seq, sport=sport, destination=destination)


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
        (Service.TELEPORT, PATHS[:1] + PATHS[2:]),  # nothing goes from alice to bob
        (Service.BBM92, PATHS[:1] + PATHS[2:]),
        (Service.BB84, (Hop(Q1, PATHS[1].in_port, PATHS[2].out_port),)),  # from alice, nothing else
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
        (replace(FRAMED, service=Service.TELEPORT, handshake=Handshake.PER_PAIR), Reason.PROTOCOL),
        (replace(FRAMED, service=Service.BB84, handshake=Handshake.ONE_PAIR), Reason.PROTOCOL),
    ]
    for setup, reason in cases:
        state = arbiter(rotation=1)
        actions = ask(state, setup)
        few = "alice has 1 fibre, SDC needs 2 there" if reason == Reason.NO_PATH else ""
        told = replace(setup, verdict=Verdict.REFUSED, reason=reason, obstacle=few)
        assert answer(actions) == told
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


def test_fin_tears_everything_down() -> None:
    state = arbiter()
    granted(state)
    arrive(state, frame(b"later", seq=LATER))
    connection = FiveTuple(ALICE, 40000, BOB, METADATA_PORT)
    actions = arrive(state, fin(LATER + 5))
    assert actions == [
        Forget(7),
        ClosePaths(Q1, 7),
        RemoveBypass(S1, connection, 7),
        Note("torn_down", 7, detail="FIN"),
    ]
    assert not state.sessions.by_number
    assert not state.sessions.occupied
    assert arrive(state, fin(LATER + 5)) == []  # its retransmission


def test_rst_of_either_end_tears_down() -> None:
    state = arbiter()
    granted(state)
    assert "torn_down" in notes(arrive(state, frame(flags="R", seq=LATER)))
    granted(state, sport=40001)
    assert "torn_down" in notes(arrive(state, from_bob("RA", 1, LATER, 40001)))
    assert not state.sessions.by_number


def test_a_late_fin_of_an_earlier_connection_is_ignored() -> None:
    state = arbiter()
    granted(state)
    assert arrive(state, fin(seq=50)) == []
    assert is_live(state, 7)


def test_what_tcp_repeats_after_the_end_still_passes() -> None:
    state = arbiter()
    first = granted(state)
    arrive(state, fin(LATER + 5))
    repeated = frame(b"later", seq=LATER)
    assert arrive(state, repeated, 0.5) == [Forward(S1, 1, repeated)]
    assert answer(ask(state, FRAMED, 0.5)) == first
    state.tick(IDLE_S)
    assert cause(arrive(state, repeated, IDLE_S)) == "malformed"


def test_a_close_while_held_gives_up_and_lets_the_message_pass() -> None:
    state = arbiter()
    ask(state, FRAMED)
    actions = arrive(state, fin(), 0.1)
    assert actions[0] == ClosePaths(Q1, 7)
    assert answer(actions).verdict == Verdict.REFUSED
    assert answer(actions).reason == Reason.PEER_GONE
    assert Note("refused", 7, detail="PEER_GONE: FIN", at=SwitchPort(S1, 1)) in actions
    assert not state.sessions.held


def test_a_reused_port_is_a_new_connection() -> None:
    state = arbiter()
    granted(state)
    actions = ask(state, replace(FRAMED, session=8), 0.5, seq=900_000)
    note = Note("torn_down", 7, detail="port reused")
    assert actions[:3] == [Forget(7), ClosePaths(Q1, 7), note]
    assert opened(actions).session == 8
    assert list(state.sessions.by_number) == [8]


def test_silence_tears_down() -> None:
    state = arbiter()
    granted(state, now=1.0)
    assert state.tick(1.0 + IDLE_S - 0.1) == []
    assert state.tick(1.0 + IDLE_S)[:2] == [Forget(7), ClosePaths(Q1, 7)]
    assert not state.sessions.by_number


def test_a_bypassed_session_lives_until_its_bypass_expires() -> None:
    state = arbiter()
    granted(state)
    arrive(state, frame(b"later", seq=LATER), 1.0)
    assert state.tick(500.0) == []
    connection = FiveTuple(ALICE, 40000, BOB, METADATA_PORT)
    actions = state.bypass_expired(S1, connection, 501.0)
    assert actions[:2] == [Forget(7), ClosePaths(Q1, 7)]
    assert notes(actions) == ["torn_down"]


def test_a_pair_source_connection_belongs_to_its_session() -> None:
    state = arbiter()
    transaction = opened(ask(state, FRAMED)).transaction
    early = ask(state, PAIR_SOURCE, destination=CHARLIE, sport=40999)
    assert answer(early).reason == Reason.UNKNOWN_SESSION  # not before the session is granted
    state.barrier_passed(Q1, transaction, 0.1)
    source: dict[str, Any] = {"destination": CHARLIE, "sport": 41000}
    assert answer(ask(state, PAIR_SOURCE, **source)).verdict == Verdict.GRANTED
    strangers: list[dict[str, Any]] = [
        {"destination": BOB},
        {"source": BOB, "destination": CHARLIE},
    ]
    for number, ends in enumerate(strangers):
        refusal = answer(ask(state, PAIR_SOURCE, sport=42000 + number, **ends))
        assert refusal.reason == Reason.UNKNOWN_SESSION
    later = frame(b"emit", seq=LATER, destination=CHARLIE, sport=41000)
    assert isinstance(arrive(state, later)[0], AddBypass)
    actions = arrive(state, fin(LATER + 4, 41000, CHARLIE))
    assert [type(action) for action in actions[:2]] == [Keep, RemoveBypass]
    assert is_live(state, 7)  # the session stays


def test_per_pair_opens_light_for_each_pair_alone() -> None:
    state = arbiter(rotation=2)
    assert answer(ask(state, PER_PAIR)).verdict == Verdict.GRANTED
    assert not is_live(state, 7)
    for number in range(3):
        one = replace(ONE_PAIR, block=number)
        message = granted(state, one, sport=50000 + number)
        assert message == replace(one, verdict=Verdict.GRANTED, rotation=2)
        assert len(state.sessions.occupied) == 6
        later = frame(b"later", seq=LATER, sport=50000 + number)
        assert arrive(state, later) == [Forward(S1, 1, later)]  # worth no entry
        actions = arrive(state, fin(LATER + 5, 50000 + number))
        assert actions == [ClosePaths(Q1, 7), Note("torn_down", 7, detail="FIN")]
        assert not state.sessions.occupied
    assert list(state.sessions.by_number) == [7]


def test_one_pair_needs_a_per_pair_session_of_the_same_hosts() -> None:
    state = arbiter()
    granted(state)
    assert answer(ask(state, ONE_PAIR, sport=1)).reason == Reason.UNKNOWN_SESSION
    state = arbiter()
    ask(state, PER_PAIR)
    for end in ("source", "destination"):
        other: dict[str, Any] = {"sport": 2, end: CHARLIE}
        assert answer(ask(state, ONE_PAIR, **other)).reason == Reason.UNKNOWN_SESSION
    moved = replace(ONE_PAIR, source=BOB)
    assert answer(ask(state, moved, sport=3)).reason == Reason.UNKNOWN_SESSION


def test_the_next_pair_takes_the_path_over_from_the_last() -> None:
    state = arbiter()
    ask(state, PER_PAIR)
    granted(state, ONE_PAIR, sport=50000)
    assert granted(state, ONE_PAIR, sport=50001).verdict == Verdict.GRANTED
    assert arrive(state, fin(LATER, 50000)) == [Note("torn_down", 7, detail="FIN")]
    assert is_live(state, 7)
    assert ClosePaths(Q1, 7) in arrive(state, fin(LATER, 50001))


def test_pairs_keep_their_session_alive() -> None:
    state = arbiter()
    ask(state, PER_PAIR)
    for number in range(5):
        granted(state, ONE_PAIR, now=number * 20.0, sport=50000 + number)
        assert state.tick(number * 20.0) == []
    assert "torn_down" in notes(state.tick(80.0 + IDLE_S))


def test_closing_the_session_refuses_the_pair_that_waits() -> None:
    state = arbiter()
    ask(state, PER_PAIR)
    opened(ask(state, ONE_PAIR, sport=50000))
    actions = arrive(state, fin())
    assert ClosePaths(Q1, 7) in actions
    assert answer(actions).reason == Reason.UNKNOWN_SESSION
    assert not state.sessions.held


def test_a_switch_that_stays_away_ends_sessions_and_refuses_set_ups() -> None:
    state = arbiter()
    granted(state)
    assert state.switch_left(Q1, 1.0) == []
    assert answer(ask(state, replace(FRAMED, session=8), sport=1)).reason == Reason.NO_PATH
    assert state.tick(0.9 + SWITCH_GRACE_S) == []
    assert notes(state.tick(1.0 + SWITCH_GRACE_S)) == ["torn_down"]
    state = arbiter()
    ask(state, FRAMED)
    assert answer(state.switch_left(Q1, 1.0)).reason == Reason.SWITCH_FAILED
    assert not state.sessions.occupied


def test_a_switch_that_is_soon_back_keeps_its_sessions() -> None:
    state = arbiter()
    granted(state)
    state.switch_left(Q1, 1.0)
    state.network.connected.add(Q1)
    assert state.network_changed(2.0) == []
    assert state.tick(2.0 + SWITCH_GRACE_S) == []
    assert is_live(state, 7)


def test_a_classical_switch_that_leaves_forgets_its_bypasses() -> None:
    state = arbiter()
    granted(state)
    later = frame(b"later", seq=LATER)
    arrive(state, later)
    assert state.switch_left(S1, 1.0) == []
    assert isinstance(arrive(state, later, 2.0)[0], AddBypass)


def test_many_pairs_leave_bounded_tables() -> None:
    state = arbiter()
    state.sessions.max_retired = 50
    ask(state, PER_PAIR)
    for number in range(200):
        sport = 2000 + number
        granted(state, replace(ONE_PAIR, block=number), sport=sport)
        arrive(state, fin(LATER, sport))
    assert len(state.sessions.retired) == 50
    assert len(state.sessions.requests) == 51
    assert not state.sessions.held
    assert not state.sessions.occupied
