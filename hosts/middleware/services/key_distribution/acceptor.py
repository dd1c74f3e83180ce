"""The end that is asked for keys: measures, announces, corrects its errors, stores."""

import asyncio
from collections import deque
from dataclasses import dataclass
from uuid import UUID

from hosts.hardware.qnic import Symbols
from hosts.middleware.qkd.alice import Alice
from hosts.middleware.qkd.bob import Bob
from hosts.middleware.qkd.end import State, Terms
from hosts.middleware.qkd.parameters import Parameters
from hosts.middleware.services.key_distribution.light import (
    measured,
    measuring,
    random_bases,
    record_of,
    with_tests,
)
from hosts.middleware.services.key_distribution.messages import Cutter
from hosts.middleware.services.key_distribution.session import (
    number_of,
    pools,
    stored,
    tell_of_failure,
)
from hosts.middleware.services.key_distribution.summary import Progress, so_far, summary
from hosts.middleware.services.key_distribution.under_way import (
    MAX_UNDER_WAY,
    KeysUnderWay,
    together,
)
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.service import AcceptorEnd
from hosts.middleware.session.values import expect
from hosts.timeouts import ANSWER_TIMEOUT_S, KEYS_TIMEOUT_S
from wire.metadata import Envelope, Finish, Message, Reason, Topic, Values
from wire.qkd import MAX_PHOTONS, Bound, Proposal, QkdMessage, Reconciliation, unframe

MAX_NAME_BYTES = 64
MAX_COMING = 3  # blocks: one is measured, one is made, and one announced


@dataclass
class Coming:
    """A block of light that is announced, for a key."""

    key: int
    bases: Symbols
    light: asyncio.Task[Symbols]


class AcceptorOfKeys:
    """The end that was asked for keys; it measures one half of each block."""

    def __init__(self, end: AcceptorEnd, half: int, *, tests: bool = False) -> None:
        """Measure this half; tests: some photons for a CHSH test."""
        self._end, self._half, self._tests = end, half, tests
        self._peer, self._parameters = "", Parameters()
        self._progress = Progress()
        self._begun = self._announced = self._overs = 0  # keys; blocks; of them that are over
        self._coming: deque[Coming] = deque()
        self._over: asyncio.Queue[int] = asyncio.Queue()  # blocks
        self._not_kept: dict[int, list[UUID]] = {}  # by the opener yet: keys in the store here

    async def run(self) -> None:
        """Measure, announce, correct, store, until the opener ends it; SessionError if it fails."""
        proposal, cutter = await self._introduced()
        try:
            async with together() as tasks:
                self._keys = KeysUnderWay(self._end, tasks, self._progress, self._store, cutter)
                self._keys.hear_message(proposal, self._begin)
                measuring_all = tasks.create_task(self._measure_all())
                await self._serve()
                measuring_all.cancel()
        except BaseException as error:
            for ids in self._not_kept.values():
                self._end.means.keyring.withdraw(self._peer, ids)
            if isinstance(error, SessionError):
                self._keys.give_up(str(error))
                await tell_of_failure(self._end, self._progress, self._keys.ends)
            raise
        finally:
            for coming in self._coming:
                coming.light.cancel()
        self._end.summary = summary(self._progress)

    async def _introduced(self) -> tuple[bytes, Cutter]:
        """Hear who opens, and its first proposal; return that with its tag."""
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
            self._peer, self._parameters = named.content.decode(), proposed_by(message)
        except ValueError as error:  # MalformedPacket and UnicodeDecodeError are such
            raise SessionError(Reason.PROTOCOL, f"no proposal of keys: {error}") from error
        if bool(self._parameters.chsh_fraction) is not self._tests:
            text = f"chsh_fraction {self._parameters.chsh_fraction} in this service"
            raise SessionError(Reason.UNSUPPORTED, text)
        return data, cutter

    def _begin(self, key: int) -> None:
        """Take part in the next key."""
        if key != self._begun or len(self._keys.numbers) > MAX_UNDER_WAY:
            raise SessionError(Reason.PROTOCOL, f"a message about key {key}, not {self._begun}")
        incoming, outgoing = pools(self._end, self._peer, self._end.means.keyring.host, key)
        name, draws = number_of(self._end, key), self._end.draws.spawn(1)[0].bytes
        self._keys.begin(key, Bob(Terms(name, self._parameters, outgoing, incoming, draws)))
        self._begun += 1

    async def _store(self, key: int, bob: Alice | Bob) -> None:
        self._not_kept[key] = await stored(self._end, self._peer, key, bob, opened=False)

    async def _serve(self) -> None:
        channel = self._end.channel
        while not isinstance(message := await channel.receive(Message, KEYS_TIMEOUT_S), Finish):
            match message:
                case Envelope():
                    self._keys.hear(message, self._begin)
                case Values(topic=Topic.COMING):
                    self._get_ready(message)
                case Values(topic=Topic.OVER) if self._overs < self._announced:
                    expect(message, Topic.OVER, self._overs, 0, 0)
                    self._over.put_nowait(self._overs)
                    self._overs += 1
                case Values(topic=Topic.KEPT) if message.block in self._not_kept:
                    self._kept(message.block)
                case _:
                    what = f"{type(message).__name__} from {channel.peer} out of its turn"
                    raise SessionError(Reason.PROTOCOL, what)
        if self._keys.numbers or not self._progress.ids:
            raise SessionError(Reason.PROTOCOL, "the other end ended it before there was a key")

    def _kept(self, key: int) -> None:
        """Count a key that both ends have."""
        bob = self._keys.end_of(key)
        self._progress.ids += self._not_kept.pop(key)
        self._progress.made.add(bob)
        self._keys.forget(key)

    def _get_ready(self, message: Values) -> None:
        """Begin to measure the block that comes next, for the newest key."""
        if len(self._coming) == MAX_COMING:
            raise SessionError(Reason.PROTOCOL, f"block {message.block} before others are over")
        end, number = self._end, self._announced
        most = min(end.setup.pairs, MAX_PHOTONS)
        (photons,) = expect(message, Topic.COMING, number, 1, most).tolist()
        if photons == 0:
            raise SessionError(Reason.PROTOCOL, f"block {number} has no photons")
        bases = with_tests(end.draws, random_bases(end, photons), self._parameters.chsh_fraction)
        light = measuring(end, end.block(number, self._half), bases)
        self._coming.append(Coming(self._begun - 1, bases, light))
        self._announced += 1
        end.agree()

    async def _measure_all(self) -> None:
        """Announce what was measured of each block that is over."""
        while True:
            await self._over.get()
            coming = self._coming[0]
            outcomes = await measured(self._end, coming.light, coming.bases.size)
            self._coming.popleft()
            self._progress.blocks += 1
            self._progress.photons += coming.bases.size
            rotation = self._end.setup.rotation
            record = record_of(outcomes, coming.bases, rotation, self._tests)
            bob = self._keys.end_of(coming.key)
            if not isinstance(bob, Bob) or bob.state not in (State.OPENING, State.SIFTING):
                raise SessionError(Reason.PROTOCOL, f"light for key {coming.key}, sifted already")
            await self._keys.step(coming.key, bob.add_block, record)
            await self._end.tell(**so_far(self._progress, self._keys.ends))


def proposed_by(message: QkdMessage) -> Parameters:
    """Return the parameters that the opener proposes; ValueError for what cannot be."""
    if not isinstance(message, Proposal):
        raise ValueError(f"{type(message).__name__} before the proposal")
    bound, reconciliation = Bound(message.bound), Reconciliation(message.reconciliation)
    return Parameters(**{**vars(message), "bound": bound, "reconciliation": reconciliation})
