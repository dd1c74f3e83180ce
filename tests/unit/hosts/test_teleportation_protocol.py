"""Sender and receiver of teleportation back to back: a list for a network, vectors for light.

What becomes of a qubit is worked out here on vectors of three qubits, the state and both halves of
a pair Phi+, without the simulator.
"""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from hosts.hardware.qnic import Symbols
from hosts.middleware.services.teleportation.protocol import (
    Correct,
    Look,
    Receiver,
    Sender,
    Teleport,
)
from hosts.middleware.services.teleportation.qubit_states import NAMES, Cardinal
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.values import values
from wire.metadata.decoding import decode
from wire.metadata.setup import Setup
from wire.metadata.values import Topic, Values
from wire.metadata.vocabulary import Handshake, Reason, Service
from wire.outcomes import Pauli

SETUP = Setup(5, Service.TELEPORT, Handshake.FRAMED, "10.0.0.3", 50, 1, 1_000_000)
EVERY, LINEAR = frozenset(range(4)), frozenset({1, 3})
COUNT, LOST = 240, 255

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


def over_the_wire(message: Values) -> Values:
    read = decode(message.encode())
    assert isinstance(read, Values)
    return read


class Ends:
    """A sender, a receiver, and what becomes of the qubits between them."""

    def __init__(self, setup: Setup = SETUP, known: frozenset[int] = EVERY) -> None:
        self.sender = Sender(setup, "random", COUNT, known, np.random.default_rng(1))
        self.receiver = Receiver(setup)
        self.draws = np.random.default_rng(2)
        self.turned: int = setup.rotation
        self.outcomes: list[int] = []
        self.sizes: list[int] = []

    def block(self, order: Teleport, lost: Symbols | None = None) -> None:
        """Teleport a block; `lost` photons do not click at the receiver."""
        assert isinstance(order.states, Cardinal)
        self.sizes.append(order.size)
        outcomes = self.draws.integers(0, 4, order.size, dtype=np.uint8)
        self.outcomes += outcomes.tolist()
        self.receiver.announced(order.block, order.size)
        orders = [
            self.receiver.hear(over_the_wire(message)) for message in self.sender.measured(outcomes)
        ]
        seen, correct, look = orders
        assert seen is None
        assert isinstance(correct, Correct)
        assert isinstance(look, Look)
        assert isinstance(look.states, Cardinal)
        found = self.found(order.states, outcomes, correct.operators, look.states)
        if lost is not None:
            found[lost] = LOST
        self.sender.heard(over_the_wire(self.receiver.measured(found, 700)))

    def found(
        self, sent: Cardinal, outcomes: Symbols, operators: Symbols, looked: Cardinal
    ) -> Symbols:
        """Return 0 where the qubit is in the state that is looked for, 1 where orthogonal to it."""
        each = []
        for state, outcome, operator, wanted in zip(
            sent.symbols, outcomes, operators, looked.symbols, strict=True
        ):
            arrived = teleported(VECTORS[state], int(outcome), self.turned)
            share = abs(np.vdot(VECTORS[wanted], PAULIS[operator] @ arrived)) ** 2
            assert min(share, 1 - share) < 1e-12  # Paulis take cardinal states to such
            each.append(share < 0.5)
        return np.array(each, dtype=np.uint8)

    def run(self) -> None:
        while (order := self.sender.next_block()) is not None:
            self.block(order)


@pytest.mark.parametrize("rotation", list(Pauli))
def test_every_state_appears_behind_any_known_rotation(rotation: Pauli) -> None:
    ends = Ends(replace(SETUP, rotation=rotation))
    ends.run()
    assert ends.sizes == [50, 50, 50, 50, 40]
    for tally in (ends.sender.tally, ends.receiver.tally):
        assert (tally.states, tally.arrived, tally.agreed) == (COUNT, COUNT, COUNT)
        assert tally.summary(2.0).waited_ms == pytest.approx(0.7)


def test_a_rotation_that_nobody_knows_leaves_its_own_eigenstates_alone() -> None:
    ends = Ends()
    ends.turned = Pauli.Z
    agreed = 0
    while (order := ends.sender.next_block()) is not None:
        assert isinstance(order.states, Cardinal)
        agreed += sum(NAMES[symbol] in "01" for symbol in order.states.symbols)
        ends.block(order)
    assert 0 < agreed < COUNT
    assert ends.sender.tally.agreed == agreed


def test_only_bell_states_that_are_told_apart_carry_a_state() -> None:
    ends = Ends(known=LINEAR)
    ends.run()
    arrived = sum(outcome in LINEAR for outcome in ends.outcomes)
    assert 0 < arrived < COUNT
    assert ends.sender.tally.arrived == ends.sender.tally.agreed == arrived


def test_a_photon_without_a_click_has_not_arrived() -> None:
    ends = Ends()
    order = ends.sender.next_block()
    assert order is not None
    ends.block(order, lost=np.array([3, 8, 9], np.uint8))
    assert (ends.sender.tally.states, ends.sender.tally.arrived) == (50, 47)


def test_a_block_without_light_counts_and_tells_what_was_meant() -> None:
    ends = Ends()
    order = ends.sender.next_block()
    assert order is not None
    ends.receiver.announced(order.block, order.size)
    for message in ends.sender.measured(None):
        ends.receiver.hear(over_the_wire(message))
    ends.sender.heard(over_the_wire(ends.receiver.measured(None, 0)))
    for tally in (ends.sender.tally, ends.receiver.tally):
        assert (tally.states, tally.arrived) == (50, 0)
        assert tally.summary(1.0).fidelity is None


def test_bits_of_another_block_or_out_of_order_are_refused() -> None:
    receiver = Receiver(SETUP)
    receiver.announced(3, 2)
    for topic, block in ((Topic.CORRECTIONS, 3), (Topic.ARRIVED, 4)):
        with pytest.raises(SessionError) as caught:
            receiver.hear(values(5, topic, block, [0, 1], 1))
        assert caught.value.reason == Reason.PROTOCOL
    with pytest.raises(ValueError, match="correct first"):
        receiver.measured(None, 0)
