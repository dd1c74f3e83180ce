"""A controller takes over from one that has died: by the arbiter alone, a new one each time."""

from dataclasses import replace
from typing import Any

import pytest
from metadata_scene import (
    ALICE,
    BOB,
    CHARLIE,
    FIBERS,
    FRAMED,
    IDLE_S,
    ONE_PAIR,
    PAIR_SOURCE,
    PER_PAIR,
    Q1,
    S1,
    arbiter,
    frame,
    payload_of,
)

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Hop
from controller_apps.packets import FiveTuple
from controller_apps.sessions.actions import (
    Action,
    AddBypass,
    ClosePaths,
    Command,
    Drop,
    Forget,
    Forward,
    Keep,
    Note,
    OpenPaths,
    RemoveBypass,
)
from controller_apps.sessions.arbiter import Arbiter
from controller_apps.sessions.snapshot import decode_session
from controller_apps.timeouts import DISCOVERY_S, HELD_UP_S, NODE_TIMEOUT_S, SWITCH_GRACE_S
from wire.device import SessionQuery
from wire.malformed import MalformedPacket
from wire.metadata.decoding import decode
from wire.metadata.header import METADATA_PORT
from wire.metadata.setup import SETUP_LENGTH, Setup
from wire.metadata.vocabulary import Reason

LATER = 100 + SETUP_LENGTH
OWNER = FiveTuple(ALICE, 40000, BOB, METADATA_PORT)
SOURCE = FiveTuple(ALICE, 41000, CHARLIE, METADATA_PORT)
HOPS = (Hop(Q1, 4, 1), Hop(Q1, 1, 3), Hop(Q1, 5, 2))
RESTART = 1000.0  # long after anybody was seen last


def arrive(state: Arbiter, data: bytes, now: float) -> list[Action]:
    return state.segment_arrived(S1, 1, data, now)


def ask(state: Arbiter, setup: Setup, now: float, **tcp: Any) -> list[Action]:
    return arrive(state, frame(setup.encode(), **tcp), now)


def answer(actions: list[Action]) -> Setup:
    (sent,) = [action for action in actions if isinstance(action, Forward)]
    message = decode(payload_of(sent.frame))
    assert isinstance(message, Setup)
    return message


def kept(setup: Setup = FRAMED, rotation: int = 0, seen: float = 0.0, source: bool = True) -> bytes:
    """Return what a controller keeps of a session and of the connection to its source."""
    state = arbiter(rotation)
    actions = ask(state, setup, seen)
    for action in list(actions):
        if isinstance(action, OpenPaths):
            actions += state.barrier_passed(Q1, action.transaction, seen)
    if source:
        pairs = replace(PAIR_SOURCE, handshake=setup.handshake)
        actions += ask(state, pairs, seen, destination=CHARLIE, sport=41000)
    return [action.data for action in actions if isinstance(action, Keep)][-1]


def successor(*data: bytes, now: float = RESTART, switches: bool = True) -> Arbiter:
    """Return a new arbiter that takes over; q1 is here, but has not reported its entries."""
    state = arbiter()
    state.recovery.begun = now
    if not switches:
        state.network.connected.clear()
    for session in data:
        state.resume(decode_session(session, now), now)
    return state


def ticked(state: Arbiter, now: float) -> list[Action]:
    """Return what is due but for questions to hosts, which say nothing here."""
    return [action for action in state.tick(now) if not isinstance(action, Command)]


def confirmed() -> Arbiter:
    """Return a successor whose switches have reported that they still have all of a session."""
    state = successor(kept())
    state.entries_found(Q1, entries())
    state.bypasses_found(S1, [(FRAMED.session, OWNER)])
    assert state.network_changed(RESTART) == []
    return state


def asked(state: Arbiter, now: float) -> list[tuple[str, object]]:
    """Return what hosts are asked now."""
    return [(each.node, each.message) for each in state.tick(now) if isinstance(each, Command)]


def entries(number: int = FRAMED.session) -> list[tuple[int, Hop | None]]:
    return [(number, hop) for hop in HOPS]


def test_what_is_kept_and_noted_is_so_before_the_hosts_hear_of_it() -> None:
    state = arbiter()
    (opening,) = ask(state, FRAMED, 0.0)
    assert isinstance(opening, OpenPaths)
    granted = state.barrier_passed(Q1, opening.transaction, 0.0)
    assert [type(action) for action in granted] == [Keep, Note, Note, Forward]


def test_a_session_lives_by_its_bypass_and_ends_with_its_connection() -> None:
    state = successor(kept(rotation=3))
    assert state.entries_found(Q1, entries()) == []
    found = [(FRAMED.session, OWNER), (FRAMED.session, SOURCE)]
    assert state.bypasses_found(S1, found) == []
    assert state.network_changed(RESTART) == []
    assert ticked(state, RESTART + 10 * IDLE_S) == []
    session = state.sessions.by_number[FRAMED.session]
    assert session.hops == HOPS
    assert [path.rotation for path in session.paths] == [3, 3, 3]
    assert arrive(state, frame(flags="FA", seq=LATER), RESTART + 400) == [
        Forget(FRAMED.session),
        ClosePaths(Q1, FRAMED.session),
        RemoveBypass(S1, OWNER, FRAMED.session),
        RemoveBypass(S1, SOURCE, FRAMED.session),
        Note("torn_down", FRAMED.session, detail="FIN"),
    ]
    assert not state.sessions.occupied


def test_its_ports_are_taken_before_any_switch_has_spoken() -> None:
    state = successor(kept())
    other = ask(state, replace(FRAMED, session=8), RESTART, sport=50000)
    assert answer(other).reason == Reason.BUSY


def test_a_session_ends_by_silence_that_a_switch_tells() -> None:
    state = successor(kept())
    state.bypasses_found(S1, [(FRAMED.session, OWNER)])
    state.network_changed(RESTART)
    assert ticked(state, RESTART + SWITCH_GRACE_S) == []
    actions = state.bypass_expired(S1, OWNER, RESTART + SWITCH_GRACE_S + 1)
    assert actions[-1] == Note("torn_down", FRAMED.session, detail="idle")


def test_light_alone_keeps_no_session_that_was_silent_for_long() -> None:
    state = successor(kept())
    state.entries_found(Q1, entries())
    state.network_changed(RESTART)
    assert ticked(state, RESTART + SWITCH_GRACE_S - 0.1) == []
    actions = ticked(state, RESTART + SWITCH_GRACE_S)
    assert ClosePaths(Q1, FRAMED.session) in actions
    assert actions[-1] == Note("torn_down", FRAMED.session, detail="idle")


def test_a_session_that_was_just_granted_has_its_idle_time_to_speak() -> None:
    state = successor(kept(seen=RESTART - 1))
    state.entries_found(Q1, entries())
    state.network_changed(RESTART)
    assert ticked(state, RESTART - 1 + IDLE_S - 0.1) == []
    bypass, _forward = arrive(state, frame(b"later", seq=LATER), RESTART + 28.9)
    assert bypass == AddBypass(S1, OWNER, FRAMED.session)
    assert ticked(state, RESTART + 10 * IDLE_S) == []


def test_a_session_that_no_switch_has_kept_is_gone_and_nothing_is_opened_for_it() -> None:
    state = successor(kept(seen=RESTART - 1))
    assert state.entries_found(Q1, []) == []
    state.network_changed(RESTART)
    assert ticked(state, RESTART + SWITCH_GRACE_S - 0.1) == []
    assert ticked(state, RESTART + SWITCH_GRACE_S) == [
        Forget(FRAMED.session),
        ClosePaths(Q1, FRAMED.session),
        Note("torn_down", FRAMED.session, detail="no switch has kept it"),
    ]


def test_what_a_switch_has_lost_is_opened_once_another_confirms_the_session() -> None:
    state = successor(kept())
    assert state.entries_found(Q1, []) == []
    state.bypasses_found(S1, [(FRAMED.session, OWNER)])
    (opening,) = ticked(state, RESTART + 0.2)
    assert isinstance(opening, OpenPaths)
    assert (opening.dpid, opening.hops) == (Q1, HOPS)
    assert ticked(state, RESTART + 0.4) == []


def test_what_a_switch_holds_beside_the_paths_of_a_session_is_closed() -> None:
    state = successor(kept())
    stale = Hop(Q1, 2, 5)
    (action,) = state.entries_found(Q1, [*entries(), (FRAMED.session, stale)])
    assert isinstance(action, OpenPaths)
    assert (action.hops, action.closed) == ((), (stale,))
    assert state.entries_found(Q1, [*entries(), (99, stale)]) == [ClosePaths(Q1, 99)]


@pytest.mark.parametrize(
    ("number", "connection"),
    [(99, OWNER), (FRAMED.session, OWNER._replace(source_port=1)), (99, SOURCE)],
)
def test_a_bypass_of_no_session_is_removed(number: int, connection: FiveTuple) -> None:
    state = successor(kept())
    found = state.bypasses_found(S1, [(number, connection)])
    assert found == [RemoveBypass(S1, connection, number)]
    assert not state.sessions.by_number[FRAMED.session].confirmed


def test_light_is_not_moved_before_its_switch_is_here() -> None:
    state = successor(kept(), switches=False)
    state.network.connected.add(9)
    assert state.network_changed(RESTART) == []
    assert ticked(state, RESTART + SWITCH_GRACE_S - 0.1) == []
    actions = ticked(state, RESTART + SWITCH_GRACE_S)
    assert actions[-1] == Note("torn_down", FRAMED.session, detail="switch gone")


def test_a_fibre_that_was_cut_meanwhile_strands_the_session() -> None:
    state = successor(kept())
    state.bypasses_found(S1, [(FRAMED.session, OWNER)])
    state.entries_found(Q1, entries())
    state.network.set_fiber(SwitchPort(Q1, 1), whole=False)
    (note,) = state.network_changed(RESTART)
    assert isinstance(note, Note)
    assert note.event == "stranded"


def test_pairs_go_on_one_by_one_and_find_their_session() -> None:
    state = successor(kept(PER_PAIR))
    assert state.entries_found(Q1, entries()) == [ClosePaths(Q1, FRAMED.session)]  # of pairs past
    state.bypasses_found(S1, [(FRAMED.session, SOURCE)])
    (opening,) = ask(state, ONE_PAIR, RESTART, sport=42000)
    assert isinstance(opening, OpenPaths)
    assert opening.hops == HOPS
    granted = state.barrier_passed(Q1, opening.transaction, RESTART)
    assert answer(granted).reason == Reason.OK
    assert ticked(state, RESTART + 10 * IDLE_S) == []


def test_a_message_that_the_other_held_is_arbitrated_afresh() -> None:
    state = successor()
    assert state.entries_found(Q1, entries()) == [ClosePaths(Q1, FRAMED.session)]
    (opening,) = ask(state, FRAMED, RESTART)
    assert isinstance(opening, OpenPaths)
    assert opening.hops == HOPS


def test_what_the_other_has_answered_is_answered_alike() -> None:
    state = successor(kept(rotation=3))
    again = answer(ask(state, FRAMED, RESTART))
    assert (again.rotation, again.reason) == (3, Reason.OK)


def test_before_the_network_is_known_again_tcp_has_to_repeat() -> None:
    state = successor(switches=False)
    (dropped,) = ask(state, FRAMED, RESTART + DISCOVERY_S - 0.1)
    assert isinstance(dropped, Drop)
    assert dropped.cause == "premature"
    refusal = answer(ask(state, FRAMED, RESTART + DISCOVERY_S))
    assert refusal.reason == Reason.NO_PATH


def test_a_controller_that_takes_over_from_nobody_refuses_at_once() -> None:
    state = arbiter()
    for port in FIBERS:
        state.network.detach(SwitchPort(Q1, port))
    assert answer(ask(state, FRAMED, 0.0)).reason == Reason.UNKNOWN_HOST


def test_two_sessions_on_one_path_are_not_both_taken_over() -> None:
    state = successor(kept())
    other = decode_session(kept(replace(FRAMED, session=8)), RESTART)
    other.requests.clear()
    with pytest.raises(MalformedPacket, match="0000000000000008 is in the way"):
        state.resume(other, RESTART)
    assert list(state.sessions.by_number) == [FRAMED.session]
    with pytest.raises(MalformedPacket, match="in the way"):
        state.resume(decode_session(kept(), RESTART), RESTART)


QUESTION = SessionQuery(0, FRAMED.session)


def test_a_session_that_has_ended_unseen_is_over_as_soon_as_its_opener_says_so() -> None:
    state = confirmed()  # by a bypass, which a switch forgets after 30 s of silence
    assert asked(state, RESTART) == [(ALICE, QUESTION)]
    over = state.session_reported(FRAMED.session, ALICE, Reason.UNKNOWN_SESSION, RESTART + 0.1)
    assert over == [
        Forget(FRAMED.session),
        ClosePaths(Q1, FRAMED.session),
        RemoveBypass(S1, OWNER, FRAMED.session),
        Note("torn_down", FRAMED.session, detail="ended while no controller was there"),
    ]
    assert not state.sessions.occupied


def test_a_session_that_its_opener_is_in_lives_and_nobody_is_asked_again() -> None:
    state = confirmed()
    asked(state, RESTART)
    assert state.session_reported(FRAMED.session, ALICE, Reason.OK, RESTART + 0.1) == []
    assert state.session_reported(FRAMED.session, ALICE, Reason.UNKNOWN_SESSION, RESTART + 9) == []
    assert not asked(state, RESTART + HELD_UP_S)
    assert FRAMED.session in state.sessions.by_number


def test_who_does_not_answer_is_asked_again_and_then_the_acceptor() -> None:
    state = confirmed()
    assert asked(state, RESTART) == [(ALICE, QUESTION)]
    assert not asked(state, RESTART + NODE_TIMEOUT_S - 0.1)
    assert asked(state, RESTART + NODE_TIMEOUT_S) == [(ALICE, QUESTION)]
    assert asked(state, RESTART + HELD_UP_S) == [(BOB, QUESTION)]
    unknown = FRAMED.session, CHARLIE, Reason.UNKNOWN_SESSION
    assert state.session_reported(*unknown, RESTART + HELD_UP_S) == []  # who was not asked
    over = state.session_reported(FRAMED.session, BOB, Reason.UNKNOWN_SESSION, RESTART + HELD_UP_S)
    assert over[-1].event == "torn_down"  # type: ignore[union-attr]


def test_nobody_is_asked_for_ever_nor_about_a_session_that_is_over() -> None:
    state = confirmed()
    assert not asked(state, RESTART + 2 * HELD_UP_S)
    state = successor(kept())
    arrive(state, frame(flags="FA", seq=LATER), RESTART)
    assert not asked(state, RESTART)


def test_who_waits_for_its_light_has_it_then() -> None:
    state = confirmed()
    state.terms.queues = True
    asked(state, RESTART)
    waiting = ask(state, replace(FRAMED, session=8), RESTART, sport=50000)
    assert Note("queued", 8) in waiting
    freed = state.session_reported(FRAMED.session, ALICE, Reason.UNKNOWN_SESSION, RESTART + 0.1)
    (opening,) = (action for action in freed if isinstance(action, OpenPaths))
    assert (opening.session, opening.hops) == (8, HOPS)
