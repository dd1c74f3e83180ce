"""Set-up messages of alice that come to an arbiter, and what it answers."""

from typing import Any

from metadata_scene import (
    BOB,
    FRAMED,
    Q1,
    S1,
    frame,
    payload_of,
)

from controller_apps.light.paths import Hop
from controller_apps.sessions.actions import (
    Action,
    Drop,
    Forward,
    Note,
    OpenPaths,
)
from controller_apps.sessions.arbiter import Arbiter
from wire.metadata.decoding import decode
from wire.metadata.setup import SETUP_LENGTH, Setup

PATHS = (Hop(Q1, 4, 1), Hop(Q1, 1, 3), Hop(Q1, 5, 2))
LATER = 100 + SETUP_LENGTH  # sequence number of what follows the set-up


def arrive(state: Arbiter, data: bytes, now: float = 0.0, dpid: int = S1) -> list[Action]:
    return state.segment_arrived(dpid, 1, data, now)


def ask(state: Arbiter, setup: Setup, now: float = 0.0, **tcp: Any) -> list[Action]:
    return arrive(state, frame(setup.encode(), **tcp), now)


def opened(actions: list[Action]) -> OpenPaths:
    (action,) = [action for action in actions if isinstance(action, OpenPaths)]
    return action


def answer(actions: list[Action]) -> Setup:
    (sent,) = [action for action in actions if isinstance(action, Forward)]
    message = decode(payload_of(sent.frame))
    assert isinstance(message, Setup)
    return message


def cause(actions: list[Action]) -> str:
    (dropped,) = actions
    assert isinstance(dropped, Drop)
    return dropped.cause


def notes(actions: list[Action]) -> list[str]:
    return [action.event for action in actions if isinstance(action, Note)]


def granted(state: Arbiter, setup: Setup = FRAMED, now: float = 0.0, **tcp: Any) -> Setup:
    transaction = opened(ask(state, setup, now, **tcp)).transaction
    return answer(state.barrier_passed(Q1, transaction, now))


def fin(seq: int = LATER, sport: int = 40000, destination: str = BOB) -> bytes:
    return frame(flags="FA", seq=seq, sport=sport, destination=destination)
