"""A host that the policy puts on a fibre: which paths that needs, and why it may not be."""

from dataclasses import replace

import pytest
from metadata_scene import BOB, CHARLIE, FRAMED, Q1, S1, arbiter, frame

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Hop, HostPort
from controller_apps.packets import parse_segment
from controller_apps.policy.policy import Tap
from controller_apps.policy.reading import parse_policy
from controller_apps.sessions.actions import Action, Forward, Note, OpenPaths
from controller_apps.sessions.arbiter import Arbiter
from controller_apps.sessions.terms import UNFILTERED
from wire.metadata.decoding import decode
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Reason, Service, Verdict

EVE = "10.0.0.4"
BB84 = replace(FRAMED, service=Service["BB84"])
TAP = Tap(("alice", "bob"), "eve")
DIRECT = Hop(Q1, 1, 2)
BY_EVE = [Hop(Q1, 1, 6), Hop(Q1, 7, 2)]


def network_of(*fibers: str, queues: bool = False) -> Arbiter:
    """Return an arbiter with eve in its network, who has these fibres from port 6 on."""
    state = arbiter(queues=queues)
    for port, name in enumerate(fibers, 6):
        state.network.attach(SwitchPort(Q1, port), HostPort("eve", EVE, name))
    return state


def ask(state: Arbiter, setup: Setup, sport: int = 40000) -> list[Action]:
    segment = frame(setup.encode(), sport=sport, destination=BOB)
    return state.segment_arrived(S1, 1, segment, 0.0)


def opened(actions: list[Action]) -> list[Hop]:
    """Return the cross-connects that are asked for."""
    return [hop for action in actions if isinstance(action, OpenPaths) for hop in action.hops]


def reason(actions: list[Action]) -> Reason:
    """Return why a set-up was refused."""
    (answer,) = (action for action in actions if isinstance(action, Forward))
    setup = decode(parse_segment(answer.frame).payload)
    assert isinstance(setup, Setup)
    assert setup.verdict == Verdict.REFUSED
    return Reason(setup.reason)


@pytest.mark.parametrize("between", [("alice", "bob"), ("bob", "alice")])
def test_light_between_two_hosts_goes_by_way_of_the_third(between: tuple[str, str]) -> None:
    state = network_of("eve-q0", "eve-q1")
    assert opened(ask(state, BB84)) == [DIRECT]
    state = network_of("eve-q0", "eve-q1")
    state.follow(replace(UNFILTERED, taps=(Tap(between, "eve"),)))
    assert opened(ask(state, BB84)) == BY_EVE


def test_her_first_fibres_by_their_names_are_taken() -> None:
    state = network_of("eve-q10", "eve-q2", "eve-q9")
    state.follow(replace(UNFILTERED, taps=(TAP,)))
    assert opened(ask(state, BB84)) == [Hop(Q1, 1, 7), Hop(Q1, 8, 2)]


def test_only_the_legs_between_these_hosts_are_divided() -> None:
    state = network_of("eve-q0", "eve-q1")
    state.follow(replace(UNFILTERED, taps=(Tap(("charlie", "alice"), "eve"),)))
    assert opened(ask(state, replace(BB84, service=Service["BBM92"], source=CHARLIE))) == [
        Hop(Q1, 4, 6),
        Hop(Q1, 7, 1),
        Hop(Q1, 5, 2),
    ]


def test_a_host_that_nobody_has_announced_is_refused_by_name() -> None:
    state = network_of()
    state.follow(replace(UNFILTERED, taps=(TAP,)))
    actions = ask(state, BB84)
    assert reason(actions) == Reason.UNKNOWN_HOST
    report = (
        "UNKNOWN_HOST: tap between alice and bob: 'eve' is not a host that has announced a fibre; "
        "those are alice, bob, charlie"
    )
    assert Note("refused", BB84.session, detail=report, at=SwitchPort(S1, 1)) in actions
    assert not opened(actions)
    assert not state.sessions.by_number


def test_a_host_of_one_fibre_cannot_tap() -> None:
    state = network_of("eve-q0")
    state.follow(replace(UNFILTERED, taps=(TAP,)))
    actions = ask(state, BB84)
    assert reason(actions) == Reason.NO_PATH
    report = (
        "NO_PATH: tap between alice and bob: eve has 1 fibre, a tap needs 2; add one, or take "
        "the tap out of the policy"
    )
    assert Note("refused", BB84.session, detail=report, at=SwitchPort(S1, 1)) in actions
    assert not opened(actions)


def test_a_tap_that_others_use_makes_the_next_wait() -> None:
    state = network_of("eve-q0", "eve-q1", queues=True)
    state.follow(replace(UNFILTERED, taps=(TAP,)))
    assert opened(ask(state, BB84)) == BY_EVE
    actions = ask(state, replace(BB84, session=8), sport=40001)
    assert Note("queued", 8) in actions
    ended = state.segment_arrived(S1, 1, frame(flags="FA", seq=5000), 1.0)
    assert opened(ended) == BY_EVE


def test_open_sessions_stay_as_they_are_when_the_policy_changes() -> None:
    state = network_of("eve-q0", "eve-q1")
    ask(state, BB84)
    state.follow(replace(UNFILTERED, taps=(TAP,)))
    (session,) = state.sessions.by_number.values()
    assert list(session.hops) == [DIRECT]
    state.segment_arrived(S1, 1, frame(flags="FA", seq=5000), 1.0)
    assert opened(ask(state, replace(BB84, session=8), sport=40001)) == BY_EVE


def test_taps_are_read_from_the_policy() -> None:
    text = "[[tap]]\nbetween = ['alice', 'bob']\nby = 'eve'\n"
    assert parse_policy(text).taps == (TAP,)
    assert parse_policy(text + text.replace("alice", "charlie")).taps[1].between[0] == "charlie"
    assert parse_policy("").taps == ()
