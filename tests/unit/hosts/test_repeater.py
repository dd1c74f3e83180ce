"""A repeater between both ends of its links: bytes in lists, and photons that come as written here.

alice --- link 1 --- the repeater --- link 2 --- bob
  6 pairs, 5 come          6 pairs, 4 come
"""

from dataclasses import dataclass, field

import numpy as np
import pytest
from steps_scene import Flying, Going, Scene, Wire

from controller_apps.sessions.actions import SwapsOrdered
from controller_apps.sessions.chains import orders
from controller_apps.sessions.sessions import Stop
from hosts.hardware.operations import BlockName
from hosts.hardware.qnic import Positions
from hosts.hardware.replies import Coincidences, HardwareError, Stored, Symbols
from hosts.middleware.services.swapping.link import IncomingLink, Kept, OutgoingLink, setup_of_link
from hosts.middleware.services.swapping.repeater import Repeater
from hosts.middleware.services.swapping.spans import Swapped
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.mailbox import Mailbox
from hosts.middleware.session.protocol import Side, Steps
from hosts.middleware.session.values import values
from wire.device import SwapOrder
from wire.metadata.blocks import Finish
from wire.metadata.setup import Answer, Setup
from wire.metadata.values import Topic
from wire.metadata.vocabulary import Handshake, Reason, Service

PAIRS = 6
CHAIN = Setup(5, Service.SWAP, Handshake.FRAMED, "10.0.0.1", PAIRS, 1, 1_000_000)
LINEAR = frozenset({1, 3})  # Bell states that the repeater tells apart
LOST = {1: {1}, 2: {0, 5}}  # places in a block that do not come, by link
FOUND = [0, 1, 2, 3]  # Bell states, of the four pairs that both links have
SINCE_NS = {1: 2000, 2: 4000}  # from when the repeater's halves wait
SWAPPED_NS = 1_003_000


@dataclass
class Bench:
    """The hardware of all three hosts."""

    scene: Scene
    broken: bool = False
    lit: set[BlockName] = field(default_factory=set)
    gathered: list[tuple[int, list[int]]] = field(default_factory=list)  # session, places

    def share_pairs(
        self, session: int, number: int, count: int, _port: str, *_light: int
    ) -> Stored:
        """Make pairs, and keep half of each."""
        self.lit.add(BlockName(session, number, 1))
        return Stored(np.ones(count, dtype=bool), SINCE_NS[2])

    def receive_into_memory(self, name: BlockName, _port: str, _timeout_s: float) -> Flying:
        """Store the result of a block."""
        link = name.session - CHAIN.session
        there = [place not in LOST[link] for place in range(PAIRS)]
        outcome = Stored(np.array(there), SINCE_NS[1])
        return Flying(lambda: name in self.lit, lambda: outcome)

    def gather(
        self, into: BlockName, picks: dict[BlockName, Positions], keep_rest: bool = False
    ) -> None:
        """Keep photons of a block."""
        ((name, places),) = picks.items()
        assert (name, keep_rest) == (into, False)
        self.gathered.append((name.session, places.tolist()))

    def coincidences(self, first: BlockName, second: BlockName) -> Coincidences:
        """Join the links."""
        if self.broken:
            raise HardwareError("dead analyser")
        assert (first.session, first.half) == (CHAIN.session + 1, 1)
        assert (second.session, second.half) == (CHAIN.session + 2, 0)
        found: Symbols = np.array(FOUND, dtype=np.uint8)
        return Coincidences(found, found.size, SWAPPED_NS)


class Chain:
    """Both links, and who is at their ends."""

    def __init__(self, broken: bool = False) -> None:
        self.scene = Scene()
        self.bench = Bench(self.scene, broken)
        stops = tuple(Stop(f"10.0.0.{place}", 0, min(place - 1, 1)) for place in (1, 2, 3))
        told = list(orders(SwapsOrdered(CHAIN.session, stops, "parallel", blocks=2), 1).values())
        (self.alice, from_left), (to_right, self.bob) = self._wire(), self._wire()
        self.right = to_right
        setups = [setup_of_link(order, CHAIN, "10.0.0.1") for order in told[:2]]
        sides = [Side(setup, ("q0", "q1"), "10.0.0.9") for setup in setups]
        links = IncomingLink(sides[0], told[1]), OutgoingLink(sides[1], "q1")
        self.making = self.scene.begin(self.alice, made(OutgoingLink(sides[0], "q0")))
        self.taking = self.scene.begin(self.bob, taken(IncomingLink(sides[1], told[2]), told[2]))
        repeater = Repeater(to_right, links, told[1], LINEAR)
        self.repeating = self.scene.begin(from_left, repeater.run())

    def _wire(self) -> tuple[Wire, Wire]:
        ends = self.scene.connection(self.bench, self.bench)
        for end in ends:
            end.mailbox = Mailbox()
        return ends

    def run(self) -> tuple[Going, Going]:
        """Go on until all are over; return what alice and bob have."""
        self.scene.run(self.making, self.taking, self.repeating)
        return self.making, self.taking


def made(link: OutgoingLink) -> Steps[list[Kept]]:
    """Make two blocks at the left end, and end the link."""
    kept = []
    for number in (1, 2):
        kept.append((yield from link.make(number, PAIRS)))
    yield from link.finish()
    return kept


def taken(link: IncomingLink, order: SwapOrder) -> Steps[list[tuple[Kept, Swapped]]]:
    """Take blocks in at the right end, until the repeater ends the link."""
    found = []
    while (coming := (yield from link.announced())) is not None:
        kept = yield from link.take(*coming)
        found.append((kept, (yield from link.swapped(coming[0], {1}))))
    yield link.agree()
    return found


def test_a_repeater_tells_which_operators_undo_the_bell_states_that_it_knows() -> None:
    chain = Chain()
    making, taking = chain.run()
    assert [kept.size for kept in making.value] == [5, 5]
    for kept, swapped in taking.value:
        assert kept.size == 4
        waited_ns = SWAPPED_NS - (SINCE_NS[1] + SINCE_NS[2]) // 2
        assert (swapped.place, swapped.waited_us) == (1, waited_ns // 1000)
        assert swapped.bits.seen.tolist() == [False, True, False, True]
        assert swapped.bits.operators.tolist() == [0, 1, 0, 3]  # a state's number undoes it
    first = [places for session, places in chain.bench.gathered if session == CHAIN.session + 1]
    assert first.count([0, 1, 2, 3]) == 2  # of five that came, as many as the other link has


def test_what_a_repeater_says_to_the_right_is_this_and_nothing_else() -> None:
    chain = Chain()
    chain.run()
    session = CHAIN.session + 2
    for number in (1, 2):
        assert [each for each in chain.right.said if getattr(each, "block", 0) == number] == [
            values(session, Topic.COMING, number, [PAIRS], 32),
            values(session, Topic.ARRIVED, number, [1] * PAIRS, 1),
            values(session, Topic.SWAPPED, number, [1, 1000], 32),
            values(session, Topic.ARRIVED, number, [0, 1, 0, 1], 1),
            values(session, Topic.CORRECTIONS, number, [0, 1, 0, 3], 2),
        ]
    assert chain.right.said[2 * 5 :] == [Finish(session, 0, bytes(32))]
    assert chain.alice.other.said[-1] == Answer(CHAIN.session + 1, Reason.OK)


def test_bytes_may_be_cut_anywhere_on_their_way_to_a_repeater() -> None:
    whole = Chain()
    whole.run()
    for here in ("alice", "bob"):
        for place in range(1, len(getattr(whole, here).sent)):
            chain = Chain()
            getattr(chain, here).other.arrives = place
            _making, taking = chain.run()
            assert [swapped.bits.operators.tolist() for _kept, swapped in taking.value] == [
                [0, 1, 0, 3]
            ] * 2


@pytest.mark.parametrize("here", ["alice", "bob"])
def test_a_repeater_does_not_outlive_a_neighbour_that_is_gone(here: str) -> None:
    whole = Chain()
    whole.run()
    for place in range(len(getattr(whole, here).sent)):
        chain = Chain()
        getattr(chain, here).other.ends = place
        with pytest.raises(SessionError):
            chain.run()
        assert not chain.repeating.over


def test_what_a_repeater_cannot_do_ends_the_chain() -> None:
    with pytest.raises(HardwareError, match="dead analyser"):
        Chain(broken=True).run()
