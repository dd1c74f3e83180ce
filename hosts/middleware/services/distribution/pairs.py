"""The pairs of a session at one end of it: block after block, the same at the other end.

Member i of a block is one pair at both ends, as both do the same to their halves.
"""

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hosts.hardware.block_name import BlockName
from hosts.hardware.qnic import Positions, Qnic
from hosts.hardware.replies import Symbols
from hosts.middleware.services.distribution.fidelity import Estimate
from hosts.middleware.services.distribution.purification import Protocol, purify
from hosts.middleware.session.blocks import (
    ASKED,
    LOST,
    PAIRS,
    RESERVED,
    SAMPLE,
    keep,
    keep_of_all,
    measure_some,
    measure_some_at,
    store,
    take,
)
from hosts.middleware.session.errors import SessionError, unsupported
from hosts.middleware.session.protocol import HostSide, Now, Steps, do, hear
from hosts.middleware.session.values import Lifetimes
from wire.analyser_frames import PHOTONS
from wire.metadata.values import Topic
from wire.metadata.vocabulary import Reason
from wire.outcomes import BASES
from wire.results.figures import MemoryFigures, PairFigures

MAX_ASKED = 100_000  # pairs in one question
MAX_BLOCKS = 4000  # that one gathering takes from

Mask = NDArray[np.bool_]


@dataclass
class Portion:
    size: int
    rounds: int = 0  # of purification so far
    since_ns: int = 0  # the mean time from which halves wait at this end; 0: unknown


@dataclass
class Moments:
    """When pairs were measured, or how long they had waited then, in whatever order."""

    pairs: int = 0
    sum_s: Fraction = Fraction()

    @property
    def mean_s(self) -> float:
        """The mean, exact; 0 without pairs."""
        return float(self.sum_s / max(self.pairs, 1))

    def add(self, pairs: int, time_s: float) -> None:
        self.pairs += pairs
        self.sum_s += pairs * Fraction(time_s)


class Pairs:
    """Keeps, purifies, samples and delivers them; both ends take each step together."""

    def __init__(self, side: HostSide, half: int, started_s: float) -> None:
        self._side, self._half = side, half
        self._used = np.zeros(0, dtype=bool)
        self._started_s = started_s
        self.blocks: dict[int, Portion] = {}
        self.facts = MemoryFigures()  # beside those that there are of all pairs
        self.estimates: dict[int, Estimate] = {}  # by rounds of purification
        self._sampled: dict[int, Moments] = {}  # by rounds of purification
        self._waited = Moments()  # of those sampled, until then
        self._corrected = Moments()  # until the bits of all swaps had come
        self.rounds = self.emitted = self.shared = self.compared = self.survived = 0
        self.dropped = 0  # too old

    @property
    def available(self) -> int:
        return sum(portion.size for portion in self.blocks.values())

    @property
    def estimate(self) -> Estimate:
        """Return what is known of the fidelity after as many rounds as there have been."""
        return self.estimates.get(self.rounds, Estimate())

    @property
    def sacrificed(self) -> int:
        """Return how many pairs were measured for that estimate, whether or not they were seen."""
        return self._sampled.get(self.rounds, Moments()).pairs

    def portion(self, number: int) -> Portion:
        """Return what there is of a block; raise SessionError if there is nothing."""
        if number not in self.blocks:
            raise SessionError(Reason.PROTOCOL, f"there are no pairs of block {number}")
        return self.blocks[number]

    def admit(self, number: int) -> None:
        """Raise SessionError unless a new block may have this number."""
        if number in self.blocks or not 0 < number < RESERVED or len(self.blocks) >= MAX_BLOCKS:
            raise unsupported(
                f"block {number} beside {len(self.blocks)} others: no number may come again, and "
                f"{MAX_BLOCKS} blocks are kept at most; choose larger ones (block_pairs)",
            )

    def share(
        self, number: int, ours: Mask, theirs: Mask, emitted: int | None = None, since_ns: int = 0
    ) -> Steps[None]:
        """Keep of a new block the pairs of which both halves have arrived; all were emitted."""
        self.admit(number)
        size = 0
        if ours.size:
            size = yield from keep(self._name(number), ours & theirs)
        self.add(number, ours.size if emitted is None else emitted, size, since_ns)

    def corrected(self, pairs: int, waited_ns: int) -> None:
        """Note how long the halves of pairs at this end have waited for the bits of all swaps."""
        self._corrected.add(pairs, waited_ns / 1e9)
        self.facts.waited_ms = self._corrected.mean_s * 1e3

    def add(self, number: int, emitted: int, size: int, since_ns: int = 0) -> None:
        """Count a new block, of which both ends have kept pairs, all of them shared."""
        self.emitted, self.shared = self.emitted + emitted, self.shared + size
        self.blocks[number] = Portion(size, since_ns=since_ns)
        self._forget_empty(number)

    def held(self, number: int) -> Steps[Mask]:
        """Return which pairs of a block are at this end, and not too old.

        None gets too old from now on, until this is asked again.
        """
        self.portion(number)
        held = yield from store(self._name(number))
        yield from do(Qnic.store, self._name(number), for_good=True)
        return held

    def drop_old(self, number: int, mask: Mask) -> Steps[None]:
        """Keep those pairs of a block alone that both ends hold."""
        portion = self.portion(number)
        self.dropped += portion.size - int(np.count_nonzero(mask))
        self.facts.dropped = self.dropped
        portion.size = yield from keep_of_all(self._name(number), mask)
        self._forget_empty(number)

    def purify(self, number: int, protocol: Protocol, seed: int) -> Steps[None]:
        """Make fewer and better pairs of those of a block."""
        portion, name = self.portion(number), self._name(number)
        portion.rounds += 1
        self.rounds = max(self.rounds, portion.rounds)
        compared = portion.size // PHOTONS
        if compared:
            ours = yield from purify(name, portion.size, protocol, seed)
            theirs = yield from self._exchange(number, ours)
            agreed = (ours == theirs) & (ours != LOST)
        else:
            agreed = np.zeros(0, dtype=bool)
        portion.size = yield from keep(name, agreed)
        self.compared, self.survived = self.compared + compared, self.survived + portion.size
        self._forget_empty(number)

    def sample(self, number: int, chosen: Mask, bases: Symbols) -> Steps[None]:
        """Sacrifice pairs of a block: measure them, each in its basis, at both ends."""
        portion, name = self.portion(number), self._name(number)
        positions = np.flatnonzero(chosen)
        ours, time_ns = yield from measure_some_at(name, SAMPLE, positions, bases)
        if portion.since_ns:
            self._note_wait(positions.size, time_ns - portion.since_ns)
        theirs = yield from self._exchange(number, ours)
        estimate = self.estimates.setdefault(portion.rounds, Estimate())
        estimate.add(bases, ours, theirs)
        sampled = self._sampled.setdefault(portion.rounds, Moments())
        sampled.add(positions.size, (yield Now()))
        portion.size = yield from keep(name, ~chosen)
        self._forget_empty(number)

    def deliver(self, count: int, theirs: Lifetimes) -> Steps[None]:
        """Number `count` pairs from 0, and discard all others; SessionError if too few."""
        if not 0 < count <= self.available:
            raise SessionError(Reason.PROTOCOL, f"{count} of {self.available} pairs to deliver")
        left = count
        picks: dict[BlockName, Positions] = {}
        for number, portion in sorted(self.blocks.items()):  # as they came differs at both ends
            picks[self._name(number)] = np.arange(min(left, portion.size))
            left -= min(left, portion.size)
        yield from take(self._name(PAIRS), picks)
        self.blocks = {PAIRS: Portion(count, self.rounds)}
        self.facts.fidelity_age_s = age_s = self._age_s((yield Now()))
        both = self._side.lifetimes, theirs
        self.facts.fidelity_expected = None if age_s is None else self.estimate.after(age_s, both)
        self._used = np.zeros(count, dtype=bool)

    def answer(self, question: dict[str, Any]) -> Steps[dict[str, Any]]:
        """Measure pairs: {"measure": numbers, "basis": "X", "Y" or "Z"}; each can be used once.

        Return {"outcomes": 0 or 1 for each, None where no detector clicked}.
        """
        if question.keys() != {"measure", "basis"}:
            raise unsupported("name pairs to measure, and a basis")
        basis = question["basis"]
        if basis not in BASES:
            raise unsupported(f"basis {basis!r}: choose X, Y or Z")
        numbers = self._unused(question["measure"])
        self._used[numbers] = True
        bases = np.full(numbers.size, BASES.index(basis), dtype=np.uint8)
        outcomes = yield from measure_some(self._name(PAIRS), ASKED, numbers, bases)
        return {"outcomes": [None if bit == LOST else int(bit) for bit in outcomes]}

    def summary(self, now_s: float) -> PairFigures:
        """Return the application's results; None where nothing is known."""
        elapsed_s = now_s - self._started_s
        low, high = self.estimate.interval or (None, None)
        return PairFigures(
            session=f"{self._side.setup.session:016x}",
            pairs=self.available,
            pairs_per_s=self.available / elapsed_s,
            fidelity=self.estimate.fidelity,
            fidelity_low=low,  # of the 95 % confidence interval
            fidelity_high=high,
            emitted=self.emitted,
            shared=self.shared,
            sampled=sum(estimate.total for estimate in self.estimates.values()),
            rounds=self.rounds,
            compared=self.compared,
            survived=self.survived,
            elapsed_s=elapsed_s,
            **vars(self.facts),
        )

    def _age_s(self, now_s: float) -> float | None:
        """Return how long ago the sample was measured on average; the pairs have waited since."""
        sampled = self._sampled.get(self.rounds)
        return now_s - sampled.mean_s if sampled else None

    def _unused(self, numbers: Any) -> NDArray[np.int64]:
        if not isinstance(numbers, list) or not 0 < len(numbers) <= MAX_ASKED:
            raise unsupported(f"name 1 to {MAX_ASKED} pairs, as a list")
        last = self._used.size - 1
        for number in numbers:
            if type(number) is not int or not 0 <= number <= last:
                raise unsupported(f"pair {number!r}: choose 0 to {last}")
        chosen = np.array(numbers)
        used = chosen[self._used[chosen]]
        if used.size or np.unique(chosen).size < chosen.size:
            which = f"pair {used[0]} is used up" if used.size else "a pair is named twice"
            raise unsupported(f"{which}: name each pair once")
        return chosen

    def _note_wait(self, pairs: int, waited_ns: int) -> None:
        """Count how long halves have waited at this end until they were sacrificed."""
        self._waited.add(pairs, waited_ns / 1e9)
        self.facts.sampled_waited_ms = self._waited.mean_s * 1e3

    def _exchange(self, number: int, outcomes: Symbols) -> Steps[Symbols]:
        """Tell the other end what has been measured here; return what has been there."""
        yield self._side.say(Topic.OUTCOMES, number, outcomes, 2)
        theirs = yield from hear(Topic.OUTCOMES, number, outcomes.size, LOST)
        return theirs.astype(np.uint8)

    def _name(self, number: int) -> BlockName:
        return self._side.block(number, self._half)

    def _forget_empty(self, number: int) -> None:
        if not self.blocks[number].size:
            del self.blocks[number]
