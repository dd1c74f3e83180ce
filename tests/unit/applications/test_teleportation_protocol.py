"""Both ends of teleportation back to back: bytes in lists, vectors for light.

The fate of a qubit is worked out here on vectors of three qubits, the state and both halves of
a pair Phi+, without the simulator.
"""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from numpy.typing import NDArray
from steps_scene import Flying, Scene
from test_distribution_protocol import FOREVER, NODE_FEATURES

from applications.teleportation.protocol import STATE_BLOCKS, receive, send
from applications.teleportation.qubit_states import NAMES
from hosts.hardware.block_name import BlockName
from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import Outcomes, Stored, Symbols
from hosts.middleware.session import protocol
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.protocol import HostSide, OpenerSide
from hosts.middleware.session.values import values
from wire.metadata.blocks import Finish
from wire.metadata.setup import Answer, Setup
from wire.metadata.values import Topic
from wire.metadata.vocabulary import Handshake, Reason, Service
from wire.outcomes import Pauli
from wire.results.figures import TeleportFigures

SETUP = Setup(5, Service["TELEPORT"], Handshake.FRAMED, "10.0.0.3", 50, 1, 1_000_000)
EVERY, LINEAR = frozenset(range(4)), frozenset({1, 3})
COUNT, LOST = 240, 255
WAITED_NS = 700_000

Vector = NDArray[np.complex128]
ROOT = np.sqrt(0.5)
VECTORS = [  # in the order of NAMES
    np.array(each, dtype=complex)
    for each in ([1, 0], [0, 1], [ROOT, ROOT], [ROOT, -ROOT], [ROOT, ROOT * 1j], [ROOT, -ROOT * 1j])
]
ONE, X, Z = np.eye(2), np.array([[0, 1], [1, 0]]), np.diag([1, -1])
PAULIS = (ONE, X, Z, X @ Z)  # numbered as on the wire
PHI_PLUS = np.array([ROOT, 0, 0, ROOT])
BELL = [np.kron(pauli, ONE) @ PHI_PLUS for pauli in PAULIS]  # Phi+, Psi+, Phi-, Psi-


def teleported(state: Vector, outcome: int, turned: int) -> Vector:
    """Return the other half when this Bell state is found; the path has applied a Pauli to it."""
    three = np.kron(state, np.kron(ONE, PAULIS[turned]) @ PHI_PLUS).reshape(4, 2)
    left = BELL[outcome].conj() @ three
    assert np.vdot(left, left).real == pytest.approx(1 / 4)  # each Bell state alike often
    return np.asarray(2 * left)


@dataclass
class Bench:
    """The source, the fibres, and the hardware of both hosts."""

    scene: Scene
    turned: int  # the Pauli operator of the paths
    unlit: frozenset[int] = frozenset()  # blocks of which no light comes to either end
    lost: frozenset[int] = frozenset()  # places in a block that do not click at the acceptor
    draws: np.random.Generator = field(default_factory=lambda: np.random.default_rng(2))
    sizes: list[int] = field(default_factory=list)
    states: list[int] = field(default_factory=list)  # all that were sent
    measured: list[int] = field(default_factory=list)  # all Bell states that were found
    reports: list[TeleportFigures] = field(default_factory=list)  # to both ends

    def emit(self, _block: int, pairs: int) -> None:
        """Let the source make a block."""
        self.sizes.append(pairs)
        self.scene.now_s += 1

    def receive_into_memory(self, name: BlockName, _port: str, _timeout_s: float) -> Flying:
        """Store the result of a block."""

        def come() -> bool:
            return len(self.sizes) >= name.number

        def outcome() -> Stored | None:
            lit = name.number not in self.unlit
            return Stored(np.ones(self.sizes[name.number - 1], dtype=bool), 5) if lit else None

        return Flying(come, outcome)

    def prepare(self, session: int, number: int, states: Symbols) -> BlockName:
        """Make states."""
        self.states += states.tolist()
        return BlockName(session, number, 0)

    def bell_measure(self, states: BlockName, half: BlockName) -> Symbols:
        """Find each of four Bell states as often as the others."""
        assert states == BlockName(5, STATE_BLOCKS + half.number, 0)
        found = self.draws.integers(0, 4, self.sizes[-1], dtype=np.uint8)
        self.measured += found.tolist()
        return found

    def outcomes(self, name: BlockName, bases: Symbols, operators: Symbols) -> Outcomes:
        """Measure the other halves behind operators, in bases in which each has a value."""
        assert name.half == 1
        found: list[int] = []
        for state, seen, basis, operator in zip(
            self.states[-bases.size :],
            self.measured[-bases.size :],
            bases,
            operators,
            strict=True,
        ):
            arrived = PAULIS[operator] @ teleported(VECTORS[state], seen, self.turned)
            share = abs(np.vdot(VECTORS[2 * basis], arrived)) ** 2
            assert min(share, 1 - share) < 1e-12  # Paulis take cardinal states to such
            found.append(LOST if len(found) in self.lost else int(share < 0.5))
        return Outcomes(np.array(found, np.uint8), 5 + WAITED_NS)


class Ends:
    """Both ends of a session for random states."""

    def __init__(
        self,
        setup: Setup = SETUP,
        known: frozenset[int] = EVERY,
        turned: int | None = None,
        unlit: frozenset[int] = frozenset(),
        lost: frozenset[int] = frozenset(),
        count: int = COUNT,
    ) -> None:
        self.scene = scene = Scene()
        self.bench = Bench(scene, setup.rotation if turned is None else turned, unlit, lost)
        self.alice, self.bob = scene.connection(self.bench, self.bench)
        common = NODE_FEATURES, FOREVER, known
        draws = np.random.default_rng(1), np.random.default_rng(3)
        opener = OpenerSide(
            *(setup, ("a-q0",), "10.0.0.2", "alice", draws[0], *common),
            *("bob", NODE_FEATURES, FOREVER, False),
        )
        acceptor = HostSide(setup, ("b-q0",), "10.0.0.1", "bob", draws[1], *common)
        self.sending = scene.begin(self.alice, send(opener, "random", count))
        self.receiving = scene.begin(self.bob, receive(acceptor))

    def run(self) -> tuple[TeleportFigures, TeleportFigures]:
        """Return the results of both applications."""
        self.scene.run(self.sending)
        self.alice.say(Finish(5, 0, bytes(32)))
        self.scene.run(self.receiving)
        theirs, ours = self.bench.reports[-2:]
        of_states = np.array(theirs.of_states)  # known to the acceptor alone
        assert of_states[:, 0].sum() == theirs.arrived
        assert theirs.fidelity == of_states[:, 1].sum() / theirs.arrived
        both = {**vars(theirs), "of_states": None}
        assert {**vars(ours), "of_states": None} == both  # time stands still between the two
        return ours, theirs


@pytest.mark.parametrize("rotation", list(Pauli))
def test_every_state_appears_behind_any_known_rotation(rotation: Pauli) -> None:
    ends = Ends(replace(SETUP, rotation=rotation))
    for report in ends.run():
        assert (report.states, report.arrived, report.fidelity) == (COUNT, COUNT, 1)
        assert report.waited_ms == pytest.approx(0.7)
        assert (report.elapsed_s, report.states_per_s) == (5, COUNT / 5)
    assert ends.bench.sizes == [50, 50, 50, 50, 40]


def test_a_rotation_that_nobody_knows_leaves_its_own_eigenstates_alone() -> None:
    ends = Ends(turned=Pauli.Z)
    report, _theirs = ends.run()
    agreed = sum(NAMES[symbol] in "01" for symbol in ends.bench.states)
    assert 0 < agreed < COUNT
    assert report.fidelity == agreed / COUNT


def test_only_bell_states_that_are_told_apart_carry_a_state() -> None:
    ends = Ends(known=LINEAR)
    report, _theirs = ends.run()
    arrived = sum(outcome in LINEAR for outcome in ends.bench.measured)
    assert 0 < arrived < COUNT
    assert (report.arrived, report.fidelity) == (arrived, 1)


def test_a_photon_without_a_click_has_not_arrived() -> None:
    report, _theirs = Ends(lost=frozenset({3, 8, 9})).run()
    assert (report.states, report.arrived, report.fidelity) == (COUNT, COUNT - 3 * 5, 1)


def test_a_block_without_light_counts_and_tells_what_was_meant() -> None:
    ends = Ends(unlit=frozenset({2}))
    report, _theirs = ends.run()
    assert (report.states, report.arrived, report.fidelity) == (COUNT, COUNT - 50, 1)
    lines = [message for message in ends.alice.messages if getattr(message, "block", 0) == 2]
    topics = [Topic.COMING, Topic.ARRIVED, Topic.CORRECTIONS, Topic.STATES]
    assert [message.topic for message in lines] == topics  # type: ignore[attr-defined]
    assert ends.bob.messages[2 * 2 - 1] == values(5, Topic.COUNTS, 2, [0, 0, 0], 32)


def test_a_session_of_which_nothing_arrives_ends_with_a_reason() -> None:
    ends = Ends(unlit=frozenset(range(1, 6)))
    with pytest.raises(SessionError, match=f"none of {COUNT} states arrived: see that fibres"):
        ends.scene.run(ends.sending)
    assert ends.bench.reports[-1].fidelity is None
    long = Ends(unlit=frozenset(range(1, 100)), count=2000)
    with pytest.raises(SessionError, match="none of 500 states arrived"):  # of ten blocks
        long.scene.run(long.sending)


@pytest.mark.parametrize("every", [7, pytest.param(1, marks=pytest.mark.nightly)])
def test_nothing_is_measured_before_the_bits_have_come_however_they_are_cut(every: int) -> None:
    whole = Ends(count=60)
    whole.run()
    for one, other in ((whole.alice, "bob"), (whole.bob, "alice")):
        for place in range(1, len(one.sent), every):
            ends = Ends(count=60)
            getattr(ends, other).arrives = place
            ends.run()
            assert ends.bob.sent == whole.bob.sent
            reports = [order for _when, wire, order in ends.scene.orders if wire is ends.bob]
            heard = [isinstance(order, protocol.Hear) for order in reports]
            measured = [getattr(order, "operation", None) == Qnic.outcomes for order in reports]
            before = [sum(heard[:place]) for place in np.flatnonzero(measured)]
            assert before == [3, 6]


@pytest.mark.parametrize("every", [5, pytest.param(1, marks=pytest.mark.nightly)])
@pytest.mark.parametrize("gone", ["alice", "bob"])
def test_an_end_that_is_gone_anywhere_ends_the_session(gone: str, every: int) -> None:
    whole = Ends(count=60)
    whole.scene.run(whole.sending)
    sent, other = (whole.alice, "bob") if gone == "alice" else (whole.bob, "alice")
    for place in range(0, len(sent.sent), every):
        ends = Ends(count=60)
        getattr(ends, other).ends = place
        with pytest.raises(SessionError):
            ends.scene.run(ends.sending)
        assert len(ends.bench.reports) < len(whole.bench.reports)


def test_bits_of_another_block_or_out_of_order_are_refused() -> None:
    for topic, block in ((Topic.CORRECTIONS, 1), (Topic.ARRIVED, 2)):
        ends = Ends()
        ends.scene.going.remove(ends.sending)
        ends.alice.say(values(5, Topic.COMING, 1, [2], 32), values(5, topic, block, [0, 1], 1))
        with pytest.raises(SessionError) as caught:
            ends.scene.run(ends.receiving)
        assert caught.value.reason == Reason.PROTOCOL
        assert ends.bob.messages == [Answer(5, Reason.OK)]
