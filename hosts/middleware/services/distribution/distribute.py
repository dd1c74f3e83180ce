"""Entanglement distribution: pairs in the memories of both ends, of the fidelity asked for.

    alice                       charlie                    bob
      | <-- light, half 0 --------- | -- light, half 1 ----> |  into memory, block by block
      | Values(ARRIVED) <----------------------------------> |  both keep what both have
      | Values(PURIFY), then OUTCOMES <--------------------> |  as often as it takes
      | Values(SAMPLE), BASES, then OUTCOMES <-------------> |  sacrificed for the estimate
      | Values(ARRIVED) <----------------------------------> |  what the cut-off has left of a block
      | Values(DELIVER) -----------------------------------> |  pairs have numbers: 0, 1, 2, …

Where both hosts have memories that emit, pairs are heralded instead (heralded.py). They stay in
memory until the opener's application ends the session; meanwhile the application at either end may
ask to measure some (Pairs.answer). They are called by session and number.
"""

from collections.abc import Awaitable, Callable
from functools import partial
from math import ceil, inf

import numpy as np

from hosts.middleware.services.distribution.distribute_options import MAX_ROUNDS
from hosts.middleware.services.distribution.distribute_options import (
    DistributeOptions as DistributeOptions,
)
from hosts.middleware.services.distribution.heralded import by_station, share_heralded
from hosts.middleware.services.distribution.pairs import Pairs
from hosts.middleware.services.distribution.purification import PHOTONS, Protocol
from hosts.middleware.session import abilities
from hosts.middleware.session.blocks import store
from hosts.middleware.session.channel import SessionError
from hosts.middleware.session.lifetimes import NUMBERS, Lifetimes
from hosts.middleware.session.service import AcceptorEnd, Answerer, OpenerEnd, ServiceKind
from hosts.middleware.session.values import expect, values
from hosts.timeouts import MAX_BLOCK_S
from wire.features import GATE, MEASURE
from wire.metadata import MemoryState, Reason, Service, Topic, Values

MAX_NUMBER = (1 << 32) - 1
LEAST_SAMPLE = 30  # pairs; of which a fidelity is told
LEAST_JUDGED = 300  # pairs; by which it is decided whether the fidelity wanted is reached
MOST_EMITTED = 1_000_000  # pairs, and so many more for each that is wanted:
MOST_EMITTED_EACH = 1000
MOST_DROPPED, MOST_DROPPED_EACH = 100, 10  # pairs, for their age
MOST_DARK = 10  # blocks in a row of which nothing arrives
MARGIN = 1.05  # of light beyond what is expected to be needed

Make = Callable[[Pairs, int, int], Awaitable[None]]  # a block, by its number and size
Share = Callable[[Pairs, Values], Awaitable[None]]  # what has been announced


class Opening:
    """What the opener does: it decides, and the acceptor follows."""

    def __init__(self, end: OpenerEnd, options: DistributeOptions, make: Make) -> None:
        """Begin with no pairs."""
        self._end, self._options, self._make = end, options, make
        self._protocol = Protocol[options.purification.upper()]
        self._pairs = Pairs(end, half=0)
        self._pairs.rounds = options.rounds or 0
        self._number = self._dark = 0
        self._size = 1
        judged = LEAST_JUDGED if options.fidelity else LEAST_SAMPLE
        self._least_sample = judged if options.sample else 0
        self._room = abilities.room(end)

    async def run(self) -> Answerer:
        """Make pairs until there are as many, and as good ones, as are wanted; deliver them."""
        pairs, count = self._pairs, self._options.count
        self._require_abilities()
        while not await self._are_ready():
            if self._judged and self._too_noisy:
                await self._purify_once_more()
            else:
                await self._acquire()
            await self._tell(min(pairs.available, count))
        ours = self._end.means.lifetimes
        await self._end.channel.request(
            values(self._end.setup.session, Topic.DELIVER, 0, [count, *ours.numbers()], 32)
        )
        await pairs.deliver(count, self._end.lifetimes)
        await self._tell(count)
        return pairs.answer

    async def _are_ready(self) -> bool:
        """Return whether there are as many as are wanted when those too old are dropped."""
        if self._short or self._too_noisy:
            return False
        if self._cutoff_s < inf:
            await self._drop_old()
        return not self._short

    @property
    def _short(self) -> bool:
        return self._pairs.available < self._options.count or not self._judged

    @property
    def _cutoff_s(self) -> float:
        """Return how old pairs may get in the memory that keeps them for the shorter time."""
        return min(self._end.means.lifetimes.cutoff_s, self._end.lifetimes.cutoff_s)

    async def _drop_old(self) -> None:
        """Keep what both ends still hold; raise SessionError if nothing ever is."""
        end, pairs = self._end, self._pairs
        for number, portion in list(pairs.blocks.items()):
            held = await pairs.held(number)
            end.say(Topic.ARRIVED, number, held, 1)
            theirs = await end.hear(Topic.ARRIVED, number, portion.size, 1)
            await pairs.drop_old(number, held & theirs.astype(bool))
        if pairs.dropped > MOST_DROPPED + MOST_DROPPED_EACH * self._options.count:
            raise SessionError(
                Reason.NO_LIGHT,
                f"{pairs.dropped} pairs were older than {self._cutoff_s:g} s before there were "
                f"{self._options.count}: choose {self._longer}, or ask for fewer at a time",
            )

    @property
    def _longer(self) -> str:
        told = "memory.cutoff_s, or what the controller has set"
        return f"a longer cut-off than {self._cutoff_s:g} s ({told})"

    def _require_abilities(self) -> None:
        """Raise SessionError before any light for what cannot come to a good end."""
        options = self._options
        abilities.require_capacity(self._end, options.count, self._spare)
        if options.sample:
            abilities.require(self._end, MEASURE, "an estimate", "choose sample 0")
        if options.rounds:
            self._require_gates()

    def _require_gates(self) -> None:
        remedy = "ask for less fidelity, use a better source, or take hosts with gates"
        abilities.require(self._end, GATE | MEASURE, "purification", remedy)

    @property
    def _spare(self) -> int:
        """Return for how many pairs there must be room to go on, beside those that are there."""
        rounds = self._pairs.rounds
        return PHOTONS**rounds if self._options.sample or rounds else 0

    @property
    def _judged(self) -> bool:
        """Return whether enough has been sacrificed to know the fidelity."""
        estimate = self._pairs.estimate
        known = estimate.fidelity is not None or not self._least_sample
        return known and estimate.total >= self._least_sample

    @property
    def _too_noisy(self) -> bool:
        fidelity = self._pairs.estimate.fidelity
        return fidelity is not None and fidelity < self._options.fidelity

    async def _tell(self, count: int) -> None:
        self._end.summary = self._pairs.summary() | {"pairs": count}
        await self._end.tell(**self._end.summary)

    async def _acquire(self) -> None:
        """Have another block of light made, and bring its pairs to where the others are."""
        pairs = self._pairs
        abilities.require_capacity(self._end, pairs.available, self._spare)
        self._number, self._size = self._number + 1, self._next_size()
        await self._make(pairs, self._number, self._size)
        self._dark = 0 if self._number in pairs.blocks else self._dark + 1
        self._require_hope()
        await self._bring_up(self._number)

    def _next_size(self) -> int:
        """Return how much light is worth asking for, by what has come of it so far."""
        pairs, share = self._pairs, self._options.sample
        room = self._room - pairs.available
        most = min(self._end.setup.pairs, int(self._end.setup.rate_hz * MAX_BLOCK_S), room)
        missing = max(self._options.count - pairs.available, 0)
        unsampled = max(self._least_sample - pairs.estimate.total, 0)
        good = pairs.available + pairs.estimate.total
        if not pairs.emitted:
            kept = float(PHOTONS) ** -pairs.rounds
        elif good:
            kept = good / pairs.emitted
        else:
            more = 4 if self._cutoff_s == inf else 1  # pairs of more light are older
            return max(1, min(most, more * self._size))
        # What is beyond the pairs that are wanted is sacrificed, and of each block its share.
        wanted = max(missing + unsampled, missing / (1 - share))
        return max(1, min(most, ceil(MARGIN * wanted / kept) + 1))

    async def _bring_up(self, number: int) -> None:
        """Purify a block as often as the others, and sacrifice a share of what is left."""
        end, blocks = self._end, self._pairs.blocks
        while number in blocks and blocks[number].rounds < self._pairs.rounds:
            seed = int(end.draws.integers(MAX_NUMBER))
            end.say(Topic.PURIFY, number, [self._protocol, seed], 32)
            await self._pairs.purify(number, self._protocol, seed)
        if number in blocks:
            await self._sample(number, blocks[number].size)

    async def _sample(self, number: int, size: int) -> None:
        """Choose pairs and bases, each basis as often as the others, and measure."""
        end, measured = self._end, self._pairs.estimate.total
        count = int(self._options.sample * size + end.draws.random())
        needless = self._pairs.available - self._options.count
        count = max(count, min(size, needless, self._least_sample - measured))
        if not count:
            return
        chosen = np.zeros(size, dtype=bool)
        chosen[end.draws.choice(size, count, replace=False)] = True
        bases = end.draws.permutation((np.arange(count) + measured) % 3).astype(np.uint8)
        end.say(Topic.SAMPLE, number, chosen, 1)
        end.say(Topic.BASES, number, bases, 2)
        await self._pairs.sample(number, chosen, bases)

    async def _purify_once_more(self) -> None:
        """Purify all pairs once more; raise SessionError if that may not or cannot help."""
        settled = self._protocol == Protocol.NONE or self._options.rounds is not None
        interval = self._pairs.estimate.interval
        hopeless = not self._pairs.rounds and interval is not None and interval[1] <= 0.5
        if not settled and not hopeless:
            self._require_gates()
        if settled or hopeless or self._pairs.rounds == MAX_ROUNDS:
            remedy = "pairs of 0.5 or less cannot be purified" if hopeless else self._remedy()
            raise self._not_reached(remedy)
        self._pairs.rounds += 1
        for number in list(self._pairs.blocks):
            await self._bring_up(number)

    def _remedy(self) -> str:
        if self._protocol == Protocol.NONE:
            return "allow purification (bbpssw or dejmps)"
        if self._pairs.rounds == MAX_ROUNDS:
            return "more rounds are not made"
        return f"allow more rounds (at most {MAX_ROUNDS})"

    def _require_hope(self) -> None:
        """Raise SessionError if all the light that may be asked for has been in vain."""
        pairs, count = self._pairs, self._options.count
        if self._dark == MOST_DARK:
            text = f"no pair of the last {MOST_DARK} blocks of light has arrived at both ends"
            remedy = "see that fibres are whole, and the loss"
            if self._cutoff_s < inf:
                remedy += f", or choose {self._longer}"
            raise SessionError(Reason.NO_LIGHT, f"{text}: {remedy}")
        if pairs.emitted > MOST_EMITTED + MOST_EMITTED_EACH * count:
            reason = Reason.TOO_NOISY if pairs.rounds else Reason.NO_LIGHT
            raise SessionError(
                reason,
                f"{pairs.available} of {count} pairs after {pairs.emitted} were made, of which "
                f"{pairs.shared} arrived at both ends, and {pairs.rounds} rounds of purification: "
                "use fibres of less loss or a better source, or ask for less fidelity",
            )

    def _not_reached(self, remedy: str) -> SessionError:
        estimate = self._pairs.estimate
        low, high = estimate.interval or (0.0, 1.0)
        reached = f"{estimate.fidelity:.4f}" if estimate.fidelity is not None else "an unknown one"
        return SessionError(
            Reason.TOO_NOISY,
            f"fidelity {self._options.fidelity} is wanted, {reached} (95 %: {low:.4f} to "
            f"{high:.4f}) is reached after {self._pairs.rounds} rounds of purification: {remedy}, "
            "or ask for less, or use a better source, fibres and memories",
        )


async def distribute(end: OpenerEnd, options: DistributeOptions) -> Answerer:
    """Do what the opener does; return what answers its application."""
    heralded = end.setup.memory == MemoryState.HERALDED
    return await Opening(end, options, partial(by_station if heralded else _by_source, end)).run()


async def _by_source(end: OpenerEnd, pairs: Pairs, number: int, size: int) -> None:
    """Have the source make a block of pairs, and keep what both ends have."""
    stored = await end.pairs(number, size)
    end.say(Topic.ARRIVED, number, stored.arrived, 1)
    theirs = await end.hear(Topic.ARRIVED, number, size, 1)
    await pairs.share(number, stored.arrived, theirs.astype(bool))


async def receive(end: AcceptorEnd) -> Answerer:
    """Follow the opener until it delivers; return what answers this end's application."""
    return await follow(end, partial(_share, end))


async def follow(end: AcceptorEnd, share: Share) -> Answerer:
    """Do what the opener says; new blocks are shared in this way."""
    pairs = Pairs(end, half=1)
    while (message := await end.next_values()) is not None:
        number = message.block
        if message.topic == Topic.COMING:
            await share(pairs, message)
        elif message.topic == Topic.PURIFY:
            protocol, seed = expect(message, Topic.PURIFY, number, 2, MAX_NUMBER).tolist()
            if protocol not in (Protocol.BBPSSW, Protocol.DEJMPS):
                raise SessionError(Reason.UNSUPPORTED, f"purification by protocol {protocol}")
            await pairs.purify(number, Protocol(protocol), seed)
        elif message.topic == Topic.ARRIVED:
            size = pairs.portion(number).size
            theirs = expect(message, Topic.ARRIVED, number, size, 1).astype(bool)
            held = await pairs.held(number)
            end.say(Topic.ARRIVED, number, held, 1)
            await pairs.drop_old(number, held & theirs)
        elif message.topic == Topic.SAMPLE:
            size = pairs.portion(number).size
            chosen = expect(message, Topic.SAMPLE, number, size, 1).astype(bool)
            count = int(np.count_nonzero(chosen))
            if not count:
                raise SessionError(Reason.PROTOCOL, f"an empty sample of block {number}")
            bases = await end.hear(Topic.BASES, number, count, 2)
            await pairs.sample(number, chosen, bases.astype(np.uint8))
        else:
            told = expect(message, Topic.DELIVER, 0, 1 + NUMBERS, MAX_NUMBER).tolist()
            await pairs.deliver(told[0], Lifetimes.of(told[1:], end.channel.peer))
            end.agree()
            end.summary = pairs.summary()
            return pairs.answer
        end.summary = pairs.summary()
        await end.tell(**end.summary)
    raise SessionError(Reason.PROTOCOL, "the session was ended before pairs were delivered")


async def _share(end: AcceptorEnd, pairs: Pairs, message: Values) -> None:
    """Take in light, undo what the path did to it, and keep what both ends have."""
    if end.setup.memory == MemoryState.HERALDED:
        await share_heralded(end, pairs, message)
        return
    number, size = end.coming(message, end.setup.pairs)
    name = end.block(number, half=1)
    light = end.expect_light(name)
    try:
        end.agree()
        theirs = await end.hear(Topic.ARRIVED, number, size, 1)
        stored = await end.stored(light, size)
    finally:
        light.cancel()
    arrived = stored.arrived
    if arrived.any() and end.setup.rotation:
        await end.qnic.apply(name, np.full(size, end.setup.rotation, dtype=np.uint8))
        arrived = await store(end.qnic, name)
    end.say(Topic.ARRIVED, number, arrived, 1)
    await pairs.share(number, arrived, theirs.astype(bool))


KIND = ServiceKind(Service.DISTRIBUTE, DistributeOptions, distribute, receive)
