"""The protocol of the end that asks for keys: no socket, no clock.

It has light sent until enough is sifted, answers questions, and has its keys stored.
"""

from collections.abc import Callable
from functools import partial

from applications.key_distribution.light import next_photons
from applications.key_distribution.options import KeyOptions
from applications.key_distribution.summary import Progress, so_far
from applications.key_distribution.under_way import MAX_UNDER_WAY, KeysUnderWay, Store
from applications.qkd.alice import Alice
from applications.qkd.bob import Bob
from applications.qkd.sifting import Known
from applications.timeouts import KEYS_TIMEOUT_S
from hosts.middleware.session.errors import SessionError, unexpected
from hosts.middleware.session.protocol import (
    Concurrently,
    Hear,
    Now,
    OpenerSide,
    Say,
    Steps,
    Tell,
    Wait,
    WaitUntil,
)
from wire.metadata.header import Message
from wire.metadata.setup import Answer
from wire.metadata.values import Envelope, Topic
from wire.metadata.vocabulary import Reason

DARK_BLOCKS = 3  # in a row without a sifted bit: the light does not arrive

Light = Callable[[OpenerSide, int, int], Steps[Known]]  # of a block: number, photons


class OpenerOfKeys:
    """The end that asked for keys; `light` makes a block and tells what this end knows of it."""

    def __init__(
        self,
        side: OpenerSide,
        options: KeyOptions,
        light: Light,
        new_key: Callable[[int], Alice],  # this end of a key, by its number in the session
        progress: Progress,
        store: Store,
    ) -> None:
        self._side, self._options, self._light = side, options, light
        self._new_key, self._progress, self._store = new_key, progress, store
        self.keys = KeysUnderWay(side, progress, self._done)
        self._answers = 0  # that nobody has waited for
        self._blocks = self._dark = 0  # announced; in a row without a sifted bit

    def run(self) -> Steps[None]:
        """Send light, and distil; SessionError if there is no key."""
        yield Say((Envelope(self._side.setup.session, Topic.OPENER, self._side.host.encode()),))
        yield Concurrently(self._read())
        yield from self._make_all()

    def _read(self) -> Steps[None]:
        """Take messages; none may be so late."""
        while True:
            match (yield Hear(Message, KEYS_TIMEOUT_S)):
                case Envelope() as envelope:
                    yield from self.keys.hear(envelope)
                case Answer(reason=Reason.OK):
                    self._answers += 1
                case message:
                    raise unexpected(message, self._side.peer)

    def _make_all(self) -> Steps[None]:
        """Make as many keys as are wanted; light for one comes while others are distilled."""
        number, so_much = 0, 0
        while share := self._next_share(number, so_much, (yield Now())):
            yield WaitUntil(lambda: len(self.keys.numbers) < MAX_UNDER_WAY)
            alice = self._new_key(number)
            yield from self.keys.begin(number, alice)
            yield from self.keys.step(number, alice.start)
            yield from self._gather(number, alice, share)
            number, so_much = number + 1, so_much + alice.sifted_bits
            yield Concurrently(self.keys.step(number - 1, alice.distil))
        yield WaitUntil(lambda: not self.keys.numbers)

    def _next_share(self, number: int, so_much: int, now_s: float) -> int:
        """Return how much to sift for the key of this number; 0: no more are wanted."""
        options = self._options
        if options.seconds:
            in_time = now_s - self._progress.started_s < options.seconds
            return options.sifted_per_key if in_time else 0
        left = -(-options.count // options.sifted_per_key) - number
        return -(-max(1, options.count - so_much) // left) if left else 0

    def _done(self, number: int, alice: Alice | Bob) -> Steps[None]:
        self._progress.stored((yield Wait(partial(self._store, number, alice))))
        self._progress.made.add(alice)
        self.keys.forget(number)
        yield self._side.say(Topic.KEPT, number, [], 1)
        yield from self._report()

    def _report(self) -> Steps[None]:
        report = so_far(self._progress, self.keys.ends, (yield Now()))
        yield Tell(report, at_the_end=False)

    def _gather(self, key: int, alice: Alice, count: int) -> Steps[None]:
        """Send blocks until so much is sifted; a block is sifted while the next one flies."""
        sizes, before = list[int](), 0
        coming = yield from self._announce(alice, count, sizes)
        while coming:
            following = yield from self._announce(alice, count, sizes)
            yield from self._send(key, alice, coming)
            earlier = len(sizes) - (2 if following else 1)
            yield WaitUntil(partial(sifted, alice, earlier))
            self._look_for_light(alice.sifted_bits > before)
            before = alice.sifted_bits
            yield from self._report()
            if not following:
                yield WaitUntil(partial(sifted, alice, len(sizes)))
                following = yield from self._announce(alice, count, sizes)
            coming = following

    def _look_for_light(self, sifted: bool) -> None:
        self._dark = 0 if sifted else self._dark + 1
        if self._dark > DARK_BLOCKS:  # the newest may not be sifted yet
            raise SessionError(
                Reason.NO_LIGHT,
                f"no key: of {DARK_BLOCKS} blocks in a row no photon was measured by both "
                "ends: is a fibre cut, or its loss too high?",
            )

    def _announce(self, alice: Alice, count: int, sizes: list[int]) -> Steps[int]:
        """Let the other end get ready for one more block; 0 if there may be enough."""
        seen = sum(sizes[: alice.blocks_sifted])
        most = self._side.setup.pairs
        size = next_photons(count, alice.sifted_bits, seen, sum(sizes) - seen, most)
        if size:
            sizes.append(size)
            yield self._side.say(Topic.COMING, self._blocks, [size], 32)
            self._blocks += 1
        return size

    def _send(self, key: int, alice: Alice, photons: int) -> Steps[None]:
        side, number = self._side, self._progress.blocks
        yield WaitUntil(lambda: self._answers > 0)
        self._answers -= 1
        record = yield from self._light(side, number, photons)
        yield side.say(Topic.OVER, number, [], 1)
        self._progress.blocks += 1
        self._progress.photons += photons
        yield from self.keys.step(key, alice.add_block, record)


def sifted(alice: Alice, blocks: int) -> bool:
    return alice.blocks_sifted >= blocks
