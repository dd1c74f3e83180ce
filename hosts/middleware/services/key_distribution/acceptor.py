"""The protocol of the end that is asked for keys: no socket, no clock.

It measures, announces, corrects its errors, and has its key stored.
"""

from collections import deque
from collections.abc import Awaitable, Callable
from typing import NamedTuple

from hosts.hardware.qnic import Symbols
from hosts.middleware.qkd.bob import Bob
from hosts.middleware.qkd.end import State
from hosts.middleware.qkd.parameters import Parameters
from hosts.middleware.qkd.sifting import Record
from hosts.middleware.services.key_distribution.light import (
    measured,
    measuring,
    random_bases,
    record_of,
    with_tests,
)
from hosts.middleware.services.key_distribution.messages import Cutter, KeyMessages
from hosts.middleware.services.key_distribution.summary import Progress, so_far
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.protocol import Hear, HostSide, Light, Now, Steps, Tell
from hosts.middleware.session.values import expect
from hosts.timeouts import KEYS_TIMEOUT_S
from wire.metadata import Envelope, Finish, Message, Reason, Topic, Values
from wire.qkd import MAX_PHOTONS, Bound, Proposal, QkdMessage, Reconciliation, unframe

MAX_NAME_BYTES = 64
MAX_COMING = 2  # blocks: one is measured while the next is made


class Introduced(NamedTuple):
    """Who opens a session for keys, what it proposes, and the message that says so."""

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
        raise SessionError(Reason.UNSUPPORTED, f"chsh_fraction {tested} in this service")
    return opener


class AcceptorOfKeys:
    """The end that was asked for keys; it measures one half of each block."""

    def __init__(
        self,
        side: HostSide,
        half: int,
        opener: Introduced,
        bob: Bob,
        progress: Progress,
        store: Callable[[], Awaitable[None]],
    ) -> None:
        """Measure this half of each block; store the key before the other end is told."""
        self._side, self._half, self._bob, self._progress = side, half, bob, progress
        self._proposal = opener.proposal
        self._tested = opener.parameters.chsh_fraction  # of the photons
        self._messages = KeyMessages(side, bob, store, opener.cutter)
        self._announced = 0  # blocks
        self._coming: deque[tuple[Symbols, Light]] = deque()  # bases, and light

    def run(self) -> Steps[None]:
        """Measure, announce, correct, until the opener ends it; SessionError if it fails."""
        bob, messages, progress = self._bob, self._messages, self._progress
        yield from messages.hear_message(self._proposal)
        while not isinstance(message := (yield Hear(Message, KEYS_TIMEOUT_S)), Finish):
            if isinstance(message, Envelope):
                yield from messages.hear(message)
            elif not isinstance(message, Values) or bob.state is not State.SIFTING:
                what = f"{type(message).__name__} from {self._side.peer}"
                raise SessionError(Reason.PROTOCOL, f"{what} while {bob.state.name.lower()}")
            elif message.topic == Topic.COMING:
                yield from self._get_ready(message)
            else:
                yield from messages.say(bob.add_block((yield from self._measure(message))))
                yield Tell(so_far(progress, bob), at_the_end=False)
            progress.note(bob.blocks_sifted, (yield Now()))
        if bob.state is not State.DONE:
            raise SessionError(Reason.PROTOCOL, "the other end ended it before there was a key")

    def _get_ready(self, message: Values) -> Steps[None]:
        """Begin to measure the block that comes next."""
        if len(self._coming) == MAX_COMING:
            raise SessionError(Reason.PROTOCOL, f"block {message.block} before others are over")
        side, number = self._side, self._announced
        most = min(side.setup.pairs, MAX_PHOTONS)
        (photons,) = expect(message, Topic.COMING, number, 1, most).tolist()
        if photons == 0:
            raise SessionError(Reason.PROTOCOL, f"block {number} has no photons")
        bases = with_tests(side.draws, random_bases(side, photons), self._tested)
        light = yield from measuring(side, side.block(number, self._half), bases)
        self._coming.append((bases, light))
        self._announced += 1
        yield side.agree()

    def _measure(self, message: Values) -> Steps[Record]:
        """Return what was measured of the block that is over."""
        expect(message, Topic.OVER, self._progress.blocks, 0, 0)
        if not self._coming:
            raise SessionError(Reason.PROTOCOL, f"the end of block {message.block}, not begun")
        bases, light = self._coming[0]
        outcomes = yield from measured(self._side, light, bases.size)
        self._coming.popleft()
        self._progress.blocks += 1
        self._progress.photons += bases.size
        return record_of(outcomes, bases, self._side.setup.rotation, bool(self._tested))


def proposed_by(message: QkdMessage) -> Parameters:
    """Return the parameters that the opener proposes; ValueError for what cannot be."""
    if not isinstance(message, Proposal):
        raise ValueError(f"{type(message).__name__} before the proposal")
    bound, reconciliation = Bound(message.bound), Reconciliation(message.reconciliation)
    return Parameters(**{**vars(message), "bound": bound, "reconciliation": reconciliation})
