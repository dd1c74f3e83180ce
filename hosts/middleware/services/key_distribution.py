"""What the protocols of key distribution share: from blocks of light to keys in both stores.

    opener (alice of hosts.middleware.qkd)                     acceptor (bob)
      | Envelope(OPENER), Envelope(KEYS: Proposal) -------------> |
      | Values(COMING) -----------------------------------------> |  gets ready to measure
      | <-------------------------------------------- Answer(OK)  |
      |   light, as the protocol makes it                         |
      | Values(OVER) -------------------------------------------> |
      | <----------------------------- Envelope(KEYS: Detections) |
      | Envelope(KEYS: Sifted) ---------------------------------> |  while the next block comes
      |   ... blocks ..., then error correction by envelopes      |
      | Finish: the opener holds the key in its store ----------> |

The acceptor stores its keys before it confirms them, and withdraws them if the session does
not end well; so the opener stores only what the acceptor has.
"""

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from uuid import UUID

from hosts.hardware.qnic import Symbols
from hosts.middleware.channel import ANSWER_TIMEOUT_S, SessionError
from hosts.middleware.qkd.alice import Alice
from hosts.middleware.qkd.authentication import KeyPool
from hosts.middleware.qkd.bob import Bob
from hosts.middleware.qkd.end import State, Terms
from hosts.middleware.qkd.key_store import KeyStoreError
from hosts.middleware.qkd.keyring import NothingShared
from hosts.middleware.qkd.parameters import Parameters
from hosts.middleware.qkd.sifting import Record
from hosts.middleware.services.key_light import (
    measured,
    measuring,
    next_photons,
    random_bases,
    turned_back,
)
from hosts.middleware.services.key_messages import SILENCE_S, Cutter, KeyMessages
from hosts.middleware.services.key_options import KeyOptions
from hosts.middleware.services.key_summary import Progress, so_far, summary
from hosts.middleware.services.service import AcceptorEnd, End, OpenerEnd
from hosts.middleware.values import expect
from wire.metadata import Envelope, Finish, Message, Reason, Topic, Values
from wire.qkd import Bound, Proposal, QkdMessage, Reconciliation, unframe

DARK_BLOCKS = 5  # in a row without a sifted bit: the light does not arrive
MAX_NAME_BYTES = 64

Light = Callable[[OpenerEnd, int, int], Awaitable[Record]]  # of a block: number, photons


class OpenerOfKeys:
    """The end that asked for keys; `light` makes a block and tells what this end knows of it."""

    def __init__(self, end: OpenerEnd, options: KeyOptions, light: Light) -> None:
        self._end, self._options, self._light = end, options, light
        self._peer = end.arrangement.peer
        self._progress = Progress()
        outgoing, incoming = pools(end, end.keyring.host, self._peer)
        terms = Terms(end.setup.session, options.parameters(), outgoing, incoming, end.draws.bytes)
        self._alice = Alice(terms)
        self._messages = KeyMessages(end, self._alice, self._store)
        self._ids: list[UUID] = []

    async def run(self) -> None:
        """Send light, distil, store; SessionError if there is no key."""
        end = self._end
        end.channel.send(Envelope(end.setup.session, Topic.OPENER, end.keyring.host.encode()))
        try:
            self._messages.say(self._alice.start())
            await self._gather()
            self._messages.say(self._alice.distil())
            await self._messages.until(lambda: self._alice.state is State.DONE)
        except SessionError:
            await _tell_of_failure(end, self._progress, self._alice)
            raise
        end.summary = summary(self._progress, self._alice, self._ids)

    async def _store(self) -> None:
        self._ids = await stored(self._end, self._peer, self._alice, opened=True)

    async def _gather(self) -> None:
        """Send blocks until enough is sifted; a block is sifted while the next one flies."""
        alice, count = self._alice, self._options.count
        sizes: list[int] = []
        dark = 0
        while (before := alice.sifted_bits) < count:
            seen = sum(sizes[: alice.blocks_sifted])
            on_the_way = sum(sizes) - seen
            size = next_photons(count, before, seen, on_the_way, self._end.setup.pairs)
            if size:
                await self._block(len(sizes), size)
                sizes.append(size)
            await self._sifted(len(sizes) - bool(size))
            dark = 0 if alice.sifted_bits > before else dark + 1
            if dark > DARK_BLOCKS:
                raise SessionError(
                    Reason.NO_LIGHT,
                    f"no key: of the last {dark} blocks no photon was measured by both ends: is a "
                    "fibre cut, or its loss too high?",
                )
            await self._end.tell(**so_far(self._progress, alice))
        await self._sifted(len(sizes))

    async def _sifted(self, blocks: int) -> None:
        """Wait until so many blocks are sifted."""
        await self._messages.until(lambda: self._alice.blocks_sifted >= blocks)
        self._progress.note(self._alice.blocks_sifted)

    async def _block(self, number: int, photons: int) -> None:
        end = self._end
        end.say(Topic.COMING, number, [photons], 32)
        await self._messages.answered()
        record = await self._light(end, number, photons)
        end.say(Topic.OVER, number, [], 1)
        self._progress.photons += photons
        self._messages.say(self._alice.add_block(record))


class AcceptorOfKeys:
    """The end that was asked for keys; it measures one half of each block."""

    def __init__(self, end: AcceptorEnd, half: int) -> None:
        self._end, self._half = end, half
        self._progress = Progress()
        self._coming: tuple[Symbols, asyncio.Task[Symbols]] | None = None  # bases, and light
        self._ids: list[UUID] = []  # of the keys in the store

    async def run(self) -> None:
        """Measure, announce, correct, store, until the opener ends it; SessionError if it fails."""
        peer, parameters, proposal, cutter = await self._introduced()
        incoming, outgoing = pools(self._end, peer, self._end.keyring.host)
        session, draws = self._end.setup.session, self._end.draws
        bob = Bob(Terms(session, parameters, outgoing, incoming, draws.bytes))

        async def store() -> None:
            self._ids = await stored(self._end, peer, bob, opened=False)

        messages = KeyMessages(self._end, bob, store, cutter)
        try:
            await messages.hear_message(proposal)
            await self._serve(bob, messages)
        except BaseException as error:
            await asyncio.to_thread(self._end.keyring.withdraw, peer, self._ids)
            if isinstance(error, SessionError):
                await _tell_of_failure(self._end, self._progress, bob)
            raise
        finally:
            if self._coming is not None:
                self._coming[1].cancel()
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
        while not isinstance(
            message := await self._end.channel.receive(Message, SILENCE_S), Finish
        ):
            if isinstance(message, Envelope):
                await messages.hear(message)
            elif isinstance(message, Values) and message.topic == Topic.COMING:
                self._get_ready(message)
            elif isinstance(message, Values):
                messages.say(bob.add_block(await self._measure(message)))
                await self._end.tell(**so_far(self._progress, bob))
            else:
                text = f"{type(message).__name__} from {self._end.channel.peer} in mid-session"
                raise SessionError(Reason.PROTOCOL, text)
            self._progress.note(bob.blocks_sifted)
        if bob.state is not State.DONE:
            raise SessionError(Reason.PROTOCOL, "the other end ended it before there was a key")

    def _get_ready(self, message: Values) -> None:
        """Begin to measure the block that comes next."""
        if self._coming is not None:
            raise SessionError(Reason.PROTOCOL, f"block {message.block} before the last is over")
        end, number = self._end, self._progress.blocks
        (photons,) = expect(message, Topic.COMING, number, 1, end.setup.pairs).tolist()
        if photons == 0:
            raise SessionError(Reason.PROTOCOL, f"block {number} has no photons")
        bases = random_bases(end, photons)
        self._coming = bases, measuring(end, end.block(number, self._half), bases)
        end.agree()

    async def _measure(self, message: Values) -> Record:
        """Return what was measured of the block that is over."""
        expect(message, Topic.OVER, self._progress.blocks, 0, 0)
        if self._coming is None:
            raise SessionError(Reason.PROTOCOL, f"the end of block {message.block}, not begun")
        bases, light = self._coming
        outcomes = await measured(self._end, light, bases.size)
        self._coming = None
        self._progress.blocks += 1
        self._progress.photons += bases.size
        return Record(bases, turned_back(outcomes, bases, self._end.setup.rotation))


def pools(end: End, opener: str, acceptor: str) -> tuple[KeyPool, KeyPool]:
    """Return the authentication keys of the session: of what the opener says, the acceptor.

    Raise SessionError if the hosts share none, or if the keys could not be stored here.
    """
    keyring = end.keyring
    try:
        keyring.store(acceptor if opener == keyring.host else opener)
        return keyring.pools(opener, acceptor, end.setup.session)
    except (NothingShared, KeyStoreError) as error:
        raise SessionError(Reason.NOT_ALLOWED, f"no key: {error}") from error


async def stored(end: End, peer: str, keys: Alice | Bob, *, opened: bool) -> list[UUID]:
    """Keep the key that has been made; SessionError if the store does not take it."""
    assert keys.key is not None
    session, keyring = end.setup.session, end.keyring
    try:
        return await asyncio.to_thread(keyring.keep, peer, session, keys.key, opened=opened)
    except KeyStoreError as error:
        raise SessionError(Reason.BUSY, f"no key: {keyring.host}: {error}") from error


def proposed_by(message: QkdMessage) -> Parameters:
    """Return the parameters that the opener proposes; ValueError for what cannot be."""
    if not isinstance(message, Proposal):
        raise ValueError(f"{type(message).__name__} before the proposal")
    bound, reconciliation = Bound(message.bound), Reconciliation(message.reconciliation)
    return Parameters(**{**vars(message), "bound": bound, "reconciliation": reconciliation})


async def _tell_of_failure(end: End, progress: Progress, keys: Alice | Bob) -> None:
    """Tell the application what was measured, if the error rate was; it may be gone."""
    if keys.estimate is not None:
        with suppress(SessionError, ConnectionError):
            await end.tell(**summary(progress, keys, []))
