"""A tamper seal: entangled photons watch a fibre (Williams, Britt and Humble 2016).

    opener                                 source                           acceptor
      | <--- half 0 ------------------------ | --- half 1, which is watched ---> |
      | measures in Z or X by chance                  measures in Z or X by chance
      | Values(OVER) ----------------------------------------------------------> |
      | <----------------------------------------- Values(BASES), then OUTCOMES  |
      | where bases are equal: do the outcomes, too?  -> SequentialTest

Who measures halves on the way and sends them on cannot know the bases that will be chosen, and
breaks the correlation in the other one: visibility V = 1 - 2 error sinks from 1 to 1 - f/2.
An opener that is the source keeps half 0; then only the way between the two is watched.
Where no light comes the session ends with an error: a fibre that is cut is no seal.
"""

import numpy as np

from hosts.hardware.qnic import Symbols
from hosts.middleware.services.key_distribution.light import (
    measured,
    measuring,
    random_bases,
    turned_back,
)
from hosts.middleware.services.sealing.options import SealOptions
from hosts.middleware.services.sealing.sequential_test import SequentialTest
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.service import AcceptorEnd, OpenerEnd, ServiceKind
from hosts.middleware.session.values import values
from wire.metadata import Reason, Service, Topic
from wire.outcomes import NO_COINCIDENCE

MOST_DARK = 5  # blocks in a row of which no pair can be compared


class Watch:
    """What the opener of a seal knows of the fibre so far."""

    def __init__(self, end: OpenerEnd, options: SealOptions) -> None:
        """Begin with nothing seen."""
        self._end, self._options = end, options
        self._test = SequentialTest(options.question)
        self._blocks = self._emitted = self._dark = 0
        self._compared, self._errors = np.zeros(2, np.int64), np.zeros(2, np.int64)  # in Z, X

    async def run(self) -> None:
        """Watch until there is an alarm, or enough was seen."""
        while not self._test.alarm and self._test.compared < self._options.count:
            await self._look()
            await self._end.tell(**self.summary())
        self._end.summary = self.summary()

    async def _look(self) -> None:
        """Have a block of pairs made, and compare."""
        size, number = self._end.setup.pairs, self._blocks
        bases = random_bases(self._end, size)
        mine = await self._measure(number, bases)
        self._blocks, self._emitted = number + 1, self._emitted + size
        theirs = await self._end.hear(Topic.BASES, number, size, 1)
        outcomes = await self._end.hear(Topic.OUTCOMES, number, size, NO_COINCIDENCE)
        there = (mine != NO_COINCIDENCE) & (outcomes != NO_COINCIDENCE) & (bases == theirs)
        self._require_light(bool(there.any()))
        differ = (mine != outcomes)[there]
        seen = self._test.compared
        self._test.add(differ)
        told = self._test.compared - seen  # what comes after an alarm is not looked at
        self._compared += np.bincount(bases[there][:told], minlength=2)
        self._errors += np.bincount(bases[there][:told][differ[:told]], minlength=2)

    async def _measure(self, number: int, bases: Symbols) -> Symbols:
        """Return what was found of the halves of a new block."""
        end, size = self._end, bases.size
        if end.is_source:  # it keeps this half
            await end.pairs(number, size)
            end.say(Topic.OVER, number, [], 1)
            return await end.qnic.measure(end.block(number), bases)
        await end.channel.request(values(end.setup.session, Topic.COMING, number, [size], 32))
        light = measuring(end, end.block(number), bases)
        try:
            await end.arrangement.emit(number, size)
            end.say(Topic.OVER, number, [], 1)
            return await measured(end, light, size)
        finally:
            light.cancel()

    def _require_light(self, seen: bool) -> None:
        self._dark = 0 if seen else self._dark + 1
        if self._dark == MOST_DARK:
            text = f"of the last {MOST_DARK} blocks no pair was found in equal bases at both ends"
            raise SessionError(Reason.NO_LIGHT, f"{text}: see that fibres are whole, and the loss")

    def summary(self) -> dict[str, object]:
        """Return what the application is told."""
        question, test = self._options.question, self._test
        compared, errors = int(self._compared.sum()), int(self._errors.sum())
        both = [
            1 - 2 * int(wrong) / int(all_) if all_ else None
            for wrong, all_ in zip(self._errors, self._compared, strict=True)
        ]
        return {
            "alarm": test.alarm,
            "compared": test.compared,
            "emitted": self._emitted,
            "error_rate": errors / compared if compared else None,
            "visibility_z": both[0],
            "visibility_x": both[1],
            "tests_whole": test.whole,
            "score": test.score,
            "score_of_alarm": question.bounds[1],
            "false_alarm": question.false_alarm,
            "missed": question.missed,
            "light_s": self._emitted / self._end.setup.rate_hz,
        }


async def watch(end: OpenerEnd, options: SealOptions) -> None:
    """Do what the opener does."""
    await Watch(end, options).run()


async def answer(end: AcceptorEnd) -> None:
    """Measure the other half of each pair, and tell what was found."""
    blocks = photons = 0
    while (coming := await end.announced(end.setup.pairs)) is not None:
        number, size = coming
        bases = random_bases(end, size)
        light = measuring(end, end.block(number, half=1), bases)
        try:
            end.agree()
            await end.hear(Topic.OVER, number, 0, 0)
            outcomes = await measured(end, light, size)
        finally:
            light.cancel()
        end.say(Topic.BASES, number, bases, 1)
        told = turned_back(outcomes, bases, end.setup.rotation)
        end.say(Topic.OUTCOMES, number, told, 8)
        blocks, photons = blocks + 1, photons + int(np.count_nonzero(told != NO_COINCIDENCE))
        end.summary = {"blocks": blocks, "photons": photons}
        await end.tell(**end.summary)


KIND = ServiceKind(Service.SEAL, SealOptions, watch, answer)
