"""The end that is asked for keys: measures, announces, corrects its errors, stores."""

import asyncio
from collections import deque
from uuid import UUID

from hosts.hardware.qnic import Symbols
from hosts.middleware.qkd.bob import Bob
from hosts.middleware.qkd.end import State, Terms
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
from hosts.middleware.services.key_distribution.session import pools, stored, tell_of_failure
from hosts.middleware.services.key_distribution.summary import Progress, so_far, summary
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.service import AcceptorEnd
from hosts.middleware.session.values import expect
from hosts.timeouts import ANSWER_TIMEOUT_S, KEYS_TIMEOUT_S
from wire.metadata import Envelope, Finish, Message, Reason, Topic, Values
from wire.qkd import MAX_PHOTONS, Bound, Proposal, QkdMessage, Reconciliation, unframe

MAX_NAME_BYTES = 64
MAX_COMING = 2  # blocks: one is measured while the next is made


class AcceptorOfKeys:
    """The end that was asked for keys; it measures one half of each block."""

    def __init__(self, end: AcceptorEnd, half: int, *, tests: bool = False) -> None:
        """Measure this half; tests: some photons for a CHSH test."""
        self._end, self._half, self._tests = end, half, tests
        self._tested = 0.0  # of the photons, as the opener proposes
        self._progress = Progress()
        self._announced = 0  # blocks
        self._coming: deque[tuple[Symbols, asyncio.Task[Symbols]]] = deque()  # bases, and light
        self._ids: list[UUID] = []  # of the keys in the store

    async def run(self) -> None:
        """Measure, announce, correct, store, until the opener ends it; SessionError if it fails."""
        peer, parameters, proposal, cutter = await self._introduced()
        self._tested = parameters.chsh_fraction
        if bool(self._tested) is not self._tests:
            raise SessionError(Reason.UNSUPPORTED, f"chsh_fraction {self._tested} in this service")
        incoming, outgoing = pools(self._end, peer, self._end.means.keyring.host)
        session, draws = self._end.setup.session, self._end.draws
        bob = Bob(Terms(session, parameters, outgoing, incoming, draws.bytes))

        async def store() -> None:
            self._ids = await stored(self._end, peer, bob, opened=False)

        messages = KeyMessages(self._end, bob, store, cutter)
        try:
            await messages.hear_message(proposal)
            await self._serve(bob, messages)
        except BaseException as error:
            self._end.means.keyring.withdraw(peer, self._ids)
            if isinstance(error, SessionError):
                await tell_of_failure(self._end, self._progress, bob)
            raise
        finally:
            for _bases, light in self._coming:
                light.cancel()
        self._end.summary = summary(self._progress, bob, self._ids)

    async def _introduced(self) -> tuple[str, Parameters, bytes, Cutter]:
        """Return who opens, what it proposes, and the message that says so with its tag."""
        named = await self._end.channel.receive(Envelope, ANSWER_TIMEOUT_S)
        proposed = await self._end.channel.receive(Envelope, ANSWER_TIMEOUT_S)
        if (named.topic, proposed.topic) != (Topic.OPENER, Topic.KEYS):
            raise SessionError(Reason.PROTOCOL, "key distribution does not begin so")
        if len(named.content) > MAX_NAME_BYTES:
            raise SessionError(Reason.PROTOCOL, f"a name of {len(named.content)} bytes")
        cutter = Cutter()
        try:
            (data,) = cutter.feed(proposed.content)
            message = unframe(data).open()
            return named.content.decode(), proposed_by(message), data, cutter
        except ValueError as error:  # MalformedPacket and UnicodeDecodeError are such
            raise SessionError(Reason.PROTOCOL, f"no proposal of keys: {error}") from error

    async def _serve(self, bob: Bob, messages: KeyMessages) -> None:
        channel = self._end.channel
        while not isinstance(message := await channel.receive(Message, KEYS_TIMEOUT_S), Finish):
            if isinstance(message, Envelope):
                await messages.hear(message)
            elif not isinstance(message, Values) or bob.state is not State.SIFTING:
                what = (
                    f"{type(message).__name__} from {channel.peer} while {bob.state.name.lower()}"
                )
                raise SessionError(Reason.PROTOCOL, what)
            elif message.topic == Topic.COMING:
                self._get_ready(message)
            else:
                messages.say(bob.add_block(await self._measure(message)))
                await self._end.tell(**so_far(self._progress, bob))
            self._progress.note(bob.blocks_sifted)
        if bob.state is not State.DONE:
            raise SessionError(Reason.PROTOCOL, "the other end ended it before there was a key")

    def _get_ready(self, message: Values) -> None:
        """Begin to measure the block that comes next."""
        if len(self._coming) == MAX_COMING:
            raise SessionError(Reason.PROTOCOL, f"block {message.block} before others are over")
        end, number = self._end, self._announced
        most = min(end.setup.pairs, MAX_PHOTONS)
        (photons,) = expect(message, Topic.COMING, number, 1, most).tolist()
        if photons == 0:
            raise SessionError(Reason.PROTOCOL, f"block {number} has no photons")
        bases = with_tests(end.draws, random_bases(end, photons), self._tested)
        self._coming.append((bases, measuring(end, end.block(number, self._half), bases)))
        self._announced += 1
        end.agree()

    async def _measure(self, message: Values) -> Record:
        """Return what was measured of the block that is over."""
        expect(message, Topic.OVER, self._progress.blocks, 0, 0)
        if not self._coming:
            raise SessionError(Reason.PROTOCOL, f"the end of block {message.block}, not begun")
        bases, light = self._coming[0]
        outcomes = await measured(self._end, light, bases.size)
        self._coming.popleft()
        self._progress.blocks += 1
        self._progress.photons += bases.size
        return record_of(outcomes, bases, self._end.setup.rotation, self._tests)


def proposed_by(message: QkdMessage) -> Parameters:
    """Return the parameters that the opener proposes; ValueError for what cannot be."""
    if not isinstance(message, Proposal):
        raise ValueError(f"{type(message).__name__} before the proposal")
    bound, reconciliation = Bound(message.bound), Reconciliation(message.reconciliation)
    return Parameters(**{**vars(message), "bound": bound, "reconciliation": reconciliation})
