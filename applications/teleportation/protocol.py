"""The protocol of teleportation at both ends: no socket, no clock.

alice                       charlie                    bob
  | <-- light, half 0 --------- | -- light, half 1 ----> |  into memory
  | Bell measurement of state and half 0                 |
  | Values(ARRIVED) -----------------------------------> |  of which two bits come
  | Values(CORRECTIONS), a real packet ----------------> |  waits for it, then corrects
  | Values(STATES or DIRECTIONS) ----------------------> |  measures each for its own state
  | <---------------------------------- Values(COUNTS)   |
"""

from dataclasses import dataclass, field
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from applications.teleportation import qubit_states
from applications.teleportation.along import measure_along, prepare_along
from applications.teleportation.qubit_states import Cardinal, Heard, States
from hosts.hardware.block_name import BlockName
from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import Outcomes, Symbols
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.estimation import share_variance
from hosts.middleware.session.protocol import (
    Hear,
    HostSide,
    Now,
    OpenerSide,
    Say,
    Steps,
    Tell,
    do,
    hear,
)
from hosts.timeouts import ANSWER_TIMEOUT_S
from wire.metadata.values import Topic, Values
from wire.metadata.vocabulary import Reason
from wire.outcomes import NO_COINCIDENCE
from wire.results.figures import TeleportFigures

MAX_NUMBER = (1 << 32) - 1
MOST_DARK = 10  # blocks from the first on of which nothing arrives
STATE_BLOCKS = 1 << 31  # numbers of the blocks of states, beside those of pairs


@dataclass
class Tally:
    states: int = 0
    arrived: int = 0
    agreed: int = 0  # of those that arrived
    waited_s: float = 0.0  # in the acceptor's memory, for the bits; summed over what arrived
    # How many of each cardinal state arrived, and agreed.
    of_states: NDArray[np.int64] = field(
        default_factory=lambda: np.zeros((len(qubit_states.NAMES), 2), dtype=np.int64)
    )

    def sort(self, states: States, there: NDArray[np.bool_], agreed: NDArray[np.bool_]) -> None:
        """Count a block by its cardinal states; others are of no few kinds."""
        if isinstance(states, Cardinal):
            for column, seen in enumerate((there, agreed)):
                kinds = np.bincount(states.symbols[seen], minlength=len(qubit_states.NAMES))
                self.of_states[:, column] += kinds

    def add(self, states: int, arrived: int, agreed: int, waited_us: int) -> None:
        """Count a block, each of whose states has waited so long."""
        self.states += states
        self.arrived += arrived
        self.agreed += agreed
        self.waited_s += arrived * waited_us * 1e-6

    def summary(self, elapsed_s: float) -> TeleportFigures:
        """Return the application's results; None where nothing has arrived."""
        arrived = self.arrived
        fidelity = self.agreed / arrived if arrived else None
        figures = TeleportFigures(
            states=self.states,
            arrived=arrived,
            fidelity=fidelity,
            fidelity_error=sqrt(share_variance(self.agreed, arrived)) if arrived else None,
            waited_ms=1000 * self.waited_s / arrived if arrived else None,
            elapsed_s=elapsed_s,
            states_per_s=self.states / elapsed_s,
        )
        if self.of_states.any():
            figures.of_states = self.of_states.tolist()
        return figures


def send(side: OpenerSide, state: str, count: int) -> Steps[None]:
    """Teleport `count` states of this name, block after block."""
    tally, began_s, number = Tally(), (yield Now()), 0
    while left := count - tally.states:
        number, size = number + 1, min(left, side.setup.pairs)
        states = qubit_states.chosen(state, side.draws, size)
        outcomes = yield from _measured(side, number, states, size)
        seen = np.isin(outcomes, list(side.distinguishable_states))
        yield side.say(Topic.ARRIVED, number, seen, 1)
        # The Bell state's number is the operator that undoes it.
        yield side.say(Topic.CORRECTIONS, number, np.where(seen, outcomes, 0), 2)
        for message in states.messages(side.setup.session, number):
            yield Say((message,))
        counts = yield from hear(Topic.COUNTS, number, 3, MAX_NUMBER)
        tally.add(size, *counts.tolist())
        yield Tell(tally.summary((yield Now()) - began_s))
        if not tally.arrived and (number == MOST_DARK or tally.states == count):
            text = f"none of {tally.states} states arrived: see that fibres are whole, the loss, "
            raise SessionError(Reason.NO_LIGHT, f"{text}and the detectors of both ends")


def _measured(side: OpenerSide, number: int, states: States, size: int) -> Steps[Symbols]:
    """Return the Bell states found of a block's states and halves 0 of new pairs."""
    stored = yield from side.pairs(number, size)
    if not stored.arrived.any():
        return np.full(size, NO_COINCIDENCE, dtype=np.uint8)
    session, block = side.setup.session, STATE_BLOCKS + number
    if isinstance(states, Cardinal):
        prepared = yield from do(Qnic.prepare, session, block, states.symbols)
    else:
        prepared = yield from do(prepare_along, session, block, states.directions)
    return (yield from do(Qnic.bell_measure, prepared, side.block(number)))


def receive(side: HostSide) -> Steps[None]:
    tally, began_s = Tally(), (yield Now())
    while (coming := (yield from side.announced(side.setup.pairs))) is not None:
        counts = yield from _take_in(side, tally, *coming)
        tally.add(coming[1], *counts)
        yield side.say(Topic.COUNTS, coming[0], counts, 32)
        yield Tell(tally.summary((yield Now()) - began_s))


def _take_in(side: HostSide, tally: Tally, number: int, size: int) -> Steps[tuple[int, int, int]]:
    """Store, correct and measure a block.

    Return how many states arrived, how many of these agreed, and how long (us) they waited.
    """
    name = side.block(number, half=1)
    light = yield from side.expect_light(name)
    yield side.agree()
    seen = (yield from hear(Topic.ARRIVED, number, size, 1)).astype(bool)
    bits = yield from hear(Topic.CORRECTIONS, number, size, 3)
    stored = yield from side.stored(light, size)
    states = yield from _told(number, size)
    if not stored.arrived.any():
        return 0, 0, 0
    # In one order: what is corrected is measured at once.
    operators = bits.astype(np.uint8) ^ np.uint8(side.setup.rotation)
    compared = yield from _compared(name, operators, states)
    waited_us = (compared.time_ns - stored.since_ns) // 1000
    if not 0 <= waited_us <= MAX_NUMBER:
        raise SessionError(
            Reason.PROTOCOL, f"a wait of {waited_us} us is not of 0 to {MAX_NUMBER} us"
        )
    there = seen & (compared.outcomes != NO_COINCIDENCE)
    agreed = there & (compared.outcomes == 0)
    tally.sort(states, there, agreed)
    return int(np.count_nonzero(there)), int(np.count_nonzero(agreed)), waited_us


def _told(number: int, size: int) -> Steps[States]:
    heard, states = Heard(number, size), None
    while states is None:
        message: Values = yield Hear(Values, ANSWER_TIMEOUT_S, number)
        states = heard.hear(message)
    return states


def _compared(name: BlockName, operators: Symbols, states: States) -> Steps[Outcomes]:
    """Correct each qubit and measure its state: 0 as it should be, 1 orthogonal, 255 no click."""
    if isinstance(states, Cardinal):
        measured = yield from do(Qnic.outcomes, name, states.bases, operators)
        agrees = np.where(measured.outcomes <= 1, measured.outcomes ^ states.bits, NO_COINCIDENCE)
        return Outcomes(agrees.astype(np.uint8), measured.time_ns)
    return (yield from do(measure_along, name, states.directions, operators))
