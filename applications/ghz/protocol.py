"""The fidelity of GHZ states, at all hosts of a line: no socket, no clock.

leader                      next                        last
  | (line.py)                  |                          |
  | Values(BASES) -----------> | Values(BASES) ---------> |  each for itself and those behind
  | <------- Values(OUTCOMES)  | <---- Values(OUTCOMES)   |
"""

from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol

import numpy as np

from applications.ghz import line
from applications.ghz.line import Table
from applications.ghz.service import GhzFigures, LineFigures
from applications.ghz.witness import Tally, chosen_bases
from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import Symbols
from hosts.middleware.session.protocol import Steps, do, hear
from hosts.timeouts import BITS_TIMEOUT_S
from wire.metadata.values import Topic
from wire.outcomes import BASES


class Witness(Protocol):
    @property
    def states(self) -> int:
        """Return how many states count."""

    def add(self, bases: Table, outcomes: Table) -> None:
        """Count states: bases and outcomes of all hosts, above 1 where there was none."""

    def summary(self) -> dict[str, Any]:
        """Return the fidelity, and what it is of; None where nothing is known."""


@dataclass
class Leader(line.Leader):
    """The host that asks: it draws the stabilisers that are measured."""

    tally: Witness = field(default_factory=Tally)
    kind: ClassVar[type[LineFigures]] = GhzFigures

    @property
    def states(self) -> int:
        return self.tally.states

    def use(self, number: int, states: int) -> Steps[None]:
        bases = self.bases(states)
        ours = line.seen((yield from do(Qnic.measure, self.qubits(number), bases[0])))
        behind = bases[1:]
        theirs = yield from self.right.ask(Topic.BASES, number, behind.ravel(), 2, behind.shape)
        self.count(bases, np.vstack([ours, theirs]))

    def count(self, bases: Table, outcomes: Table) -> None:
        self.tally.add(bases, outcomes)

    def bases(self, states: int) -> Table:
        return chosen_bases(self.side.draws, len(self.options.names), states)

    def figures(self) -> dict[str, Any]:
        return self.tally.summary()


class Follower(line.Follower):
    def use(self, number: int, states: int) -> Steps[None]:
        """Measure, have those behind measure, and tell what all have found."""
        shape = 1 + self.behind, states
        numbers = yield from hear(
            Topic.BASES, number, shape[0] * states, len(BASES) - 1, BITS_TIMEOUT_S
        )
        bases = numbers.astype(np.uint8).reshape(shape)
        outcomes = yield from self.outcomes(number, bases[0])
        others = []
        if self.right is not None:
            behind = bases[1:]
            ask = self.right.ask(Topic.BASES, number, behind.ravel(), 2, behind.shape)
            others.append((yield from ask))
        yield self.answer(number, outcomes, others)

    def outcomes(self, number: int, bases: Symbols) -> Steps[Symbols]:
        return line.seen((yield from do(Qnic.measure, self.qubits(number), bases)))
