"""The sessions of a traffic model: when who asks whom, and how long it holds what it gets.

Times are seconds of the network. Every choice follows from the seed.
"""

import csv
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from heapq import merge
from itertools import islice
from math import inf
from pathlib import Path
from random import Random

ENDS, OTHERS = {"opener", "acceptor"}, "others"  # columns of either file
OF_TRACE = {*ENDS, "at_s"}
COLUMNS = {*OF_TRACE, OTHERS, "holding_s", "deadline_s", "priority"}
OF_MATRIX = {*ENDS, "rate_per_s"}
MOST_SESSIONS = 100_000
MOST_PRIORITY = 255


class BadTraffic(ValueError):
    """A model or file that no sessions follow from; the message names value and remedy."""


@dataclass(frozen=True)
class Planned:
    """A session that will be asked for; opener and acceptor "": hosts that are idle then."""

    at_s: float
    opener: str
    acceptor: str
    holding_s: float
    deadline_s: float | None = None  # until it must have light; None: it waits as its options say
    priority: int = 0  # the higher the sooner, if the controller's policy orders by it
    others: tuple[str, ...] = ()  # further hosts of it, of a line in its order


@dataclass(frozen=True)
class Traffic:
    openers: Sequence[str]
    acceptors: Sequence[str]
    rate_per_s: float
    holding_s: float
    constant: bool = False  # holding times, else exponential
    deadline_s: float | None = None
    urgent: float = 0.0  # share of the sessions that have a priority of 1
    idle: bool = False  # whether hosts are chosen that are idle then
    on_s: float = 1.0  # mean, of on-off
    off_s: float = 1.0
    file: Path | None = None
    hosts: int = 2  # that take part in a session


def poisson(traffic: Traffic, random: Random) -> Iterator[Planned]:
    """Yield sessions of a Poisson process; the hosts are any, all alike."""
    now = 0.0
    while True:
        now += random.expovariate(traffic.rate_per_s)
        yield planned(traffic, random, now, ends(traffic, random))


def on_off(traffic: Traffic, random: Random) -> Iterator[Planned]:
    """Yield sessions of openers that ask in bursts; the mean rate is as without them.

    On and off times are exponential, and each opener begins off.
    """
    share = traffic.on_s / (traffic.on_s + traffic.off_s)
    rate = traffic.rate_per_s / len(traffic.openers) / share

    def bursts(opener: str, generator: Random) -> Iterator[tuple[float, str]]:
        now = 0.0
        while True:
            now += generator.expovariate(1 / traffic.off_s)
            end = now + generator.expovariate(1 / traffic.on_s)
            while (now := now + generator.expovariate(rate)) < end:
                yield now, opener
            now = end

    requests = merge(*(bursts(opener, Random(random.random())) for opener in traffic.openers))  # noqa: S311
    for at_s, opener in requests:
        yield planned(traffic, random, at_s, with_others(traffic, random, opener))


def matrix(traffic: Traffic, random: Random) -> Iterator[Planned]:
    rows = list(rows_of(traffic, OF_MATRIX, {*OF_MATRIX, OTHERS}))
    rates = [number(traffic, row, "rate_per_s", 0.0) for row in rows]
    if not sum(rates):
        raise BadTraffic(f"{traffic.file} names no rate above 0")
    now = 0.0
    while True:
        now += random.expovariate(sum(rates))
        (row,) = random.choices(rows, rates)
        yield planned(traffic, random, now, hosts_of(traffic, random, row))


def trace(traffic: Traffic, random: Random) -> Iterator[Planned]:
    """Yield the sessions of a file, in its order of time."""
    rows = sorted(
        rows_of(traffic, OF_TRACE, COLUMNS), key=lambda row: number(traffic, row, "at_s", 0.0)
    )
    for row in rows:
        at_s = number(traffic, row, "at_s", 0.0)
        session = planned(traffic, random, at_s, hosts_of(traffic, random, row))
        holding_s = number(traffic, row, "holding_s", session.holding_s)
        deadline_s = number(traffic, row, "deadline_s", session.deadline_s or inf)
        deadline = None if deadline_s == inf else deadline_s
        priority = number(traffic, row, "priority", session.priority)
        if priority not in range(MOST_PRIORITY + 1):
            raise BadTraffic(f"{traffic.file}: priority {priority:g}: choose 0 to {MOST_PRIORITY}")
        timed = replace(session, holding_s=holding_s, deadline_s=deadline)
        yield replace(timed, priority=int(priority))


MODELS: dict[str, Callable[[Traffic, Random], Iterator[Planned]]] = {
    "poisson": poisson,
    "on-off": on_off,
    "matrix": matrix,
    "trace": trace,
}


def plan(model: str, traffic: Traffic, seed: int, sessions: int) -> list[Planned]:
    """Return `count` sessions, or those of a trace; raise BadTraffic for none."""
    schedule = list(islice(MODELS[model](traffic, Random(seed)), sessions))  # noqa: S311
    if not schedule:
        raise BadTraffic(f"{traffic.file} names no sessions")
    for session in schedule:
        if session.opener and session.opener == session.acceptor:
            raise BadTraffic(f"{traffic.file}: {session.opener} asks itself; name two hosts")
    return schedule


def planned(traffic: Traffic, random: Random, at_s: float, hosts: Sequence[str]) -> Planned:
    mean_s = traffic.holding_s
    held = mean_s if traffic.constant or not mean_s else random.expovariate(1 / mean_s)
    urgent = int(random.random() < traffic.urgent) if traffic.urgent else 0
    opener, acceptor, *others = hosts
    return Planned(at_s, opener, acceptor, held, traffic.deadline_s, urgent, tuple(others))


def ends(traffic: Traffic, random: Random) -> list[str]:
    """Return the hosts of a session, none if they are chosen later."""
    if traffic.idle:
        return ["", ""]
    return with_others(traffic, random, random.choice(traffic.openers))


def with_others(traffic: Traffic, random: Random, *first: str) -> list[str]:
    hosts = list(first)
    while len(hosts) < traffic.hosts:
        hosts.append(random.choice([host for host in traffic.acceptors if host not in hosts]))
    return hosts


def hosts_of(traffic: Traffic, random: Random, row: dict[str, str]) -> list[str]:
    """Return the hosts of a row's session; those that it does not name are drawn."""
    others = (row.get(OTHERS) or "").split()
    named = [row["opener"], row["acceptor"], *others]
    if not others:
        return with_others(traffic, random, *named)
    if len(named) != traffic.hosts or len(set(named)) < len(named):
        raise BadTraffic(
            f"{traffic.file}: {', '.join(named)}: a session has {traffic.hosts} hosts, each once"
        )
    return named


def rows_of(traffic: Traffic, needed: set[str], possible: set[str]) -> list[dict[str, str]]:
    """Return the rows of the CSV file; raise BadTraffic for columns or hosts there are not."""
    if traffic.file is None:
        raise BadTraffic(f"name a file with the columns {', '.join(sorted(needed))}")
    try:
        with traffic.file.open(newline="") as file:
            rows = list(csv.DictReader(file, strict=True))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise BadTraffic(f"cannot read {traffic.file}: {error}") from error
    columns = set(rows[0]) if rows else needed
    if not needed <= columns <= possible:
        more = ", ".join(sorted(possible - needed)) or "no more"
        raise BadTraffic(
            f"{traffic.file} has the columns {', '.join(map(str, rows[0]))}: it needs "
            f"{', '.join(sorted(needed))}, and may have {more}"
        )
    for row in rows:
        named = [("opener", row["opener"], traffic.openers)]
        asked = row["acceptor"], *(row.get(OTHERS) or "").split()
        named += [("acceptor", host, traffic.acceptors) for host in asked]
        for end, host, hosts in named:
            if host not in hosts:
                raise BadTraffic(f"{traffic.file}: {end} {host!r} is not one of {', '.join(hosts)}")
    return rows


def number(traffic: Traffic, row: dict[str, str], column: str, default: float) -> float:
    """Return a number of a row that is not below 0; raise BadTraffic for another."""
    text = row.get(column)
    if text is None or text == "":
        return default
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value < inf:
        raise BadTraffic(f"{traffic.file}: {column} {text!r} is not a number from 0 on")
    return value
