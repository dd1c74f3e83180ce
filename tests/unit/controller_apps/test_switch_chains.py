"""The light of chains of switches that swap: granted, arbitrated, and what their sources emit."""

from dataclasses import replace
from functools import partial

import pytest
from metadata_scene import ALICE, BOB, FRAMED, HOLD_S, IDLE_S, frame, payload_of, rotating

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Hop, HostPort, Network
from controller_apps.policy.schedules import Purification
from controller_apps.sessions.actions import (
    Action,
    Drop,
    Emit,
    Flood,
    Forward,
    Keep,
    KeepPulses,
    OpenPaths,
)
from controller_apps.sessions.arbiter import Arbiter
from controller_apps.sessions.snapshot import decode_session
from controller_apps.sessions.swap_turns import Command, Release, SwapTurns
from controller_apps.sessions.terms import UNFILTERED
from wire.analyser_frames import (
    BROADCAST,
    MOST_OUTCOMES,
    AnalyserFrame,
    Emission,
    End,
    Receivers,
    frames_of,
    group_of,
)
from wire.metadata.decoding import decode
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import MemoryState, Reason, Service
from wire.outcomes import NO_COINCIDENCE
from wire.parameters.switch import inner_ports

S1, NOW = 100, 1.0
MEMORIES = 61_001, 61_002
WHOLE = frozenset(inner_ports(analysers=1, memories=2, sources=1))
STORED = AnalyserFrame(61_001, 5, End.STORED, 2, 0, bytes(2)).encode(BROADCAST, bytes(6))


def line(switches: int, inner: frozenset[int] = WHOLE, loss_mdb: int = 0) -> Network:
    """Return alice, switches with these inner ports in a line, and bob; light goes 1 -> 2.

    Each switch loses as much as is given.
    """
    found = Network(set(range(1, switches + 1)))
    found.inner = dict.fromkeys(found.connected, inner)
    found.attach(SwitchPort(1, 1), HostPort("alice", ALICE, "alice-q0"))
    found.attach(SwitchPort(switches, 2), HostPort("bob", BOB, "bob-q0"))
    for dpid in range(1, switches):
        found.add_link(SwitchPort(dpid, 2), SwitchPort(dpid + 1, 1))
    for dpid in found.connected:
        found.optics.switches[dpid] = rotating(0, loss_mdb)
    return found


def asked(
    arbiter: Arbiter, count: int, session: int = 7, sport: int = 40_000, heralded: bool = False
) -> list[Action]:
    """Ask for a chain of this many switches."""
    setup = replace(FRAMED, service=Service.SWAP, source=ALICE, block=count, session=session)
    if heralded:
        setup = replace(setup, memory=MemoryState.HERALDED)
    data = frame(setup.encode(), sport=sport)
    return arbiter.segment_arrived(S1, 1, data, NOW)


def hops(actions: list[Action]) -> dict[int, set[tuple[int, int]]]:
    opened = [each for each in actions if isinstance(each, OpenPaths)]
    return {each.dpid: {(hop.in_port, hop.out_port) for hop in each.hops} for each in opened}


def refusal(actions: list[Action]) -> Setup:
    (forward,) = [each for each in actions if isinstance(each, Forward)]
    answer = decode(payload_of(forward.frame))
    assert isinstance(answer, Setup)
    return answer


def test_every_switch_of_a_chain_stores_and_all_but_the_last_emit() -> None:
    emits = {(62_001, 61_002), (62_002, 2)}
    actions = asked(Arbiter(line(3), HOLD_S, IDLE_S), 3)
    assert hops(actions) == {
        1: {(1, 61_001), *emits},
        2: {(1, 61_001), *emits},
        3: {(1, 61_001), (2, 61_002)},
    }
    heard = {each.dpid: each.heard for each in actions if isinstance(each, OpenPaths)}
    assert heard == {1: {61_001: Receivers.OPENER}, 2: {}, 3: {61_002: Receivers.ACCEPTOR}}


def test_switches_beyond_the_chain_pass_light() -> None:
    found = hops(asked(Arbiter(line(3), HOLD_S, IDLE_S), 1))
    assert found[2] == {(2, 1)}  # from bob to the only one that swaps
    assert found[3] == {(2, 1)}


def test_one_switch_without_memories_has_light_meet_in_its_analyser() -> None:
    inner = frozenset(inner_ports(analysers=1))
    assert hops(asked(Arbiter(line(1, inner), HOLD_S, IDLE_S), 1)) == {
        1: {(1, 60_001), (2, 60_002)}
    }


@pytest.mark.parametrize(
    ("inner", "text"),
    [
        (frozenset(inner_ports(analysers=1)), "0 of 2 switches on the way have a free analyser"),
        (frozenset(inner_ports(analysers=1, memories=2)), "switch 0x1 has no free source"),
        (frozenset[int](), "0 of 2 switches"),
    ],
)
def test_a_chain_that_lacks_parts_is_refused_by_name(inner: frozenset[int], text: str) -> None:
    answer = refusal(asked(Arbiter(line(2, inner), HOLD_S, IDLE_S), 2))
    assert answer.reason == Reason.NO_CHAIN
    assert text in answer.obstacle


@pytest.mark.parametrize(
    ("loss_mdb", "count", "link_db"), [(15_001, 4, 30.002), (7_501, 1, 30.004)]
)
def test_the_loss_budget_is_of_each_link(loss_mdb: int, count: int, link_db: float) -> None:
    """A link between neighbours passes two switches; from the only swap to bob it passes four."""
    actions = asked(Arbiter(line(4, loss_mdb=loss_mdb), HOLD_S, IDLE_S, 30.0), count)
    refused = refusal(actions)
    assert refused.reason == Reason.LOSS_TOO_HIGH
    text = f"a link of the chain loses {link_db} dB: raise --loss-budget-db (30), or shorten its"
    assert refused.obstacle == text + " fibres"
    assert hops(asked(Arbiter(line(4, loss_mdb=loss_mdb - 1), HOLD_S, IDLE_S, 30.0), count))


def test_a_second_session_that_wants_the_analyser_is_busy_until_the_first_is_over() -> None:
    arbiter = Arbiter(line(2), HOLD_S, IDLE_S)
    (session,) = [each.session for each in asked(arbiter, 2) if isinstance(each, OpenPaths)][:1]
    assert refusal(asked(arbiter, 2, session=8, sport=40_001)).reason == Reason.BUSY
    arbiter.tick(NOW + HOLD_S + 1)  # nobody has answered its barriers
    assert session not in arbiter.sessions.by_number
    assert hops(asked(arbiter, 2, session=9, sport=40_002)).keys() == {1, 2}


def test_sources_emit_when_the_first_memory_holds_a_block() -> None:
    arbiter = Arbiter(line(3), HOLD_S, IDLE_S)
    opened = [each for each in asked(arbiter, 3) if isinstance(each, OpenPaths)]
    first = SwitchPort(1, 61_001)
    assert not arbiter.inner_frame(first, 7, STORED)  # it is not open yet
    for each in opened:
        arbiter.barrier_passed(each.dpid, each.transaction, NOW)
    assert not arbiter.inner_frame(SwitchPort(2, 61_001), 7, STORED)
    light = 5, 2, FRAMED.rate_hz, arbiter.sessions.by_number[7].frequency_mhz
    assert arbiter.inner_frame(first, 7, STORED) == [
        Emit(1, 62_001, Emission(8, *light)),
        Emit(2, 62_001, Emission(9, *light)),
    ]
    assert not arbiter.inner_frame(first, 99, STORED)
    assert [type(each).__name__ for each in arbiter.inner_frame(first, 7, b"rubbish")] == ["Drop"]


def test_a_session_of_the_longest_chain_is_kept_for_another_controller() -> None:
    arbiter = Arbiter(line(64), HOLD_S, IDLE_S)
    for each in asked(arbiter, 64):
        if isinstance(each, OpenPaths):
            actions = arbiter.barrier_passed(each.dpid, each.transaction, NOW)
    (kept,) = [each for each in actions if isinstance(each, Keep)]
    again = decode_session(kept.data, NOW)
    assert again.paths == arbiter.sessions.by_number[7].paths
    assert len(again.paths) == 64 * 2 + 63 * 2 + 2


def heralding(switches: int) -> Network:
    """Return a line of stations and, between them, switches with memories that emit."""
    found = line(switches, frozenset(inner_ports(analysers=1)))
    for dpid in range(2, switches + 1, 2):
        found.inner[dpid] = frozenset(inner_ports(analysers=1, memories=2, emitters=2))
        found.modes |= {SwitchPort(dpid, memory): 5 for memory in MEMORIES}
    return found


def test_light_of_memories_that_emit_meets_in_stations_between_them() -> None:
    actions = asked(Arbiter(heralding(5), HOLD_S, IDLE_S), 5, heralded=True)
    from_left = {(1, 60_001), (2, 60_002)}
    assert hops(actions) == {
        1: from_left,
        2: {(63_001, 1), (63_002, 2)},
        3: from_left,
        4: {(63_001, 1), (63_002, 2)},
        5: from_left,
    }
    assert all(each.heard == {} for each in actions if isinstance(each, OpenPaths))


def test_a_distribution_has_the_station_whose_farther_arm_loses_least() -> None:
    """Behind each of three switches light has lost 1 dB more; the last turns it, too."""
    network = line(3, frozenset(inner_ports(analysers=1)), loss_mdb=1000)
    network.inner[3], network.optics.switches[3] = frozenset(), rotating(2, 1000)
    setup = replace(FRAMED, service=Service.DISTRIBUTE, source=ALICE, memory=MemoryState.HERALDED)
    arbiter = Arbiter(network, HOLD_S, IDLE_S)
    actions = arbiter.segment_arrived(S1, 1, frame(setup.encode()), NOW)
    assert hops(actions) == {1: {(1, 2)}, 2: {(1, 60_001), (2, 60_002)}, 3: {(2, 1)}}
    session = arbiter.sessions.by_number[setup.session]
    assert session.requests[session.owner].rotation == 2
    assert session.turns is None


@pytest.mark.parametrize("count", [2, 4, 7])
def test_a_chain_that_does_not_end_in_stations_is_refused_by_name(count: int) -> None:
    answer = refusal(asked(Arbiter(heralding(5), HOLD_S, IDLE_S), count, heralded=True))
    assert answer.reason == Reason.NO_CHAIN
    assert f"of {count} switches on the way have in turn a free station" in answer.obstacle


def test_memories_attempt_when_the_opener_does_and_swap_when_links_hold() -> None:
    arbiter = Arbiter(heralding(3), HOLD_S, IDLE_S)
    for each in asked(arbiter, 3, heralded=True):
        if isinstance(each, OpenPaths):
            actions = arbiter.barrier_passed(each.dpid, each.transaction, NOW)
    (forward,) = [each for each in actions if isinstance(each, Forward)]
    granted = decode(payload_of(forward.frame))
    assert isinstance(granted, Setup)
    assert granted.pairs == 5  # one block, as large as a memory
    waits = AnalyserFrame(60_001, 3, End.WAITS, 4).encode(BROADCAST, bytes(6))
    light = 3, 4, FRAMED.rate_hz, arbiter.sessions.by_number[7].frequency_mhz
    assert arbiter.inner_frame(SwitchPort(1, 60_001), 7, waits) == [
        Emit(2, 63_001, Emission(8, *light)),
        Emit(2, 63_002, Emission(9, *light)),
    ]
    assert not arbiter.inner_frame(SwitchPort(3, 60_001), 7, waits)  # bob's qubits
    heralded = AnalyserFrame(60_001, 3, End.HERALDED, 2, 0, bytes([1, 3]), 99)
    assert not arbiter.inner_frame(SwitchPort(1, 60_001), 7, heralded.encode(BROADCAST, bytes(6)))
    actions = stored(arbiter, 2)
    assert named(actions) == {(2, port) for port in MEMORIES}
    assert hops(actions) == {2: {(61_001, 60_001), (61_002, 60_002)}}


def test_stations_report_bell_states_to_the_controller_if_it_purifies() -> None:
    """Of pairs in Psi+ and Psi- the right end is turned by X and XZ, in either order of frames."""
    arbiter = Arbiter(heralding(3), HOLD_S, IDLE_S)
    arbiter.follow(replace(UNFILTERED, purification=Purification("dejmps", 1)))
    for each in asked(arbiter, 3, heralded=True):
        if isinstance(each, OpenPaths):
            assert each.reports
            arbiter.barrier_passed(each.dpid, each.transaction, NOW)
    herald = AnalyserFrame(60_001, 3, End.HERALDED, 2, 0, bytes([1, 3]), 99)
    reports = [
        (SwitchPort(1, 60_001), herald.encode(BROADCAST, bytes(6))),
        (SwitchPort(2, 61_001), STORED),
        (SwitchPort(2, 61_002), STORED),
        (SwitchPort(3, 60_001), herald.encode(BROADCAST, bytes(6))),
    ]
    due = [arbiter.inner_frame(at, 7, data) for at, data in reports]
    assert (due[0], due[2]) == ([], [])
    to_memory = [each.herald for each in due[1] if isinstance(each, KeepPulses)]
    to_hosts = [each.frame for each in due[3] if isinstance(each, Flood)]
    (to_bob,) = [data for data in to_hosts if data[:6] == group_of(7, Receivers.ACCEPTOR)]
    rounds = [*to_memory[:1], AnalyserFrame.decode(to_bob)]
    assert [each.outcomes for each in rounds] == [bytes([1, 3])] * 2
    assert [each.method for each in rounds] == [5, 5]


def test_a_link_that_heralds_nothing_is_swapped_as_no_pulse_and_the_next_block_follows() -> None:
    turns = SwapTurns(swaps(1), "parallel")
    left, right = (SwitchPort(1, port) for port in MEMORIES)
    measured = partial(AnalyserFrame, 60_001, end=End.MEASURED)
    herald = partial(AnalyserFrame, 61_001, end=End.STORED)
    for number, dark in ((1, True), (2, False), (3, True)):
        held = bytes([NO_COINCIDENCE]) if dark else bytes(2)
        assert turns.arrived(left, herald(number, pulses=2, outcomes=bytes(2))) == []
        due = turns.arrived(right, herald(number, pulses=len(held), outcomes=held))
        named = {each.at: each.frame.outcomes for each in due if isinstance(each, Command)}
        assert named == {left: bytes(2), right: held}
        outcomes = b"" if dark else bytes(2)
        at = SwitchPort(1, 60_001)
        assert turns.arrived(at, measured(number, pulses=len(outcomes), outcomes=outcomes)) == []
    assert not turns._pairs  # nothing is kept of blocks that are over


def test_switches_swap_in_the_turns_of_the_policy() -> None:
    arbiter = Arbiter(line(3), HOLD_S, IDLE_S)
    arbiter.follow(replace(UNFILTERED, schedule="nested"))
    opened = [each for each in asked(arbiter, 3) if isinstance(each, OpenPaths)]
    releases = {(61_001, 60_001), (61_002, 60_002)}
    assert not any(releases & paths for paths in hops(list(opened)).values())
    for each in opened:
        arbiter.barrier_passed(each.dpid, each.transaction, NOW)
    outcomes = AnalyserFrame(60_001, 1, End.MEASURED, 2, 0, bytes(2)).encode(BROADCAST, bytes(6))
    for opens in (True, False):  # entries stay: later blocks leave when they are named
        assert named(stored(arbiter, 2)) == set()  # it comes behind its neighbours
        first = stored(arbiter, 1)
        assert named(first) == {(1, port) for port in MEMORIES}
        assert hops(first) == ({1: releases} if opens else {})
        assert not arbiter.inner_frame(SwitchPort(1, 60_001), 7, outcomes)
        assert named(stored(arbiter, 3)) == {(3, port) for port in MEMORIES}
        last = arbiter.inner_frame(SwitchPort(3, 60_001), 7, outcomes)
        assert named(last) == {(2, port) for port in MEMORIES}
        assert hops(last) == ({2: releases} if opens else {})
        assert not arbiter.inner_frame(SwitchPort(2, 60_001), 7, outcomes)


def test_a_chain_without_memories_is_refused_if_the_policy_purifies() -> None:
    arbiter = Arbiter(line(1, frozenset(inner_ports(analysers=1))), HOLD_S, IDLE_S)
    arbiter.follow(replace(UNFILTERED, purification=Purification("dejmps", 1)))
    answer = refusal(asked(arbiter, 1))
    assert (answer.reason, answer.obstacle) == (
        Reason.NO_CHAIN,
        "switches purify only light that their memories take in",
    )


def test_hosts_are_ends_of_a_chain_that_is_purified() -> None:
    """Frames to alice go in where her set-up did; hers count if they come from her address."""
    arbiter = Arbiter(line(1), HOLD_S, IDLE_S)
    arbiter.follow(replace(UNFILTERED, purification=Purification("dejmps", 1)))
    for each in asked(arbiter, 1):
        if isinstance(each, OpenPaths):
            arbiter.barrier_passed(each.dpid, each.transaction, NOW)
    to_alice, to_memory = arbiter.inner_frame(SwitchPort(1, 61_001), 7, STORED)
    round_ = AnalyserFrame(61_001, 5, End.PURIFY, 2, 0, bytes(2), method=5)
    assert to_memory == KeepPulses(1, 61_001, round_)
    assert isinstance(to_alice, Flood)
    assert to_alice.dpid == S1
    assert to_alice.frame[:6] == group_of(7, Receivers.OPENER)
    command = AnalyserFrame.decode(to_alice.frame)
    assert command == AnalyserFrame(1, 1, End.PURIFY, 2, 0, bytes(2), method=4)
    bits = replace(command, end=End.PURIFIED, pulses=1, outcomes=b"\1", method=0)
    arbiter.inner_frame(SwitchPort(1, 61_002), 7, STORED)
    to_controller = group_of(7, Receivers.CONTROLLER)
    addresses = frame(b"")[6:12], frame(b"")[:6]
    for sender, receiver, sent in (
        (addresses[1], to_controller, bits),
        (addresses[0], group_of(8, Receivers.CONTROLLER), bits),
        (addresses[0], to_controller, command),
    ):
        (drop,) = arbiter.host_frame(SwitchPort(S1, 1), sent.encode(receiver, sender))
        assert isinstance(drop, Drop)
    answers = [replace(bits, port=61_001, number=5), replace(bits, port=61_002, number=5)]
    for at, answer in zip(MEMORIES, answers, strict=True):
        data = answer.encode(BROADCAST, bytes(6))
        assert not arbiter.inner_frame(SwitchPort(1, at), 7, data)
    assert not arbiter.host_frame(SwitchPort(S1, 1), bits.encode(to_controller, addresses[0]))
    theirs = replace(bits, port=2).encode(to_controller, addresses[1])
    assert named(arbiter.host_frame(SwitchPort(S1, 2), theirs)) == {(1, at) for at in MEMORIES}


def swaps(switches: int) -> tuple[tuple[Hop, ...], ...]:
    """Return those of a chain."""
    places = range(1, switches + 1)
    return tuple(tuple(Hop(dpid, port, port - 1000) for port in MEMORIES) for dpid in places)


def test_blocks_follow_each_other_through_the_turns_before_the_first_is_done() -> None:
    turns = SwapTurns(swaps(3), "nested")
    measured = partial(AnalyserFrame, 60_001, end=End.MEASURED, pulses=2, outcomes=bytes(2))
    for dpid in (1, 3):
        assert turns.arrived(SwitchPort(dpid, 60_001), measured(1)) == []  # light of others
    for number in (5, 6, 7):
        for dpid in (1, 3, 2):
            herald = AnalyserFrame(61_001, number, End.STORED, 2, 0, bytes(2))
            due = [turns.arrived(SwitchPort(dpid, port), herald) for port in MEMORIES]
            # The right memory of the first is of the link to the second, which comes last.
            released = 2 + (number == 5)
            assert [len(each) for each in due] == ([released] * 2 if dpid == 2 else [0, 0])
    for number in (5, 6, 7):
        assert turns.arrived(SwitchPort(1, 60_001), measured(number)) == []
        named = turns.arrived(SwitchPort(3, 60_001), measured(number))
        assert [each for each in named if isinstance(each, Release)] == (
            [Release(2, swaps(3)[1])] if number == 5 else []
        )
        commands = [each for each in named if isinstance(each, Command)]
        assert [each.at for each in commands] == [SwitchPort(2, port) for port in MEMORIES]
        assert {each.frame.number for each in commands} == {number}
        assert turns.arrived(SwitchPort(2, 60_001), measured(number)) == []
    assert turns.arrived(SwitchPort(2, 60_001), measured(8)) == []  # nothing was released


@pytest.mark.parametrize(("modes", "pairs"), [(400, 100), (3, 1), (4_000_000, FRAMED.pairs)])
def test_all_blocks_under_way_fit_into_the_smallest_memory(modes: int, pairs: int) -> None:
    network = line(3)
    network.modes = {SwitchPort(dpid, port): 10_000_000 for dpid in (1, 2, 3) for port in MEMORIES}
    network.modes[SwitchPort(2, 61_001)] = modes
    arbiter = Arbiter(network, HOLD_S, IDLE_S)
    asked(arbiter, 3)
    session = arbiter.sessions.by_number[7]
    assert session.requests[session.owner].granted.pairs == min(pairs, FRAMED.pairs)


@pytest.mark.parametrize("pulses", [4, 2 * MOST_OUTCOMES])
def test_a_swap_waits_for_both_ends_of_its_links_and_takes_what_both_hold(pulses: int) -> None:
    arbiter = Arbiter(line(2), HOLD_S, IDLE_S)
    for each in asked(arbiter, 2):
        if isinstance(each, OpenPaths):
            arbiter.barrier_passed(each.dpid, each.transaction, NOW)
    held = {(1, 61_001): b"\0\0\0\xff", (1, 61_002): b"\0\0\xff\0", (2, 61_001): b"\0\xff\0\0"}
    actions: list[Action] = []
    for at, outcomes in held.items():
        assert not any(isinstance(each, OpenPaths | KeepPulses) for each in actions)
        herald = AnalyserFrame(at[1], 9, End.STORED, pulses, 0, outcomes * (pulses // 4))
        for frame_ in frames_of(herald):
            data = frame_.encode(BROADCAST, bytes(6))
            actions += arbiter.inner_frame(SwitchPort(*at), 7, data)
    kept = [each for each in actions if isinstance(each, KeepPulses)]
    both = b"\0\xff\xff\0"
    assert [(each.dpid, each.port, each.herald.outcomes[:4]) for each in kept] == [
        (1, 61_001, held[1, 61_001]),
        (1, 61_002, both),
    ]
    assert {len(each.herald.outcomes) for each in kept} == {pulses}
    assert hops(actions) == {1: {(61_001, 60_001), (61_002, 60_002)}}


def stored(arbiter: Arbiter, dpid: int) -> list[Action]:
    """Have both memories of a switch hold a block; return what is done then."""
    first, then = (arbiter.inner_frame(SwitchPort(dpid, port), 7, STORED) for port in MEMORIES)
    assert not named(first)
    return then


def named(actions: list[Action]) -> set[tuple[int, int]]:
    """Return the memories of which pulses are named."""
    return {(each.dpid, each.port) for each in actions if isinstance(each, KeepPulses)}


@pytest.mark.parametrize(
    "spoiled",
    [
        {"first": 2, "number": 4},  # of another block
        {"first": 3},  # what is before it was lost
        {"pulses": 5, "outcomes": bytes(3)},  # not as large as at the other end
    ],
)
def test_heralds_that_do_not_fit_release_nothing(spoiled: dict[str, object]) -> None:
    turns = SwapTurns(swaps(2), "parallel")
    left, right, far = (SwitchPort(1, 61_001), SwitchPort(1, 61_002), SwitchPort(2, 61_001))
    halves = [AnalyserFrame(61_001, 3, End.STORED, 4, first, bytes(2)) for first in (0, 2)]
    for at in (left, far):
        for half in halves:
            assert turns.arrived(at, half) == []
    assert turns.arrived(right, halves[0]) == []
    assert turns.arrived(right, replace(halves[1], **spoiled)) == []  # type: ignore[arg-type]
    # A whole one afterwards is taken, in place of the one that was spoiled.
    if "pulses" not in spoiled:
        assert turns.arrived(right, halves[0]) == []
        assert Release(1, swaps(2)[0]) in turns.arrived(right, halves[1])
