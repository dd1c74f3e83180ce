"""The protocol of teleportation at both ends: no socket, no clock.

    Sender                                          Receiver
    next_block()  an order: pairs, and states       announced(message)  how many photons to store
                  to put in                         hear(message)       ARRIVED, CORRECTIONS:
    measured()    what to tell of it          ->                        an order to correct;
                                                                        then the states: an order
                                                                        to measure
    heard()       COUNTS                      <-    measured()          what has come of the block

teleport.py carries the messages and has photons made, corrected and measured.
"""

from dataclasses import dataclass
from math import sqrt

import numpy as np

from hosts.hardware.qnic import Symbols
from hosts.middleware.services.teleportation import qubit_states
from hosts.middleware.services.teleportation.qubit_states import Heard, States
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.values import Numbers, expect, values
from wire.metadata.setup import Setup
from wire.metadata.values import Topic, Values
from wire.metadata.vocabulary import Reason
from wire.outcomes import NO_COINCIDENCE
from wire.results.figures import TeleportFigures

MAX_NUMBER = (1 << 32) - 1


@dataclass
class Tally:
    """What has become of states so far."""

    states: int = 0
    arrived: int = 0
    agreed: int = 0  # of those that arrived
    waited_s: float = 0.0  # in the acceptor's memory, for the bits; summed over what arrived

    def add(self, states: int, arrived: int, agreed: int, waited_us: int) -> None:
        """Count a block, each of whose states has waited so long."""
        self.states += states
        self.arrived += arrived
        self.agreed += agreed
        self.waited_s += arrived * waited_us * 1e-6

    def summary(self, elapsed_s: float) -> TeleportFigures:
        """Return what the application is told; None where nothing has arrived."""
        arrived = self.arrived
        fidelity = self.agreed / arrived if arrived else None
        return TeleportFigures(
            states=self.states,
            arrived=arrived,
            fidelity=fidelity,
            fidelity_error=fidelity and sqrt(fidelity * (1 - fidelity) / arrived),
            waited_ms=1000 * self.waited_s / arrived if arrived else None,
            elapsed_s=elapsed_s,
            states_per_s=self.states / elapsed_s,
        )


@dataclass(frozen=True)
class Teleport:
    """An order: have so many pairs made, and measure these states with their halves 0."""

    block: int
    size: int
    states: States


@dataclass(frozen=True)
class Correct:
    """An order: apply an operator to each photon that is stored; shape (k,)."""

    operators: Symbols


@dataclass(frozen=True)
class Look:
    """An order: measure each photon for its own state."""

    states: States


class Sender:
    """The end that has the states."""

    def __init__(
        self,
        setup: Setup,
        state: str,
        count: int,
        distinguishable_states: frozenset[int],
        draws: np.random.Generator,
    ) -> None:
        """Teleport so many states of this name, where these Bell states are told apart."""
        self._setup, self._state, self._count, self._draws = setup, state, count, draws
        self._distinguishable = list(distinguishable_states)
        self._number = self._size = 0  # of the block under way
        self._states: States | None = None  # of the block under way
        self.tally = Tally()

    def next_block(self) -> Teleport | None:
        """Return what to do next; None once all states are sent."""
        left = self._count - self.tally.states
        if not left:
            return None
        self._number, self._size = self._number + 1, min(left, self._setup.pairs)
        self._states = qubit_states.chosen(self._state, self._draws, self._size)
        return Teleport(self._number, self._size, self._states)

    def measured(self, outcomes: Symbols | None) -> list[Values]:
        """Return what to tell of the Bell states that were found; None: no half 0 has come."""
        assert self._states is not None
        if outcomes is None:
            outcomes = np.full(self._size, NO_COINCIDENCE, dtype=np.uint8)
        seen = np.isin(outcomes, self._distinguishable)
        session, number = self._setup.session, self._number
        return [
            values(session, Topic.ARRIVED, number, seen, 1),
            # The Bell state's number is the operator that undoes it.
            values(session, Topic.CORRECTIONS, number, np.where(seen, outcomes, 0), 2),
            *self._states.messages(session, number),
        ]

    def heard(self, message: Values) -> None:
        """Note how many arrived, how many agreed, and how long they waited (us)."""
        counts = expect(message, Topic.COUNTS, self._number, 3, MAX_NUMBER)
        self.tally.add(self._size, *counts.tolist())


class Receiver:
    """The end where the states appear."""

    def __init__(self, setup: Setup) -> None:
        self._setup = setup
        self._number = self._size = 0  # of the block under way
        self._seen: Numbers | None = None  # whose two bits the sender has
        self._corrected = False
        self._states: Heard | None = None
        self.tally = Tally()

    def announced(self, number: int, size: int) -> None:
        """Begin with a block of this number and size."""
        self._number, self._size = number, size
        self._seen, self._corrected, self._states = None, False, Heard(number, size)

    def hear(self, message: Values) -> Correct | Look | None:
        """Return what to do now; None: more is to be heard first. SessionError if it is other."""
        assert self._states is not None
        if self._seen is None:
            self._seen = expect(message, Topic.ARRIVED, self._number, self._size, 1)
            return None
        if not self._corrected:
            operators = expect(message, Topic.CORRECTIONS, self._number, self._size, 3)
            self._corrected = True
            return Correct(operators.astype(np.uint8) ^ np.uint8(self._setup.rotation))
        states = self._states.hear(message)
        return None if states is None else Look(states)

    def measured(self, found: Symbols | None, waited_us: int) -> Values:
        """Return what tells the sender of a block: 0 where a state was found, 1 orthogonal to it.

        None: no photon has come.
        """
        if self._seen is None or not self._corrected:
            raise ValueError("measured before the bits were heard: correct first")
        arrived = agreed = 0
        if found is not None:
            there = self._seen.astype(bool) & (found != NO_COINCIDENCE)
            arrived = int(np.count_nonzero(there))
            agreed = int(np.count_nonzero(there & (found == 0)))
        if not 0 <= waited_us <= MAX_NUMBER:
            raise SessionError(Reason.PROTOCOL, f"a wait of {waited_us} us cannot be told")
        self.tally.add(self._size, arrived, agreed, waited_us)
        counts = arrived, agreed, waited_us
        return values(self._setup.session, Topic.COUNTS, self._number, counts, 32)
