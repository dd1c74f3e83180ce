"""Chains of repeaters at the arbiter: nodes are heard first; links belong to chains, and end so."""

from dataclasses import replace

import pytest
from arbiter_scene import LATER, answer, arrive, fin, notes, opened
from metadata_scene import ALICE, BOB, CHARLIE, FRAMED, HOLD_S, IDLE_S, Q1, S1, arbiter, frame

from controller_apps.light.paths import Hop
from controller_apps.policy.reading import parse_policy
from controller_apps.sessions.actions import Action, ClosePaths, Keep, Note
from controller_apps.sessions.admission import Admission
from controller_apps.sessions.arbiter import Arbiter
from controller_apps.sessions.permission import Permission
from controller_apps.sessions.sessions import Stop
from controller_apps.sessions.snapshot import decode_session
from controller_apps.timeouts import NODE_TIMEOUT_S
from wire.features import EVERYTHING, NodeFeatures
from wire.malformed import MalformedPacket
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Reason, Service, Verdict

SWAP = replace(FRAMED, service=Service.SWAP, fidelity_ppm=900_000)
CHAIN = (ALICE, CHARLIE, BOB)
FIRST = replace(SWAP, session=8, service=Service.LINK, source=ALICE, fidelity_ppm=0)
SECOND = replace(FIRST, session=9, source=CHARLIE)


def ask_swap(state: Arbiter, now: float = 0.0) -> list[Action]:
    return arrive(state, frame(SWAP.encode()), now)


def chained(state: Arbiter | None = None, now: float = 0.0) -> Arbiter:
    """Return an arbiter that has granted a chain."""
    state = state or arbiter()
    ask_swap(state, now)
    for node in CHAIN:
        actions = state.node_answered(7, node, Reason.OK, now)
    assert answer(actions).verdict == Verdict.GRANTED
    return state


def ask_link(
    state: Arbiter,
    setup: Setup,
    source: str = ALICE,
    destination: str = CHARLIE,
    now: float = 0.0,
    sport: int = 50000,
) -> list[Action]:
    segment = frame(setup.encode(), sport=sport, source=source, destination=destination)
    return arrive(state, segment, now)


def linked(state: Arbiter, now: float = 0.0) -> Arbiter:
    """Return an arbiter after it has granted the first link."""
    actions = ask_link(state, FIRST, now=now)
    assert opened(actions).hops == (Hop(Q1, 1, 4),)
    granted = state.barrier_passed(Q1, opened(actions).transaction, now)
    assert answer(granted).verdict == Verdict.GRANTED
    return state


def test_a_swap_is_granted_when_the_last_node_has_answered_its_order() -> None:
    state = arbiter()
    ask_swap(state, 1.0)
    assert state.node_answered(7, BOB, Reason.OK, 1.1) == []
    assert state.node_answered(7, ALICE, Reason.OK, 1.1) == []
    assert state.node_answered(7, ALICE, Reason.OK, 1.1) == []  # once more
    assert state.node_answered(7, "10.0.0.9", Reason.OK, 1.1) == []  # of another chain
    assert state.node_answered(6, CHARLIE, Reason.OK, 1.1) == []
    actions = state.node_answered(7, CHARLIE, Reason.OK, 1.25)
    assert answer(actions) == replace(SWAP, verdict=Verdict.GRANTED)
    assert notes(actions) == ["chain_ready", "granted"]
    (ready,) = [a for a in actions if isinstance(a, Note) and a.event == "chain_ready"]
    assert ready.setup_ms == pytest.approx(250)


def test_a_node_that_does_not_answer_is_named_soon() -> None:
    state = arbiter()
    ask_swap(state)
    state.node_answered(7, ALICE, Reason.OK, 0.1)
    state.node_answered(7, BOB, Reason.OK, 0.1)
    assert state.tick(NODE_TIMEOUT_S - 0.01) == []
    actions = state.tick(NODE_TIMEOUT_S)
    told = replace(SWAP, source=CHARLIE, verdict=Verdict.REFUSED, reason=Reason.NODE_SILENT)
    assert answer(actions) == told
    assert not state.sessions.by_number
    assert not state.sessions.held
    assert state.node_answered(7, CHARLIE, Reason.OK, NODE_TIMEOUT_S + 0.1) == []
    # TCP may repeat the set-up: it gets the same answer.
    assert answer(ask_swap(state, NODE_TIMEOUT_S + 0.2)) == told
    assert NODE_TIMEOUT_S < HOLD_S


def test_a_node_that_refuses_its_order_is_named_at_once() -> None:
    state = arbiter()
    ask_swap(state)
    told = answer(state.node_answered(7, CHARLIE, Reason.UNSUPPORTED, 0.1))
    assert (told.verdict, told.reason, told.source) == (
        Verdict.REFUSED,
        Reason.UNSUPPORTED,
        CHARLIE,
    )
    assert not state.sessions.by_number


def test_a_swap_is_kept_with_its_chain_and_read_back() -> None:
    state = arbiter()
    ask_swap(state)
    for node in CHAIN:
        actions = state.node_answered(7, node, Reason.OK, 0.0)
    (kept,) = [action for action in actions if isinstance(action, Keep)]
    session = decode_session(kept.data, 1.0)
    assert (session.setup, session.paths, session.open) == (SWAP, (), True)
    assert session.chain == (Stop(ALICE), Stop(CHARLIE, 0, 1), Stop(BOB))
    address = 10  # bytes, with two fibres and a station
    for wrong in (
        kept.data[: -3 * address - 1] + b"\0",  # a swap without a chain
        kept.data[:-address] + kept.data[-2 * address : -address],  # a node twice
        kept.data[:-address] + b"\x0a\0\0\x09\0\0" + bytes(4),  # it ends at another host
    ):
        with pytest.raises(MalformedPacket, match="chain"):
            decode_session(wrong, 1.0)


def test_another_controller_grants_the_links_of_a_chain_that_was_kept() -> None:
    state = arbiter()
    ask_swap(state)
    for node in CHAIN:
        actions = state.node_answered(7, node, Reason.OK, 0.0)
    (kept,) = [action for action in actions if isinstance(action, Keep)]
    successor = arbiter()
    successor.resume(decode_session(kept.data, 1.0), 1.0)
    linked(successor, 1.0)


def test_the_links_of_a_granted_chain_get_light() -> None:
    state = linked(chained())
    actions = ask_link(state, SECOND, CHARLIE, BOB)
    assert opened(actions).hops == (Hop(Q1, 5, 2),)


@pytest.mark.parametrize(
    ("setup", "source", "destination"),
    [
        (replace(FIRST, session=6), ALICE, CHARLIE),  # of no chain
        (replace(FIRST, session=10), ALICE, CHARLIE),  # of a place behind the last
        (replace(FIRST, session=7), ALICE, CHARLIE),  # the chain itself
        (FIRST, ALICE, BOB),  # past the repeater
        (FIRST, CHARLIE, BOB),  # another one's
        (SECOND, BOB, CHARLIE),  # the wrong way
        (SECOND, ALICE, CHARLIE),
        (replace(FIRST, source=BOB), ALICE, CHARLIE),
        (replace(FIRST, rate_hz=FIRST.rate_hz + 1), ALICE, CHARLIE),
        (replace(FIRST, pairs=FIRST.pairs + 1), ALICE, CHARLIE),
        (replace(FIRST, wavelength_pm=1_551_720), ALICE, CHARLIE),
    ],
)
def test_any_other_link_is_refused(setup: Setup, source: str, destination: str) -> None:
    state = chained()
    actions = ask_link(state, setup, source, destination, sport=50001)
    told = answer(actions)
    assert (told.verdict, told.reason) == (Verdict.REFUSED, Reason.UNKNOWN_SESSION)
    assert list(state.sessions.by_number) == [7]
    assert not state.sessions.occupied
    linked(state)  # and the one that was ordered is not in the way of it


def test_a_link_is_refused_while_its_chain_is_not_granted() -> None:
    state = arbiter()
    ask_swap(state)
    assert answer(ask_link(state, FIRST)).reason == Reason.UNKNOWN_SESSION


def test_a_link_whose_fibre_is_gone_gets_no_other_light() -> None:
    state = chained()
    for port, host_port in list(state.network.hosts.items()):
        if (host_port.address, host_port.name[-1]) == (CHARLIE, "1"):
            state.network.detach(port)
    told = answer(ask_link(state, SECOND, CHARLIE, BOB))
    assert (told.verdict, told.reason) == (Verdict.REFUSED, Reason.NO_PATH)


def test_links_end_with_their_chain_and_free_their_light() -> None:
    state = linked(chained())
    waiting = opened(ask_link(state, SECOND, CHARLIE, BOB)).transaction
    actions = arrive(state, fin(), 1.0)
    assert [action for action in actions if isinstance(action, ClosePaths)] == [
        ClosePaths(Q1, 8),
        ClosePaths(Q1, 9),
    ]
    told = answer(actions)  # to the link that was not granted yet
    assert (told.session, told.verdict, told.reason) == (
        9,
        Verdict.REFUSED,
        Reason.UNKNOWN_SESSION,
    )
    ended = [a for a in actions if isinstance(a, Note) and a.event == "torn_down"]
    assert Note("torn_down", 8, detail="its chain is over") in ended
    assert not state.sessions.by_number
    assert not state.sessions.occupied
    assert state.barrier_passed(Q1, waiting, 1.1) == []


def test_a_link_that_ends_leaves_its_chain() -> None:
    state = linked(chained())
    arrive(state, fin(sport=50000, destination=CHARLIE), 1.0)
    assert list(state.sessions.by_number) == [7]
    assert not state.sessions.occupied


def test_a_chain_is_not_idle_while_its_links_are_in_use() -> None:
    state = linked(chained())
    later = frame(b"more", seq=LATER, sport=50000, destination=CHARLIE)
    arrive(state, later, IDLE_S - 1)
    assert notes(state.tick(IDLE_S)) == []
    assert list(state.sessions.by_number) == [7, 8]


def test_a_chain_and_its_links_that_fall_silent_end_once_each() -> None:
    state = linked(chained())
    assert notes(state.tick(IDLE_S)).count("torn_down") == 1  # the link
    assert notes(state.tick(IDLE_S)).count("torn_down") == 1  # then the chain
    assert not state.sessions.by_number


def test_a_link_waits_for_the_rest_of_its_chain_however_long_that_takes_to_stand() -> None:
    state = linked(chained())
    late = IDLE_S - 5
    actions = ask_link(state, SECOND, CHARLIE, BOB, now=late)
    state.barrier_passed(Q1, opened(actions).transaction, late)
    assert notes(state.tick(IDLE_S + 1)) == []
    assert list(state.sessions.by_number) == [7, 8, 9]
    assert notes(state.tick(late + IDLE_S)).count("torn_down") == 2


def test_links_are_allowed_with_their_chain_and_count_for_nothing() -> None:
    state = arbiter()
    policy = "default = 'deny'\n[[rule]]\naction = 'allow'\nfrom = 'alice'\nmax_sessions = 2"
    policy += "\n[filter]\nnumbers = false"
    permission = Permission(parse_policy(policy), state.network, state.sessions)
    state.terms.forbid = lambda setup, connection: (
        Admission(Reason.NOT_ALLOWED) if permission.objection(setup, connection) else None
    )
    linked(chained(state))
    opened(ask_link(state, SECOND, CHARLIE, BOB))
    another = replace(SWAP, session=70)
    assert permission.objection(another, state.sessions.by_number[7].owner) == ""


def test_a_fault_of_a_chain_is_no_switchs() -> None:
    """A chain that waits for its nodes waits for no barrier."""
    state = arbiter()
    ask_swap(state)
    assert state.switch_left(S1, 0.5) == []
    assert notes(state.tick(NODE_TIMEOUT_S)) == ["refused"]


def test_a_link_comes_with_the_blocks_that_memories_take_and_no_larger_ones() -> None:
    state = arbiter()
    small = NodeFeatures(EVERYTHING, 32)
    state.network.hosts = {
        at: replace(host, node_features=small) for at, host in state.network.hosts.items()
    }
    chained(state)
    larger = ask_link(state, FIRST)
    assert answer(larger).reason == Reason.UNKNOWN_SESSION
    actions = ask_link(state, replace(FIRST, pairs=16), sport=50001)  # half of a repeater's memory
    granted = state.barrier_passed(Q1, opened(actions).transaction, 0.0)
    assert answer(granted) == replace(FIRST, pairs=16, verdict=Verdict.GRANTED)
