"""Opener and acceptor of superdense coding back to back: bytes in lists, light in a table.

The table says which Bell state two Pauli operators leave of Phi+ (test_superdense_protocol); which
blocks come, and when the analyser tells of them, is written down here.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from math import inf
from typing import Any
from zlib import crc32

import numpy as np
import pytest
from steps_scene import Flying, Going, Scene, Wire
from test_distribution_protocol import FOREVER, NODE_FEATURES
from test_superdense_protocol import OUTCOMES

from hosts.hardware.block_name import BlockName
from hosts.hardware.replies import Coincidences, HardwareError, Symbols
from hosts.middleware.services.superdense.acceptor import Acceptor, accepted
from hosts.middleware.services.superdense.opener import HANDSHAKES_AHEAD, LIGHTS_AT_A_TIME, Opener
from hosts.middleware.session import protocol
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.protocol import OpenerSide, Side
from hosts.timeouts import (
    ARRIVED_TIMEOUT_S,
    DARK_LIMIT_S,
    EXPECTED_TIMEOUT_S,
    GRACE_S,
    OUTCOME_TIMEOUT_S,
    PAIR_TIMEOUT_S,
)
from wire.metadata.blocks import Block, Finish, Frame, Report
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Handshake, Reason, Service
from wire.outcomes import Pauli

SETUP = Setup(7, Service.SDC, Handshake.FRAMED, "10.0.0.3", 32, 8, 1000)
DATA = bytes(range(40))
PAIRS_OF_BYTE = 4
LEFT_NS = 5


@dataclass
class Bench:
    """The source, the fibres and the hardware of both hosts."""

    scene: Scene
    rotation: int
    dark: set[int] = field(default_factory=set)  # blocks of which no light comes to the opener
    lost: set[int] = field(default_factory=set)  # of which none comes from there to the acceptor
    late_s: float = 0.0  # outcomes of light that was expected
    light_s: float = 0.0  # that light takes
    broken: bool = False  # the analyser is
    paulis: dict[int, Symbols] = field(default_factory=dict)  # of what was sent on
    sent_s: dict[int, float] = field(default_factory=dict)
    emitted: list[int] = field(default_factory=list)
    discarded: list[int] = field(default_factory=list)
    asked: list[tuple[int, bool]] = field(default_factory=list)  # of the analyser; following
    received: bytes = b""

    def emit(self, block: int, _pairs: int) -> Flying:
        """Let the source make a block, whose light leaves at once."""
        self.emitted.append(block)
        return Flying(lambda: True, lambda: None)

    def modulate(self, half: BlockName, paulis: Symbols, port: str, *_light: float) -> Flying:
        """Send a half on."""
        assert (half.session, half.half, port) == (7, 0, "a-q0")
        block = half.number
        if block in self.dark:
            return Flying(lambda: False, lambda: None)
        left_s = self.scene.now_s + self.light_s
        self.paulis[block], self.sent_s[block] = paulis, left_s
        return Flying(lambda: self.scene.now_s >= left_s, lambda: LEFT_NS, left_s)

    def detect_pairs(
        self, session: int, block: int, ports: Sequence[str], timeout_s: float, following: bool
    ) -> Flying:
        """Find Bell states of two halves, of which the one sent on comes by the second fibre."""
        assert (session, *ports) == (7, "b-q1", "b-q0")
        if self.broken:
            raise HardwareError("dead analyser")
        self.asked.append((block, following))
        late_s = self.late_s if following else inf if self.late_s else 0.0
        assert timeout_s == (EXPECTED_TIMEOUT_S if following else ARRIVED_TIMEOUT_S)

        def come() -> bool:
            here = block in self.sent_s and block not in self.lost
            return here and self.scene.now_s >= self.sent_s[block] + late_s

        def outcome() -> Coincidences:
            found = OUTCOMES[self.paulis[block], self.rotation]
            return Coincidences(found, found.size, 0)

        if following and self.late_s:
            when_s = self.sent_s.get(block, self.scene.now_s)
            self.scene.flying.append(Flying(come, outcome, when_s + late_s))
        return Flying(come, outcome, self.scene.now_s + timeout_s)

    def discard_block(self, session: int, block: int) -> None:
        """Let go of a block."""
        self.discarded.append(block)

    def deliver(self, data: bytes) -> None:
        """Take bytes."""
        self.received += data


class Ends:
    """Both ends of a session."""

    def __init__(self, setup: Setup = SETUP, sequential: bool = False, **bench: Any) -> None:
        self.scene = Scene(join=self._join)
        self.bench = Bench(self.scene, setup.rotation, **bench)
        self.alice, self.bob = self.scene.connection(self.bench, self.bench)
        known, draws = frozenset(range(4)), np.random.default_rng(1)
        side = OpenerSide(
            *(setup, ("a-q0",), "10.0.0.2", "alice", draws, NODE_FEATURES, FOREVER, known),
            *("bob", NODE_FEATURES, FOREVER, False),
        )
        answer = accepted(4, setup)
        self.opener = Opener(side, answer, "charlie", 0.0, sequential)
        self.acceptor = Acceptor(Side(setup, ("b-q0", "b-q1"), "10.0.0.1"), 4)
        self.receiving = self.scene.begin(self.bob, self.acceptor.run())

    def _join(self, wire: Wire, setup: Setup) -> Going:
        return self.scene.begin(self.bob, self.acceptor.join(wire, setup, "10.0.0.1"))

    def send(self, data: bytes = DATA) -> None:
        """Send all of it; the other end has taken the last report back then."""
        self.scene.run(self.scene.begin(self.alice, self.opener.send(data)))

    def finish(self) -> None:
        """End the session."""
        self.alice.say(Finish(7, *self.opener.sent))
        self.scene.run(self.receiving)


PER_PAIR = replace(SETUP, handshake=Handshake.PER_PAIR)
HANDSHAKES = {
    "framed": (SETUP, False),
    "per-pair": (PER_PAIR, False),
    "sequential": (PER_PAIR, True),
}


@pytest.mark.parametrize("handshake", HANDSHAKES)
@pytest.mark.parametrize("rotation", list(Pauli))
def test_bytes_come_as_they_were_sent(handshake: str, rotation: Pauli) -> None:
    setup, sequential = HANDSHAKES[handshake]
    ends = Ends(replace(setup, rotation=rotation), sequential)
    ends.send(DATA[:12])
    ends.send(DATA[12:])
    ends.finish()
    assert ends.bench.received == DATA
    assert ends.opener.sent == (len(DATA), sha256(DATA).digest())
    assert ends.opener.counts()["pairs_sent"] == PAIRS_OF_BYTE * len(DATA)
    assert ends.opener.summary.lost_pairs == ends.acceptor.receiver.statistics.lost_pairs == 0


def test_what_is_said_of_blocks_is_what_they_carry() -> None:
    ends = Ends()
    ends.send(DATA[:20])
    assert ends.alice.messages == [
        Block(7, 1, 32, 0, LEFT_NS, (Frame(0, 8, crc32(DATA[:8])),)),
        Block(7, 2, 32, 0, LEFT_NS, (Frame(1, 8, crc32(DATA[8:16])),)),
        Block(7, 3, 16, 0, LEFT_NS, (Frame(2, 4, crc32(DATA[16:20])),)),
    ]
    assert ends.bob.messages == [Report(7, 1, 32), Report(7, 2, 32), Report(7, 3, 16)]


def test_bytes_may_be_cut_anywhere_on_their_way() -> None:
    whole = Ends()
    whole.send()
    for one, other in ((whole.alice, "bob"), (whole.bob, "alice")):
        for place in range(1, len(one.sent)):
            ends = Ends()
            getattr(ends, other).arrives = place
            ends.send()
            ends.finish()
            assert ends.bench.received == DATA
            assert ends.bob.sent == whole.bob.sent


def test_an_opener_that_is_gone_anywhere_leaves_nothing_but_the_beginning() -> None:
    whole = Ends()
    whole.send()
    for place in range(len(whole.alice.sent)):
        ends = Ends()
        ends.bob.ends = place
        with pytest.raises(SessionError):
            ends.send()
        assert DATA.startswith(ends.bench.received)
        assert len(ends.bench.received) < len(DATA)


def test_an_acceptor_that_is_gone_anywhere_is_not_taken_to_hold_the_bytes() -> None:
    whole = Ends()
    whole.send()
    for place in range(len(whole.bob.sent)):
        ends = Ends()
        ends.alice.ends = place
        with pytest.raises(SessionError) as caught:
            ends.send()
        assert caught.value.reason == Reason.PEER_GONE
        assert ends.opener.sent == (0, sha256().digest())


def test_light_of_four_blocks_is_ordered_before_the_first_report() -> None:
    ends = Ends()
    ends.alice.arrives = 0  # no report comes while there is something to do
    ends.send()
    reports = [order for _when, wire, order in ends.scene.orders if wire is ends.alice]
    begun = [place for place, order in enumerate(reports) if isinstance(order, protocol.BeginEmit)]
    heard = [place for place, order in enumerate(reports) if isinstance(order, protocol.Now)]
    assert [reports[place].block for place in begun] == [1, 2, 3, 4, 5]
    assert begun[3] < heard[0] < begun[4]


def test_a_block_without_light_is_told_of_when_grace_is_over_and_calls_off_those_behind() -> None:
    ends = Ends(dark={2})
    ends.send()
    ends.finish()
    bench = ends.bench
    assert bench.received == DATA
    texts = {each.block: each.pairs for each in ends.alice.messages if isinstance(each, Block)}
    assert [block for block, pairs in texts.items() if pairs == 0] == [2, 3, 4, 5]
    assert sorted(bench.sent_s) == [1, 6, 7, 8, 9]
    assert bench.discarded.count(2) == 1  # at the acceptor; those called off at both ends
    assert [bench.discarded.count(block) for block in (3, 4, 5)] == [2, 2, 2]
    assert bench.sent_s[6] == GRACE_S + 32 / SETUP.rate_hz
    assert ends.opener.summary.lost_pairs == 4 * 32


def test_an_opener_without_light_gives_up_in_time() -> None:
    ends = Ends(dark=set(range(1, 1000)))
    with pytest.raises(SessionError, match="no light from charlie at a-q0 for 10 s") as caught:
        ends.send()
    assert caught.value.reason == Reason.NO_LIGHT
    wait_s = GRACE_S + 32 / SETUP.rate_hz
    assert DARK_LIMIT_S < ends.scene.now_s <= DARK_LIMIT_S + wait_s + 1e-9


def test_light_that_is_lost_behind_the_opener_is_sent_again() -> None:
    ends = Ends(lost={1})
    ends.send()
    ends.finish()
    assert ends.bench.received == DATA
    assert ends.bob.messages[0] == Report(7, 1, 32, 32, again=bytes([0xFF] * 4))
    assert ends.bench.discarded == [1]


def test_each_block_is_expected_before_there_is_word_of_it() -> None:
    ends = Ends()
    ends.send()
    assert ends.bench.asked == [(block, True) for block in range(1, 7)]
    assert [ahead.cancelled for ahead in ends.scene.flying if not ahead.come()] == [False]


LOST_S = OUTCOME_TIMEOUT_S + ARRIVED_TIMEOUT_S  # then the analyser says that it has seen nothing


@pytest.mark.parametrize("late_s", [OUTCOME_TIMEOUT_S / 2, OUTCOME_TIMEOUT_S + 0.01, LOST_S - 0.01])
def test_an_outcome_that_is_late_counts_unless_the_analyser_says_that_light_is_lost(
    late_s: float,
) -> None:
    ends = Ends(late_s=late_s)
    ends.send(DATA[:8])
    assert ends.bench.received == DATA[:8]
    assert ends.bob.messages == [Report(7, 1, 32)]
    again = [] if late_s < OUTCOME_TIMEOUT_S else [(1, False)]
    assert ends.bench.asked == [(1, True), *again, (2, True)]
    assert ends.scene.now_s == pytest.approx(late_s)
    asked = [each for each in ends.scene.flying if each.until_s == pytest.approx(LOST_S)]
    assert [each.cancelled for each in asked if not each.come()] == [True] * len(again)


def test_light_of_which_the_analyser_has_seen_nothing_is_lost_however_late_it_would_come() -> None:
    ends = Ends(late_s=LOST_S + 0.01)
    with pytest.raises(SessionError, match="no pair reached bob"):
        ends.send(DATA[:8])
    assert {report.lost for report in ends.bob.messages if isinstance(report, Report)} == {32}
    assert ends.bench.received == b""


@pytest.mark.parametrize(
    ("sequential", "most_open", "at_a_time"),
    [(True, 1, 1), (False, LIGHTS_AT_A_TIME + HANDSHAKES_AHEAD - 1, LIGHTS_AT_A_TIME)],
)
def test_handshakes_are_made_as_far_ahead_as_is_said_and_end_in_order(
    sequential: bool, most_open: int, at_a_time: int
) -> None:
    ends = Ends(PER_PAIR, sequential, light_s=0.1)
    ends.send(DATA[:8])
    assert ends.bench.received == DATA[:8]
    assert ends.scene.now_s == pytest.approx(0.1 * 32 / at_a_time)  # that many lights at a time
    opened, most, closed = 0, 0, []
    numbers = iter(range(1, 33))
    for _when, wire, order in ends.scene.orders:
        if isinstance(order, protocol.Join):
            assert order.setup == replace(
                PER_PAIR, handshake=Handshake.ONE_PAIR, block=next(numbers), pairs=1
            )
            opened += 1
        elif isinstance(order, protocol.Leave) and wire is ends.alice:
            assert order.seen is sequential
            closed.append(order.connection)
        most = max(most, opened - len(closed))
    assert most == most_open
    assert closed == [wire for wire in ends.scene.wires[2:] if not wire.messages]
    assert ends.alice.messages == [Block(7, 1, 32, 0, LEFT_NS, (Frame(0, 8, crc32(DATA[:8])),))]


def test_a_pair_without_light_is_just_lost() -> None:
    ends = Ends(PER_PAIR, dark={3})
    ends.send(DATA[:8])
    ends.finish()
    assert ends.bench.received == DATA[:8]
    assert ends.opener.summary.lost_pairs == 1
    assert ends.opener.counts()["pairs_sent"] == 33
    first = ends.bob.messages[0]
    assert isinstance(first, Report)
    assert (first.pairs, first.lost) == (32, 1)


def pairs_told(count: int, **bench: Any) -> Ends:
    """Return ends of which the opener has announced four pairs, and made the handshakes of some."""
    ends = Ends(PER_PAIR, **bench)
    for number in range(1, count + 1):
        asked = replace(PER_PAIR, handshake=Handshake.ONE_PAIR, block=number, pairs=1)
        ends._join(ends.scene.connection(ends.bench, ends.bench)[1], asked)
    ends.alice.say(Block(7, 1, 4, 0, 0, (Frame(0, 1, 0),)))
    return ends


def test_a_block_whose_pairs_are_not_over_in_time_ends_the_session() -> None:
    ends = pairs_told(4)
    with pytest.raises(SessionError, match="pairs up to 4 were not over in 30 s"):
        ends.scene.run(ends.receiving)
    assert ends.scene.now_s == PAIR_TIMEOUT_S


def test_what_a_pair_fails_with_is_what_its_block_fails_with() -> None:
    ends = pairs_told(4, broken=True)
    for wire in ends.scene.wires[2::2]:
        wire.left = True
    with pytest.raises(HardwareError, match="dead analyser"):
        ends.scene.run(ends.receiving)


def test_a_handshake_that_must_not_be_is_refused_and_ends_nothing_else() -> None:
    ends = Ends(PER_PAIR)
    asked = replace(PER_PAIR, handshake=Handshake.ONE_PAIR, block=1, pairs=1)
    with pytest.raises(SessionError, match=r"of a session of 10\.0\.0\.1 from 10\.0\.0\.9"):
        ends.acceptor.join(ends.bob, asked, "10.0.0.9")
    ends.send(DATA[:8])
    assert ends.bench.received == DATA[:8]


def test_what_has_no_place_between_blocks_ends_the_session() -> None:
    ends = Ends()
    ends.alice.say(Report(7, 1, 32))
    with pytest.raises(SessionError) as caught:
        ends.scene.run(ends.receiving)
    assert caught.value.reason == Reason.PROTOCOL
