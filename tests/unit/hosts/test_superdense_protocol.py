"""Sender and receiver of superdense coding back to back: a list for a network, a table for light.

The table says which Bell state two Pauli operators leave of Phi+: it is computed here from their
matrices.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from hashlib import sha256
from typing import TypeVar

import numpy as np
import pytest

from hosts.hardware.replies import Symbols
from hosts.middleware.services.superdense.options import SuperdenseOptions
from hosts.middleware.services.superdense.receiver import (
    Collect,
    Discard,
    Measure,
    Receiver,
    answer_to,
)
from hosts.middleware.services.superdense.sender import (
    ATTEMPTS_LIMIT,
    Light,
    Sender,
    Singles,
    blocks_under_way,
)
from hosts.middleware.session.errors import SessionError
from hosts.timeouts import DARK_LIMIT_S
from wire.metadata.blocks import Block, Finish, Report
from wire.metadata.decoding import decode
from wire.metadata.header import Message
from wire.metadata.setup import Answer, Setup
from wire.metadata.vocabulary import Handshake, Reason, Service
from wire.outcomes import Pauli

SETUP = Setup(7, Service.SDC, Handshake.FRAMED, "10.0.0.3", 64, 8, 1_000_000)
DATA = bytes(range(256)) * 2
LOST = 255

ONE, X, Z = np.eye(2), np.array([[0, 1], [1, 0]]), np.diag([1, -1])
PAULIS = (ONE, X, Z, X @ Z)  # numbered as on the wire
PHI_PLUS = np.array([1, 0, 0, 1]) / np.sqrt(2)
BELL = [np.kron(pauli, ONE) @ PHI_PLUS for pauli in PAULIS]  # Phi+, Psi+, Phi-, Psi-, up to a sign


def bell_state(first: int, second: int) -> int:
    """Return which Bell state these operators on the first half leave of Phi+."""
    left = np.kron(PAULIS[second] @ PAULIS[first], ONE) @ PHI_PLUS
    overlaps = [abs(state @ left) for state in BELL]
    assert sorted(overlaps)[-2] < 1e-12
    return int(np.argmax(overlaps))


OUTCOMES = np.array([[bell_state(one, two) for two in range(4)] for one in range(4)], np.uint8)

M = TypeVar("M", bound=Message)
Fiber = Callable[[Symbols], Symbols]  # what becomes of Bell states on their way


def over_the_wire(message: M) -> M:
    """Return the message as the other end reads it."""
    read = decode(message.encode())
    assert type(read) is type(message)
    return read


class Ends:
    """A sender, a receiver and the light between them."""

    def __init__(self, setup: Setup = SETUP, symbols: int = 4, fiber: Fiber = np.copy) -> None:
        self.setup, self._fiber = setup, fiber
        answer = over_the_wire(answer_to(setup, symbols, setup.rotation))
        self.sender = Sender(setup, answer, "bob", now_s=0.0)
        self.receiver = Receiver(setup, symbols, "alice")
        self.received, self.now_s = b"", 0.0
        self.pairs: Counter[str] = Counter()  # as the fibre has counted them

    def light(self, paulis: Symbols) -> Symbols:
        """Return what a Bell analyser sees of halves sent with these operators."""
        seen = self._fiber(OUTCOMES[paulis, self.setup.rotation])
        self.pairs.update(lit=seen.size, lost=int(np.count_nonzero(seen == LOST)))
        return seen

    def single(self, number: int, symbol: Symbols) -> Symbols:
        """Make the handshake and the light of one pair."""
        setup = over_the_wire(self.sender.single(number))
        assert (setup.handshake, setup.block, setup.pairs) == (Handshake.ONE_PAIR, number, 1)
        answer, measure = self.receiver.join(setup, "alice")
        encoding = self.sender.single_encoding(over_the_wire(answer))
        operator = np.array([encoding >> 2 * int(symbol[0]) & 3], np.uint8)
        return self.receiver.read(measure, self.light(operator))

    def turn(self, order: Light | Singles) -> None:
        """Carry out an order, both ways."""
        match order:
            case Light():
                outcomes = self.light(order.paulis)
                do = self.receiver.block(over_the_wire(self.sender.lit(5)))
                assert isinstance(do, Measure)
                symbols = self.receiver.read(do, outcomes)
            case Singles():
                each = [
                    self.single(order.first + index, order.symbols[index : index + 1])
                    for index in range(order.symbols.size)
                ]
                do = self.receiver.block(over_the_wire(self.sender.lit(5)))
                assert isinstance(do, Collect)
                assert list(do.numbers) == [order.first + index for index in range(len(each))]
                symbols = np.concatenate(each)
        self.report(symbols)

    def report(self, symbols: Symbols) -> None:
        """Let the receiver take symbols, and the sender hear of it."""
        data, report = self.receiver.arrived(symbols)
        self.received += data
        self.now_s += 1.0
        self.sender.heard(over_the_wire(report), self.now_s)

    def send(self, data: bytes) -> None:
        """Send all of it."""
        self.sender.send(data)
        while (order := self.sender.next_order()) is not None:
            self.turn(order)


def losing(seed: int, loss: float) -> Fiber:
    """Return a fibre that loses photons."""
    draws = np.random.default_rng(seed)
    return lambda states: np.where(draws.random(states.size) < loss, LOST, states).astype(np.uint8)


@pytest.mark.parametrize("handshake", [Handshake.FRAMED, Handshake.PER_PAIR])
@pytest.mark.parametrize("rotation", list(Pauli))
def test_bytes_come_as_they_were_sent_behind_any_known_rotation(
    handshake: Handshake, rotation: Pauli
) -> None:
    ends = Ends(replace(SETUP, handshake=handshake, rotation=rotation))
    ends.send(DATA[:100])
    ends.send(DATA[100:])
    assert ends.received == DATA
    assert ends.sender.sent == (len(DATA), sha256(DATA).digest())
    assert ends.pairs["lit"] == ends.sender.statistics.bell_pairs == 4 * len(DATA)
    ends.receiver.finish(Finish(7, len(DATA), sha256(DATA).digest()))


@pytest.mark.parametrize("rotation", list(Pauli))
def test_an_analyser_that_tells_three_states_receives_bytes_too(rotation: Pauli) -> None:
    def linear(states: Symbols) -> Symbols:
        return np.where(states == 2, 0, states).astype(np.uint8)  # it reports Phi- as Phi+

    ends = Ends(replace(SETUP, rotation=rotation, pairs=100), symbols=3, fiber=linear)
    ends.send(DATA)
    assert ends.received == DATA


@pytest.mark.parametrize("handshake", [Handshake.FRAMED, Handshake.PER_PAIR])
def test_lost_pairs_are_sent_again_and_counted_at_both_ends(handshake: Handshake) -> None:
    ends = Ends(replace(SETUP, handshake=handshake), fiber=losing(1, 0.4))
    ends.send(DATA)
    assert ends.received == DATA
    counted, lost = ends.sender.statistics, ends.pairs["lost"]
    assert lost > 0
    assert counted.lost_pairs == ends.receiver.statistics.lost_pairs == lost
    assert counted.received_symbols == ends.pairs["lit"] - lost
    assert counted.bell_pairs == ends.pairs["lit"]


def test_a_block_without_light_is_let_go_and_its_bytes_go_into_the_next() -> None:
    ends = Ends()
    ends.sender.send(DATA[:8])
    dark = ends.sender.next_order()
    assert isinstance(dark, Light)
    order = ends.receiver.block(over_the_wire(ends.sender.dark("no light here")))
    assert order == Discard(dark.block)
    ends.report(np.empty(0, np.uint8))
    assert ends.received == b""
    again = ends.sender.next_order()
    assert isinstance(again, Light)
    assert again.block == dark.block + 1
    assert np.array_equal(again.paulis, dark.paulis)
    ends.turn(again)
    assert ends.received == DATA[:8]
    assert ends.sender.statistics.lost_pairs == dark.paulis.size
    assert ends.sender.next_order() is None


def test_blocks_are_under_way_while_the_receiver_has_not_reported() -> None:
    ends = Ends()
    ends.sender.send(DATA)  # 32 blocks of 8 frames
    orders = []
    while (order := ends.sender.next_order()) is not None:
        orders.append(order)
    assert [order.block for order in orders if isinstance(order, Light)] == [1, 2, 3, 4]
    ends.turn(orders[0])
    following = ends.sender.next_order()
    assert isinstance(following, Light)
    assert following.block == 5
    assert ends.sender.next_order() is None
    for order in (*orders[1:], following):
        ends.turn(order)
    ends.send(b"")
    assert ends.received == DATA
    assert ends.sender.statistics.bell_pairs == 4 * len(DATA)


@pytest.mark.parametrize(("pairs", "most"), [(64, 4), (65_536, 4), (131_072, 2), (262_144, 1)])
def test_few_blocks_are_under_way_where_they_are_large(pairs: int, most: int) -> None:
    setup = replace(SETUP, pairs=pairs)
    assert blocks_under_way(setup) == most
    assert blocks_under_way(replace(setup, handshake=Handshake.PER_PAIR)) == 1


def test_what_was_lost_is_sent_again_once_every_block_is_reported_of() -> None:
    def first_lost(states: Symbols) -> Symbols:
        lost = ends.pairs["lit"] == 0
        return np.where(np.arange(states.size) < 3 * lost, LOST, states).astype(np.uint8)

    ends = Ends(fiber=first_lost)
    ends.sender.send(DATA)
    orders = [ends.sender.next_order() for _ in range(4)]
    for number, order in enumerate(orders, 1):
        assert isinstance(order, Light)
        ends.turn(order)
        refills = ends.sender.next_order()
        assert (refills is None) == (number < 4)
    assert isinstance(refills, Light)
    assert ends.sender.lit(5).refills == 3


def test_blocks_behind_one_without_light_are_called_off() -> None:
    ends = Ends()
    ends.sender.send(DATA)
    orders = [ends.sender.next_order() for _ in range(4)]
    assert all(isinstance(order, Light) for order in orders)
    ends.turn(orders[0])  # type: ignore[arg-type]
    for number in (2, 3, 4):
        assert ends.sender.is_called_off(number) == (number > 2)
        if number > 2:
            with pytest.raises(ValueError, match="is called off"):
                ends.sender.lit(5)
        order = ends.receiver.block(over_the_wire(ends.sender.dark("no light here")))
        assert order == Discard(number)
        ends.report(np.empty(0, np.uint8))
    ends.send(b"")
    assert ends.received == DATA
    assert ends.sender.statistics.lost_pairs == 3 * 64
    assert ends.sender.statistics.bell_pairs == 4 * len(DATA) + 3 * 64


def test_a_half_that_did_not_come_loses_its_whole_block() -> None:
    receiver = Receiver(SETUP, 4, "alice")
    symbols = receiver.read(Measure(1, 5, Pauli.X), None)
    assert symbols.tolist() == [LOST] * 5


def test_the_sender_gives_up_when_it_has_been_dark_for_too_long() -> None:
    ends = Ends(fiber=losing(1, 1.0))
    with pytest.raises(SessionError, match="no pair reached bob") as caught:
        ends.send(DATA)
    assert caught.value.reason == Reason.NO_LIGHT
    assert ends.now_s == DARK_LIMIT_S + 1  # blocks take a second each here


def test_the_sender_gives_up_on_a_frame_that_never_passes_its_check() -> None:
    ends = Ends(replace(SETUP, rotation=Pauli.X))
    ends.setup = SETUP  # the fibres turn nothing, against the setting
    with pytest.raises(SessionError, match=f"failed its check {ATTEMPTS_LIMIT} times") as caught:
        ends.send(DATA[:8])
    assert caught.value.reason == Reason.TOO_NOISY
    assert ends.pairs["lit"] == 32 * ATTEMPTS_LIMIT


@pytest.mark.parametrize(
    "change",
    [{"block": 2}, {"pairs": 31}, {"failed": (9,)}, {"failed": (0, 0)}],
)
def test_a_report_of_something_else_ends_the_session(change: dict[str, object]) -> None:
    ends = Ends()
    ends.sender.send(DATA[:8])
    ends.sender.next_order()
    ends.sender.lit(0)
    report = replace(Report(7, 1, 32, 0, 0, 0, 0, (), b""), **change)  # type: ignore[arg-type]
    with pytest.raises(SessionError, match="report of") as caught:
        ends.sender.heard(report, 1.0)
    assert caught.value.reason == Reason.PROTOCOL


def test_an_answer_with_another_analyser_ends_the_session() -> None:
    with pytest.raises(SessionError, match="does not say what its analyser can do"):
        Sender(SETUP, Answer(7, Reason.OK), "bob", 0.0)
    ends = Ends(replace(SETUP, handshake=Handshake.PER_PAIR))
    with pytest.raises(SessionError, match="bob distinguishes 3 Bell states, before 4"):
        ends.sender.single_encoding(answer_to(SETUP, 3, Pauli.I))


def test_pairs_are_taken_once_from_their_own_sender_after_a_handshake() -> None:
    receiver = Receiver(replace(SETUP, handshake=Handshake.PER_PAIR), 4, "alice")
    one = replace(SETUP, handshake=Handshake.ONE_PAIR, block=1, pairs=1)
    with pytest.raises(SessionError, match="of a session of alice from mallory"):
        receiver.join(one, "mallory")
    receiver.join(one, "alice")
    with pytest.raises(SessionError, match="is its set-up a replay"):
        receiver.join(one, "alice")
    with pytest.raises(SessionError, match="pair 2 had no handshake"):
        receiver.block(Block(7, 1, 4, 0, 0, ()))


def test_a_block_larger_than_agreed_on_is_refused() -> None:
    with pytest.raises(SessionError, match="block 1 has 65 pairs"):
        Receiver(SETUP, 4, "alice").block(Block(7, 1, 65, 0, 0, ()))


def test_light_of_another_number_of_pairs_is_refused() -> None:
    with pytest.raises(SessionError, match="block 1: 3 pairs of light"):
        Receiver(SETUP, 4, "alice").read(Measure(1, 4, Pauli.I), np.zeros(3, np.uint8))


def test_what_came_must_be_what_was_sent() -> None:
    ends = Ends()
    ends.send(DATA)
    for size, digest in ((len(DATA) - 1, sha256(DATA).digest()), (len(DATA), bytes(32))):
        with pytest.raises(SessionError, match=r"512 of 51\d bytes arrived") as caught:
            ends.receiver.finish(Finish(7, size, digest))
        assert caught.value.reason == Reason.WRONG_DIGEST


def test_calls_out_of_turn_are_a_mistake_of_the_caller() -> None:
    ends = Ends()
    with pytest.raises(ValueError, match="next_order\\(\\) comes first"):
        ends.sender.lit(0)
    ends.sender.send(DATA)
    ends.sender.next_order()
    with pytest.raises(ValueError, match="1 blocks are under way"):
        ends.sender.send(DATA)
    with pytest.raises(ValueError, match=r"lit\(\) or dark\(\) come first"):
        ends.sender.heard(Report(7, 1, 64), 1.0)
    with pytest.raises(ValueError, match="waiting, not measuring"):
        ends.receiver.arrived(np.empty(0, np.uint8))


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("frame_bytes", 0, "frame_bytes 0: choose 1 to 65536"),
        ("fec", "turbo", "fec 'turbo': choose one of none, repetition"),
        ("interleave", 3, "interleave 3: choose True or False"),
    ],
)
def test_what_no_session_may_have_is_refused(name: str, value: object, text: str) -> None:
    with pytest.raises(SessionError, match=text):
        SuperdenseOptions.from_fields({"host": "bob", "port": 7, name: value})
