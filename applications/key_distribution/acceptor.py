"""The protocol of the end that is asked for keys: no socket, no clock.

It takes its part in the light, announces, corrects its errors, and has its key stored.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, Protocol
from uuid import UUID

from applications.key_distribution.light import detected, detecting, record_of, with_tests
from applications.key_distribution.summary import Progress, so_far
from applications.key_distribution.under_way import MAX_UNDER_WAY, Cutter, KeysUnderWay, Store
from applications.measured_light import measured, measuring, random_bases
from applications.qkd.alice import Alice
from applications.qkd.bob import Bob
from applications.qkd.end import State
from applications.qkd.messages import (
    MAX_PULSES,
    Bound,
    Proposal,
    QkdMessage,
    Reconciliation,
    unframe,
)
from applications.qkd.parameters import Parameters
from applications.qkd.sifting import Announced, Clicks, Record
from applications.timeouts import KEYS_TIMEOUT_S
from hosts.hardware.replies import Symbols
from hosts.middleware.session.errors import SessionError, unsupported
from hosts.middleware.session.protocol import (
    Concurrently,
    Hear,
    HostSide,
    Light,
    Now,
    Steps,
    Tell,
    Wait,
    WaitUntil,
)
from hosts.middleware.session.values import expect
from wire.keyed import KEY_BYTES, KeyedChoices
from wire.metadata.blocks import Finish
from wire.metadata.header import Message
from wire.metadata.values import Envelope, Topic, Values
from wire.metadata.vocabulary import Reason

MAX_NAME_BYTES = 64
MAX_COMING = 3  # blocks: one is measured, one is made, and one announced


class Introduced(NamedTuple):
    """The opener of a session for keys, its proposal, and that message."""

    peer: str
    parameters: Parameters
    proposal: bytes  # with its tag, which nobody has looked at
    cutter: Cutter  # of what comes behind it


def introduced(tests: bool) -> Steps[Introduced]:
    """Hear how a session for keys begins; tests: with some photons for a CHSH test."""
    named = yield Hear(Envelope)
    proposed = yield Hear(Envelope)
    if (named.topic, proposed.topic) != (Topic.OPENER, Topic.KEYS):
        raise SessionError(Reason.PROTOCOL, "key distribution does not begin so")
    if len(named.content) > MAX_NAME_BYTES:
        raise SessionError(Reason.PROTOCOL, f"a name of {len(named.content)} bytes")
    cutter = Cutter()
    try:
        (data,) = cutter.feed(proposed.content)
        message = unframe(data).open()
        opener = Introduced(named.content.decode(), proposed_by(message), data, cutter)
    except ValueError as error:  # MalformedPacket and UnicodeDecodeError are such
        raise SessionError(Reason.PROTOCOL, f"no proposal of keys: {error}") from error
    tested = opener.parameters.chsh_fraction
    if bool(tested) is not tests:
        raise unsupported(f"chsh_fraction {tested} in this service")
    return opener


class BlockOfLight(Protocol):
    """This end's part in a block of light."""

    def record(self) -> Steps[Announced]:
        """Return what this end knows of it when it is over."""

    def heard(self, message: Values) -> Steps[None]:
        """Take what the opener tells of it meanwhile; SessionError for what it may not tell."""


class GetReady(Protocol):
    """The acceptor's part in light: of a block, by its number and how many photons it has."""

    def __call__(self, side: HostSide, number: int, photons: int, /) -> Steps[BlockOfLight]:
        """Get ready for a block."""


@dataclass
class Half:
    """A half of a block, which is measured as it arrives."""

    side: HostSide
    bases: KeyedChoices
    light: Light

    def record(self) -> Steps[Clicks]:
        """Return what was measured, without the known rotation of the paths."""
        return detected(self.side, self.light, self.bases, self.side.setup.rotation)

    def heard(self, message: Values) -> Steps[None]:
        yield from ()
        raise out_of_turn(message, self.side.peer)


@dataclass
class TestedHalf:
    """A half of which some photons are for a CHSH test."""

    side: HostSide
    bases: Symbols
    light: Light

    def record(self) -> Steps[Record]:
        """Return the same of it."""
        outcomes = yield from measured(self.side, self.light, self.bases.size)
        return record_of(outcomes, self.bases, self.side.setup.rotation)

    def heard(self, message: Values) -> Steps[None]:
        yield from ()
        raise out_of_turn(message, self.side.peer)


def measuring_half(
    side: HostSide, number: int, photons: int, *, half: int, tested: float
) -> Steps[BlockOfLight]:
    """Begin to measure a half of a block; tested: how much of it is for a CHSH test."""
    name = side.block(number, half)
    if tested:
        settings = with_tests(side.draws, random_bases(side, photons), tested)
        return TestedHalf(side, settings, (yield from measuring(side, name, settings)))
    bases = KeyedChoices(side.draws.bytes(KEY_BYTES), photons)
    return Half(side, bases, (yield from detecting(side, name, bases.key)))


def out_of_turn(message: Message, peer: str) -> SessionError:
    """Return the failure that a message is which must not come now."""
    return SessionError(Reason.PROTOCOL, f"{type(message).__name__} from {peer} out of its turn")


@dataclass
class Coming:
    """A block of light that is announced, for a key."""

    key: int
    photons: int
    block: BlockOfLight


class AcceptorOfKeys:
    """The end that was asked for keys; it takes its part in each block of light."""

    def __init__(
        self,
        side: HostSide,
        light: GetReady,
        opener: Introduced,
        new_key: Callable[[int], Bob],  # this end of a key, by its number in the session
        progress: Progress,
        store: Store,
    ) -> None:
        """Take part in this light; store keys before the other end learns of them."""
        self._side, self._light, self._new_key, self._progress = side, light, new_key, progress
        self._store, self._proposal = store, opener.proposal
        self.keys = KeysUnderWay(side, progress, self._done, opener.cutter)
        self._begun = self._announced = self._over = 0  # keys; blocks; of them that are over
        self._coming: deque[Coming] = deque()
        self.not_kept: dict[int, list[UUID]] = {}  # by the opener yet: keys in the store here

    def run(self) -> Steps[None]:
        """Measure, announce, correct, until the opener ends it; SessionError if it fails."""
        yield from self.keys.hear_message(self._proposal, self._begin)
        yield Concurrently(self._measure_all())
        while not isinstance(message := (yield Hear(Message, KEYS_TIMEOUT_S)), Finish):
            match message:
                case Envelope():
                    yield from self.keys.hear(message, self._begin)
                case Values(topic=Topic.COMING):
                    yield from self._get_ready(message)
                case Values(topic=Topic.OVER) if self._over < self._announced:
                    expect(message, Topic.OVER, self._over, 0, 0)
                    self._over += 1
                case Values(topic=Topic.KEPT) if message.block in self.not_kept:
                    self._kept(message.block)
                case Values() if self._begun_blocks <= message.block < self._announced:
                    coming = self._coming[message.block - self._begun_blocks]
                    yield from coming.block.heard(message)
                case _:
                    raise out_of_turn(message, self._side.peer)
        if self.keys.numbers or not self._begun:
            raise SessionError(Reason.PROTOCOL, "the other end ended it before there was a key")

    def _begin(self, key: int) -> Steps[None]:
        if key != self._begun or len(self.keys.numbers) > MAX_UNDER_WAY:
            raise SessionError(Reason.PROTOCOL, f"a message about key {key}, not {self._begun}")
        self._begun += 1
        return self.keys.begin(key, self._new_key(key))

    def _done(self, key: int, bob: Alice | Bob) -> Steps[None]:
        self.not_kept[key] = yield Wait(partial(self._store, key, bob))

    def _kept(self, key: int) -> None:
        self._progress.made.add(self.keys.end_of(key))
        self._progress.stored(self.not_kept.pop(key))
        self.keys.forget(key)

    def _get_ready(self, message: Values) -> Steps[None]:
        """Get ready for the block that comes next, for the newest key."""
        if len(self._coming) == MAX_COMING:
            raise SessionError(Reason.PROTOCOL, f"block {message.block} before others are over")
        side, number = self._side, self._announced
        most = min(side.setup.pairs, MAX_PULSES)
        (photons,) = expect(message, Topic.COMING, number, 1, most).tolist()
        if photons == 0:
            raise SessionError(Reason.PROTOCOL, f"block {number} has no photons")
        block = yield from self._light(side, number, photons)
        self._coming.append(Coming(self._begun - 1, photons, block))
        self._announced += 1
        yield side.agree()

    @property
    def _begun_blocks(self) -> int:
        """The number of the first block that is announced and not over here."""
        return self._announced - len(self._coming)

    def _measure_all(self) -> Steps[None]:
        """Announce what is known here of each block that is over."""
        progress = self._progress
        while True:
            yield WaitUntil(lambda: progress.blocks < self._over)
            coming = self._coming[0]
            record = yield from coming.block.record()
            self._coming.popleft()
            progress.blocks += 1
            progress.photons += coming.photons
            bob = self.keys.end_of(coming.key)
            if not isinstance(bob, Bob) or bob.state not in (State.OPENING, State.SIFTING):
                raise SessionError(Reason.PROTOCOL, f"light for key {coming.key}, sifted already")
            yield from self.keys.step(coming.key, bob.add_block, record)
            report = so_far(progress, self.keys.ends, (yield Now()))
            yield Tell(report, at_the_end=False)


def proposed_by(message: QkdMessage) -> Parameters:
    """Return the parameters that the opener proposes; ValueError for what cannot be."""
    if not isinstance(message, Proposal):
        raise ValueError(f"{type(message).__name__} before the proposal")
    bound, reconciliation = Bound(message.bound), Reconciliation(message.reconciliation)
    return Parameters(**{**vars(message), "bound": bound, "reconciliation": reconciliation})
