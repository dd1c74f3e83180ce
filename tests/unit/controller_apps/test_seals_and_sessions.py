"""Seals beside sessions, and fibres that the policy closes: who has light, and by which way."""

from dataclasses import replace

import pytest
from metadata_scene import ALICE, BOB, CHARLIE, FRAMED, Q1, S1, arbiter, frame, rotating

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Hop, HostPort, Network
from controller_apps.packets import parse_segment
from controller_apps.policy.policy import CLOSE, TELL
from controller_apps.policy.reading import BadPolicy, parse_policy, require_network
from controller_apps.sessions.actions import Action, ClosePaths, Command, Forward, Note, OpenPaths
from controller_apps.sessions.arbiter import Arbiter
from controller_apps.sessions.link_monitors import LinkMonitors
from controller_apps.timeouts import PREEMPTION_S
from wire.metadata.decoding import decode
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Reason, Service
from wire.monitor_messages import PreemptMonitor

SEAL = replace(FRAMED, service=Service["SEAL"], source=ALICE)
KEYS = replace(FRAMED, service=Service["BB84"], session=8)


def ask(state: Arbiter, setup: Setup, sport: int) -> list[Action]:
    segment = frame(setup.encode(), sport=sport, destination=BOB)
    return state.segment_arrived(S1, 1, segment, 0.0)


def opened(actions: list[Action]) -> list[Hop]:
    return [hop for action in actions if isinstance(action, OpenPaths) for hop in action.hops]


def noted(actions: list[Action]) -> list[str]:
    return [action.event for action in actions if isinstance(action, Note)]


def grant(state: Arbiter, actions: list[Action]) -> None:
    """Have the switches answer what was asked of them."""
    for action in actions:
        if isinstance(action, OpenPaths):
            state.barrier_passed(action.dpid, action.transaction, 0.0)


def refused(actions: list[Action]) -> Reason:
    (answer,) = (action for action in actions if isinstance(action, Forward))
    setup = decode(parse_segment(answer.frame).payload)
    assert isinstance(setup, Setup)
    return Reason(setup.reason)


def test_a_session_waits_for_the_light_of_a_seal_where_others_are_refused() -> None:
    state = arbiter()
    watching = ask(state, SEAL, 40000)
    assert opened(watching) == [Hop(Q1, 1, 2)]
    grant(state, watching)
    waiting = ask(state, KEYS, 40001)
    assert noted(waiting) == ["queued", "wanted"]
    assert Command(ALICE, PreemptMonitor(0, SEAL.session)) in waiting
    length = len(SEAL.encode())
    fin = frame(sport=40000, seq=100 + length, flags="FA", destination=BOB)
    over = state.segment_arrived(S1, 1, fin, 1.0)
    assert opened(over) == [Hop(Q1, 1, 2)]
    assert any(isinstance(action, ClosePaths) for action in over)


def test_a_seal_that_came_while_a_session_waited_for_others_is_told_to_end_too() -> None:
    """The session waits for alice's way to bob; charlie's fibres are free, and he watches."""
    state = arbiter(queues=True)
    grant(state, ask(state, KEYS, 40000))
    assert noted(ask(state, replace(FRAMED, session=9), 40001)) == ["queued"]
    other = replace(FRAMED, service=Service["SEAL"], session=10, source=CHARLIE)
    segment = frame(other.encode(), sport=40005, source=CHARLIE, destination=ALICE)
    grant(state, state.segment_arrived(S1, 3, segment, 0.0))
    fin = frame(sport=40000, seq=100 + len(KEYS.encode()), flags="FA", destination=BOB)
    over = state.segment_arrived(S1, 1, fin, 1.0)
    assert Command(CHARLIE, PreemptMonitor(0, 10)) in over


def test_a_seal_that_is_not_given_back_is_torn_down() -> None:
    state = arbiter()
    grant(state, ask(state, SEAL, 40000))
    ask(state, KEYS, 40001)
    assert not opened(state.tick(PREEMPTION_S * 0.9))
    late = state.tick(PREEMPTION_S)
    assert noted(late)[0] == "torn_down"
    assert opened(late) == [Hop(Q1, 1, 2)]


def test_a_seal_that_has_not_begun_is_refused_at_once() -> None:
    state = arbiter()
    ask(state, SEAL, 40000)  # and no switch has answered yet
    wanted = ask(state, KEYS, 40001)
    assert noted(wanted) == ["queued", "refused", "light_after"]
    assert opened(wanted) == [Hop(Q1, 1, 2)]


def test_only_seals_in_the_way_are_told_to_end_and_once() -> None:
    state = arbiter()
    grant(state, ask(state, SEAL, 40000))
    other = replace(FRAMED, service=Service["SEAL"], session=10, source=CHARLIE)
    segment = frame(other.encode(), sport=40005, source=CHARLIE, destination=ALICE)
    grant(state, state.segment_arrived(S1, 3, segment, 0.0))
    assert len(state.sessions.by_number) == 2
    orders = [each for each in ask(state, KEYS, 40001) if isinstance(each, Command)]
    assert orders == [Command(ALICE, PreemptMonitor(0, SEAL.session))]
    assert not [each for each in state.tick(0.3) if isinstance(each, Command)]


def test_a_session_does_not_wait_for_another() -> None:
    state = arbiter()
    grant(state, ask(state, KEYS, 40000))
    assert refused(ask(state, replace(KEYS, session=9), 40001)) == Reason.BUSY


@pytest.mark.parametrize("queues", [False, True])
def test_a_seal_never_waits(queues: bool) -> None:
    state = arbiter(queues=queues)
    grant(state, ask(state, KEYS, 40000))
    assert refused(ask(state, SEAL, 40001)) == Reason.BUSY


def test_a_session_that_a_seal_is_not_alone_in_the_way_of_is_refused() -> None:
    """Alice's light to bob is a session's, charlie's to bob a seal's; BBM92 wants another way."""
    state = arbiter()
    grant(state, ask(state, KEYS, 40000))
    wanted = replace(KEYS, session=9)
    seal = replace(FRAMED, service=Service["SEAL"], session=10, source=CHARLIE)
    segment = frame(seal.encode(), sport=40005, source=CHARLIE, destination=ALICE)
    grant(state, state.segment_arrived(S1, 3, segment, 0.0))
    assert len(state.sessions.by_number) == 2
    assert refused(ask(state, wanted, 40006)) == Reason.BUSY


def triangle() -> Network:
    """Return alice at q1 and bob at q2, which are joined, and by way of q3."""
    found = Network({1, 2, 3}, names={1: "q1", 2: "q2", 3: "q3"})
    found.attach(SwitchPort(1, 1), HostPort("alice", ALICE, "alice-q0"))
    found.attach(SwitchPort(2, 1), HostPort("bob", BOB, "bob-q0"))
    for one, other in (((1, 2), (2, 2)), ((1, 3), (3, 1)), ((3, 2), (2, 3))):
        found.add_link(SwitchPort(*one), SwitchPort(*other))
    for dpid in (1, 2, 3):
        found.optics.switches[dpid] = rotating(0)
    return found


DIRECT, ROUND = [Hop(1, 1, 2), Hop(2, 2, 1)], [Hop(1, 1, 3), Hop(3, 1, 2), Hop(2, 3, 1)]
CLOSED = '[[closed]]\nbetween = ["q2", "q1"]\n'


def test_light_goes_round_a_fibre_that_is_closed() -> None:
    state = Arbiter(triangle(), 5.0, 30.0)
    assert sorted(opened(ask(state, replace(KEYS, source=ALICE), 40000))) == sorted(DIRECT)
    state = Arbiter(triangle(), 5.0, 30.0)
    state.network.closed = parse_policy(CLOSED).closed
    assert sorted(opened(ask(state, replace(KEYS, source=ALICE), 40000))) == sorted(ROUND)


def test_sessions_that_stand_are_moved_from_it() -> None:
    state = Arbiter(triangle(), 5.0, 30.0)
    grant(state, ask(state, replace(KEYS, source=ALICE), 40000))
    assert state.network_changed(1.0) == []
    state.network.closed = parse_policy(CLOSED).closed
    moved = state.network_changed(1.0)
    assert {Hop(1, 1, 3), Hop(3, 1, 2), Hop(2, 3, 1)} == set(opened(moved))


def test_an_alarm_closes_the_way_of_its_seal_and_no_other() -> None:
    state = Arbiter(triangle(), 5.0, 30.0)
    seals = LinkMonitors(state.network)
    seal = replace(SEAL, session=11)
    for setup, sport in ((seal, 40000), (replace(KEYS, source=ALICE, session=12), 40001)):
        grant(state, ask(state, setup, sport))
        seals.granted(state.sessions.by_number.get(setup.session))
        fin = frame(sport=sport, seq=100 + len(setup.encode()), flags="FA", destination=BOB)
        state.segment_arrived(S1, 1, fin, 1.0)  # over, when word of the alarm comes
    assert not state.sessions.by_number
    way = frozenset({frozenset({"q1", "q2"})})
    assert seals.watched(11, ALICE) == way
    assert not seals.watched(11, BOB)  # who has not opened it
    assert not seals.watched(12, ALICE)  # which is no seal
    seals.close(way)
    state.network.closed = seals.closed
    assert sorted(opened(ask(state, replace(KEYS, source=ALICE), 40002))) == sorted(ROUND)


@pytest.mark.parametrize(("text", "alarm"), [("", TELL), ('[seal]\nalarm = "close"\n', CLOSE)])
def test_the_policy_says_what_an_alarm_does(text: str, alarm: str) -> None:
    assert parse_policy(text).alarm == alarm
    with pytest.raises(ValueError, match="seal: alarm 'cut': choose one of tell, close"):
        parse_policy('[seal]\nalarm = "cut"\n')


def test_where_there_is_no_way_round_the_refusal_names_what_is_closed() -> None:
    state = Arbiter(triangle(), 5.0, 30.0)
    state.network.remove_link(SwitchPort(3, 1))
    state.network.closed = parse_policy(CLOSED).closed
    actions = ask(state, replace(KEYS, source=ALICE), 40000)
    assert refused(actions) == Reason.PATH_BROKEN
    (note,) = (action for action in actions if isinstance(action, Note))
    assert "the policy closes the fibres between q1 and q2" in note.detail


@pytest.mark.parametrize("between", ['"q1"', '["q1"]', '["q1", "q1"]', '["q1", 2]', '["q1", ""]'])
def test_what_is_closed_is_between_two_switches(between: str) -> None:
    with pytest.raises(ValueError, match=r"closed 1: between is .*: write between"):
        parse_policy(f"[[closed]]\nbetween = {between}\n")


def test_a_switch_that_there_is_not_is_named() -> None:
    policy = parse_policy(CLOSED)
    require_network(policy, ["q1", "q2"], "observed")
    with pytest.raises(
        BadPolicy, match="'q2' is not a quantum switch of this network: choose one of q1"
    ):
        require_network(policy, ["q1", "q3"], "observed")
