"""Schedulers of light against closed forms, on a trunk of one fibre in counted time; seed 1.

Averages within five standard errors, between batches of sessions one after the other.
"""

import asyncio
from collections.abc import Sequence
from math import sqrt
from random import Random
from statistics import fmean, stdev

import pytest

from controller_apps.policy.schedules import Queue
from controller_apps.sessions.arbiter import Arbiter
from evidence.curves.catalogue import EXPERIMENTS
from evidence.curves.contention import FOR_EVER_S, PAIRS, address, trunk
from evidence.curves.experiment import Outcome
from evidence.curves.scheduling import address as address_of
from evidence.curves.scheduling import away, network_of, requests, schedule
from evidence.traffic.counted import Asked, CountedTime, Fate
from topologies.catalogue.maps import read_map

SESSIONS = 1_500
BATCHES = 20


def fates(
    requests: Sequence[Asked], queue: Queue, channels: int = 1, away_s: float = 0.0
) -> list[Fate]:
    arbiter = Arbiter(trunk(channels), FOR_EVER_S, FOR_EVER_S, queues=True, order=queue)
    return CountedTime(arbiter, lambda _place: away_s).run(requests)


def poisson(load: float, random: Random, constant: bool = False) -> list[Asked]:
    """Return requests of a mean holding time of 1 s, a third of them urgent."""
    now, found = 0.0, []
    for number in range(SESSIONS):
        now += random.expovariate(load)
        ends = address(0, number % PAIRS), address(1, number % PAIRS)
        holding_s = 1.0 if constant else random.expovariate(1.0)
        found.append(Asked(now, *ends, holding_s, priority=int(random.random() < 1 / 3)))
    return found


def agrees(values: Sequence[float], wanted: float) -> bool:
    size = len(values) // BATCHES
    means = [fmean(values[at : at + size]) for at in range(size, BATCHES * size, size)]
    return abs(fmean(means) - wanted) < 5 * stdev(means) / sqrt(len(means))


@pytest.mark.nightly
def test_priorities_wait_as_cobham_says() -> None:
    """Non-preemptive priorities, M/M/1: W_k = rho / ((1 - s_k) (1 - s_k-1)), s_k their loads.

    A. Cobham, Operations Research 2, 70 (1954).
    """
    load = 0.7
    found = fates(poisson(load, Random(1)), Queue("edf"))
    waits = [[each.waited_s or 0.0 for each in found if each.asked.priority == p] for p in (1, 0)]
    urgent = load / 3
    assert agrees(waits[0], load / (1 - urgent))
    assert agrees(waits[1], load / ((1 - load) * (1 - urgent)))
    same = fates(poisson(load, Random(1)), Queue("fcfs"))
    every = [each.waited_s or 0.0 for each in same if each.asked.priority]
    assert agrees(every, load / (1 - load))  # M/M/1, for any hosts
    assert not agrees(waits[0], load / (1 - load))


def test_by_earliest_deadline_none_is_late_if_none_need_be() -> None:
    """J. R. Jackson (1955): with all there at once, the n-th deadline must leave time for n - 1."""
    random = Random(1)
    slack = sorted(random.uniform(n, n + 3) for n in range(1, 41))
    deadlines = random.sample(slack, len(slack))
    requests = [
        Asked(0.0, address(0, n), address(1, n), 1.0, deadline_s=deadline)
        for n, deadline in enumerate(deadlines)
    ]
    assert not any(each.reason for each in fates(requests, Queue("edf")))
    late = [each for each in fates(requests, Queue("fcfs")) if each.reason]
    assert late
    assert {each.reason for each in late} == {"TOO_LATE"}


def test_who_has_no_light_within_its_slot_since_switches_are_far_is_too_late() -> None:
    """A barrier takes 80 ms there and back, a slot 30: nobody ever has light, all are answered."""
    ends = address(0, 0), address(1, 0)
    requests = [Asked(at_s, *ends, 0.01, deadline_s=0.5) for at_s in (0.0, 1.0, 2.0)]
    found = fates(requests, Queue("slots", 0.03), away_s=0.04)
    assert [each.reason for each in found] == ["TOO_LATE"] * 3
    (alone,) = fates([Asked(0.0, *ends, 0.01)], Queue("slots", 0.3), away_s=0.04)
    assert alone.waited_s == pytest.approx(0.3 + 5 * 0.04)  # slot 1, a barrier, three ways


@pytest.mark.nightly
def test_slots_wait_as_a_slotted_queue_does() -> None:
    """Poisson arrivals, one slot each: half a slot until one begins, and load / (2 (1 - load)).

    L. Kleinrock, Queueing Systems II, section 6.1 (TDMA by M/D/1).
    """
    load = 0.6
    requests = [
        Asked(each.at_s, each.opener, each.acceptor, 0.3)
        for each in poisson(load, Random(1), constant=True)
    ]
    waits = [each.waited_s or 0.0 for each in fates(requests, Queue("slots", 1.0))]
    assert agrees(waits, 0.5 + load / (2 * (1 - load)))
    assert not agrees(waits, load / (2 * (1 - load)))


def test_who_is_admitted_to_a_slot_has_it_in_time_and_others_hear_at_once() -> None:
    requests = [
        Asked(each.at_s, each.opener, each.acceptor, 1.0, deadline_s=2.5)
        for each in poisson(1.5, Random(1), constant=True)[:600]
    ]
    found = fates(requests, Queue("slots", 1.0))
    admitted = [each for each in found if each.light_s is not None]
    assert 300 < len(admitted) < 450  # of 400 slots, about
    assert all(each.waited_s is not None and each.waited_s <= 2.5 for each in admitted)
    begins = [each.light_s or 0.0 for each in admitted]
    assert begins == sorted(set(begins))  # one at a time
    assert begins == pytest.approx([round(begin) for begin in begins])
    refused = [each for each in found if each.reason]
    assert len(admitted) + len(refused) == len(found)
    assert {each.reason for each in refused} == {"TOO_LATE"}


def test_two_fibres_carry_two_in_a_slot() -> None:
    requests = [Asked(0.0, address(0, n), address(1, n), 0.3) for n in range(6)]
    found = fates(requests, Queue("slots", 0.5), channels=2)
    assert [each.light_s for each in found] == pytest.approx([0.5, 0.5, 1.0, 1.0, 1.5, 1.5])


def test_light_is_there_when_messages_have_gone_their_ways() -> None:
    """To the controller, to the switches and back, to the acceptor and back, to the opener."""
    (found,) = fates([Asked(1.0, address(0, 0), address(1, 0), 1.0)], Queue(), away_s=0.01)
    assert found.waited_s == pytest.approx(0.01 * (1 + 2 + 2 + 1))


def test_the_controller_on_a_map_is_as_far_away_as_its_fibres_are_long() -> None:
    """Where nobody waits: four ways to the ends, and two to the farthest switch at most."""
    quiet: dict[str, float | int | str] = {
        "rate_per_s": 0.1,
        "holding_s": 0.01,
        "sessions": 400,
        "deadline_s": 600.0,
    }
    off = outcome(signalling="off", **quiet)
    assert (off["in_time"].value, off["wait"].value) == (1.0, 0.0)
    read = read_map("abilene")
    _network, switches = network_of(read)
    away_s = away(read, switches)
    assert min(away_s.values()) == 0.0
    values = EXPERIMENTS["schedule"].complete(quiet)
    asked = requests(values, [address_of(n) for n in switches.values()], Random(1))
    ends_s = fmean(2 * (away_s[each.opener] + away_s[each.acceptor]) for each in asked)
    on = outcome(**quiet)
    assert ends_s < on["wait"].value < ends_s + 2 * max(away_s.values())


def outcome(**given: float | str) -> Outcome:
    values = EXPERIMENTS["schedule"].complete({"map": "abilene", **given})
    return asyncio.run(schedule(values, seed=1))
