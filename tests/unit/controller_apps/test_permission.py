"""The policy between a set-up message and the paths it asks for."""

from dataclasses import replace

import pytest
from metadata_scene import (
    ALICE,
    BOB,
    CHARLIE,
    FRAMED,
    ONE_PAIR,
    PAIR_SOURCE,
    PER_PAIR,
    S1,
    arbiter,
    frame,
)

from controller_apps.light.optics import SwitchPort
from controller_apps.packets import parse_segment
from controller_apps.policy.reading import parse_policy
from controller_apps.sessions.actions import Action, Drop, Forward, Note, OpenPaths
from controller_apps.sessions.admission import Admission
from controller_apps.sessions.arbiter import Arbiter
from controller_apps.sessions.permission import Permission
from wire.metadata.decoding import decode
from wire.metadata.header import session_number
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Reason, Service, Verdict

ANY_NUMBER = "\n[filter]\nnumbers = false\n"


def under(policy: str, numbers: str = ANY_NUMBER) -> tuple[Arbiter, Permission]:
    """Return an arbiter that keeps to a policy."""
    state = arbiter()
    permission = Permission(parse_policy(policy + numbers), state.network, state.sessions)
    state.terms.forbid = lambda setup, connection: (
        Admission(Reason.NOT_ALLOWED) if permission.objection(setup, connection) else None
    )
    return state, permission


def ask(state: Arbiter, setup: Setup, sport: int = 40000, destination: str = BOB) -> list[Action]:
    segment = frame(setup.encode(), sport=sport, destination=destination)
    return state.segment_arrived(S1, 1, segment, 0.0)


def refused(actions: list[Action]) -> Reason | None:
    """Return why the set-up was refused, None if it was not."""
    for action in actions:
        if isinstance(action, Forward):
            answer = decode(parse_segment(action.frame).payload)
            assert isinstance(answer, Setup)
            return Reason(answer.reason) if answer.verdict == Verdict.REFUSED else None
    return None


def test_what_is_denied_opens_nothing_and_says_so() -> None:
    state, _ = under("default = 'deny'")
    actions = ask(state, FRAMED)
    assert refused(actions) == Reason.NOT_ALLOWED
    assert not [action for action in actions if isinstance(action, OpenPaths)]
    assert Note("refused", FRAMED.session, detail="NOT_ALLOWED", at=SwitchPort(S1, 1)) in actions
    assert not state.sessions.by_number


def test_hosts_are_known_by_the_names_they_announce() -> None:
    rule = "[[rule]]\naction = 'deny'\nfrom = '{}'\nto = 'bob'\nsource = 'charlie'"
    assert refused(ask(under(rule.format("alice"))[0], FRAMED)) == Reason.NOT_ALLOWED
    assert refused(ask(under(rule.format("10.0.0.1"))[0], FRAMED)) == Reason.NOT_ALLOWED
    assert refused(ask(under(rule.format("eve"))[0], FRAMED)) is None


def test_a_host_without_fibres_is_unknown_whatever_the_policy() -> None:
    state, _ = under("default = 'deny'")
    assert refused(ask(state, replace(FRAMED, source="10.0.0.77"))) == Reason.UNKNOWN_HOST


def test_an_open_session_counts_and_its_pair_source_is_free() -> None:
    state, _ = under("default = 'deny'\n[[rule]]\naction = 'allow'\nto = 'bob'\nmax_sessions = 1")
    assert refused(ask(state, PER_PAIR)) is None
    assert refused(ask(state, ONE_PAIR, sport=40001)) is None
    assert refused(ask(state, PAIR_SOURCE, sport=40002, destination=CHARLIE)) is None
    other = replace(PER_PAIR, session=8)
    assert refused(ask(state, other, sport=40003)) == Reason.NOT_ALLOWED


@pytest.mark.parametrize("limit", ["max_rate_hz = 1", "default = 'deny'"])
def test_a_new_policy_holds_for_the_next_pair(limit: str) -> None:
    state, permission = under("")
    assert refused(ask(state, PER_PAIR)) is None
    rule = limit if "default" in limit else f"[[rule]]\naction = 'allow'\n{limit}"
    permission.policy = parse_policy(rule + ANY_NUMBER)
    assert refused(ask(state, ONE_PAIR, sport=40001)) == Reason.NOT_ALLOWED


def test_a_session_has_a_number_of_its_opener() -> None:
    """A host that takes the next number of another would keep it out of its own session."""
    own, anothers = session_number(ALICE, 1), session_number(CHARLIE, 1)
    for number, reason in ((anothers, Reason.NOT_ALLOWED), (7, Reason.NOT_ALLOWED), (own, None)):
        assert refused(ask(under("", "")[0], replace(FRAMED, session=number))) == reason
        assert refused(ask(under("")[0], replace(FRAMED, session=number))) is None


@pytest.mark.parametrize(
    "service",
    [Service["GHZ"], Service["GRAPH"], Service["SENSE"], Service["CONFERENCE"]],
    ids=lambda at: at.name,
)
def test_a_host_in_a_line_goes_on_with_the_number_of_the_host_before_it(service: Service) -> None:
    first = replace(FRAMED, service=service, session=session_number(CHARLIE, 1))
    after = replace(first, session=first.session + 1)
    state, permission = under("", "")

    def asks(setup: Setup, source: str, destination: str) -> bool:
        segment = parse_segment(frame(setup.encode(), source=source, destination=destination))
        return permission.objection(setup, segment.five_tuple) == ""

    assert not asks(after, ALICE, BOB)  # of a line that there is not
    segment = frame(first.encode(), source=CHARLIE, destination=ALICE)
    assert not any(isinstance(each, Drop) for each in state.segment_arrived(S1, 3, segment, 0.0))
    assert state.sessions.by_number.keys() == {first.session}
    assert asks(after, ALICE, BOB)
    assert not asks(after, BOB, ALICE)  # which nobody has asked
    assert not asks(replace(after, service=Service["TELEPORT"]), ALICE, BOB)
    assert not asks(replace(after, session=after.session + 1), ALICE, BOB)
