"""The protocol of the end that asks for keys: no socket, no clock.

It has light sent until enough is sifted, answers questions, and has its key stored.
"""

from collections.abc import Awaitable, Callable

from hosts.middleware.qkd.alice import Alice
from hosts.middleware.qkd.end import State
from hosts.middleware.qkd.sifting import Record
from hosts.middleware.services.key_distribution.light import next_photons
from hosts.middleware.services.key_distribution.messages import KeyMessages
from hosts.middleware.services.key_distribution.summary import Progress, so_far
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.protocol import Now, OpenerSide, Say, Steps, Tell
from wire.metadata import Envelope, Reason, Topic

DARK_BLOCKS = 3  # in a row without a sifted bit: the light does not arrive

Light = Callable[[OpenerSide, int, int], Steps[Record]]  # of a block: number, photons


class OpenerOfKeys:
    """The end that asked for keys; `light` makes a block and tells what this end knows of it."""

    def __init__(
        self,
        side: OpenerSide,
        count: int,
        light: Light,
        alice: Alice,
        progress: Progress,
        store: Callable[[], Awaitable[None]],
    ) -> None:
        """Make a key of so many sifted bits of this light; store it before the end is told."""
        self._side, self._count, self._light = side, count, light
        self._alice, self._progress = alice, progress
        self._messages = KeyMessages(side, alice, store)
        self._sizes: list[int] = []  # of the blocks that were announced

    def run(self) -> Steps[None]:
        """Send light, and distil; SessionError if there is no key."""
        side, alice = self._side, self._alice
        yield Say((Envelope(side.setup.session, Topic.OPENER, side.host.encode()),))
        try:
            yield from self._messages.say(alice.start())
            yield from self._gather()
            yield from self._messages.say(alice.distil())
            yield from self._messages.until(lambda: alice.state is State.DONE)
        except SessionError as error:
            yield self._messages.give_up(str(error))
            raise

    def _gather(self) -> Steps[None]:
        """Send blocks until enough is sifted; a block is sifted while the next one flies."""
        dark, coming = 0, (yield from self._announce())
        while coming is not None:
            before = self._alice.sifted_bits
            following = yield from self._announce()
            yield from self._send(coming)
            dark = 0 if self._alice.sifted_bits > before else dark + 1
            if dark > DARK_BLOCKS:  # the newest may not be sifted yet
                raise SessionError(
                    Reason.NO_LIGHT,
                    f"no key: of {DARK_BLOCKS} blocks in a row no photon was measured by both "
                    "ends: is a fibre cut, or its loss too high?",
                )
            yield Tell(so_far(self._progress, self._alice), at_the_end=False)
            if following is None:
                yield from self._sifted(len(self._sizes))
                following = yield from self._announce()
            coming = following

    def _announce(self) -> Steps[int | None]:
        """Let the other end get ready for one more block; None if there may be enough."""
        alice, sizes = self._alice, self._sizes
        seen = sum(sizes[: alice.blocks_sifted])
        on_the_way = sum(sizes) - seen
        most = self._side.setup.pairs
        size = next_photons(self._count, alice.sifted_bits, seen, on_the_way, most)
        if size == 0:
            return None
        number = len(sizes)
        sizes.append(size)
        yield self._side.say(Topic.COMING, number, [size], 32)
        return number

    def _send(self, number: int) -> Steps[None]:
        """Send a block that was announced, and wait until the one before it is sifted."""
        side, photons = self._side, self._sizes[number]
        yield from self._messages.answered()
        record = yield from self._light(side, number, photons)
        yield side.say(Topic.OVER, number, [], 1)
        self._progress.photons += photons
        yield from self._messages.say(self._alice.add_block(record))
        yield from self._sifted(number)

    def _sifted(self, blocks: int) -> Steps[None]:
        """Wait until so many blocks are sifted."""
        yield from self._messages.until(lambda: self._alice.blocks_sifted >= blocks)
        self._progress.note(self._alice.blocks_sifted, (yield Now()))
