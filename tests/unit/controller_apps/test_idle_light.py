"""Seals that the controller begins by itself: on which light, when, and by whose leave."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from itertools import count
from math import inf
from typing import Any

import pytest
from metadata_scene import ALICE, BOB, CHARLIE, FRAMED, S1, arbiter, frame, is_live
from test_seals_and_sessions import DIRECT, ROUND, grant, noted, opened, triangle

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Hop, Network
from controller_apps.packets import FiveTuple
from controller_apps.policy.policy import Watch
from controller_apps.policy.reading import BadPolicy, parse_policy, require_network
from controller_apps.sessions.actions import Action, Command, Note
from controller_apps.sessions.admission import Admission, find_light
from controller_apps.sessions.arbiter import Arbiter
from controller_apps.sessions.idle_light import MOST_AT_ONCE, IdleLight
from controller_apps.timeouts import DISCOVERY_S, MONITOR_BEGIN_S
from wire.metadata.header import METADATA_PORT
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Reason, Service
from wire.monitor_messages import MonitorCommand

WATCH = Watch(("alice", "bob"), every_s=10.0, pairs=2000, rate_hz=5000, false_alarm=1e-9)
SEAL = replace(FRAMED, service=Service["SEAL"], source=ALICE)
KEYS = replace(FRAMED, service=Service["BB84"], session=8)


def idle(state: Arbiter, *watches: Watch) -> IdleLight:
    """Return what watches the idle light of an arbiter; the first link monitor is session 1000."""

    def find(setup: Setup, connection: FiveTuple) -> Admission:
        return find_light(setup, connection, state.sessions, state.network, state.terms.budget_mdb)

    numbers = count(1000)
    found = IdleLight(state.network, state.sessions, find, lambda: next(numbers))
    found.follow(watches, 0.0)
    return found


def orders(actions: Iterable[Action]) -> list[tuple[str, Any]]:
    return [(each.node, each.message) for each in actions if isinstance(each, Command)]


def begin(state: Arbiter, light: IdleLight, number: int, now: float) -> list[Action]:
    """Let both hosts obey their orders, and the opener's set-up come to the controller."""
    light.node_answered(number, BOB, Reason.OK, now)
    light.node_answered(number, ALICE, Reason.OK, now)
    setup = replace(SEAL, session=number)
    sport = 41000 + number
    segment = frame(setup.encode(), sport=sport, destination=BOB)
    actions = state.segment_arrived(S1, 1, segment, now)
    grant(state, actions)
    return actions


def end(state: Arbiter, light: IdleLight, number: int, now: float) -> None:
    fin = frame(sport=41000 + number, seq=100 + len(SEAL.encode()), flags="FA", destination=BOB)
    for action in state.segment_arrived(S1, 1, fin, now):
        if isinstance(action, Note) and action.event == "torn_down":
            light.over(action.session, now)


def test_the_acceptor_is_told_first_and_the_opener_when_it_has_answered() -> None:
    light = idle(arbiter(), WATCH)
    begun = light.tick(0.0)
    order = MonitorCommand(0, 1000, ALICE, BOB, 2000, 500, 5000, 0.01, 0.25, 1e-9, 0.01)
    assert orders(begun) == [(BOB, order)]
    assert noted(begun) == ["watch"]
    assert not light.tick(0.2)
    assert not light.node_answered(1000, ALICE, Reason.OK, 0.2)
    assert orders(light.node_answered(1000, BOB, Reason.OK, 0.3)) == [(ALICE, order)]
    assert not light.node_answered(1000, BOB, Reason.OK, 0.4)  # as often as it likes


def test_seals_follow_each_other_as_often_as_the_policy_says() -> None:
    state = arbiter()
    light = idle(state, WATCH)
    assert light.next_s == 0.0
    light.tick(0.0)
    assert light.next_s == inf
    assert opened(begin(state, light, 1000, 0.5)) == [Hop(2, 1, 2)]
    assert not light.tick(30.0)  # it still watches
    end(state, light, 1000, 31.0)
    assert light.next_s == 41.0
    assert not light.tick(40.9)
    assert orders(light.tick(41.0))[0][1].monitor == 1001


@pytest.mark.parametrize("answer", [Reason.UNSUPPORTED, None])
def test_a_host_that_does_not_obey_is_asked_again_later(answer: Reason | None) -> None:
    light, now = idle(arbiter(), WATCH), 1.0
    light.tick(0.0)
    if answer is None:
        now = MONITOR_BEGIN_S
        assert not light.tick(now)
    else:
        report = light.node_answered(1000, BOB, answer, now)
        assert noted(report) == ["unwatched"]
    assert not light.tick(now + 9.9)
    assert orders(light.tick(now + 10.0))


def test_light_that_a_session_has_is_not_watched() -> None:
    state = arbiter()
    light = idle(state, WATCH)
    segment = frame(KEYS.encode(), sport=40000, destination=BOB)
    grant(state, state.segment_arrived(S1, 1, segment, 0.0))
    assert not light.tick(0.0)
    assert light.next_s == inf  # nobody knows when the session gives it back
    fin = frame(sport=40000, seq=100 + len(KEYS.encode()), flags="FA", destination=BOB)
    state.segment_arrived(S1, 1, fin, 1.0)
    assert orders(light.tick(1.2))


def test_light_that_a_session_waits_for_is_not_watched() -> None:
    state = arbiter(queues=True)
    for session, sport in ((20, 40001), (21, 40002)):
        segment = frame(replace(KEYS, session=session).encode(), sport=sport, destination=BOB)
        grant(state, state.segment_arrived(S1, 1, segment, 0.0))
    assert len(state.sessions.queue) == 1
    state.sessions.vacate(state.sessions.by_number[20])  # and nobody has been served yet
    light = idle(state, WATCH)
    assert not light.tick(0.1)
    state.sessions.queue.clear()
    assert orders(light.tick(1.2))


def test_no_tick_looks_for_more_light_than_a_few_ways_and_each_has_its_turn() -> None:
    """Each search may take a millisecond of a large network; all find alice's light taken."""
    state = arbiter()
    segment = frame(KEYS.encode(), sport=40000, destination=BOB)
    grant(state, state.segment_arrived(S1, 1, segment, 0.0))
    watches = [replace(WATCH, pairs=number) for number in range(1, 21)]
    light, asked = idle(state, *watches), Counter[int]()
    find = light.find

    def counted(setup: Setup, connection: FiveTuple) -> Admission:
        asked[setup.pairs] += 1
        return find(setup, connection)

    light.find = counted
    for tick in range(5):
        before = asked.total()
        light.tick(0.2 * tick)
        assert asked.total() - before <= MOST_AT_ONCE
    assert asked == Counter({watch.block_pairs: 1 for watch in watches})


def test_only_the_seal_that_was_ordered_needs_no_leave_of_the_policy() -> None:
    light = idle(arbiter(), WATCH)
    light.tick(0.0)
    ordered, connection = replace(SEAL, session=1000), FiveTuple(ALICE, 4, BOB, METADATA_PORT)
    assert light.ordered(ordered, connection)
    assert not light.ordered(replace(ordered, session=1001), connection)
    assert not light.ordered(replace(ordered, service=Service["BB84"]), connection)
    assert not light.ordered(replace(ordered, source=CHARLIE), connection)
    assert not light.ordered(ordered, FiveTuple(CHARLIE, 4, BOB, METADATA_PORT))
    assert not light.ordered(ordered, FiveTuple(ALICE, 4, CHARLIE, METADATA_PORT))
    light.over(1000, 1.0)
    assert not light.ordered(ordered, connection)


@pytest.mark.parametrize(
    ("over", "hops"),
    [({"q1", "q2"}, DIRECT), ({"q1", "q3"}, ROUND), ({"q3", "q2"}, ROUND), (set(), DIRECT)],
)
def test_a_seal_goes_over_the_fibre_that_it_is_to_watch(over: set[str], hops: list[Hop]) -> None:
    state = Arbiter(triangle(), 5.0, 30.0)
    light = idle(state, replace(WATCH, over=frozenset(over)))
    assert orders(light.tick(0.0))
    assert sorted(opened(begin(state, light, 1000, 0.0))) == sorted(hops)
    end(state, light, 1000, 1.0)
    assert not state.sessions.over


def broken(network: Network) -> None:
    network.set_fiber(SwitchPort(1, 3), whole=False)


def closed(network: Network) -> None:
    network.closed = frozenset({frozenset({"q1", "q3"})})


@pytest.mark.parametrize("change", [broken, closed])
def test_a_fibre_that_is_cut_or_closed_is_not_watched_and_that_is_noted_once(change: Any) -> None:
    state = Arbiter(triangle(), 5.0, 30.0)
    change(state.network)
    light = idle(state, replace(WATCH, over=frozenset({"q1", "q3"})))
    assert not light.tick(0.0)  # fibres may still be unknown
    assert not light.tick(DISCOVERY_S - 1.0)
    (note,) = light.tick(DISCOVERY_S)
    assert isinstance(note, Note)
    assert (note.event, note.detail) == ("unwatched", "alice to bob over q1-q3: NO_PATH")
    assert not light.tick(DISCOVERY_S + 1.0)


def test_a_way_back_to_the_same_switch_is_none() -> None:
    """From q1 over q2-q3 to bob at q2 light comes by q3, whichever end of the fibre is nearer."""
    state = Arbiter(triangle(), 5.0, 30.0)
    state.network.remove_link(SwitchPort(1, 3))
    light = idle(state, replace(WATCH, over=frozenset({"q2", "q3"})))
    assert not light.tick(0.0)


def test_a_host_that_has_announced_nothing_is_named() -> None:
    light = idle(arbiter(), replace(WATCH, between=("alice", "zoe")))
    light.tick(0.0)
    (note,) = light.tick(DISCOVERY_S)
    assert isinstance(note, Note)
    assert note.detail == "alice to zoe: zoe has announced no fibre"


def test_a_session_that_wants_the_light_of_an_ordered_seal_has_it_when_that_ends() -> None:
    state = arbiter()
    light = idle(state, WATCH)
    light.tick(0.0)
    begin(state, light, 1000, 0.5)
    segment = frame(KEYS.encode(), sport=40001, destination=BOB)
    waiting = state.segment_arrived(S1, 1, segment, 1.0)
    assert noted(waiting) == ["queued", "wanted"]
    end(state, light, 1000, 1.02)
    assert is_live(state, KEYS.session)
    assert not light.tick(11.1)  # the session has the light now


def test_the_policy_says_what_is_watched() -> None:
    text = """[[watch]]
between = ["bob", "alice"]
over = ["q2", "q1"]
every_s = 5
pairs = 300
rate_hz = 1_000_000
whole_error = 0.02
fraction = 0.5
false_alarm = 1e-9
missed = 0.05
[[watch]]
between = ["alice", "bob"]
"""
    policy = parse_policy(text)
    one = Watch(
        ("bob", "alice"), frozenset({"q1", "q2"}), 5.0, 300, 1_000_000, 0.02, 0.5, 1e-9, 0.05
    )
    assert policy.watches == (one, Watch(("alice", "bob")))
    assert one.block_pairs == 300
    require_network(policy, ["q1", "q2"], "observed")
    with pytest.raises(BadPolicy, match="watch: over: 'q2' is not a quantum switch"):
        require_network(policy, ["q1"], "observed")


BETWEEN = 'between = ["alice", "bob"]\n'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "watch 1: between is None: write between"),
        ('between = ["alice", "alice"]', "watch 1: between is"),
        (BETWEEN + 'over = ["q1"]', "watch 1: over is .*: write over"),
        (BETWEEN + "every_s = 0", "watch 1: every_s 0: choose 0.2 to 86400"),
        (BETWEEN + "pairs = 0.5", "watch 1: pairs 0.5: choose 1 to"),
        (BETWEEN + "fraction = 2.0", "watch 1: fraction 2.0: choose 0.001 to 1"),
        (BETWEEN + "count = 3", "watch 1 has no count"),
        (BETWEEN + "[[watch]]\n" + BETWEEN, "watch 2: alice to bob is watched so already"),
        (BETWEEN + '[queue]\norder = "slots"', "watch: not with the queue's order"),
    ],
)
def test_what_cannot_be_watched_is_refused_with_why(text: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        parse_policy("[[watch]]\n" + text)
