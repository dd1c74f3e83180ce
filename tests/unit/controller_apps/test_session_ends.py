"""How sessions end: a FIN, a RST, silence, a switch that leaves; and pairs one by one."""

from dataclasses import replace
from typing import Any

from arbiter_scene import LATER, answer, arrive, ask, cause, fin, granted, notes, opened
from metadata_scene import (
    ALICE,
    BOB,
    CHARLIE,
    FRAMED,
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
)

from controller_apps.light.optics import SwitchPort
from controller_apps.packets import FiveTuple
from controller_apps.sessions.actions import (
    AddBypass,
    ClosePaths,
    Forget,
    Forward,
    Keep,
    Note,
    RemoveBypass,
)
from controller_apps.timeouts import SWITCH_GRACE_S
from wire.metadata.header import METADATA_PORT
from wire.metadata.vocabulary import Reason, Verdict


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
    state.sessions.max_retired = 20
    ask(state, PER_PAIR)
    for number in range(60):
        sport = 2000 + number
        granted(state, replace(ONE_PAIR, block=number), sport=sport)
        arrive(state, fin(LATER, sport))
    assert len(state.sessions.retired) == 20
    assert len(state.sessions.requests) == 21
    assert not state.sessions.held
    assert not state.sessions.occupied
