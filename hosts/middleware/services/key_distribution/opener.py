"""The end that asks for keys: sends light until enough is sifted, answers questions, stores."""

from collections.abc import Awaitable, Callable
from uuid import UUID

from hosts.middleware.qkd.alice import Alice
from hosts.middleware.qkd.decoy import Decoys
from hosts.middleware.qkd.end import State, Terms
from hosts.middleware.qkd.parameters import Parameters
from hosts.middleware.qkd.sifting import Record
from hosts.middleware.services.key_distribution.light import next_photons
from hosts.middleware.services.key_distribution.messages import KeyMessages
from hosts.middleware.services.key_distribution.options import KeyOptions
from hosts.middleware.services.key_distribution.session import pools, stored, tell_of_failure
from hosts.middleware.services.key_distribution.summary import Progress, so_far, summary
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.service import OpenerEnd
from wire.metadata import Envelope, Reason, Topic

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
        self._peer = end.arrangement.peer
        self._progress = Progress()
        outgoing, incoming = pools(end, end.means.keyring.host, self._peer)
        terms = Terms(end.setup.session, parameters, outgoing, incoming, end.draws.bytes)
        self._alice = Alice(terms, decoys)
        self._messages = KeyMessages(end, self._alice, self._store)
        self._sizes: list[int] = []  # of the blocks that were announced
        self._ids: list[UUID] = []

    async def run(self) -> None:
        """Send light, distil, store; SessionError if there is no key."""
        end = self._end
        end.channel.send(Envelope(end.setup.session, Topic.OPENER, end.means.keyring.host.encode()))
        try:
            self._messages.say(self._alice.start())
            await self._gather()
            self._messages.say(self._alice.distil())
            await self._messages.until(lambda: self._alice.state is State.DONE)
        except SessionError as error:
            self._messages.give_up(str(error))
            await tell_of_failure(end, self._progress, self._alice)
            raise
        end.summary = summary(self._progress, self._alice, self._ids)

    async def _store(self) -> None:
        self._ids = await stored(self._end, self._peer, self._alice, opened=True)

    async def _gather(self) -> None:
        """Send blocks until enough is sifted; a block is sifted while the next one flies."""
        dark, coming = 0, self._announce()
        while coming is not None:
            before = self._alice.sifted_bits
            following = self._announce()
            await self._send(coming)
            dark = 0 if self._alice.sifted_bits > before else dark + 1
            if dark > DARK_BLOCKS:  # the newest may not be sifted yet
                raise SessionError(
                    Reason.NO_LIGHT,
                    f"no key: of {DARK_BLOCKS} blocks in a row no photon was measured by both "
                    "ends: is a fibre cut, or its loss too high?",
                )
            await self._end.tell(**so_far(self._progress, self._alice))
            if following is None:
                await self._sifted(len(self._sizes))
                following = self._announce()
            coming = following

    def _announce(self) -> int | None:
        """Let the other end get ready for one more block; None if there may be enough."""
        alice, sizes = self._alice, self._sizes
        seen = sum(sizes[: alice.blocks_sifted])
        on_the_way = sum(sizes) - seen
        count, most = self._options.count, self._end.setup.pairs
        size = next_photons(count, alice.sifted_bits, seen, on_the_way, most)
        if size == 0:
            return None
        number = len(sizes)
        sizes.append(size)
        self._end.say(Topic.COMING, number, [size], 32)
        return number

    async def _send(self, number: int) -> None:
        """Send a block that was announced, and wait until the one before it is sifted."""
        end, photons = self._end, self._sizes[number]
        await self._messages.answered()
        record = await self._light(end, number, photons)
        end.say(Topic.OVER, number, [], 1)
        self._progress.photons += photons
        self._messages.say(self._alice.add_block(record))
        await self._sifted(number)

    async def _sifted(self, blocks: int) -> None:
        """Wait until so many blocks are sifted."""
        await self._messages.until(lambda: self._alice.blocks_sifted >= blocks)
        self._progress.note(self._alice.blocks_sifted)
