"""The sessions of a host: each once in a role, a limited number at a time, and remembered."""

from contextlib import ExitStack

import pytest

from hosts.middleware.session.errors import SessionError
from hosts.serving import active_sessions
from hosts.serving.active_sessions import MAX_SESSIONS, ActiveSessions
from wire.light import Role
from wire.metadata.vocabulary import Reason


def refusal(
    one: ActiveSessions, session: int, role: Role = Role.ACCEPTOR, opener: str = ""
) -> SessionError:
    with pytest.raises(SessionError) as caught, one.engage(session, role, opener):
        pass
    return caught.value


def test_a_session_is_there_while_it_lasts_and_never_again() -> None:
    one = ActiveSessions()
    with one.engage(7, Role.ACCEPTOR):
        assert one.sessions == {7}
        for role in (Role.OPENER, Role.ACCEPTOR):
            assert "0000000000000007 is under way here" in str(refusal(one, 7, role))
    assert one.sessions == frozenset()
    assert "0000000000000007 was here before" in str(refusal(one, 7))


def test_a_host_may_be_the_source_of_its_own_session_once() -> None:
    one = ActiveSessions()
    with one.engage(7, Role.OPENER), one.engage(7, Role.SOURCE):
        assert refusal(one, 7, Role.SOURCE).reason == Reason.BUSY
    assert refusal(one, 7, Role.SOURCE).reason == Reason.UNKNOWN_SESSION


def test_so_many_sessions_of_others_and_no_more_are_taken_at_a_time() -> None:
    one = ActiveSessions()
    with ExitStack() as stack:
        for session in range(MAX_SESSIONS):
            stack.enter_context(one.engage(session, Role.ACCEPTOR, f"10.0.0.{session % 8}"))
        report = refusal(one, MAX_SESSIONS, opener="10.0.0.9")
        assert str(report) == "64 sessions are under way here: try again when one has ended"
        stack.enter_context(one.engage(MAX_SESSIONS, Role.OPENER))  # this host's own application
    with one.engage(1000, Role.ACCEPTOR):
        pass


def test_one_peer_does_not_take_the_places_of_all_others() -> None:
    """Of 64 it has 16, as acceptor and as source; what a host opens itself is of no share."""
    one, bob, h4 = ActiveSessions(), "10.0.0.2", "10.0.0.4"
    with ExitStack() as stack:
        for session in range(16):
            role = Role.SOURCE if session % 2 else Role.ACCEPTOR
            stack.enter_context(one.engage(session, role, bob))
        report = refusal(one, 16, opener=bob)
        assert report.reason == Reason.BUSY
        assert str(report).startswith("16 sessions of 10.0.0.2 are under way here, its share: ")
        for session in range(100, 120):
            stack.enter_context(one.engage(session, Role.OPENER))
        with one.engage(200, Role.ACCEPTOR, h4):
            pass
    with one.engage(16, Role.ACCEPTOR, bob):
        pass


def test_the_oldest_are_forgotten_when_many_are_remembered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(active_sessions, "MAX_REMEMBERED", 2)
    one = ActiveSessions()
    for session in (1, 2, 3):
        with one.engage(session, Role.ACCEPTOR):
            pass
    assert refusal(one, 3)
    assert refusal(one, 2)
    with one.engage(1, Role.ACCEPTOR):
        pass
