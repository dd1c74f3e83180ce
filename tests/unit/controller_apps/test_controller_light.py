"""Sessions whose light is moved, queued, tuned or reconciled; by the arbiter alone.

Two switches, 1 and 3, with three fibres between them: alice and charlie at 1, bob at 3.
"""

import random
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from metadata_scene import (
    ALICE,
    BOB,
    FIBERS,
    FRAMED,
    HOLD_S,
    IDLE_S,
    MACS,
    ONE_PAIR,
    PER_PAIR,
    Q1,
    S1,
    frame,
    is_live,
    payload_of,
    rotating,
)
from scapy.layers.inet import IP, TCP
from scapy.layers.l2 import Ether

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Hop, HostPort, Network, directions
from controller_apps.sessions.actions import (
    Action,
    ClosePaths,
    Forget,
    Forward,
    Keep,
    Note,
    OpenPaths,
)
from controller_apps.sessions.arbiter import Arbiter
from controller_apps.sessions.snapshot import decode_session, keep
from wire.metadata.decoding import decode
from wire.metadata.header import METADATA_PORT
from wire.metadata.setup import SETUP_LENGTH, Setup
from wire.metadata.vocabulary import Reason, Verdict
from wire.optical import DEFAULT_FREQUENCY_MHZ, TUNABLE, PortOptics

Q2 = 3
LATER = 100 + SETUP_LENGTH
AT_BOB = {2: FIBERS[2], 3: FIBERS[3]}
FIRST, SECOND, THIRD = 10, 11, 12  # ports of both switches that the fibres between them end in


def two_switches(queues: bool = False) -> Arbiter:
    network = Network({Q1, Q2})
    for port, host_port in FIBERS.items():
        network.attach(SwitchPort(Q2 if port in AT_BOB else Q1, port), host_port)
    for port in (FIRST, SECOND, THIRD):
        network.add_link(SwitchPort(Q1, port), SwitchPort(Q2, port))
    return Arbiter(network, HOLD_S, IDLE_S, queues=queues)


def ask(state: Arbiter, setup: Setup, now: float = 0.0, **tcp: Any) -> list[Action]:
    return state.segment_arrived(S1, 1, frame(setup.encode(), **tcp), now)


def fin(state: Arbiter, now: float = 1.0, **tcp: Any) -> list[Action]:
    return state.segment_arrived(S1, 1, frame(flags="FA", seq=LATER, **tcp), now)


def opened(actions: list[Action]) -> list[OpenPaths]:
    return [action for action in actions if isinstance(action, OpenPaths)]


def ready(state: Arbiter, actions: list[Action], now: float = 0.0) -> list[Action]:
    """Let every switch do as the controller says."""
    done = [state.barrier_passed(a.dpid, a.transaction, now) for a in opened(actions)]
    return [action for part in done for action in part]


def answers(actions: list[Action]) -> list[Setup]:
    messages = [decode(payload_of(a.frame)) for a in actions if isinstance(a, Forward)]
    return [message for message in messages if isinstance(message, Setup)]


def reasons(actions: list[Action]) -> list[int]:
    return [answer.reason for answer in answers(actions)]


def notes(actions: list[Action]) -> list[str]:
    return [action.event for action in actions if isinstance(action, Note)]


def granted(state: Arbiter, setup: Setup = FRAMED, **tcp: Any) -> None:
    (answer,) = answers(ready(state, ask(state, setup, **tcp)))
    assert answer.verdict == Verdict.GRANTED


def cut(state: Arbiter, dpid: int, port: int, now: float = 1.0) -> list[Action]:
    assert state.network.set_fiber(SwitchPort(dpid, port), whole=False)
    return state.network_changed(now)


def test_a_cut_moves_the_path_by_one_bundle_a_switch_and_leaves_the_others() -> None:
    state = two_switches()
    granted(state)
    assert state.sessions.by_number[7].hops == (
        *(Hop(Q1, 4, 1),),
        *(Hop(Q1, 1, FIRST), Hop(Q2, FIRST, 3)),
        *(Hop(Q1, 5, SECOND), Hop(Q2, SECOND, 2)),
    )
    actions = cut(state, Q2, FIRST)
    number = opened(actions)[0].transaction
    assert actions == [
        keep(state.sessions.by_number[7]),  # first: what a switch may do is known to a successor
        OpenPaths(Q1, (Hop(Q1, 1, THIRD),), 7, number),  # in place of the entry for in_port 1
        OpenPaths(Q2, (Hop(Q2, THIRD, 3),), 7, number, closed=(Hop(Q2, FIRST, 3),)),
    ]
    assert state.barrier_passed(Q1, number, 1.1) == []
    assert state.barrier_passed(Q2, number, 1.25) == [Note("moved", 7, 250.0)]
    assert set(state.sessions.occupied) == set(directions(state.sessions.by_number[7].hops))
    assert state.network_changed(2.0) == []


def test_two_cuts_in_a_row_move_twice() -> None:
    state = two_switches()
    state.network.add_link(SwitchPort(Q1, 13), SwitchPort(Q2, 13))
    granted(state)
    first = cut(state, Q1, FIRST)
    second = cut(state, Q1, THIRD)
    assert state.sessions.by_number[7].hops[1] == Hop(Q1, 1, 13)
    assert notes(ready(state, first)) == notes(ready(state, second)) == ["moved"]
    assert state.light.moves == {}


def test_without_another_way_the_session_waits_for_its_own() -> None:
    state = two_switches()
    granted(state)
    assert notes(cut(state, Q1, 1)) == ["stranded"]  # alice's own fibre
    assert state.network_changed(2.0) == []  # reported once
    state.network.set_fiber(SwitchPort(Q1, 1), whole=True)
    assert state.network_changed(3.0) == []
    assert is_live(state, 7)
    assert notes(cut(state, Q1, 1, 4.0)) == ["stranded"]


def test_a_way_that_turns_light_differently_is_not_taken() -> None:
    state = two_switches()
    state.network.optics.switches = {Q1: rotating(1), Q2: rotating(1), 4: rotating(2)}
    state.network.connected.add(4)
    state.network.add_link(SwitchPort(Q1, 40), SwitchPort(4, 1))
    state.network.add_link(SwitchPort(4, 2), SwitchPort(Q2, 40))
    state.network.remove_link(SwitchPort(Q1, THIRD))
    granted(state)
    assert notes(cut(state, Q1, FIRST)) == ["stranded"]
    state.network.optics.switches[4] = rotating(0)
    moved = state.network_changed(2.0)
    assert [action.dpid for action in opened(moved)] == [Q1, 4, Q2]
    assert state.sessions.by_number[7].hops[1:4] == (
        Hop(Q1, 1, 40),
        Hop(4, 1, 2),
        Hop(Q2, 40, 3),
    )


def test_a_fibre_that_is_cut_before_the_switches_are_ready_is_left_after() -> None:
    state = two_switches()
    actions = ask(state, FRAMED)
    assert cut(state, Q1, FIRST) == []
    done = ready(state, actions, 1.0)
    assert [answer.verdict for answer in answers(done)] == [Verdict.GRANTED]
    assert opened(done)[0].hops == (Hop(Q1, 1, THIRD),)


def test_a_switch_that_refuses_the_move_ends_the_session() -> None:
    state = two_switches()
    granted(state)
    (one, _other) = opened(cut(state, Q2, FIRST))
    actions = state.switch_refused(one.transaction, 1.5)
    assert actions[:3] == [Forget(7), ClosePaths(Q1, 7), ClosePaths(Q2, 7)]
    assert notes(actions) == ["torn_down"]
    assert state.switch_refused(one.transaction, 1.6) == []


def test_a_move_has_a_deadline() -> None:
    state = two_switches()
    granted(state)
    cut(state, Q2, FIRST, 1.0)
    assert state.tick(0.9 + HOLD_S) == []
    assert notes(state.tick(1.0 + HOLD_S)) == ["torn_down"]
    assert not state.sessions.occupied


def test_a_lost_switch_is_gone_round_and_cleaned_up_when_it_is_back() -> None:
    state = two_switches()
    state.network.connected.add(4)
    for number in (1, 2):  # cheaper by 4 than the direct fibres
        state.network.add_link(SwitchPort(Q1, 40 + number), SwitchPort(4, number))
        state.network.add_link(SwitchPort(4, 10 + number), SwitchPort(Q2, 40 + number))
    for port in (FIRST, SECOND, THIRD):
        state.network.cut.add(SwitchPort(Q1, port))
    granted(state)
    at_four = {hop for hop in state.sessions.by_number[7].hops if hop.dpid == 4}
    assert len(at_four) == 2
    state.network.cut.clear()
    actions = state.switch_left(4, 1.0)
    assert ClosePaths(4, 7) in actions
    assert notes(ready(state, actions)) == ["moved"]
    state.network.connected.add(4)
    kept = [(7, hop) for hop in at_four]
    assert state.entries_found(4, kept) == [ClosePaths(4, 7)]


def test_entries_of_a_live_session_stay_and_stale_ones_go() -> None:
    state = two_switches()
    granted(state)
    own = [(7, hop) for hop in state.sessions.by_number[7].hops if hop.dpid == Q1]
    assert state.entries_found(Q1, own) == []
    (again,) = state.entries_found(Q1, own[1:])
    assert isinstance(again, OpenPaths)
    assert (again.dpid, again.hops, again.closed) == (Q1, (own[0][1],), ())
    stale = Hop(Q1, 1, THIRD)
    (action,) = state.entries_found(Q1, [*own, (7, stale)])
    assert isinstance(action, OpenPaths)
    assert (action.dpid, action.hops, action.closed) == (Q1, (), (stale,))
    assert state.entries_found(Q1, [*own, (8, None), (9, stale)]) == [
        ClosePaths(Q1, 8),
        ClosePaths(Q1, 9),
    ]


def test_ports_are_tuned_in_the_bundle_and_once() -> None:
    state = two_switches()
    optics = state.network.optics
    for at in (SwitchPort(Q1, 4), SwitchPort(Q1, 1), SwitchPort(Q1, FIRST)):
        optics.ranges[at] = PortOptics(
            TUNABLE, 191_350_000, 196_100_000, 50_000, 191_350_000, 196_100_000, 50_000, -200, 0
        )
    optics.tuned_mhz[SwitchPort(Q1, 1)] = DEFAULT_FREQUENCY_MHZ
    here, there = opened(ask(state, FRAMED))
    assert (here.tuned, here.frequency_mhz) == ((4, FIRST), DEFAULT_FREQUENCY_MHZ)
    assert (there.tuned, there.frequency_mhz) == ((), 0)
    ready(state, [here, there])
    fin(state)
    again = ask(state, replace(FRAMED, session=8), 2.0, sport=40001)
    assert [bundle.tuned for bundle in opened(again)] == [(), ()]
    state.switch_refused(opened(again)[0].transaction, 2.1)
    doubtful = ask(state, replace(FRAMED, session=9), 3.0, sport=40002)
    assert set(opened(doubtful)[0].tuned) == {4, 1, FIRST}


def test_light_of_another_wavelength_keeps_out_of_ports_in_use() -> None:
    state = two_switches()
    granted(state)
    blocks = state.sessions.blocks
    back = directions([Hop(Q2, 9, FIRST)])[1]  # the other direction of a fibre in use
    assert not blocks(back, 8, DEFAULT_FREQUENCY_MHZ)
    assert blocks(back, 8, DEFAULT_FREQUENCY_MHZ + 50_000)
    assert not blocks(back, 7, DEFAULT_FREQUENCY_MHZ)


def test_a_wavelength_that_is_no_light_is_refused() -> None:
    assert reasons(ask(two_switches(), replace(FRAMED, wavelength_pm=1))) == [Reason.NO_WAVELENGTH]


def test_a_pair_of_another_wavelength_than_its_session_is_refused() -> None:
    state = two_switches()
    ask(state, PER_PAIR)
    other = replace(ONE_PAIR, wavelength_pm=1_549_320)
    assert reasons(ask(state, other, sport=40001)) == [Reason.UNKNOWN_SESSION]


def test_too_much_loss_is_refused_and_says_so() -> None:
    state = two_switches()
    state.network.optics.switches[Q2] = rotating(0, 30_001)
    assert reasons(ask(state, FRAMED)) == [Reason.LOSS_TOO_HIGH]


def test_who_waits_for_light_gets_it_when_it_is_free() -> None:
    state = two_switches(queues=True)
    granted(state)
    second, third = replace(FRAMED, session=8), replace(FRAMED, session=9)
    assert ask(state, second, 0.1, sport=40001) == [Note("queued", 8)]
    assert ask(state, third, 0.2, sport=40002) == [Note("queued", 9)]
    assert ask(state, second, 0.3, sport=40001)[0].cause == "repeated"  # type: ignore[union-attr]
    actions = fin(state)
    assert {bundle.session for bundle in opened(actions)} == {8}
    assert [answer.session for answer in answers(ready(state, actions))] == [8]
    actions = fin(state, 2.0, sport=40001)
    assert {bundle.session for bundle in opened(actions)} == {9}


def after(actions: list[Action]) -> list[tuple[int, int]]:
    """Return which session has light, and who gave it back."""
    return [(a.session, a.after.session) for a in actions if isinstance(a, Note) and a.after]


def test_who_has_waited_is_noted_with_who_gave_its_light_back() -> None:
    state = two_switches(queues=True)
    actions = ask(state, FRAMED)
    assert after([*actions, *ready(state, actions)]) == []  # nobody was in its way
    ask(state, replace(FRAMED, session=8), 0.1, sport=40001)
    ask(state, replace(FRAMED, session=9), 0.2, sport=40002)
    actions = fin(state)
    assert after(actions) == [(8, 7)]
    (note,) = (a for a in actions if isinstance(a, Note) and a.after)
    assert note.after is not None
    assert note.ends == note.after.ends == (ALICE, BOB)
    ready(state, actions)
    assert after(fin(state, 2.0, sport=40001)) == [(9, 8)]  # and not the first, who was long gone


def test_who_has_waited_too_long_is_refused_with_busy() -> None:
    state = two_switches(queues=True)
    granted(state)
    ask(state, replace(FRAMED, session=8), 1.0, sport=40001)
    assert state.tick(0.9 + HOLD_S) == []
    assert reasons(state.tick(1.0 + HOLD_S)) == [Reason.BUSY]
    assert list(state.sessions.by_number) == [7]
    assert state.sessions.queue == {}


def test_who_gives_up_waiting_gets_nothing() -> None:
    state = two_switches(queues=True)
    granted(state)
    ask(state, replace(FRAMED, session=8), 0.1, sport=40001)
    assert answers(fin(state, 0.2, sport=40001))[0].verdict == Verdict.REFUSED
    assert opened(fin(state)) == []
    assert state.sessions.queue == {}


def test_who_waits_is_refused_when_the_way_is_gone_for_all() -> None:
    state = two_switches(queues=True)
    granted(state)
    ask(state, replace(FRAMED, session=8), 0.1, sport=40001)
    assert reasons(state.switch_left(Q2, 1.0)) == [Reason.NO_PATH]
    assert list(state.sessions.by_number) == [7]


def test_a_pair_may_wait_for_the_light_of_another_session() -> None:
    state = two_switches(queues=True)
    ask(state, PER_PAIR)
    granted(state, replace(FRAMED, session=8), sport=40001)
    assert ask(state, ONE_PAIR, 0.1, sport=40002) == [Note("queued", 7)]
    actions = fin(state, sport=40001)
    assert {bundle.session for bundle in opened(actions)} == {7}


class FlowTables:
    """The effect of the arbiter's actions on switches: each hop, and whose it is."""

    def __init__(self, state: Arbiter) -> None:
        self.state = state
        self.hops: dict[Hop, int] = {}
        self.kept: dict[int, bytes] = {}
        self.events: Counter[str] = Counter()

    def do(self, actions: list[Action], now: float) -> None:
        for action in actions:
            if isinstance(action, ClosePaths):
                self._close(action.dpid, action.session)
            elif isinstance(action, OpenPaths):
                self._change(action)
            elif isinstance(action, Keep):
                self.kept[action.session] = action.data
            elif isinstance(action, Forget):
                del self.kept[action.session]
            elif isinstance(action, Note):
                self.events[action.event] += 1
        ways = [way for hop in self.hops for way in directions([hop])]
        assert len(ways) == len(set(ways))
        for bundle in opened(actions):
            self.do(self.state.barrier_passed(bundle.dpid, bundle.transaction, now), now)

    def _close(self, dpid: int, session: int) -> None:
        self._delete(lambda hop, of: (hop.dpid, of) == (dpid, session))

    def _change(self, action: OpenPaths) -> None:
        self._delete(lambda hop, _: hop in action.closed)
        for new in action.hops:  # an entry replaces that for the same port
            replaced = [session for hop, session in self.hops.items() if hop[:2] == new[:2]]
            assert replaced in ([], [action.session])
            self._delete(lambda hop, _, new=new: hop[:2] == new[:2])  # type: ignore[misc]
            self.hops[new] = action.session

    def _delete(self, which: Callable[[Hop, int], bool]) -> None:
        self.hops = {hop: of for hop, of in self.hops.items() if not which(hop, of)}


RIM = (1, Q1, Q2, 4)
FIBERS_EACH = 2


def ring_of_triples(draw: random.Random, count: int) -> Network:
    """Return four switches in a ring and senders, receivers, sources at random ones."""
    network = Network(set(RIM))
    for one, other in zip(RIM, (*RIM[1:], RIM[0]), strict=True):
        for fiber in range(FIBERS_EACH):
            network.add_link(SwitchPort(one, 100 + fiber), SwitchPort(other, 200 + fiber))
    port = iter(range(1, 100))
    for number in range(count):
        for name, fibers in ((1, 1), (2, 2), (3, 2)):
            address = f"10.0.{number}.{name}"
            for fiber in range(fibers):
                at = SwitchPort(draw.choice(RIM), next(port))
                network.attach(at, HostPort(address, address, f"q{fiber}"))
    return network


def between(number: int, payload: bytes, sport: int, flags: str = "PA") -> bytes:
    """Return a frame from sender to receiver of a triple."""
    tcp = TCP(sport=sport, dport=METADATA_PORT, seq=100 if payload else LATER, flags=flags)
    ip = IP(src=f"10.0.{number}.1", dst=f"10.0.{number}.2")
    return bytes(Ether(src=MACS[ALICE], dst=MACS[BOB]) / ip / tcp / payload)


def restarted(tables: FlowTables, now: float) -> Arbiter:
    """Let another arbiter take over; switches find it one after the other."""
    before, hops = tables.state, dict(tables.hops)
    before.network.connected.clear()
    tables.state = Arbiter(before.network, HOLD_S, IDLE_S, queues=before.terms.queues)
    for data in tables.kept.values():
        tables.state.resume(decode_session(data, now), now)
    for dpid in RIM:
        found = [(session, hop) for hop, session in tables.hops.items() if hop.dpid == dpid]
        tables.do(tables.state.entries_found(dpid, found), now)
        before.network.connected.add(dpid)
        tables.do(tables.state.network_changed(now), now)
    assert tables.hops == hops
    assert tables.state.sessions.occupied == before.sessions.occupied
    return tables.state


@pytest.mark.parametrize("queues", [False, True])
def test_many_sessions_at_once_never_share_light(queues: bool) -> None:
    """Set-ups, ends, cuts and restarts of the controller in random order.

    The switches hold exactly what is accounted.
    """
    draw = random.Random(5)
    network = ring_of_triples(draw, 8)
    state = Arbiter(network, HOLD_S, IDLE_S, queues=queues)
    tables = FlowTables(state)
    live: dict[int, int] = {}
    for step in range(600):
        now, number, choice = step * 0.5, draw.randrange(8), draw.random()
        if choice < 0.4 and number not in live:
            live[number] = 2000 + step
            setup = replace(FRAMED, session=1000 + step, source=f"10.0.{number}.3")
            asked = between(number, setup.encode(), live[number])
            tables.do(state.segment_arrived(S1, 1, asked, now), now)
        elif choice < 0.7 and number in live:
            over = between(number, b"", live.pop(number), "FA")
            tables.do(state.segment_arrived(S1, 1, over, now), now)
        elif 0.7 <= choice < 0.72:
            state = restarted(tables, now)
        elif choice > 0.8:
            at = SwitchPort(draw.choice(RIM), 100 + draw.randrange(FIBERS_EACH))
            far = network.links[at]
            network.set_fiber(at, whole=False)
            tables.do(state.network_changed(now), now)
            network.set_fiber(at, whole=True)
            network.add_link(at, far)
        tables.do(state.tick(now), now)
        sessions = state.sessions.by_number.values()
        assert tables.hops == {hop: s.number for s in sessions for hop in s.hops}
        assert set(state.sessions.occupied) == set(directions(tables.hops))
    assert tables.events["granted"] > 50
    assert tables.events["moved"] > 10
    assert tables.events["refused"] > 10
    assert (tables.events["queued"] > 10) == queues
