"""Passages of many photons for noise models, and bounds of 5 standard errors; the seed is 1."""

from dispatcher.fiber.noise import NoiseHistory, Passage, Pattern, Schedule
from dispatcher.sabot.draws import Draws

COUNT = 200_000
START_NS = 1_700_000_000_000_000_000
DRAWS = Draws(1)


def passage(
    photons: int = COUNT,
    interval_ns: float = 20.0,
    first_ns: int = START_NS,
    history: NoiseHistory | None = None,
    number: int = 0,
    depth: int = 1_000_000,
) -> Passage:
    """Return the passage of block `number` of session 7."""
    schedule = Schedule(first_ns, Pattern(interval_ns, photons))
    return Passage(DRAWS, (7, number, 0), "here", schedule, history or NoiseHistory(depth))


def within(found: int, probability: float, count: int = COUNT) -> bool:
    """Return whether a count is what a probability lets expect, within 5 sigma."""
    sigma = (count * probability * (1 - probability)) ** 0.5
    return bool(abs(found - count * probability) <= 5 * sigma)
