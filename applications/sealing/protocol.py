"""The protocol of a tamper seal at both ends: no socket, no clock."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from applications.measured_light import measured, measuring, random_bases, turned_back
from applications.sealing.sequential_test import Question, SequentialTest
from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import Symbols
from hosts.middleware.session.blocks import LOST
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.options import MAX_BLOCK_PAIRS, MAX_COUNT, MAX_RATE_HZ, ServiceOptions
from hosts.middleware.session.protocol import Emit, HostSide, Now, OpenerSide, Steps, Tell, do, hear
from wire.metadata.values import Topic
from wire.metadata.vocabulary import Reason
from wire.outcomes import NO_COINCIDENCE
from wire.parameters.option import option
from wire.results.figures import SealedFigures, SealFigures

MOST_DARK = 5  # blocks in a row of which no pair can be compared


@dataclass(frozen=True)
class SealOptions(ServiceOptions):
    """Watch with `count` pairs that are compared, or until an alarm."""

    count: int = option(10_000, "compared (10000)", metavar="N", range=(1, MAX_COUNT))
    block_pairs: int = option(
        1024, "pairs in a block (1024)", metavar="N", range=(1, MAX_BLOCK_PAIRS)
    )
    rate_hz: int = option(
        100_000, "rate of the source (100000)", metavar="HZ", range=(1, MAX_RATE_HZ)
    )
    whole_error: float = option(
        0.01,
        "part of the pairs that differ without an eavesdropper, at most (0.01)",
        metavar="P",
        range=(1e-6, 0.2),
    )
    fraction: float = option(
        0.25,
        "of the photons that an eavesdropper measures, who is to be detected (0.25)",
        metavar="F",
        range=(0.001, 1.0),
    )
    false_alarm: float = option(
        1e-6,
        "that a test of a whole fibre ends in an alarm, at most (1e-06)",
        metavar="P",
        range=(1e-15, 0.1),
    )
    missed: float = option(
        0.01,
        "that a test misses such an eavesdropper, at most (0.01)",
        metavar="P",
        range=(1e-15, 0.1),
    )

    @property
    def question(self) -> Question:
        return Question(self.whole_error, self.fraction, self.false_alarm, self.missed)


class Watch:
    """The opener's counts of a fibre so far."""

    def __init__(
        self,
        side: OpenerSide,
        options: SealOptions,
        wanted_back: Callable[[], bool] = lambda: False,
    ) -> None:
        """Begin with nothing seen; `wanted_back` tells whether a session wants the light."""
        self._side, self._options, self._wanted_back = side, options, wanted_back
        self.preempted = False
        self._elapsed_s = 0.0
        self._test = SequentialTest(options.question)
        self._blocks = self._emitted = self._dark = 0
        self._compared, self._errors = np.zeros(2, np.int64), np.zeros(2, np.int64)  # in Z, X

    @property
    def alarm(self) -> bool:
        return self._test.alarm

    @property
    def errors(self) -> int:
        return int(self._errors.sum())

    @property
    def compared(self) -> int:
        return self._test.compared

    @property
    def whole(self) -> int:
        return self._test.whole

    def run(self) -> Steps[None]:
        """Watch until there is an alarm, or enough was seen, or a session wants the light."""
        began_s = yield Now()
        while not self._test.alarm and self._test.compared < self._options.count:
            if self._wanted_back():
                self.preempted = True
                return
            yield from self._look()
            self._elapsed_s = (yield Now()) - began_s
            yield Tell(self.summary(), at_the_end=False)

    def _look(self) -> Steps[None]:
        """Have a block of pairs made, and compare."""
        size, number = self._side.setup.pairs, self._blocks
        bases = random_bases(self._side, size)
        mine = yield from self._measure(number, bases)
        self._blocks, self._emitted = number + 1, self._emitted + size
        theirs = yield from hear(Topic.BASES, number, size, 1)
        outcomes = yield from hear(Topic.OUTCOMES, number, size, LOST)
        there = (mine != NO_COINCIDENCE) & (outcomes != LOST) & (bases == theirs)
        self._require_light(bool(there.any()))
        differ = (mine != outcomes)[there]
        seen = self._test.compared
        self._test.add(differ)
        compared = self._test.compared - seen  # nothing after an alarm counts
        self._compared += np.bincount(bases[there][:compared], minlength=2)
        self._errors += np.bincount(bases[there][:compared][differ[:compared]], minlength=2)

    def _measure(self, number: int, bases: Symbols) -> Steps[Symbols]:
        """Return what was found of the halves of a new block."""
        side, size = self._side, bases.size
        if side.is_source:  # it keeps this half
            yield from side.pairs(number, size)
            yield side.say(Topic.OVER, number, [], 1)
            return (yield from do(Qnic.measure, side.block(number), bases))
        yield from side.announce(number, size)
        light = yield from measuring(side, side.block(number), bases)
        yield Emit(number, size)
        yield side.say(Topic.OVER, number, [], 1)
        return (yield from measured(side, light, size))

    def _require_light(self, seen: bool) -> None:
        self._dark = 0 if seen else self._dark + 1
        if self._dark == MOST_DARK:
            text = f"of the last {MOST_DARK} blocks no pair was found in equal bases at both ends"
            text += ": see that fibres are whole, the loss, and the detectors"
            raise SessionError(Reason.NO_LIGHT, text)

    def summary(self) -> SealFigures:
        question, test = self._options.question, self._test
        compared, errors = int(self._compared.sum()), self.errors
        both = [
            1 - 2 * int(wrong) / int(all_) if all_ else None
            for wrong, all_ in zip(self._errors, self._compared, strict=True)
        ]
        return SealFigures(
            alarm=test.alarm,
            preempted=self.preempted,
            compared=test.compared,
            emitted=self._emitted,
            error_rate=errors / compared if compared else None,
            visibility_z=both[0],
            visibility_x=both[1],
            tests_whole=test.whole,
            score=test.score,
            score_of_alarm=question.bounds[1],
            false_alarm=question.false_alarm,
            missed=question.missed,
            light_s=self._emitted / self._side.setup.rate_hz,
            elapsed_s=self._elapsed_s,
            pairs_per_s=test.compared / self._elapsed_s if self._elapsed_s else 0.0,
        )


def answer(side: HostSide) -> Steps[None]:
    """Measure the other half of each pair, and tell what was found."""
    blocks = photons = 0
    while (coming := (yield from side.announced(side.setup.pairs))) is not None:
        number, size = coming
        bases = random_bases(side, size)
        light = yield from measuring(side, side.block(number, half=1), bases)
        yield side.agree()
        yield from hear(Topic.OVER, number, 0, 0)
        outcomes = yield from measured(side, light, size)
        yield side.say(Topic.BASES, number, bases, 1)
        bits = turned_back(outcomes, bases, side.setup.rotation)
        seen = bits != NO_COINCIDENCE
        yield side.say(Topic.OUTCOMES, number, np.where(seen, bits, LOST), 2)
        blocks, photons = blocks + 1, photons + int(np.count_nonzero(seen))
        yield Tell(SealedFigures(blocks=blocks, photons=photons))
