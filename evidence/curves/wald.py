"""How many pairs Wald's sequential tests compare, one after the other, until an alarm."""

from functools import cache
from math import exp, log

import numpy as np

from applications.sealing.sequential_test import Question

NEGLIGIBLE = 1e-12  # probability of tests that still go on
ROOTS_WITHIN = 1e-12


@cache
def lengths(question: Question, error: float) -> tuple[float, float]:
    """Return the mean number of pairs in a test, and how likely it ends in an alarm.

    Enumerated over the pairs and how many of them differ, of which there may be part `error`.
    """
    agreeing, differing = question.steps
    low, high = question.bounds
    going, pairs = np.ones(1), 0  # probability, by how many differ
    mean = alarm = 0.0
    while (chance := float(going.sum())) > NEGLIGIBLE:
        mean, pairs = mean + chance, pairs + 1
        going = np.append(going * (1 - error), 0.0) + np.append(0.0, going * error)
        differ = np.arange(pairs + 1)
        score = differ * differing + (pairs - differ) * agreeing
        alarm += float(going[score >= high].sum())
        going[(score <= low) | (score >= high)] = 0.0
    return mean, alarm


def pairs_to_alarm(question: Question, error: float) -> float:
    """Return the mean number of pairs until a test ends in an alarm; each begins afresh."""
    mean, alarm = lengths(question, error)
    return mean / alarm


def wald_pairs_to_alarm(question: Question, error: float) -> float:
    """Return the same by Wald's approximations (1945, (3.43), (3.57)): nothing overshoots."""
    low, high = question.bounds
    agreeing, differing = question.steps
    h = _exponent(question, error)
    alarm = (1 - exp(low * h)) / (exp(high * h) - exp(low * h))
    drift = error * differing + (1 - error) * agreeing
    return (alarm * high + (1 - alarm) * low) / drift / alarm


def _exponent(question: Question, error: float) -> float:
    """Return the h other than 0 with which the likelihood ratio to the power of h has mean 1."""
    agreeing, differing = question.steps

    def excess(h: float) -> float:
        return error * exp(differing * h) + (1 - error) * exp(agreeing * h) - 1

    drift = error * differing + (1 - error) * agreeing
    # The mean is convex in h, 1 at h = 0, and least where its derivative vanishes.
    least = log(-(1 - error) * agreeing / (error * differing)) / (differing - agreeing)
    far = least
    while excess(far) < 0:
        far += -1 if drift > 0 else 1
    near = least
    while abs(far - near) > ROOTS_WITHIN:
        middle = (near + far) / 2
        near, far = (middle, far) if excess(middle) < 0 else (near, middle)
    return near
