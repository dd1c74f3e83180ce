"""The protocol of GHZ states at all hosts: no socket, no clock.

    leader                      next                        last
      | Envelope(HOSTS) ---------> | Envelope(HOSTS) -------> |  who comes behind
      | <--------- Values(COUNTS)  | <------ Values(COUNTS)   |  how large blocks may be
      | Values(COMING) ----------> | Values(COMING) --------> |  ready, from the last on
      | -- light, half 1 --------> | -- light, half 1 ------> |  into memory
      | Values(ARRIVED) ---------> | Values(ARRIVED) -------> |  of those that all have so far
      | <-------- Values(ARRIVED)  | <----- Values(ARRIVED)   |  that all have
      |                            | CX, one half measured    |
      | Values(CORRECTIONS) -----> | Values(CORRECTIONS) ---> |  sum of the bits so far: X
      | <-------- Values(ARRIVED)  | <----- Values(ARRIVED)   |  that all have
      | Values(BASES) -----------> | Values(BASES) ---------> |  each for itself and those behind
      | <------- Values(OUTCOMES)  | <---- Values(OUTCOMES)   |

Each host makes pairs with the next one. Who has halves of two pairs fuses them: CX from the half
that came to its own, which it then measures in Z; all hosts behind turn theirs by the outcome.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hosts.hardware.qnic import BlockName, Qnic, Symbols
from hosts.middleware.services.ghz.options import MOST_HOSTS, GhzOptions
from hosts.middleware.services.ghz.witness import Table, Tally, chosen_bases
from hosts.middleware.session.blocks import LOST, Mask, correct_rotation, keep_of_all
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.options import MAX_BLOCK_PAIRS
from hosts.middleware.session.protocol import (
    Connection,
    Hear,
    HostSide,
    Now,
    OpenerSide,
    Say,
    Side,
    Steps,
    Tell,
    Through,
    coming,
    do,
    hear,
    own_pairs,
    request,
)
from hosts.timeouts import BITS_TIMEOUT_S, REPORT_TIMEOUT_S
from wire.metadata import Envelope, Finish, Reason, Topic
from wire.outcomes import BASES

NO_DIGEST = bytes(32)
MOST_DARK = 10  # blocks in a row of which nothing is left
MARGIN = 1.1  # of light beyond what is expected to be needed
MAX_NAMES_BYTES = 1024
FLIP = 1  # X, as a Pauli operator


def introduce(side: Side, names: list[str]) -> Steps[int]:
    """Tell the next host who comes behind it; return how large blocks may be to the right."""
    yield Say((Envelope(side.setup.session, Topic.HOSTS, ",".join(names).encode()),))
    (most,) = yield from hear(Topic.COUNTS, 0, 1, MAX_BLOCK_PAIRS, REPORT_TIMEOUT_S)
    return int(most)


def introduced() -> Steps[list[str]]:
    """Hear who comes behind this host."""
    message = yield Hear(Envelope)
    if message.topic != Topic.HOSTS or len(message.content) > MAX_NAMES_BYTES:
        raise SessionError(Reason.PROTOCOL, "a GHZ state does not begin so")
    try:
        names = message.content.decode().split(",") if message.content else []
    except UnicodeDecodeError as error:
        raise SessionError(Reason.PROTOCOL, f"no names of hosts: {error}") from error
    if len(names) > MOST_HOSTS:
        raise SessionError(Reason.PROTOCOL, f"{len(names)} hosts behind this one")
    return names


@dataclass(frozen=True)
class Right:
    """The connection to the next host."""

    connection: Connection
    side: Side

    def block(self, number: int) -> BlockName:
        """Return the name of the halves that are kept here."""
        return self.side.block(number, half=0)

    def make(self, number: int, size: int, there: Mask) -> Steps[Mask]:
        """Make pairs with the next host of those states that are there; return which all have."""
        side = self.side
        stored = yield from own_pairs(side, number, size, side.ports[-1])
        yield Through(self.connection, _say(side, Topic.ARRIVED, number, stored.arrived & there, 1))
        heard = yield Through(self.connection, hear(Topic.ARRIVED, number, size, 1, BITS_TIMEOUT_S))
        return heard.astype(bool)  # type: ignore[no-any-return]

    def correct(self, number: int, bits: Symbols) -> Steps[Mask]:
        """Tell by what all behind turn their qubits; return which states are left then."""
        side, size = self.side, bits.size
        yield Through(self.connection, _say(side, Topic.CORRECTIONS, number, bits, 2))
        heard = yield Through(self.connection, hear(Topic.ARRIVED, number, size, 1, BITS_TIMEOUT_S))
        return heard.astype(bool)  # type: ignore[no-any-return]

    def measure(self, number: int, bases: Table) -> Steps[Table]:
        """Have all behind measure, each in its bases; return their outcomes."""
        count = bases.size
        yield Through(self.connection, _say(self.side, Topic.BASES, number, bases.ravel(), 2))
        told = hear(Topic.OUTCOMES, number, count, LOST, BITS_TIMEOUT_S)
        heard = yield Through(self.connection, told)
        return heard.astype(np.uint8).reshape(bases.shape)  # type: ignore[no-any-return]


def _say(side: Side, topic: Topic, number: int, values: Any, width: int) -> Steps[None]:
    yield side.say(topic, number, values, width)


def _measured(name: BlockName, bases: Symbols) -> Steps[Symbols]:
    outcomes = yield from do(Qnic.measure, name, bases)
    return np.where(outcomes <= 1, outcomes, LOST).astype(np.uint8)


@dataclass
class Leader:
    """The host that asks: the first of the line."""

    side: OpenerSide
    right: Right
    options: GhzOptions
    most: int  # states in a block
    tally: Tally = field(default_factory=Tally)
    emitted: int = 0  # pairs of its own
    made: int = 0  # states, as far as anybody can tell

    def run(self) -> Steps[None]:
        """Make states and measure them until so many have told something."""
        began_s, number, dark = (yield Now()), 0, 0
        while self.tally.states < self.options.count:
            number += 1
            found = yield from self._block(number, self._size())
            dark = 0 if found else dark + 1
            if dark == MOST_DARK:
                text = f"no state of the last {MOST_DARK} blocks was seen by all hosts: see that "
                raise SessionError(Reason.NO_LIGHT, f"{text}fibres are whole, and the loss")
            yield Tell(self._summary((yield Now()) - began_s))

    def _size(self) -> int:
        """Return how many states to begin, by what has come of those before."""
        missing = self.options.count - self.tally.states
        share = self.tally.states / self.emitted if self.tally.states else 1.0
        wanted = MARGIN * missing / share if self.emitted else missing
        return max(1, min(int(np.ceil(wanted)), self.most))

    def _block(self, number: int, size: int) -> Steps[int]:
        """Make and measure a block; return how many states have told something."""
        right, name, before = self.right, self.right.block(number), self.tally.states
        yield Through(right.connection, right.side.announce(number, size))
        self.emitted += size
        kept = yield from right.make(number, size, np.ones(size, dtype=bool))
        if not (yield from keep_of_all(name, kept)):
            return 0
        kept = yield from right.correct(number, np.zeros(np.count_nonzero(kept), dtype=np.uint8))
        states = yield from keep_of_all(name, kept)
        if not states:
            return 0
        self.made += states
        bases = chosen_bases(self.side.draws, len(self.options.names), states)
        ours = yield from _measured(name, bases[0])
        theirs = yield from right.measure(number, bases[1:])
        self.tally.add(bases, np.vstack([ours, theirs]))
        return self.tally.states - before

    def _summary(self, elapsed_s: float) -> dict[str, Any]:
        return {
            "states": self.tally.states,
            "hosts": len(self.options.names),
            **self.tally.summary(),
            "made": self.made,
            "emitted": self.emitted,
            "states_per_s": self.tally.states / elapsed_s,
            "elapsed_s": elapsed_s,
        }


@dataclass
class Follower:
    """A host that another has asked: it fuses, unless it is the last."""

    side: HostSide
    right: Right | None  # of the last there is none
    behind: int  # hosts
    fused: int = 0
    measured: int = 0

    def run(self) -> Steps[None]:
        """Do what the line does until its leader ends it."""
        while (message := (yield from self.side.next_values())) is not None:
            yield from self._block(*coming(message, self.side.setup.pairs))
            yield Tell({"states": self.measured, "fused": self.fused})
        if self.right is not None:
            finish = Finish(self.right.side.setup.session, 0, NO_DIGEST)
            yield Through(self.right.connection, request(finish, BITS_TIMEOUT_S))

    def _block(self, number: int, size: int) -> Steps[None]:
        """Take part in a block that was announced."""
        side, right, name = self.side, self.right, self.side.block(number, half=1)
        if right is not None:
            yield Through(right.connection, right.side.announce(number, size))
        light = yield from side.expect_light(name)
        yield side.agree()
        there = (yield from hear(Topic.ARRIVED, number, size, 1, BITS_TIMEOUT_S)).astype(bool)
        stored = yield from side.stored(light, size)
        there &= yield from correct_rotation(name, stored.arrived, side.setup.rotation)
        if right is not None:
            there = yield from right.make(number, size, there)
        yield side.say(Topic.ARRIVED, number, there, 1)
        left = yield from keep_of_all(name, there)
        if right is not None:
            yield from keep_of_all(right.block(number), there)
        if left:
            yield from self._fuse(number, left)

    def _fuse(self, number: int, size: int) -> Steps[None]:
        """Fuse with the next host, correct, and measure as the leader says."""
        side, right, name = self.side, self.right, self.side.block(number, half=1)
        outcomes = np.zeros(size, dtype=np.uint8)
        if right is not None:
            yield from do(Qnic.controlled_x, name, right.block(number))
            outcomes = yield from _measured(right.block(number), np.zeros(size, dtype=np.uint8))
            self.fused += size
        heard = yield from hear(Topic.CORRECTIONS, number, size, LOST, BITS_TIMEOUT_S)
        bits = heard.astype(np.uint8)
        yield from do(Qnic.apply, name, np.where(bits == FLIP, FLIP, 0).astype(np.uint8))
        there = bits != LOST
        if right is not None:
            lost = ~there | (outcomes == LOST)
            there = yield from right.correct(number, np.where(lost, LOST, bits ^ outcomes))
        yield side.say(Topic.ARRIVED, number, there, 1)
        states = yield from keep_of_all(name, there)
        if states:
            yield from self._measure(number, states)

    def _measure(self, number: int, states: int) -> Steps[None]:
        """Measure, have those behind measure, and tell what all have found."""
        side, hosts = self.side, 1 + self.behind
        most = len(BASES) - 1
        told = yield from hear(Topic.BASES, number, hosts * states, most, BITS_TIMEOUT_S)
        bases = told.astype(np.uint8).reshape(hosts, states)
        found = [(yield from _measured(side.block(number, half=1), bases[0]))[None]]
        if self.right is not None:
            found.append((yield from self.right.measure(number, bases[1:])))
        self.measured += states
        yield side.say(Topic.OUTCOMES, number, np.vstack(found).ravel(), 2)
