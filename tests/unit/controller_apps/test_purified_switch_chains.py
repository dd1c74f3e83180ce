"""The controller's account of purified chains of switches, beside a model of the ends.

The model knows which halves are of one pair, and which Pauli operator makes Phi+ of it: ideal
links have none, and swaps multiply (Briegel et al., Phys. Rev. Lett. 81, 5932).
"""

from collections import defaultdict, deque
from dataclasses import dataclass, field

import numpy as np
import pytest

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Hop
from controller_apps.policy.schedules import Purification
from controller_apps.sessions.chain_pairs import Half, Pairs
from controller_apps.sessions.swap_turns import NOWHERE, Command, Hosts, SwapTurns, swap_turns
from wire.analyser_frames import THIRD, AnalyserFrame, End, Receivers
from wire.outcomes import NO_COINCIDENCE as NONE

SWITCHES, BLOCKS = 3, 4
MEMORIES = 61_001, 61_002
LOST = 0.1  # of pulses, of what is measured, and of coincidences
Place = SwitchPort | Receivers


@dataclass(eq=False)
class Pair:
    """The pair of two halves; after a swap the two outer halves are of `now`."""

    operator: int = 0  # that makes Phi+ of it
    seen: bool = True
    now: "Pair | None" = None
    bit: int | None = None  # of the end that was measured first
    partner: "Pair | None" = None  # with which it was compared there

    @property
    def whole(self) -> "Pair":
        return self if self.now is None else self.now.whole


@dataclass
class Ends:
    """Memories and hosts, which do as the controller commands."""

    turns: SwapTurns
    random: np.random.Generator
    held: dict[tuple[Place, int], list[Pair | None]] = field(default_factory=dict)
    named: defaultdict[Place, deque[list[Pair]]] = field(default_factory=lambda: defaultdict(deque))
    # On its way to the controller, in order at each place.
    sent: defaultdict[Place, deque[AnalyserFrame]] = field(
        default_factory=lambda: defaultdict(deque)
    )
    last: defaultdict[int, dict[Place, list[tuple[Pair, int]]]] = field(
        default_factory=lambda: defaultdict(dict)
    )
    rounds: int = 0

    def emit(self, block: int, pulses: int) -> None:
        """Put light of all links into memories; hosts lose none."""
        places: list[Place] = [Receivers.OPENER, *memories(), Receivers.ACCEPTOR]
        for link, (left, right) in enumerate(zip(places[::2], places[1::2], strict=True)):
            states = self.random.integers(0, 4 if self.turns.stations else 1, pulses, np.uint8)
            pairs = [Pair(int(state)) for state in states]
            for at in self.turns.stations[link : link + 1]:
                herald = AnalyserFrame(at.port, block, End.HERALDED, pulses, 0, states.tobytes())
                self.sent[at].append(herald)
            for place in (left, right):
                is_host = isinstance(place, Receivers)
                lost = self.random.random(pulses) < (0 if is_host else LOST)
                self.held[place, block] = [
                    None if gone else pair for gone, pair in zip(lost, pairs, strict=True)
                ]
                if isinstance(place, SwitchPort):
                    outcomes = np.where(lost, NONE, 0).astype(np.uint8).tobytes()
                    herald = AnalyserFrame(place.port, block, End.STORED, pulses, 0, outcomes)
                    self.sent[place].append(herald)

    def run(self) -> None:
        """Deliver frames until there are none, those of different places in any order."""
        while waiting := [place for place, frames in self.sent.items() if frames]:
            place = waiting[self.random.integers(len(waiting))]
            for due in self.turns.arrived(place, self.sent[place].popleft()):
                if isinstance(due, Command):
                    self.obey(due.at, due.frame)

    def obey(self, place: Place, frame: AnalyserFrame) -> None:
        block = self.held[place, frame.number]
        assert len(block) == frame.pulses
        chosen = [
            (pair, each) for pair, each in zip(block, frame.outcomes, strict=True) if each != NONE
        ]
        pairs = [(pair.whole, symbol) for pair, symbol in chosen if pair is not None]
        assert len(pairs) == len(chosen)
        if frame.end == End.STORED:
            assert isinstance(place, SwitchPort)
            self.named[place].append([pair for pair, _each in pairs])
            self.swap(place.dpid)
        elif frame.method:
            self.compare(place, frame, pairs)
        else:
            self.last[frame.number][place] = pairs

    def compare(self, place: Place, frame: AnalyserFrame, pairs: list[tuple[Pair, int]]) -> None:
        """Measure every second pair at one end; both ends must compare the same ones, corrected."""
        self.rounds += 1
        bits, left = [], list[Pair | None]()
        for pair, symbol in pairs:
            assert pair.seen
            pair.operator ^= symbol % THIRD
        for (one, _), (target, _) in zip(pairs[::2], pairs[1::2], strict=False):
            bit = int(self.random.integers(2))
            if target.partner is None:
                target.partner, target.bit = one, bit
            else:
                assert target.partner is one
                assert (one.operator, target.operator) == (0, 0)
                assert target.bit is not None
                bit = target.bit
            bits.append(NONE if self.random.random() < LOST else bit)
            left.append(one)
        self.held[place, frame.number] = left
        answer = AnalyserFrame(1, frame.number, End.PURIFIED, len(bits), 0, bytes(bits))
        self.sent[place].append(answer)

    def swap(self, dpid: int) -> None:
        """Join what is named in both memories of a switch."""
        left, right = (self.named[SwitchPort(dpid, port)] for port in MEMORIES)
        while left and right:
            outcomes = list[int]()
            for one, other in zip(left.popleft(), right.popleft(), strict=False):
                outcome = int(self.random.integers(4))
                seen = self.random.random() >= LOST
                made = Pair(one.operator ^ other.operator ^ outcome, one.seen & other.seen & seen)
                one.whole.now = made
                other.whole.now = made
                outcomes.append(outcome if seen else NONE)
            at = SwitchPort(dpid, 60_001)
            number = len(outcomes)
            report = AnalyserFrame(60_001, 1, End.MEASURED, number, 0, bytes(outcomes))
            self.sent[at].append(report)


def memories() -> list[SwitchPort]:
    return [SwitchPort(dpid, port) for dpid in range(1, SWITCHES + 1) for port in MEMORIES]


def played(
    schedule: str, purification: Purification, pulses: int, heralded: bool = False
) -> tuple[Ends, list[int]]:
    """Run blocks through a chain; return its ends, and how many pairs each block has left."""
    hops = [Hop(at.dpid, at.port, at.port - 1000) for at in memories()]
    # Stations are switches between these, of which each has light to its first input.
    hops += [Hop(100 + link, 1, 60_001) for link in range(SWITCHES + 1) if heralded]
    turns = swap_turns(hops, schedule, purification, NOWHERE)
    assert turns is not None
    ends, blocks = Ends(turns, np.random.default_rng(5)), BLOCKS
    for block in range(1, blocks + 1):
        ends.emit(block, pulses)
    ends.run()
    sizes = []
    for _block, last in sorted(ends.last.items()):
        alice, bob = last[Receivers.OPENER], last[Receivers.ACCEPTOR]
        sizes.append(len(bob))
        for (ours, nothing), (theirs, operator) in zip(alice, bob, strict=True):
            assert ours is theirs
            assert ours.seen
            assert (nothing, ours.operator ^ operator) == (0, 0)
    assert not ends.turns._pairs  # nothing is kept of blocks that are over
    return ends, sizes


@pytest.mark.parametrize("heralded", [False, True])
@pytest.mark.parametrize("protocol", ["dejmps", "bbpssw"])
@pytest.mark.parametrize(
    ("schedule", "spans"), [("parallel", 4), ("left-to-right", 6), ("nested", 6)]
)
def test_ends_compare_corrected_halves_of_the_same_pairs(
    schedule: str, spans: int, protocol: str, heralded: bool
) -> None:
    """Each span halves its pairs, once at least, by each end: there are four links, and two more.

    Of 400 pulses per link there must be some that pass, as (0.9^2 / 2)^2 of them are left by two
    levels of ideal pairs, less what is not seen. Pairs that stations herald are in any Bell state.
    """
    rounds = 1
    ends, sizes = played(schedule, Purification(protocol, rounds), 400, heralded)
    assert ends.rounds == 2 * spans * rounds * BLOCKS
    assert len(sizes) == BLOCKS
    assert min(sizes) > 5


def test_two_rounds_and_blocks_with_too_few_pairs_end_all_the_same() -> None:
    _ends, sizes = played("nested", Purification("dejmps", 2), 2000)
    assert min(sizes) > 5
    _ends, sizes = played("nested", Purification("dejmps", 2), 3)
    assert sizes == [0] * BLOCKS
    ends, sizes = played("nested", Purification("dejmps", 1), 1)
    assert (sizes, ends.rounds) == ([0] * BLOCKS, 0)


def test_pairs_whose_state_a_station_has_not_seen_are_in_no_round() -> None:
    """Of six pairs two are not seen: neither end acts on them."""
    operators = np.array([3, NONE, 0, 1, NONE, 2], np.uint8)
    half = Half(61_001, 3, operators.size, np.arange(operators.size))
    frames = Pairs.of_link(half, half, operators, rounds=1).begin_round("dejmps", (0,))
    assert [list(frame.outcomes) for frame in frames] == [
        [0, NONE, 0, 0, NONE, 0],
        [3, NONE, 0, 1, NONE, 2],
    ]
    for frame in frames:
        assert AnalyserFrame.decode(frame.encode(bytes(6), bytes(6))) == frame


def test_a_round_keeps_pairs_of_which_both_ends_measured_the_same() -> None:
    """By enumeration of what two ends can measure: 0, 1 or nothing."""
    cases = [(a, b) for a in (0, 1, NONE) for b in (0, 1, NONE)]
    at = np.arange(2 * len(cases))
    half = Half(61_001, 3, at.size, at)
    pairs = Pairs.of_link(half, half, np.zeros(at.size, np.uint8), rounds=1)
    assert len(pairs.begin_round("dejmps", (0,))) == 2
    assert not pairs.measured(False, bytes(5))  # of another block
    assert not pairs.measured(False, bytes(a for a, _b in cases))
    assert pairs.measured(True, bytes(b for _a, b in cases))
    kept = [place for place, (a, b) in enumerate(cases) if a == b != NONE]
    assert pairs.left.at.tolist() == pairs.right.at.tolist() == kept
    assert (pairs.left.pulses, pairs.rounds) == (len(cases), 0)


@pytest.mark.parametrize(("protocol", "number"), [("bbpssw", 1), ("dejmps", 2)])
def test_each_end_of_a_round_has_the_method_of_its_side(protocol: str, number: int) -> None:
    half = Half(61_001, 3, 4, np.arange(4))
    pairs = Pairs.of_link(half, half, np.zeros(4, np.uint8), rounds=1)
    methods = [frame.method for frame in pairs.begin_round(protocol, (0,))]
    assert methods == [2 * number, 2 * number + 1]


def test_every_round_of_pairs_is_twirled_anew() -> None:
    """Two draws of twenty Pauli operators are alike by chance once in 4^20."""
    count = 40
    hops = [Hop(1, port, port - 1000) for port in MEMORIES]
    turns = swap_turns(hops, "parallel", Purification("bbpssw", 2), NOWHERE)
    assert turns is not None
    held = AnalyserFrame(MEMORIES[0], 1, End.STORED, count, 0, bytes(count))
    place: Place = SwitchPort(1, MEMORIES[0])
    rounds = [turns.arrived(place, held)]
    bits = AnalyserFrame(MEMORIES[0], 1, End.PURIFIED, count // 2, 0, bytes(count // 2))
    for at in (place, Receivers.OPENER):
        rounds.append(turns.arrived(at, bits))
    first, nothing, second = (
        [each.frame.outcomes for each in due if isinstance(each, Command)] for due in rounds
    )
    assert (len(first), nothing, len(second)) == (2, [], 2)
    one, other = ([symbol % THIRD for symbol in each[0]] for each in (first, second))
    assert one[: count // 2] != other


def test_a_link_of_which_neither_memory_holds_a_pulse_is_swapped_though_none_was_heralded() -> None:
    """A memory has one place for the block that is missing, and the station no pair."""
    hops = [Hop(1, port, port - 1000) for port in MEMORIES]
    hops += [Hop(100 + link, 1, 60_001) for link in range(2)]
    turns = swap_turns(hops, "parallel", Purification("dejmps", 1), NOWHERE)
    assert turns is not None
    released = list[object]()
    for link, port in enumerate(MEMORIES):
        herald = AnalyserFrame(60_001, 1, End.HERALDED, 0, 0, b"")
        held = AnalyserFrame(port, 1, End.STORED, 1, 0, bytes([NONE]))
        turns.arrived(SwitchPort(100 + link, 60_001), herald)
        released += turns.arrived(SwitchPort(1, port), held)
    ends = [each.frame.end for each in released if isinstance(each, Command)]
    assert ends == [End.STORED, End.STORED]


def commands(session: int, states: int, pulses: int = 40) -> list[AnalyserFrame]:
    """Return the commands to a link's ends for a number of Bell states that its station reports."""
    hops = [Hop(1, port, port - 1000) for port in MEMORIES]
    hops += [Hop(100 + link, 1, 60_001) for link in range(2)]
    turns = swap_turns(hops, "parallel", Purification("bbpssw", 1), Hosts(session))
    assert turns is not None
    held = AnalyserFrame(MEMORIES[0], 1, End.STORED, pulses, 0, bytes(pulses))
    herald = AnalyserFrame(60_001, 1, End.HERALDED, states, 0, bytes(states))
    assert turns.arrived(SwitchPort(1, MEMORIES[0]), held) == []
    due = turns.arrived(SwitchPort(100, 60_001), herald)
    return [each.frame for each in due if isinstance(each, Command)]


@pytest.mark.parametrize("states", [0, 39, 41])
def test_a_station_that_reports_other_pairs_than_memories_hold_releases_nothing(
    states: int,
) -> None:
    assert commands(7, states) == []


def test_sessions_twirl_differently_and_both_ends_of_one_alike() -> None:
    """Two draws of 40 of twelve symbols are alike by chance once in 12^40."""
    ours, theirs = (commands(session, 40) for session in (7, 8))
    assert [each.outcomes for each in ours] == [ours[0].outcomes] * 2
    assert ours == commands(7, 40)
    assert ours[0].outcomes != theirs[0].outcomes
