"""Copies of set-up messages at quantum switches: what they are to sessions, and to light."""

import pytest
from metadata_scene import BOB, CHARLIE, FRAMED, HOLD_S, Q1, S1, frame, network

from controller_apps.light.optics import SwitchPort
from controller_apps.sessions import copies
from controller_apps.sessions.actions import Action, Drop, Forward, Note, OpenPaths
from controller_apps.sessions.arbiter import Arbiter
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Reason

COPPER = SwitchPort(Q1, 1)
ASKED = frame(FRAMED.encode())


def arbiter(needs_copies: bool = True) -> Arbiter:
    return Arbiter(network(), HOLD_S, 30.0, needs_copies=needs_copies)


def opens(actions: list[Action]) -> bool:
    return any(isinstance(action, OpenPaths) for action in actions)


def refusal(actions: list[Action]) -> Setup:
    (sent,) = [action for action in actions if isinstance(action, Forward)]
    answer = Setup.parse(FRAMED.session, sent.frame[-len(FRAMED.encode()) + 16 :])
    assert isinstance(answer, Setup)
    return answer


def test_light_waits_for_the_copy_of_its_switch_whichever_comes_first() -> None:
    copy_last, copy_first = arbiter(), arbiter()
    assert not opens(copy_last.segment_arrived(S1, 1, ASKED, 0.0))
    assert opens(copy_last.copy_arrived(COPPER, ASKED, 0.1))
    assert not opens(copy_last.copy_arrived(COPPER, ASKED, 0.2))
    assert copy_first.copy_arrived(COPPER, ASKED, 0.0) == []
    assert opens(copy_first.segment_arrived(S1, 1, ASKED, 0.1))


@pytest.mark.parametrize(
    "other",
    [
        frame(FRAMED.encode(), sport=40001),
        frame(FRAMED.encode(), source=CHARLIE),
        frame(Setup(**{**vars(FRAMED), "session": 8}).encode()),
        frame(Setup(**{**vars(FRAMED), "source": BOB}).encode()),
    ],
)
def test_a_copy_of_another_connection_or_message_opens_nothing(other: bytes) -> None:
    state = arbiter()
    assert state.segment_arrived(S1, 1, ASKED, 0.0) == []
    assert not opens(state.copy_arrived(COPPER, other, 0.1))
    assert opens(state.copy_arrived(COPPER, ASKED, 0.2))


def test_without_a_copy_a_request_is_refused_at_the_deadline_and_names_the_switch() -> None:
    state = arbiter()
    state.network.names[Q1] = "q1"
    state.segment_arrived(S1, 1, ASKED, 0.0)
    assert state.tick(HOLD_S - 0.1) == []
    answer = refusal(state.tick(HOLD_S))
    assert (answer.reason, answer.obstacle) == (Reason.SETUP_UNSEEN, "q1")
    assert not opens(state.copy_arrived(COPPER, ASKED, HOLD_S + 0.1))


def test_observed_light_waits_for_none_and_a_late_copy_is_noted_once() -> None:
    state = arbiter(needs_copies=False)
    opening = state.segment_arrived(S1, 1, ASKED, 0.0)
    assert opens(opening)
    assert state.copy_arrived(SwitchPort(9, 1), ASKED, 0.1) == []  # on no way of its light
    transaction = next(each.transaction for each in opening if isinstance(each, OpenPaths))
    state.barrier_passed(Q1, transaction, 0.2)
    noted = Note("copy_late", FRAMED.session, 500.0, at=COPPER)
    assert state.copy_arrived(COPPER, ASKED, 0.5) == [noted]
    assert state.copy_arrived(COPPER, ASKED, 0.6) == []


def test_what_is_no_setup_is_dropped_unless_it_follows_one() -> None:
    state = arbiter()
    data = frame(b"behind the set-up")
    (dropped,) = state.copy_arrived(COPPER, data, 0.0)
    assert isinstance(dropped, Drop)
    state.segment_arrived(S1, 1, ASKED, 0.0)
    assert state.copy_arrived(COPPER, data, 0.1) == []


@pytest.mark.parametrize(("others", "kept"), [(49, True), (50, False)])
def test_the_latest_early_copies_are_kept(
    others: int, kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(copies, "MAX_EARLY", 50)
    state = arbiter()
    state.copy_arrived(COPPER, ASKED, 0.0)
    for port in range(1, 1 + others):
        state.copy_arrived(COPPER, frame(FRAMED.encode(), sport=port), 0.1)
    assert opens(state.segment_arrived(S1, 1, ASKED, 0.2)) is kept
