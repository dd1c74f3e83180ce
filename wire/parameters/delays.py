"""Delays of software that a user states: a number with its unit, or a distribution of such.

5ms, 200us, exponential(1ms) by its mean, uniform(1ms,3ms); queued(1ms): one after the other
ryu: a preset, whose source is in docs/time.md
"""

import re
from argparse import ArgumentTypeError
from collections.abc import Callable
from random import Random

UNITS_NS = {"ns": 1.0, "us": 1e3, "ms": 1e6, "s": 1e9}
MOST_NS = 10e9
PRESETS = {"ryu": "queued(350us)", "os-ken": "queued(560us)", "agent": "450us", "nox": "10ms"}
NUMBER = re.compile(r"(\d+(?:\.\d+)?)(ns|us|ms|s)")
DISTRIBUTION = re.compile(r"(exponential|uniform|queued)\(([^()]*)\)")
NUMBERS = {"": 1, "exponential": 1, "uniform": 2, "queued": 1}  # none: a constant


def delay(text: str) -> str:
    """Return a delay as the command line has it, "" for none; raise ArgumentTypeError."""
    if text:
        _parsed(text)
    return text


def draws(text: str, random: Random) -> Callable[[], int]:
    """Return what draws a delay in nanoseconds."""
    name, numbers = _parsed(text)
    if name == "exponential":
        return lambda: round(random.expovariate(1.0) * numbers[0])
    if name == "uniform":
        return lambda: round(random.uniform(*numbers))
    return lambda: round(numbers[0])


def is_queued(text: str) -> bool:
    """Return whether a program handles one message after the other."""
    return PRESETS.get(text, text).startswith("queued")


def _parsed(text: str) -> tuple[str, list[float]]:
    """Return the name of a distribution and its numbers in nanoseconds."""
    stated = PRESETS.get(text, text)
    distribution = DISTRIBUTION.fullmatch(stated)
    name, arguments = distribution.groups() if distribution else ("", stated)
    words = [NUMBER.fullmatch(word.strip()) for word in arguments.split(",")]
    numbers = [float(word[1]) * UNITS_NS[word[2]] for word in words if word]
    fits = len(numbers) == len(words) == NUMBERS[name]
    if not fits or max(numbers) > MOST_NS or numbers != sorted(numbers):
        raise ArgumentTypeError(
            f"{text}: write 5ms, 200us, exponential(1ms), uniform(1ms,3ms) or queued(1ms), "
            f"at most 10s, or {', '.join(PRESETS)}"
        )
    return name, numbers
