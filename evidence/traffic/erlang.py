"""Closed forms of traffic theory, for Poisson arrivals (A. K. Erlang, 1917).

`load` is in erlang: arrivals in a mean holding time. L. Kleinrock, Queueing Systems I, sections 3.4
and 3.5.
"""

from collections.abc import Sequence
from itertools import product
from math import factorial, prod

MOST_STEPS, CLOSE = 10_000, 1e-12  # until a fixed point is found


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


def kaufman_roberts(loads: Sequence[float], needs: Sequence[int], channels: int) -> list[float]:
    """Return the share of each class that is blocked, if each of its sessions needs several.

    The recursion of J. S. Kaufman (1981) and J. W. Roberts (1981): c q(c) is the sum over classes
    of a b q(c - b), where q tells how often c channels are taken. Holding times are of any
    distribution.
    """
    taken = [1.0]
    for count in range(1, channels + 1):
        before = (
            load * need * taken[count - need]
            for load, need in zip(loads, needs, strict=True)
            if need <= count
        )
        taken.append(sum(before) / count)
    total = sum(taken)
    return [sum(taken[max(channels - need + 1, 0) :]) / total for need in needs]


def blocked_on_links(
    loads: Sequence[float], routes: Sequence[Sequence[int]], channels: Sequence[int]
) -> list[float]:
    """Return the share of each class that is blocked, if it needs a channel of each of its links.

    Enumerated: how many sessions of each class there are at a time is as if they were independent
    and of Poisson distribution, but for what does not fit (F. P. Kelly, Loss networks, 1991).
    """
    total, blocked = 0.0, [0.0] * len(loads)
    for counts in product(*(range(min(channels[link] for link in r) + 1) for r in routes)):
        taken = [0] * len(channels)
        for count, route in zip(counts, routes, strict=True):
            for link in route:
                taken[link] += count
        if any(used > there for used, there in zip(taken, channels, strict=True)):
            continue
        weight = prod(load**n / factorial(n) for load, n in zip(loads, counts, strict=True))
        total += weight
        for number, route in enumerate(routes):
            if any(taken[link] == channels[link] for link in route):
                blocked[number] += weight
    return [each / total for each in blocked]


def reduced_load(
    loads: Sequence[float], routes: Sequence[Sequence[int]], channels: Sequence[int]
) -> list[float]:
    """Return the same by the reduced-load approximation, as if links were independent.

    Each link has Erlang's blocking for what the others of a route let through (Kelly, 1991): the
    fixed point, which is the only one.
    """
    full = [0.0] * len(channels)
    for _ in range(MOST_STEPS):
        before = list(full)
        for link, there in enumerate(channels):
            reduced = (
                load * prod(1 - full[other] for other in route if other != link)
                for load, route in zip(loads, routes, strict=True)
                if link in route
            )
            full[link] = (full[link] + erlang_b(sum(reduced), there)) / 2  # damped: it converges
        if max(abs(a - b) for a, b in zip(full, before, strict=True)) < CLOSE:
            break
    return [1 - prod(1 - full[link] for link in route) for route in routes]
