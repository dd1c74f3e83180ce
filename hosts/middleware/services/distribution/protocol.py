"""The protocol of entanglement distribution at both ends: no socket, no clock.

The opener decides, block by block, by what it has measured; the acceptor follows. How new blocks
come to both ends is for others to say (sharing.py, and swapping, whose pairs come by switches and
of which several blocks are under way).
"""

from collections.abc import Callable, Collection
from math import ceil, inf

import numpy as np

from hosts.middleware.services.distribution.pairs import Pairs
from hosts.middleware.services.distribution.purification import (
    MAX_ROUNDS,
    DistributeOptions,
    Protocol,
)
from hosts.middleware.session import node_features
from hosts.middleware.session.errors import SessionError, unsupported
from hosts.middleware.session.protocol import (
    Concurrently,
    HostSide,
    Now,
    OpenerSide,
    Steps,
    Tell,
    WaitUntil,
    hear,
    request,
)
from hosts.middleware.session.values import NUMBERS, Lifetimes, expect
from hosts.timeouts import MAX_BLOCK_S
from wire.analyser_frames import PHOTONS
from wire.features import GATE, MEASURE
from wire.metadata.values import Topic, Values
from wire.metadata.vocabulary import Reason

MAX_NUMBER = (1 << 32) - 1
LEAST_SAMPLE = 30  # pairs, for an estimate of the fidelity
LEAST_JUDGED = 300  # pairs; by which it is decided whether the fidelity wanted is reached
MOST_EMITTED = 1_000_000  # pairs, and this number more for each wanted one:
MOST_EMITTED_EACH = 1000
MOST_DROPPED, MOST_DROPPED_EACH = 100, 10  # pairs, for their age
MOST_DARK = 10  # blocks in a row of which nothing arrives
MOST_UNSEEN = 10_000  # pairs that are sacrificed, and of which no measurement tells anything
LEAST_SEEN = 0.5  # of those sacrificed so far, if none is
MARGIN = 1.05  # of light beyond what is expected to be needed


Make = Callable[[Pairs, int, int], Steps[None]]  # a block, by its number and size
Share = Callable[[Pairs, Values], Steps[None]]  # what has been announced


class Opening:
    """The opener: it decides, and the acceptor follows."""

    def __init__(
        self,
        side: OpenerSide,
        options: DistributeOptions,
        make: Make,
        started_s: float,
        blocks: int = 1,
    ) -> None:
        """Begin with no pairs; `blocks` may be under way at once."""
        self._blocks = blocks
        self._under_way: dict[int, int] = {}  # sizes of blocks by their numbers, in order
        self._made: set[int] = set()  # of these, what has come to both ends
        self._side, self._options, self._make = side, options, make
        self._protocol = Protocol[options.purification.upper()]
        self._pairs = Pairs(side, half=0, started_s=started_s)
        self._pairs.rounds = options.rounds or 0
        self._number = self._dark = 0
        self._size = 1
        judged = LEAST_JUDGED if options.fidelity else LEAST_SAMPLE
        self._least_sample = judged if options.sample else 0
        self._capacity = node_features.capacity(side)

    def run(self) -> Steps[Pairs]:
        """Make pairs until there are as many, and as good ones, as are wanted; deliver them."""
        pairs, count = self._pairs, self._options.count
        self._require_node_features()
        while not (yield from self._are_ready()):
            if self._needs_purification and not self._under_way:
                yield from self._purify_once_more()
            else:
                yield from self._acquire()
            yield from self._tell(min(pairs.available, count))
        ours = self._side.lifetimes
        yield from request(self._side.words(Topic.DELIVER, 0, [count, *ours.numbers()], 32))
        yield from pairs.deliver(count, self._side.their_lifetimes)
        yield from self._tell(count)
        return pairs

    def _are_ready(self) -> Steps[bool]:
        """Return whether there are as many as are wanted when those too old are dropped."""
        if self._short or self._too_noisy or self._under_way:
            return False
        if self._cutoff_s < inf:
            yield from self._drop_old()
        return not self._short

    @property
    def _short(self) -> bool:
        return self._pairs.available < self._options.count or not self._judged

    @property
    def _needs_purification(self) -> bool:
        return self._judged and self._too_noisy

    @property
    def _cutoff_s(self) -> float:
        return min(self._side.lifetimes.cutoff_s, self._side.their_lifetimes.cutoff_s)

    def _drop_old(self) -> Steps[None]:
        """Keep what both ends still hold; raise SessionError if nothing ever is."""
        side, pairs = self._side, self._pairs
        for number, portion in list(pairs.blocks.items()):
            held = yield from pairs.held(number)
            yield side.say(Topic.ARRIVED, number, held, 1)
            theirs = yield from hear(Topic.ARRIVED, number, portion.size, 1)
            yield from pairs.drop_old(number, held & theirs.astype(bool))
        if pairs.dropped > MOST_DROPPED + MOST_DROPPED_EACH * self._options.count:
            raise SessionError(
                Reason.NO_LIGHT,
                f"{pairs.dropped} pairs were older than {self._cutoff_s:g} s before there were "
                f"{self._options.count}: choose {self._longer}, or ask for fewer at a time",
            )

    @property
    def _longer(self) -> str:
        setting = "memory.cutoff_s, or the controller's"
        return f"a longer cut-off than {self._cutoff_s:g} s ({setting})"

    def _require_node_features(self) -> None:
        """Raise SessionError before any light for what cannot come to a good end."""
        options = self._options
        node_features.require_capacity(self._side, options.count, self._spare)
        if options.sample:
            node_features.require(self._side, MEASURE, "an estimate", "choose sample 0")
        if options.rounds:
            self._require_gates()

    def _require_gates(self) -> None:
        remedy = "ask for less fidelity, use a better source, or take hosts with gates"
        node_features.require(self._side, GATE | MEASURE, "purification", remedy)

    @property
    def _spare(self) -> int:
        """Return for how many pairs there must be room to go on, beside those that are there."""
        rounds = self._pairs.rounds
        return PHOTONS**rounds if self._options.sample or rounds else 0

    @property
    def _judged(self) -> bool:
        estimate = self._pairs.estimate
        has_fidelity = estimate.fidelity is not None or not self._least_sample
        return has_fidelity and estimate.total >= self._least_sample

    @property
    def _too_noisy(self) -> bool:
        fidelity = self._pairs.estimate.fidelity
        return fidelity is not None and fidelity < self._options.fidelity

    def _tell(self, count: int) -> Steps[None]:
        summary = self._pairs.summary((yield Now()))
        summary.pairs = count
        yield Tell(summary)

    def _acquire(self) -> Steps[None]:
        """Have more light made, and bring the pairs of the oldest block to where others are."""
        yield from self._begin_blocks()
        oldest = next(iter(self._under_way))
        if oldest not in self._made:
            yield WaitUntil(lambda: oldest in self._made)
        self._made.remove(oldest)
        del self._under_way[oldest]
        self._dark = 0 if oldest in self._pairs.blocks else self._dark + 1
        self._require_hope()
        if self._under_way:
            yield from self._begin_blocks()  # while those are brought up
        yield from self._bring_up(oldest)

    def _begin_blocks(self) -> Steps[None]:
        """Have light made for as many blocks as there is need of and room for."""
        while len(self._under_way) < self._blocks and (size := self._next_size()):
            node_features.require_capacity(self._side, self._pairs.available, self._spare)
            self._number, self._size = self._number + 1, size
            self._under_way[self._number] = size
            if self._blocks == 1:
                yield from self._make_block(self._number, size)
            else:
                yield Concurrently(self._make_block(self._number, size))

    def _make_block(self, number: int, size: int) -> Steps[None]:
        yield from self._make(self._pairs, number, size)
        self._made.add(number)

    def _next_size(self) -> int:
        """Return how much light is worth asking for, by what has come so far; 0: none now."""
        pairs, coming = self._pairs, sum(self._under_way.values())
        if self._under_way and self._needs_purification:
            return 0
        free = self._capacity - pairs.available - coming
        most = min(self._side.setup.pairs, int(self._side.setup.rate_hz * MAX_BLOCK_S), free)
        size = self._wanted
        if size is None:
            if self._under_way:
                return 0
            more = 4 if self._cutoff_s == inf else 1  # pairs of more light are older
            return max(1, min(most, more * self._size))
        if self._under_way:
            return max(0, min(most, ceil(size) - coming))
        return max(1, min(most, ceil(size)))

    @property
    def _wanted(self) -> float | None:
        """How much light is expected to be needed, with a margin; None: nothing has come yet."""
        pairs, share = self._pairs, self._options.sample
        missing = max(self._options.count - pairs.available, 0)
        unsampled = self._unsampled
        good = pairs.available + pairs.sacrificed
        if not pairs.emitted:
            chance = float(PHOTONS) ** -pairs.rounds
        elif good:
            chance = good / pairs.emitted
        else:
            return None
        # Pairs beyond the wanted ones are sacrificed, and of each block its share.
        needed = max(missing + unsampled, missing / (1 - share))
        return MARGIN * needed / chance + 1

    @property
    def _unsampled(self) -> float:
        if self._judged:
            return 0.0
        seen, pairs = self._pairs.estimate.total, self._pairs
        share = max(seen, LEAST_SEEN) / pairs.sacrificed if pairs.sacrificed else 1.0
        few = seen < self._least_sample  # else a basis is missing
        return (self._least_sample - seen if few else LEAST_SAMPLE) / share

    def _bring_up(self, number: int) -> Steps[None]:
        """Purify a block as often as the others, and sacrifice a share of what is left."""
        side, blocks = self._side, self._pairs.blocks
        while number in blocks and blocks[number].rounds < self._pairs.rounds:
            seed = int(side.draws.integers(MAX_NUMBER))
            yield side.say(Topic.PURIFY, number, [self._protocol, seed], 32)
            yield from self._pairs.purify(number, self._protocol, seed)
        if number in blocks:
            yield from self._sample(number, blocks[number].size)

    def _sample(self, number: int, size: int) -> Steps[None]:
        """Choose pairs and bases, each basis as often as the others, and measure."""
        side, measured = self._side, self._pairs.estimate.total
        count = int(self._options.sample * size + side.draws.random())
        needless = self._pairs.available - self._options.count
        count = max(count, min(size, needless, ceil(self._unsampled)))
        if not count:
            return
        chosen = np.zeros(size, dtype=bool)
        chosen[side.draws.choice(size, count, replace=False)] = True
        bases = side.draws.permutation((np.arange(count) + measured) % 3).astype(np.uint8)
        yield side.say(Topic.SAMPLE, number, chosen, 1)
        yield side.say(Topic.BASES, number, bases, 2)
        yield from self._pairs.sample(number, chosen, bases)
        if not self._pairs.estimate.total and self._pairs.sacrificed > MOST_UNSEEN:
            raise SessionError(
                Reason.NO_LIGHT,
                f"none of {self._pairs.sacrificed} pairs that were sacrificed was measured at both "
                "ends: see the detectors (efficiency, gate_s, jitter_ps), or choose sample 0",
            )

    def _purify_once_more(self) -> Steps[None]:
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
            yield from self._bring_up(number)

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
            remedy = "see that fibres are whole, the loss, and the detectors"
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


def follow(
    side: HostSide, share: Share, started_s: float, under_way: Collection[int] = ()
) -> Steps[Pairs]:
    """Do what the opener says until it delivers; new blocks are shared in this way.

    Other steps hear messages about blocks under way.
    """
    pairs = Pairs(side, half=1, started_s=started_s)
    while (message := (yield from side.next_values(apart=under_way))) is not None:
        number = message.block
        if message.topic == Topic.COMING:
            yield from share(pairs, message)
        elif message.topic == Topic.PURIFY:
            protocol, seed = expect(message, Topic.PURIFY, number, 2, MAX_NUMBER).tolist()
            if protocol not in (Protocol.BBPSSW, Protocol.DEJMPS):
                raise unsupported(f"purification by protocol {protocol}")
            yield from pairs.purify(number, Protocol(protocol), seed)
        elif message.topic == Topic.ARRIVED:
            size = pairs.portion(number).size
            theirs = expect(message, Topic.ARRIVED, number, size, 1).astype(bool)
            held = yield from pairs.held(number)
            yield side.say(Topic.ARRIVED, number, held, 1)
            yield from pairs.drop_old(number, held & theirs)
        elif message.topic == Topic.SAMPLE:
            size = pairs.portion(number).size
            chosen = expect(message, Topic.SAMPLE, number, size, 1).astype(bool)
            count = int(np.count_nonzero(chosen))
            if not count:
                raise SessionError(Reason.PROTOCOL, f"an empty sample of block {number}")
            bases = yield from hear(Topic.BASES, number, count, 2)
            yield from pairs.sample(number, chosen, bases.astype(np.uint8))
        else:
            numbers = expect(message, Topic.DELIVER, 0, 1 + NUMBERS, MAX_NUMBER).tolist()
            yield from pairs.deliver(numbers[0], Lifetimes.of(numbers[1:], side.peer))
            yield side.agree()
            return pairs
        yield Tell(pairs.summary((yield Now())))
    raise SessionError(Reason.PROTOCOL, "the session was ended before pairs were delivered")
