"""GHZ states of a line of hosts, made of pairs between neighbours: no socket, no clock.

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

Each host makes pairs with the next one. A host with halves of two fuses them: CX from the half
that came to its own, which it then measures in Z; all hosts behind turn theirs by the outcome.
Each service has its own use of the states.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from applications.ghz.options import MOST_HOSTS, GhzOptions
from applications.ghz.service import FollowerFigures, LineFigures
from hosts.hardware.block_name import BlockName
from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import Symbols
from hosts.middleware.session.blocks import LOST, Mask, correct_rotation, keep_of_all, store
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.options import MAX_BLOCK_PAIRS
from hosts.middleware.session.protocol import (
    Connection,
    Hear,
    HostSide,
    Now,
    OnConnection,
    OpenerSide,
    Say,
    Side,
    Steps,
    Tell,
    coming,
    do,
    hear,
    own_pairs,
    request,
    saying,
)
from hosts.middleware.session.values import Numbers
from hosts.timeouts import BITS_TIMEOUT_S, REPORT_TIMEOUT_S
from wire.metadata.blocks import Finish
from wire.metadata.header import MAX_LENGTH
from wire.metadata.setup import SEAL_BYTES, Setup
from wire.metadata.values import Envelope, Topic, Values
from wire.metadata.vocabulary import Reason, Verdict
from wire.outcomes import Pauli

NO_DIGEST = bytes(32)
MOST_DARK = 10  # blocks in a row of which nothing is left
MARGIN = 1.1  # of light beyond what is expected to be needed
MAX_NAMES_BYTES = 1024
FIXED_BYTES = 64  # of a message, at most
OUTCOME_BITS = 2
FLIP = 1  # X, as a Pauli operator

Table = NDArray[np.uint8]  # shape (hosts, states)


def most_states(behind: int) -> int:
    """Return of how many states one message can tell a number of two bits for each host behind."""
    return 8 * (MAX_LENGTH - FIXED_BYTES) // (OUTCOME_BITS * behind)


def introduce(side: Side, names: list[str]) -> Steps[int]:
    """Tell the next host who comes behind it; return how large blocks may be to the right."""
    yield Say((Envelope(side.setup.session, Topic.HOSTS, ",".join(names).encode()),))
    (most,) = yield from hear(Topic.COUNTS, 0, 1, MAX_BLOCK_PAIRS, REPORT_TIMEOUT_S)
    return int(most)


def introduced() -> Steps[list[str]]:
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


def asked_of_next(setup: Setup) -> Setup:
    """Return what is asked of the next host, which the controller judges and seals again."""
    session, seal = (setup.session + 1) % (1 << 64), bytes(SEAL_BYTES)
    pending, ok = Verdict.PENDING, Reason.OK
    return replace(setup, session=session, verdict=pending, rotation=Pauli.I, reason=ok, seal=seal)


@dataclass(frozen=True)
class Right:
    connection: Connection
    side: Side

    def block(self, number: int) -> BlockName:
        return self.side.block(number, half=0)

    def make(self, number: int, there: Mask, lit: bool = True) -> Steps[Mask]:
        """Make pairs with the next host of those states that are there; return which all have.

        If it is not lit, there are none to be made here, but perhaps behind.
        """
        side, size = self.side, there.size
        if lit:
            there = there & (yield from own_pairs(side, number, size, side.ports[-1])).arrived
        yield OnConnection(self.connection, saying(side.say(Topic.ARRIVED, number, there, 1)))
        heard = yield OnConnection(
            self.connection, hear(Topic.ARRIVED, number, size, 1, BITS_TIMEOUT_S)
        )
        return heard.astype(bool)  # type: ignore[no-any-return]

    def correct(self, number: int, bits: Symbols) -> Steps[Mask]:
        """Send corrections down the line; return which states are left."""
        side, size = self.side, bits.size
        yield OnConnection(self.connection, saying(side.say(Topic.CORRECTIONS, number, bits, 2)))
        heard = yield OnConnection(
            self.connection, hear(Topic.ARRIVED, number, size, 1, BITS_TIMEOUT_S)
        )
        return heard.astype(bool)  # type: ignore[no-any-return]

    def ask(
        self, topic: Topic, number: int, values: Any, width: int, shape: tuple[int, int]
    ) -> Steps[Table]:
        """Send measurement bases down the line; return the outcomes, shape (hosts, states)."""
        yield OnConnection(self.connection, saying(self.side.say(topic, number, values, width)))
        outcomes = hear(Topic.OUTCOMES, number, shape[0] * shape[1], LOST, BITS_TIMEOUT_S)
        heard = yield OnConnection(self.connection, outcomes)
        return heard.astype(np.uint8).reshape(shape)  # type: ignore[no-any-return]

    def tell(self, *messages: Say) -> Steps[None]:
        for message in messages:
            yield OnConnection(self.connection, saying(message))

    def hear(
        self, topic: Topic, number: int, count: int, most: int, timeout_s: float
    ) -> Steps[Numbers]:
        numbers = hear(topic, number, count, most, timeout_s)
        return (yield OnConnection(self.connection, numbers))  # type: ignore[no-any-return]


def seen(outcomes: Symbols) -> Symbols:
    """Return outcomes as they travel: LOST where no detector has clicked."""
    return np.where(outcomes <= 1, outcomes, LOST).astype(np.uint8)


@dataclass
class Leader(ABC):
    """The host that asks: the first of the line."""

    side: OpenerSide
    right: Right
    options: GhzOptions
    most: int  # states in a block
    emitted: int = 0  # pairs of its own
    made: int = 0  # states, as far as anybody can tell
    kind: ClassVar[type[LineFigures]] = LineFigures  # of what it tells

    @property
    @abstractmethod
    def states(self) -> int:
        """Return how many states count."""

    @abstractmethod
    def use(self, number: int, states: int) -> Steps[None]:
        """Use states, of which this host has its qubits."""

    @abstractmethod
    def figures(self) -> dict[str, Any]:
        """Return their results, by name."""

    def wanted(self) -> int:
        """Return how many of the missing states the next block should add."""
        return self.options.count - self.states

    def run(self) -> Steps[None]:
        """Make states and use them until enough of them count."""
        began_s, number, dark = (yield Now()), 0, 0
        while self.states < self.options.count:
            number, before = number + 1, self.states
            yield from self.block(number, self._size())
            dark = 0 if self.states > before else dark + 1
            if dark == MOST_DARK:
                text = f"no state of the last {MOST_DARK} blocks was seen by all hosts: see that "
                text += "fibres are whole, the loss, and the detectors"
                raise SessionError(Reason.NO_LIGHT, text)
            yield Tell(self._summary((yield Now()) - began_s))

    def _size(self) -> int:
        """Return how many states to begin, by the yield of those before."""
        share = self.states / self.emitted if self.states else 1.0
        needed = self.wanted() / share * (MARGIN if share < 1 else 1)
        return max(1, min(int(np.ceil(needed)), self.most))

    def block(self, number: int, size: int) -> Steps[None]:
        """Make a block of states and use it."""
        right, name = self.right, self.qubits(number)
        self.emitted += size
        mask = yield from self.pairs(number, size)
        if not (yield from keep_of_all(name, mask)):
            return
        mask = yield from right.correct(number, np.zeros(np.count_nonzero(mask), dtype=np.uint8))
        if states := (yield from keep_of_all(name, mask)):
            self.made += states
            yield from self.use(number, states)

    def pairs(self, number: int, size: int, lit: bool = True) -> Steps[Mask]:
        """Have pairs made along the line, here too if it is lit; return of which states all are."""
        yield OnConnection(self.right.connection, self.right.side.announce(number, size))
        return (yield from self.right.make(number, np.ones(size, dtype=bool), lit))

    def qubits(self, number: int) -> BlockName:
        return self.right.block(number)

    def _summary(self, elapsed_s: float) -> LineFigures:
        return self.kind(
            states=self.states,
            hosts=len(self.options.names),
            **self.figures(),
            made=self.made,
            emitted=self.emitted,
            states_per_s=self.states / elapsed_s,
            elapsed_s=elapsed_s,
        )


@dataclass
class Follower(ABC):
    """A host that another has asked: it fuses, unless it is the last."""

    side: HostSide
    right: Right | None  # of the last there is none
    behind: int  # hosts
    fused: int = 0
    measured: int = 0

    @abstractmethod
    def use(self, number: int, states: int) -> Steps[None]:
        """Use states, of which this host has its qubits."""

    def figures(self) -> FollowerFigures:
        return FollowerFigures(states=self.measured, fused=self.fused)

    def run(self) -> Steps[None]:
        """Do what the line does until its leader ends it."""
        while (message := (yield from self.side.next_values())) is not None:
            yield from self.heard(message)
            yield Tell(self.figures())
        if self.right is not None:
            finish = Finish(self.right.side.setup.session, 0, NO_DIGEST)
            yield OnConnection(self.right.connection, request(finish, BITS_TIMEOUT_S))

    def heard(self, message: Values) -> Steps[None]:
        """Take part in what the message announces: a block of states."""
        yield from self._block(*coming(message, self.side.setup.pairs))

    def qubits(self, number: int) -> BlockName:
        return self.side.block(number, half=1)

    def pairs(self, number: int, size: int, left: bool = True, right: bool = True) -> Steps[Mask]:
        """Store halves from the left, make pairs to the right; return of which states all are.

        Where there are none on one side of this host, there may be some further on.
        """
        side, name, after = self.side, self.side.block(number, half=1), self.right
        if after is not None:
            yield OnConnection(after.connection, after.side.announce(number, size))
        light = (yield from side.expect_light(name)) if left else None
        yield side.agree()
        there = (yield from hear(Topic.ARRIVED, number, size, 1, BITS_TIMEOUT_S)).astype(bool)
        if light is not None:
            stored = yield from side.stored(light, size)
            there &= yield from correct_rotation(name, stored.arrived, side.setup.rotation)
        if after is not None:
            there = yield from after.make(number, there, right)
        yield side.say(Topic.ARRIVED, number, there, 1)
        return there

    def _block(self, number: int, size: int) -> Steps[None]:
        there = yield from self.pairs(number, size)
        left = yield from keep_of_all(self.qubits(number), there)
        if self.right is not None:
            yield from keep_of_all(self.right.block(number), there)
        if left:
            yield from self._fuse(number, left)

    def _fuse(self, number: int, size: int) -> Steps[None]:
        """Fuse with the next host, correct, and use what is left."""
        side, right, name = self.side, self.right, self.qubits(number)
        outcomes = np.zeros(size, dtype=np.uint8)
        if right is not None:
            yield from do(Qnic.controlled_x, name, right.block(number))
            in_z = np.zeros(size, dtype=np.uint8)
            outcomes = seen((yield from do(Qnic.measure, right.block(number), in_z)))
            outcomes[~(yield from store(name))] = LOST  # to wait for corrections
            self.fused += size
        heard = yield from hear(Topic.CORRECTIONS, number, size, LOST, BITS_TIMEOUT_S)
        bits = heard.astype(np.uint8)
        yield from do(Qnic.apply, name, np.where(bits == FLIP, FLIP, 0).astype(np.uint8))
        there = (bits != LOST) & (yield from store(name))  # to wait until it is used
        if right is not None:
            lost = ~there | (outcomes == LOST)
            there = yield from right.correct(number, np.where(lost, LOST, bits ^ outcomes))
        yield side.say(Topic.ARRIVED, number, there, 1)
        if states := (yield from keep_of_all(name, there)):
            yield from self.use(number, states)
            self.measured += states

    def answer(self, number: int, outcomes: Symbols, others: list[Table]) -> Say:
        """Tell outcomes: this host's, and those of all behind it."""
        return self.side.say(
            Topic.OUTCOMES, number, np.vstack([outcomes[None], *others]).ravel(), 2
        )
