"""Wald's sequential probability ratio test (1945) of whether a fibre is whole or tapped.

    sum of ln(p1 / p0)   ln(1 / false_alarm) ------------- alarm
      over outcomes      ------/\\--/\\/ ------------------- goes on
                         ln(missed) ---------------------- whole; the next test begins

Of pairs measured in equal bases p0 differ where the fibre is whole, p1 where a fraction of its
photons is measured in Z or X by chance and sent on: half of these differ by chance whenever the
basis was the other one. By Ville's inequality no more than `false_alarm` of the tests of a whole
fibre end in an alarm, and no more than `missed` of those of a tapped one end as whole.
"""

from dataclasses import dataclass
from math import log

import numpy as np
from numpy.typing import NDArray

LEAST = 1e-6


def tapped_error(whole: float, fraction: float) -> float:
    """Return which part differs if this fraction is intercepted and resent.

    A photon in four is measured and sent on in the wrong basis and then found wrong; the others
    differ as those of the whole fibre do.
    """
    return whole + fraction * (1 / 4 - whole / 2)


@dataclass(frozen=True)
class Question:
    """Two hypotheses to distinguish, and with which confidence."""

    whole: float  # part that differs at most where the fibre is whole
    fraction: float  # of the photons that a tap measures at least
    false_alarm: float
    missed: float

    @property
    def tapped(self) -> float:
        return tapped_error(self.whole, self.fraction)

    @property
    def steps(self) -> tuple[float, float]:
        return log((1 - self.tapped) / (1 - self.whole)), log(self.tapped / self.whole)

    @property
    def bounds(self) -> tuple[float, float]:
        return log(self.missed), log(1 / self.false_alarm)


class SequentialTest:
    """Tests one after the other, until one ends in an alarm."""

    def __init__(self, question: Question) -> None:
        self.question = question
        self.score = 0.0
        self.compared = 0  # pairs of all tests, up to the alarm if there is one
        self.whole = 0  # tests that have ended so
        self.alarm = False

    def add(self, differ: NDArray[np.bool_]) -> None:
        """Take in pairs in their order, those before an alarm."""
        agreeing, differing = self.question.steps
        low, high = self.question.bounds
        steps = np.where(differ, differing, agreeing)
        begun = 0
        while begun < steps.size and not self.alarm:
            scores = self.score + np.cumsum(steps[begun:])
            outside = np.flatnonzero((scores <= low) | (scores >= high))
            ended = int(outside[0]) + 1 if outside.size else scores.size
            self.score = float(scores[ended - 1])
            self.compared += ended
            begun += ended
            if self.score >= high:
                self.alarm = True
            elif self.score <= low:
                self.whole, self.score = self.whole + 1, 0.0
