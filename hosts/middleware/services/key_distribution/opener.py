"""The end that asks for keys: sends light until enough is sifted, answers questions, stores."""

import asyncio
from collections.abc import Awaitable, Callable

from hosts.middleware.qkd.alice import Alice
from hosts.middleware.qkd.bob import Bob
from hosts.middleware.qkd.decoy import Decoys
from hosts.middleware.qkd.end import Terms
from hosts.middleware.qkd.parameters import Parameters
from hosts.middleware.qkd.sifting import Record
from hosts.middleware.services.key_distribution.light import next_photons
from hosts.middleware.services.key_distribution.options import KeyOptions
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
from hosts.middleware.session.errors import SessionError, unexpected
from hosts.middleware.session.service import OpenerEnd
from hosts.timeouts import KEYS_TIMEOUT_S
from wire.metadata import Answer, Envelope, Message, Reason, Topic

DARK_BLOCKS = 3  # in a row without a sifted bit: the light does not arrive

Light = Callable[[OpenerEnd, int, int], Awaitable[Record]]  # of a block: number, photons


class OpenerOfKeys:
    """The end that asked for keys; `light` makes a block and tells what this end knows of it."""

    def __init__(
        self,
        end: OpenerEnd,
        options: KeyOptions,
        light: Light,
        parameters: Parameters,
        decoys: Decoys | None = None,
    ) -> None:
        """Make keys of this light, by these parameters, or whose pulses are decoys."""
        self._end, self._options, self._light = end, options, light
        self._parameters, self._decoys = parameters, decoys
        self._host, self._peer = end.means.keyring.host, end.arrangement.peer
        self._progress = Progress()
        self._answers = 0  # that nobody has waited for
        self._blocks = self._dark = 0  # blocks announced; in a row without a sifted bit

    async def run(self) -> None:
        """Send light, distil, store; SessionError if there is no key."""
        end = self._end
        end.channel.send(Envelope(end.setup.session, Topic.OPENER, self._host.encode()))
        try:
            async with together() as tasks:
                self._keys = KeysUnderWay(end, tasks, self._progress, self._done)
                reading = tasks.create_task(self._read())
                await self._make_all(tasks)
                reading.cancel()
        except SessionError as error:
            self._keys.give_up(str(error))
            await tell_of_failure(end, self._progress, self._keys.ends)
            raise
        end.summary = summary(self._progress)

    async def _read(self) -> None:
        """Take messages; none may be so late."""
        while True:
            match await self._end.channel.receive(Message, KEYS_TIMEOUT_S):
                case Envelope() as envelope:
                    self._keys.hear(envelope)
                case Answer(reason=Reason.OK):
                    self._answers += 1
                    self._keys.wake()
                case message:
                    raise unexpected(message, self._end.channel.peer)

    async def _make_all(self, tasks: asyncio.TaskGroup) -> None:
        """Make as many keys as are wanted; light for one comes while others are distilled."""
        keys, sifted = -(-self._options.count // self._options.sifted_per_key), 0
        for number in range(keys):
            await self._keys.until(lambda: len(self._keys.numbers) < MAX_UNDER_WAY)
            outgoing, incoming = pools(self._end, self._host, self._peer, number)
            draws = self._end.draws.spawn(1)[0].bytes
            name = number_of(self._end, number)
            alice = Alice(Terms(name, self._parameters, outgoing, incoming, draws), self._decoys)
            self._keys.begin(number, alice)
            await self._keys.step(number, alice.start)
            left = max(1, self._options.count - sifted)
            await self._gather(number, alice, -(-left // (keys - number)))
            sifted += alice.sifted_bits
            tasks.create_task(self._keys.step(number, alice.distil))
        await self._keys.until(lambda: not self._keys.numbers)

    async def _done(self, number: int, alice: Alice | Bob) -> None:
        """Store a key that the other end has stored, and say so."""
        ids = await stored(self._end, self._peer, number, alice, opened=True)
        self._progress.ids += ids
        self._progress.made.add(alice)
        self._end.say(Topic.KEPT, number, [], 1)
        self._keys.forget(number)

    async def _gather(self, key: int, alice: Alice, count: int) -> None:
        """Send blocks until so much is sifted; a block is sifted while the next one flies."""
        sizes: list[int] = []
        coming = self._announce(alice, count, sizes)
        while coming:
            before = alice.sifted_bits
            following = self._announce(alice, count, sizes)
            await self._send(key, alice, coming, len(sizes) - (2 if following else 1))
            self._look_for_light(alice.sifted_bits > before)
            await self._end.tell(**so_far(self._progress, self._keys.ends))
            if not following:
                await self._keys.until(lambda: alice.blocks_sifted >= len(sizes))
                following = self._announce(alice, count, sizes)
            coming = following

    def _look_for_light(self, sifted: bool) -> None:
        self._dark = 0 if sifted else self._dark + 1
        if self._dark > DARK_BLOCKS:  # the newest may not be sifted yet
            raise SessionError(
                Reason.NO_LIGHT,
                f"no key: of {DARK_BLOCKS} blocks in a row no photon was measured by both "
                "ends: is a fibre cut, or its loss too high?",
            )

    def _announce(self, alice: Alice, count: int, sizes: list[int]) -> int:
        """Let the other end get ready for one more block; 0 if there may be enough."""
        seen = sum(sizes[: alice.blocks_sifted])
        most = self._end.setup.pairs
        size = next_photons(count, alice.sifted_bits, seen, sum(sizes) - seen, most)
        if size:
            sizes.append(size)
            self._end.say(Topic.COMING, self._blocks, [size], 32)
            self._blocks += 1
        return size

    async def _send(self, key: int, alice: Alice, photons: int, before: int) -> None:
        """Send a block that was announced; so many blocks of the key come before it.

        Return when those are sifted.
        """
        end, number = self._end, self._progress.blocks
        await self._keys.until(lambda: self._answers > 0)
        self._answers -= 1
        record = await self._light(end, number, photons)
        end.say(Topic.OVER, number, [], 1)
        self._progress.blocks += 1
        self._progress.photons += photons
        await self._keys.step(key, alice.add_block, record)
        await self._keys.until(lambda: alice.blocks_sifted >= before)
