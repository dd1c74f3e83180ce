"""Sessions that go back on the light of another: granted beside it, and ended with it."""

from dataclasses import replace
from typing import Any

import pytest
from arbiter_scene import LATER, answer, ask, granted, notes, opened
from metadata_scene import ALICE, BOB, CHARLIE, FRAMED, PAIR_SOURCE, Q1, S1, arbiter, frame

from controller_apps.light.optics import SwitchOptics, SwitchPort
from controller_apps.light.paths import Hop, HostPort
from controller_apps.policy.policy import Tap
from controller_apps.policy.reading import parse_policy
from controller_apps.sessions.actions import ClosePaths, Note
from controller_apps.sessions.arbiter import Arbiter
from controller_apps.sessions.permission import Permission
from controller_apps.sessions.terms import UNFILTERED
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Reason, Service, Verdict
from wire.optical import ANY_PORT, PathOptics

BACK = replace(FRAMED, session=8, service=Service.SDC_RETURN)
BACKWARDS: dict[str, Any] = {"source": BOB, "destination": ALICE, "sport": 50000}
EVE = "10.0.0.5"


def scene(rotation: int = 0) -> Arbiter:
    """Return an arbiter of a network in which alice has two fibres."""
    state = arbiter(rotation)
    state.network.attach(SwitchPort(Q1, 6), HostPort("alice", ALICE, "alice-q1"))
    return state


def refused(state: Arbiter, setup: Setup, **tcp: Any) -> Reason:
    message = answer(ask(state, setup, **tcp))
    assert message.verdict == Verdict.REFUSED
    return Reason(message.reason)


def test_a_return_adds_the_one_path_from_the_receiver_to_the_sender() -> None:
    state = scene()
    granted(state)
    assert opened(ask(state, BACK, **BACKWARDS)).hops == (Hop(Q1, 2, 6),)


def test_its_pairs_are_asked_of_the_source_by_who_opened_it() -> None:
    state = scene()
    granted(state)
    granted(state, BACK, **BACKWARDS)
    asked = replace(PAIR_SOURCE, session=8), replace(PAIR_SOURCE, session=8)
    mine = answer(ask(state, asked[0], source=BOB, destination=CHARLIE, sport=50001))
    assert mine.verdict == Verdict.GRANTED
    assert refused(state, asked[1], destination=CHARLIE, sport=50002) == Reason.UNKNOWN_SESSION


def test_its_rotation_is_that_of_all_paths_of_its_pairs() -> None:
    state = scene()
    # From charlie to alice X, from charlie to bob Z, and the paths between these differ.
    ways = {(4, 1): 1, (5, 2): 2, (1, 3): 3, (2, 6): 0}
    state.network.optics.switches[Q1] = SwitchOptics(
        PathOptics(ANY_PORT, ANY_PORT, 0, 0),
        {way: PathOptics(*way, 0, rotation) for way, rotation in ways.items()},
    )
    assert granted(state).rotation == 1 ^ 3 ^ 2
    assert granted(state, BACK, **BACKWARDS).rotation == 1 ^ 2 ^ 0


# Each path turns by 1; a tap makes two paths of one, on the way there only.
@pytest.mark.parametrize(
    ("between", "rotation"),
    [
        (("alice", "bob"), 1 ^ 1 ^ 1),
        (("alice", "charlie"), 1 ^ 1 ^ 1 ^ 1),
        (("bob", "charlie"), 1 ^ 1 ^ 1 ^ 1),
    ],
)
def test_a_tap_counts_where_the_pairs_of_a_return_pass_it(
    between: tuple[str, str], rotation: int
) -> None:
    state = scene(rotation=1)
    state.network.attach(SwitchPort(Q1, 7), HostPort("eve", EVE, "eve-q0"))
    state.network.attach(SwitchPort(Q1, 8), HostPort("eve", EVE, "eve-q1"))
    state.follow(replace(UNFILTERED, taps=(Tap(between, "eve"),)))
    granted(state)
    state.follow(replace(UNFILTERED, taps=()))
    assert granted(state, BACK, **BACKWARDS).rotation == rotation


@pytest.mark.parametrize(
    "other",
    [replace(BACK, source="10.0.0.9"), replace(BACK, wavelength_pm=1_530_000)],
)
def test_a_return_needs_a_session_of_the_same_light(other: Setup) -> None:
    state = scene()
    missing = Reason.UNKNOWN_SESSION
    assert refused(state, BACK, **BACKWARDS) == missing
    granted(state)
    assert refused(state, other, source=BOB, destination=ALICE, sport=50001) == missing
    assert refused(state, BACK, source=ALICE, destination=BOB, sport=50002) == missing


def test_a_session_that_is_not_granted_yet_has_no_return() -> None:
    state = scene()
    ask(state, FRAMED)
    assert refused(state, BACK, **BACKWARDS) == Reason.UNKNOWN_SESSION


def test_there_is_one_return_at_a_time() -> None:
    state = scene()
    granted(state)
    granted(state, BACK, **BACKWARDS)
    again = replace(BACK, session=9)
    assert refused(state, again, source=BOB, destination=ALICE, sport=50009) == Reason.BUSY


def test_a_return_ends_with_the_session_of_its_light() -> None:
    state = scene()
    granted(state)
    granted(state, BACK, **BACKWARDS)
    ended = state.segment_arrived(S1, 1, frame(flags="FA", seq=LATER), 1.0)
    assert {action.session for action in ended if isinstance(action, ClosePaths)} == {7, 8}
    assert Note("torn_down", 8, detail="the session of its light is over") in ended
    assert not state.sessions.by_number
    assert not state.sessions.occupied


def test_a_session_goes_on_without_its_return() -> None:
    state = scene()
    granted(state)
    granted(state, BACK, **BACKWARDS)
    over = state.segment_arrived(S1, 1, frame(flags="FA", seq=LATER, **BACKWARDS), 1.0)
    assert notes(over) == ["torn_down"]
    assert list(state.sessions.by_number) == [7]


def test_the_policy_judges_a_return_as_what_it_is_a_return_of() -> None:
    state = scene()
    granted(state)
    text = "[filter]\nnumbers = false\n[[rule]]\naction = 'deny'\nservice = 'sdc'\nfrom = 'bob'\n"
    permission = Permission(parse_policy(text), state.network, state.sessions)
    request = opened(ask(state, BACK, **BACKWARDS))
    session = state.sessions.by_number[request.session]
    assert permission.objection(BACK, session.owner) == "rule 1 denies it"
    with pytest.raises(ValueError, match="'sdc_return'"):
        parse_policy("[[rule]]\naction = 'deny'\nservice = 'sdc_return'\n")
