"""Links and spans that are purified before they are swapped: whole stacks over loopback, seed 1.

Beside the maps of both protocols on Bell-diagonal pairs, and of swaps: Pauli errors convolve.
"""

from functools import partial, reduce
from pathlib import Path
from typing import Any

import pytest
from bell_pairs import Bell, convolved, near
from chain_scene import nodes, order_swaps, swapped
from test_distribution import bbpssw, dejmps, werner

from controller_apps.policy.schedules import Purification, Span, spans
from wire.parameters.physics import Device, PairSource

FIDELITY = 0.92


def purified(protocol: str, rounds: int, pair: Bell) -> Bell:
    """Return a pair after a number of rounds of a protocol on pairs like it."""
    for _round in range(rounds):
        pair = dejmps(pair)[0] if protocol == "dejmps" else werner(bbpssw(pair[0])[0])
    return pair


def physics(schedule: str, protocol: str, rounds: int, repeaters: int) -> dict[str, Any]:
    """Return a chain whose sources make Werner pairs, under a plan."""
    devices = {name: Device(source=PairSource(fidelity=FIDELITY)) for name in nodes(repeaters)[:-1]}
    plan = Purification(protocol, rounds)
    return {
        "order": partial(order_swaps, schedule=schedule, purification=plan),
        "devices": devices,
    }


@pytest.mark.parametrize(
    ("schedule", "protocol", "rounds", "repeaters"),
    [
        ("nested", "dejmps", 1, 3),
        ("nested", "bbpssw", 1, 1),
        ("left-to-right", "dejmps", 1, 2),
        ("parallel", "dejmps", 2, 2),
        ("nested", "dejmps", 1, 1),
    ],
)
def test_chains_have_the_fidelity_of_the_plan(
    tmp_path: Path, schedule: str, protocol: str, rounds: int, repeaters: int
) -> None:
    """Level by level: purify, then join two by two, or one link more, or all at once."""
    better = partial(purified, protocol, rounds)
    link = better(werner(FIDELITY))
    if schedule == "nested" and repeaters == 3:
        half = better(convolved(link, link))
        expected = convolved(half, half)
    elif schedule == "left-to-right":
        expected = convolved(better(convolved(link, link)), link)
    else:
        expected = reduce(convolved, [link] * (repeaters + 1))
    scene = physics(schedule, protocol, rounds, repeaters)
    options = {"count": 200, "sample": 0.8, "purification": "none"}
    alice, bob = swapped(tmp_path, repeaters, physics=scene, **options)
    assert alice["pairs"] == bob["pairs"] == 200
    assert alice["sampled"] >= 700
    assert near(alice, expected)
    assert alice["span_rounds"] == rounds


def test_pairs_that_are_purified_between_swaps_are_better_than_those_that_are_not() -> None:
    """Briegel, Duer, Cirac and Zoller, of four links: it is what a nested order is for."""
    link = purified("dejmps", 1, werner(FIDELITY))
    half = convolved(link, link)
    nested = convolved(purified("dejmps", 1, half), purified("dejmps", 1, half))
    assert nested[0] > convolved(half, half)[0] > reduce(convolved, [werner(FIDELITY)] * 4)[0]


def test_spans_of_a_nested_chain_double() -> None:
    purified_spans, made = spans("nested", 3)
    links = [Span(place, place + 1) for place in range(4)]
    assert purified_spans == [*links, Span(0, 2), Span(2, 4)]
    assert made == [(1, Span(0, 2)), (3, Span(2, 4)), (2, Span(0, 4))]


def test_spans_grow_from_the_left_or_are_links_alone() -> None:
    links = [Span(place, place + 1) for place in range(4)]
    assert spans("left-to-right", 3)[0] == [*links, Span(0, 2), Span(0, 3)]
    assert spans("parallel", 3)[0] == links


@pytest.mark.by_day(every=4)
@pytest.mark.parametrize("schedule", ["nested", "left-to-right"])
@pytest.mark.parametrize("protocol", ["bbpssw", "dejmps"])
def test_blocks_that_follow_each_other_are_purified_each_by_itself(
    tmp_path: Path, schedule: str, protocol: str
) -> None:
    """Four at a time, at the same nodes: what is set aside of one is never another's."""
    scene = physics(schedule, protocol, 1, 2)
    options = {"count": 150, "sample": 0.8, "purification": "none", "block_pairs": 150}
    alice, bob = swapped(tmp_path, 2, physics=scene, **options)
    link = purified(protocol, 1, werner(FIDELITY))
    pair = purified(protocol, 1, convolved(link, link))
    assert alice["pairs"] == bob["pairs"] == 150
    assert alice["emitted"] >= 4 * 150
    assert near(alice, convolved(pair, link))
