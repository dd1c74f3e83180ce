"""Closed forms of traffic theory, for Poisson arrivals (A. K. Erlang, 1917).

`load` is in erlang: arrivals in a mean holding time. L. Kleinrock, Queueing Systems I, sections 3.4
and 3.5.
"""

from math import exp


def erlang_b(load: float, channels: int) -> float:
    """Return the share of the arrivals that find all channels taken, if those go away.

    It holds for holding times of any distribution.
    """
    blocked = 1.0
    for number in range(1, channels + 1):
        blocked = load * blocked / (number + load * blocked)
    return blocked


def erlang_c(load: float, channels: int) -> float:
    """Return the share of the arrivals that have to wait, if they wait in a queue; 1 if overloaded.

    For exponential holding times, first come first served.
    """
    if load >= channels:
        return 1.0
    blocked = erlang_b(load, channels)
    return blocked / (1 - load / channels * (1 - blocked))


def mean_wait(load: float, channels: int, holding_s: float) -> float:
    """Return how long (s) an arrival waits on average, those that do not wait included."""
    return erlang_c(load, channels) * holding_s / (channels - load)


def waits_longer(load: float, channels: int, holding_s: float, time_s: float) -> float:
    """Return the share of the arrivals that wait longer than a time."""
    return erlang_c(load, channels) * exp(-(channels - load) * time_s / holding_s)
