"""Set-ups and closes in the name of others, by guesses at what a connection is about."""

from dataclasses import replace

import pytest
from metadata_scene import (
    ALICE,
    BOB,
    CHARLIE,
    FRAMED,
    Q1,
    S1,
    arbiter,
    frame,
    from_bob,
    is_live,
)

from controller_apps.packets import FiveTuple
from controller_apps.policy.policy import Filter, Policy
from controller_apps.sessions import connections
from controller_apps.sessions.actions import (
    Action,
    AddBypass,
    CountBypass,
    Drop,
    Note,
    OpenPaths,
)
from controller_apps.sessions.arbiter import Arbiter
from controller_apps.sessions.connections import WINDOW
from controller_apps.timeouts import COUNTING_S, HELD_UP_S
from wire.metadata.header import METADATA_PORT
from wire.metadata.setup import SETUP_LENGTH
from wire.metadata.vocabulary import Reason

# Sequence numbers of the first byte of alice and bob, near the end of their space.
A, B = 0xFFFFFFF0, 0xFFFFFF00
ALICE_PORT, BOB_PORT, CHARLIE_PORT = 1, 2, 3
CONNECTION = FiveTuple(ALICE, 40000, BOB, METADATA_PORT)
BEHIND = (A + SETUP_LENGTH) & 0xFFFFFFFF  # what follows the set-up


def state_of(needs_handshake: bool = True) -> Arbiter:
    state = arbiter()
    state.follow(Policy(filter=Filter(handshakes=needs_handshake)))
    return state


def arrive(state: Arbiter, data: bytes, port: int = ALICE_PORT, now: float = 0.0) -> list[Action]:
    return state.segment_arrived(S1, port, data, now)


def accept(state: Arbiter, port: int = BOB_PORT, dport: int = 40000) -> None:
    assert arrive(state, from_bob("SA", B - 1, A, dport), port) == []


def ask(state: Arbiter, seq: int = A, ack: int = B, now: float = 0.0) -> list[Action]:
    return arrive(state, frame(FRAMED.encode(), seq=seq, ack=ack), now=now)


def opened(state: Arbiter) -> Arbiter:
    """Open alice's session."""
    accept(state)
    (action,) = ask(state)
    assert isinstance(action, OpenPaths)
    state.barrier_passed(Q1, action.transaction, 0.0)
    assert is_live(state, FRAMED.session)
    return state


def causes(actions: list[Action]) -> list[str]:
    return [action.cause for action in actions if isinstance(action, Drop)]


def torn_down(actions: list[Action]) -> bool:
    return any(isinstance(action, Note) and action.event == "torn_down" for action in actions)


def test_a_set_up_follows_a_handshake() -> None:
    opened(state_of())


@pytest.mark.parametrize(("seq", "ack"), [(A, B + 1), (A, 0), (A + 1, B), (100, 1)])
def test_who_has_not_heard_the_other_end_asks_for_nothing(seq: int, ack: int) -> None:
    state = state_of()
    assert causes(ask(state, seq, ack)) == ["unopened"]
    accept(state)
    assert causes(ask(state, seq, ack)) == ["unopened"]
    assert not state.sessions.requests


def test_who_speaks_for_both_ends_is_found_by_the_port() -> None:
    state = state_of()
    accept(state, ALICE_PORT)
    assert causes(ask(state)) == ["unopened"]


def test_a_set_up_on_the_connection_of_another_does_not_end_it() -> None:
    state = opened(state_of())
    elsewhere = frame(FRAMED.encode(), seq=5000, ack=1)
    assert causes(arrive(state, elsewhere)) == ["unopened"]
    assert is_live(state, FRAMED.session)


def test_a_new_connection_between_the_same_ports_takes_the_place_of_the_old() -> None:
    state = opened(state_of())
    arrive(state, from_bob("SA", 6999, 5000), BOB_PORT)
    assert torn_down(arrive(state, frame(FRAMED.encode(), seq=5000, ack=7000)))


def test_after_another_controller_handshakes_are_not_known_for_a_while() -> None:
    state = state_of()
    state.recovery.begun = 1000.0
    assert causes(ask(state, now=1000.0 + HELD_UP_S)) == ["unopened"]
    assert any(isinstance(action, OpenPaths) for action in ask(state, now=1000.0))


def test_the_handshakes_of_one_host_crowd_out_its_own_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(connections, "MAX_OF_ONE", 4)
    state = state_of()
    accept(state)
    for port in range(5):  # to charlie, and from bob: as if he had asked
        answer = bytearray(from_bob("SA", B - 1, A, 41000 + port))
        answer[30:34] = bytes(map(int, CHARLIE.split(".")))
        arrive(state, bytes(answer), BOB_PORT)
    assert len(state.handshakes._by_connection) == 5
    assert any(isinstance(action, OpenPaths) for action in ask(state))


@pytest.mark.parametrize("flags", ["FA", "RA"])
@pytest.mark.parametrize(
    ("seq", "ack"),
    [
        (BEHIND + WINDOW + 1, B),
        (A - 1, B),
        (BEHIND, B + WINDOW + 1),
        (BEHIND, B - 1),
        (0x40000000, 0x40000000),
    ],
)
def test_a_blind_close_ends_nothing(flags: str, seq: int, ack: int) -> None:
    state = opened(state_of())
    blind = frame(flags=flags, seq=seq & 0xFFFFFFFF, ack=ack & 0xFFFFFFFF)
    assert arrive(state, blind, CHARLIE_PORT) == []
    assert arrive(state, from_bob("RA", ack & 0xFFFFFFFF, seq & 0xFFFFFFFF), CHARLIE_PORT) == []
    assert is_live(state, FRAMED.session)
    state.follow(Policy(filter=Filter(sequences=False)))  # for attack studies: any close counts
    assert torn_down(arrive(state, blind, CHARLIE_PORT))
    assert not is_live(state, FRAMED.session)


@pytest.mark.parametrize(
    "data",
    [
        frame(flags="FA", seq=BEHIND, ack=B + 20),
        frame(flags="RA", seq=(BEHIND + WINDOW) & 0xFFFFFFFF, ack=B),
        frame(flags="R", seq=BEHIND),
        from_bob("RA", B, BEHIND),
        from_bob("R", B, 0),
    ],
)
def test_a_close_of_the_connection_itself_ends_it(data: bytes) -> None:
    state = opened(state_of())
    assert torn_down(arrive(state, data))
    assert not is_live(state, FRAMED.session)


@pytest.mark.parametrize("data", [frame(flags="R", seq=BEHIND + 1), from_bob("R", B + 1, 0)])
def test_a_reset_that_acknowledges_nothing_has_to_be_exact(data: bytes) -> None:
    state = opened(state_of())
    assert arrive(state, data) == []
    assert is_live(state, FRAMED.session)


@pytest.mark.parametrize(("counted", "ends"), [(3 * WINDOW, True), (WINDOW // 2, False)])
@pytest.mark.parametrize("lags", [False, True])
def test_a_close_far_on_is_held_against_what_the_switch_has_counted(
    counted: int, ends: bool, lags: bool
) -> None:
    state = opened(state_of())
    later = frame(b"later", seq=BEHIND, ack=B)
    assert AddBypass(S1, CONNECTION, FRAMED.session) in arrive(state, later)
    far = frame(flags="FA", seq=(BEHIND + 2 * WINDOW) & 0xFFFFFFFF, ack=B)
    asked = [CountBypass(S1, CONNECTION, FRAMED.session)]
    assert arrive(state, far, now=1.0) == asked
    assert arrive(state, far, now=1.0) == []
    if lags or not ends:
        assert state.bypass_counted(CONNECTION, WINDOW // 2, 1.1) == []
        assert not any(isinstance(action, CountBypass) for action in state.tick(1.2))
        assert state.tick(1.0 + COUNTING_S) == asked
    assert torn_down(state.bypass_counted(CONNECTION, counted, 3.0)) == ends
    assert is_live(state, FRAMED.session) != ends
    assert state.bypass_counted(CONNECTION, 1 << 40, 4.0) == []


NEXT = replace(FRAMED, session=FRAMED.session + 1)


def ask_next(state: Arbiter, now: float) -> list[Action]:
    """Ask for the light of the first session, over another connection."""
    accept(state, dport=40001)
    return arrive(state, frame(NEXT.encode(), sport=40001, seq=A, ack=B), now=now)


def notes(actions: list[Action]) -> list[tuple[str, str]]:
    return [(action.event, action.detail) for action in actions if isinstance(action, Note)]


@pytest.mark.parametrize(("counted", "ends"), [(3 * WINDOW, True), (WINDOW // 2, False)])
def test_light_of_a_session_whose_close_is_being_counted_is_waited_for(
    counted: int, ends: bool
) -> None:
    state = opened(state_of())
    arrive(state, frame(b"later", seq=BEHIND, ack=B))
    arrive(state, frame(flags="FA", seq=(BEHIND + 2 * WINDOW) & 0xFFFFFFFF, ack=B), now=1.0)
    assert notes(ask_next(state, 1.0)) == [("queued", "")]
    state.tick(1.0 + COUNTING_S)
    counted_now = state.bypass_counted(CONNECTION, counted, 3.0)
    assert any(isinstance(action, OpenPaths) for action in counted_now) == ends
    if not ends:  # somebody else has guessed at the close
        late = state.tick(1.0 + state.terms.hold_timeout_s)
        assert notes(late) == [("refused", Reason.BUSY.name)]


def test_light_of_a_session_that_goes_on_is_not_waited_for() -> None:
    state = opened(state_of())
    arrive(state, frame(b"later", seq=BEHIND, ack=B))
    assert notes(ask_next(state, 1.0)) == [("refused", Reason.BUSY.name)]
