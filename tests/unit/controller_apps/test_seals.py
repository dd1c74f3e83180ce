"""The controller's seal is on what it lets on, and the receiving host checks it."""

from dataclasses import replace

import pytest
from metadata_scene import (
    ALICE,
    BOB,
    FRAMED,
    PAIR_SOURCE,
    Q1,
    S1,
    arbiter,
    frame,
    payload_of,
)

from controller_apps.sessions.actions import Action, Forward, Keep, OpenPaths
from controller_apps.sessions.arbiter import Arbiter
from controller_apps.sessions.snapshot import decode_session
from wire.metadata.header import HEADER, METADATA_PORT
from wire.metadata.setup import Setup
from wire.verdict import is_sealed

KEY = "0011223344556677"
CONNECTION = ALICE, 40000, BOB, METADATA_PORT


def ask(state: Arbiter, message: bytes, now: float = 0.0) -> list[Action]:
    actions = state.segment_arrived(S1, 1, frame(message), now)
    for action in list(actions):
        if isinstance(action, OpenPaths):
            actions += state.barrier_passed(Q1, action.transaction, now)
    return actions


def answer(actions: list[Action]) -> bytes:
    (sent,) = [action for action in actions if isinstance(action, Forward)]
    return payload_of(sent.frame)


UNKNOWN = bytearray(FRAMED.encode())
UNKNOWN[HEADER.size] = 99
ASKED = {
    "granted": FRAMED.encode(),
    "refused": replace(PAIR_SOURCE, session=99).encode(),
    "unknown": bytes(UNKNOWN),
}


@pytest.mark.parametrize("message", ASKED.values(), ids=ASKED)
def test_every_verdict_is_sealed_for_its_connection(message: bytes) -> None:
    sent = answer(ask(arbiter(keys={BOB: KEY}), message))
    assert len(sent) == len(message)
    assert is_sealed(sent, KEY, CONNECTION)
    assert not is_sealed(sent, KEY, (ALICE, 40001, BOB, METADATA_PORT))


def test_a_repeated_message_is_sealed_alike() -> None:
    state = arbiter(keys={BOB: KEY})
    first = answer(ask(state, FRAMED.encode()))
    assert answer(ask(state, FRAMED.encode(), 1.0)) == first


def test_a_host_that_is_not_ours_gets_no_seal() -> None:
    sent = answer(ask(arbiter(keys={ALICE: KEY}), FRAMED.encode()))
    assert Setup.parse(0, sent[HEADER.size :]).seal == bytes(16)


def test_a_successor_seals_what_it_takes_over() -> None:
    actions = ask(arbiter(keys={BOB: KEY}), FRAMED.encode())
    (kept,) = [action.data for action in actions if isinstance(action, Keep)]
    state = arbiter(keys={BOB: KEY})
    state.resume(decode_session(kept, 1000.0), 1000.0)
    assert answer(ask(state, FRAMED.encode(), 1000.0)) == answer(actions)
