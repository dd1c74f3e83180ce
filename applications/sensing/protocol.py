"""The protocol of distributed sensing at all hosts of a line: no socket, no clock.

    leader                      next                        last
      | (ghz/line.py)              |                          |  GHZ states
      | Values(ANGLES) ----------> | Values(ANGLES) --------> |  all take their phases, and measure
      | <------- Values(OUTCOMES)  | <---- Values(OUTCOMES)   |

      | Values(PROBES) ----------> | Values(PROBES) --------> |  all make probes of their own |+>,
      | <------- Values(OUTCOMES)  | <---- Values(OUTCOMES)   |  take phases, and measure

Of a GHZ state |0...0> + exp(i sum of phases) |1...1> the parity of all outcomes between X and Y
tells the sum: one fringe. Only the leader turns its angle. Of separate probes each host has a
fringe and an angle of its own.
"""

from dataclasses import dataclass, field
from math import sqrt
from typing import Any

import numpy as np

from applications.ghz import line
from applications.ghz.line import Table
from applications.ghz.options import GhzOptions
from applications.sensing.fringe import Fringe, in_rad
from applications.sensing.sensors import measure_at, sense
from applications.sensing.service import SensingFigures
from hosts.hardware.block_name import BlockName
from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import Symbols
from hosts.middleware.session.blocks import LOST, PAIRS
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.protocol import Steps, do, hear
from hosts.middleware.session.values import MAX_WORD, numbers_of
from hosts.timeouts import BITS_TIMEOUT_S
from wire.metadata.values import Topic, Values
from wire.metadata.vocabulary import Reason
from wire.parameters.option import option

GHZ, SEPARATE = PROBES = ("ghz", "separate")


@dataclass(frozen=True)
class SensingOptions(GhzOptions):
    """`count` probes at each host: its qubits of `count` GHZ states, or qubits of its own."""

    probes: str = option(
        GHZ, f"qubits of GHZ states of all, or as many of each host's own ({GHZ})", choices=PROBES
    )

    @property
    def sends_light(self) -> bool:
        return self.probes != SEPARATE


PLUS = 2  # as states are prepared
FIRST_SHARE = 1 / 32  # of the probes, in X, and as many in Y
LEAST_FIRST = 16
GROWTH = 4  # of what is known, until the middle of the fringe is known better


def exposed(name: BlockName, turns: int) -> Steps[Symbols]:
    yield from do(sense, name)
    return line.seen((yield from do(measure_at, name, in_rad(turns))))


def own_probes(name: BlockName, count: int, steps: int) -> Steps[Symbols]:
    states = np.full(count, PLUS, dtype=np.uint8)
    made = yield from do(Qnic.prepare, name.session, name.number, states)
    return (yield from exposed(made, steps))


@dataclass
class Leader(line.Leader):
    """The host that asks: it says at which angles all measure, and tells the sum."""

    options: SensingOptions
    kind = SensingFigures
    fringes: list[Fringe] = field(init=False)  # of the parity; or one for each host

    def __post_init__(self) -> None:
        hosts = len(self.options.names)
        self.fringes = [Fringe() for _ in range(hosts if self._separate else 1)]

    @property
    def _separate(self) -> bool:
        return self.options.probes == SEPARATE

    @property
    def states(self) -> int:
        return min(fringe.seen for fringe in self.fringes)

    def wanted(self) -> int:
        """Return how many are measured at an angle, before it is chosen again."""
        first = max(LEAST_FIRST, round(self.options.count * FIRST_SHARE))
        located = all(fringe.located for fringe in self.fringes)
        return min(super().wanted(), GROWTH * self.states if located else first)

    def block(self, number: int, size: int) -> Steps[None]:
        if not self._separate:
            yield from super().block(number, size)
            return
        angles = [fringe.next_steps() for fringe in self.fringes]
        self.emitted += size
        self.made += size
        shape = len(angles) - 1, size
        theirs = yield from self.right.ask(Topic.PROBES, number, [size, *angles[1:]], 32, shape)
        ours = yield from own_probes(self.right.block(number), size, angles[0])
        for fringe, steps, parities in zip(self.fringes, angles, [ours, *theirs], strict=True):
            fringe.add(steps, parities[parities != LOST])

    def use(self, number: int, states: int) -> Steps[None]:
        """Let a block of states take all phases, and measure it."""
        (fringe,), others = self.fringes, len(self.options.names) - 1
        steps, angles = fringe.next_steps(), [0] * others
        theirs = yield from self.right.ask(Topic.ANGLES, number, angles, 32, (others, states))
        ours = yield from exposed(self.right.block(number), steps)
        there = (theirs != LOST).all(axis=0) & (ours != LOST)
        parities = (ours[there] + theirs[:, there].sum(axis=0)) & 1
        fringe.add(steps, parities.astype(np.uint8))

    def figures(self) -> dict[str, Any]:
        """Return the sum of the phases and their mean, with the limits of its error."""
        hosts, count = len(self.options.names), self.states
        figures = dict.fromkeys(FIGURES)
        if not all(fringe.located for fringe in self.fringes):
            return figures
        phases = [fringe.phase() for fringe in self.fringes]
        total = sum(phase.phase_rad for phase in phases)
        error = sqrt(sum(phase.error_rad**2 for phase in phases))
        return {
            "sum_rad": total,
            "sum_error_rad": error,
            "mean_rad": total / hosts,
            "mean_error_rad": error / hosts,
            "heisenberg_limit_rad": 1 / (hosts * sqrt(count)),
            "standard_limit_rad": 1 / sqrt(hosts * count),
            # An estimate exceeds 1 by chance alone.
            "visibility": sum(min(phase.visibility, 1.0) for phase in phases) / len(phases),
        }


FIGURES = (
    "sum_rad",
    "sum_error_rad",
    "mean_rad",
    "mean_error_rad",
    "heisenberg_limit_rad",
    "standard_limit_rad",
    "visibility",
)


class Follower(line.Follower):
    def heard(self, message: Values) -> Steps[None]:
        if message.topic != Topic.PROBES:
            yield from super().heard(message)
            return
        numbers = numbers_of(message)
        if numbers.size != 2 + self.behind or not 1 <= numbers[0] <= self.side.setup.pairs:
            text = f"probes by {numbers.size} numbers, of {self.side.setup.pairs} at most"
            raise SessionError(Reason.PROTOCOL, text)
        size, steps, *behind = numbers.tolist()
        number, others = message.block, list[Table]()
        if self.right is not None:
            shape = self.behind, size
            ask = self.right.ask(Topic.PROBES, number, [size, *behind], 32, shape)
            others.append((yield from ask))
        outcomes = yield from own_probes(self.side.block(PAIRS), size, steps)
        self.measured += size
        yield self.answer(number, outcomes, others)

    def use(self, number: int, states: int) -> Steps[None]:
        """Let a block of states take all phases behind, and this one, and measure it."""
        numbers = yield from hear(Topic.ANGLES, number, 1 + self.behind, MAX_WORD, BITS_TIMEOUT_S)
        steps, *behind = numbers.tolist()
        others = list[Table]()
        if self.right is not None:
            shape = self.behind, states
            others.append((yield from self.right.ask(Topic.ANGLES, number, behind, 32, shape)))
        outcomes = yield from exposed(self.side.block(number, half=1), steps)
        yield self.answer(number, outcomes, others)
