"""Blocking in networks: formulas against Markov chains that are solved, and the arbiter's."""

from collections.abc import Sequence
from itertools import product
from math import factorial

import numpy as np
import pytest

from evidence.curves.catalogue import EXPERIMENTS, measure
from evidence.curves.estimates import Estimate
from evidence.traffic.erlang import blocked_on_links, erlang_b, kaufman_roberts, reduced_load

SESSIONS = 600


def solved(
    loads: Sequence[float], needs: Sequence[Sequence[int]], channels: Sequence[int]
) -> list[float]:
    """Return who is blocked how often, by the stationary state of the chain's rates.

    needs[k][j] is how many channels of link j a session of class k takes.
    """
    most = max(channels)

    def fits(state: tuple[int, ...]) -> bool:
        taken = np.array(state) @ np.array(needs)
        return bool((taken <= channels).all())

    states = [state for state in product(range(most + 1), repeat=len(loads)) if fits(state)]
    place = {state: number for number, state in enumerate(states)}
    rates = np.zeros((len(states), len(states)))
    for state, kind in product(states, range(len(loads))):
        more = tuple(n + (k == kind) for k, n in enumerate(state))
        if more in place:
            rates[place[state], place[more]] = loads[kind]
            rates[place[more], place[state]] = more[kind]
    balance = (rates - np.diag(rates.sum(axis=1))).T
    balance[-1] = 1.0
    likely = np.linalg.solve(balance, np.eye(len(states))[-1])
    return [
        sum(
            float(likely[place[state]])
            for state in states
            if tuple(n + (k == kind) for k, n in enumerate(state)) not in place
        )
        for kind in range(len(loads))
    ]


@pytest.mark.parametrize("channels", [1, 2, 5])
def test_sessions_of_one_channel_are_blocked_as_erlang_says(channels: int) -> None:
    weights = [1.7**n / factorial(n) for n in range(channels + 1)]
    expected = pytest.approx([weights[-1] / sum(weights)])
    assert kaufman_roberts([1.7], [1], channels) == expected
    assert blocked_on_links([1.7], [[0]], [channels]) == expected
    assert reduced_load([1.7], [[0]], [channels]) == expected


@pytest.mark.parametrize("loads", [(1.0, 0.5), (3.0, 2.0)])
@pytest.mark.parametrize("needs", [(1, 2), (2, 3), (1, 6)])
def test_sessions_of_several_channels_are_blocked_as_the_markov_chain_says(
    loads: tuple[float, ...], needs: tuple[int, ...]
) -> None:
    expected = solved(loads, [[need] for need in needs], [5])
    assert kaufman_roberts(loads, needs, 5) == pytest.approx(expected)


def test_sessions_over_several_links_are_blocked_as_the_markov_chain_says() -> None:
    loads, routes, channels = (1.0, 1.5, 0.7), ([0, 1], [0], [1]), (3, 2)
    needs = [[int(link in route) for link in range(2)] for route in routes]
    expected = solved(loads, needs, channels)
    assert blocked_on_links(loads, routes, channels) == pytest.approx(expected)


def test_reduced_load_is_a_fixed_point_that_is_near() -> None:
    """Links of which each has what the other lets through, and Erlang's blocking for that."""
    (blocked,) = reduced_load([4.0], [[0, 1]], [3, 3])
    full = 1 - (1 - blocked) ** 0.5
    assert full == pytest.approx(erlang_b(4.0 * (1 - full), 3))
    many = [[*range(4)], *([link] for link in range(4))]
    near = reduced_load([0.3] * 5, many, [4] * 4)
    assert near == pytest.approx(blocked_on_links([0.3] * 5, many, [4] * 4), abs=0.01)


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("name", ["links", "several-fibers"])
def test_the_arbiter_blocks_as_theory_says(name: str) -> None:
    values = EXPERIMENTS[name].complete({"load": 3.0, "channels": 2, "sessions": SESSIONS})
    outcome = measure(name, values, 3)
    for each in EXPERIMENTS[name].measures:
        expected, found = each.theory(values), Estimate(*outcome[each.name])
        assert expected is not None
        assert 0.1 < expected < 0.9
        assert found.agrees(expected)
        assert found.error < 0.09
