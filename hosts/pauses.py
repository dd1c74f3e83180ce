"""Pauses between requests for light that others have, which grow: fewer ask a busy controller."""

from collections.abc import Iterator
from random import Random

from hosts.timeouts import LONGEST_RETRY_PAUSE_S, RETRY_PAUSE_S


def growing_pauses(asker: str) -> Iterator[float]:
    """Yield pauses in seconds, each half to all of a time that doubles up to the longest.

    Random, so that hosts that were refused together do not ask together again (exponential back-off
    with jitter); by the name of who asks, so that each asker's are its own, and can be had again.
    Long waits end in equal pauses: the longest is the same for all.
    """
    chance = Random(asker)  # noqa: S311
    most_s = RETRY_PAUSE_S
    while True:
        yield most_s * chance.uniform(0.5, 1.0)
        most_s = min(2 * most_s, LONGEST_RETRY_PAUSE_S)
