"""Measured numbers with their standard errors."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

SIGMAS = 5  # how far a measured number may be from theory, in standard errors

SERIES_BATCHES = 20  # of values one after the other


@dataclass(frozen=True)
class Estimate:
    """A measured number and its standard error; NaN where nothing was measured."""

    value: float
    error: float

    def agrees(self, theory: float) -> bool:
        """Return whether theory is within SIGMAS standard errors; rounding is forgiven."""
        return abs(self.value - theory) <= SIGMAS * self.error + 1e-12


NOTHING = Estimate(math.nan, math.nan)


def proportion(events: int, trials: int) -> Estimate:
    """Return how often something happened in independent trials.

    The error is that of a proportion with one event of either kind more (Laplace), so that
    it is not 0 where no event was seen.
    """
    if not trials:
        return NOTHING
    likely = (events + 1) / (trials + 2)
    return Estimate(events / trials, math.sqrt(likely * (1 - likely) / trials))


def of_counts(figure: Callable[[NDArray[Any]], float], counts: NDArray[Any]) -> Estimate:
    """Return a figure of counts of events; their errors (Poisson) are propagated one by one."""
    square = 0.0
    for place in np.ndindex(*counts.shape):
        more, less = counts.astype(float), counts.astype(float)
        step = math.sqrt(max(int(counts[place]), 1))
        more[place] += step
        less[place] = max(less[place] - step, 0.0)
        square += ((figure(more) - figure(less)) / 2) ** 2
    return Estimate(figure(counts), math.sqrt(square))


def of_two(figure: Callable[[float, float], float], one: Estimate, other: Estimate) -> Estimate:
    """Return a figure of two estimates; their errors are propagated one by one."""
    error = math.hypot(
        figure(one.value + one.error, other.value) - figure(one.value - one.error, other.value),
        figure(one.value, other.value + other.error) - figure(one.value, other.value - other.error),
    )
    return Estimate(figure(one.value, other.value), error / 2)


def mean(values: Sequence[float], counts: Sequence[int]) -> Estimate:
    """Return the mean of independent draws of which counts[i] gave values[i].

    The error is never below what one draw more of the largest value would change.
    """
    total = sum(counts)
    if not total:
        return NOTHING
    weights = np.asarray(counts) / total
    value = float(weights @ np.asarray(values))
    variance = float(weights @ (np.asarray(values) - value) ** 2)
    least = max(abs(each) for each in values) / total
    return Estimate(value, max(math.sqrt(variance / total), least))


def mean_of_draws(values: ArrayLike) -> Estimate:
    """Return the mean of independent measurements; the error is that between them."""
    drawn = np.asarray(values, np.float64)
    if len(drawn) < 2:
        return NOTHING
    return Estimate(float(drawn.mean()), float(drawn.std(ddof=1)) / math.sqrt(len(drawn)))


def mean_of_series(values: Sequence[float]) -> Estimate:
    """Return the mean of what was measured one after the other, neighbours of which are alike.

    The error is that of batches, as between them.
    """
    batches = min(SERIES_BATCHES, len(values))
    if batches < 2:
        return NOTHING
    means = [float(part.mean()) for part in np.array_split(np.asarray(values), batches)]
    error = math.sqrt(float(np.var(means, ddof=1)) / batches)
    return Estimate(float(np.mean(values)), error)


def ratio(parts: ArrayLike, wholes: ArrayLike, clump: int = 1) -> Estimate:
    """Return sum(parts) / sum(wholes) over independent batches, with the error between them.

    It is never below 1 / sum(wholes). Where nothing was counted it is that of one event, which
    may count up to `clump` at once.
    """
    part, whole = np.asarray(parts, np.float64), np.asarray(wholes, np.float64)
    total = whole.sum()
    if not total:
        return NOTHING
    value = float(part.sum() / total)
    batches = len(part)
    residue = ((part - value * whole) ** 2).sum() * batches / max(batches - 1, 1)
    least = 1 if value else clump
    return Estimate(value, max(math.sqrt(residue), least) / float(total))


def information(counts: Sequence[int]) -> Estimate:
    """Return 2 - H of the frequencies of the four dibit errors: the capacity in bits.

    The error is that of first order, and at least that of second order, which alone is left
    where all four are alike.
    """
    total = sum(counts)
    if not total:
        return NOTHING
    frequencies = np.array([count / total for count in counts if count])
    bits = np.log2(frequencies)
    entropy = -float((frequencies * bits).sum())
    variance = float((frequencies * bits**2).sum()) - entropy**2
    error = math.sqrt(max(variance, 0) / total)
    return Estimate(2 - entropy, max(error, len(counts) / total))
