"""Swapped pairs against closed forms, within 5 standard errors; whole stacks, seed 1."""

import asyncio
from functools import partial, reduce
from math import sqrt
from pathlib import Path
from typing import Any

import pytest
from bell_pairs import Bell, convolved, dephased, near
from chain_scene import nodes, order_swaps, swapped
from stacks_scene import Change

from wire.metadata import Message, Topic, Values
from wire.physics import BellAnalyser, Device, Memory, PairSource

COUNT = 2000
SAMPLE = 0.8
# No two coefficients of a pair are alike: what is exchanged by mistake is seen.
LINKS: list[Bell] = [
    (0.9, 0.06, 0.03, 0.01),
    (0.88, 0.02, 0.01, 0.09),
    (0.92, 0.005, 0.07, 0.005),
    (0.93, 0.01, 0.02, 0.04),
]


@pytest.mark.parametrize("repeaters", [1, 2, 3])
def test_ideal_pairs_come_by_way_of_repeaters(tmp_path: Path, repeaters: int) -> None:
    alice, bob = swapped(tmp_path, repeaters, count=COUNT, block_pairs=1000)
    for summary in (alice, bob):
        assert (summary["pairs"], summary["fidelity"]) == (COUNT, 1)
        assert summary["shared"] == summary["emitted"]
    assert 0 < bob["waited_ms"] < 1000


@pytest.mark.parametrize("repeaters", [1, 2, 3])
def test_noisy_links_make_the_pairs_of_the_pauli_convolution(
    tmp_path: Path, repeaters: int
) -> None:
    links = LINKS[: repeaters + 1]
    devices = {
        node: Device(source=PairSource(bell_diagonal=bell))
        for node, bell in zip(nodes(repeaters), links, strict=False)
    }
    physics = {"devices": devices}
    alice, bob = swapped(tmp_path, repeaters, physics=physics, count=COUNT, sample=SAMPLE)
    assert near(alice, reduce(convolved, links))
    assert bob["fidelity"] == alice["fidelity"]


def test_the_pairs_of_a_chain_are_purified_until_they_are_as_good_as_is_asked(
    tmp_path: Path,
) -> None:
    devices = {node: Device(source=PairSource(fidelity=0.93)) for node in ("alice", "r1")}
    physics = {"devices": devices}
    alice, _bob = swapped(tmp_path, 1, physics=physics, count=COUNT, fidelity=0.9)
    assert alice["rounds"] == 1
    assert (alice["pairs"], alice["fidelity"] >= 0.9) == (COUNT, True)


@pytest.mark.parametrize("repeaters", [1, 3])
def test_losses_make_pairs_fewer_and_not_worse(tmp_path: Path, repeaters: int) -> None:
    """Each link loses 3 of 4; there are as many pairs as the poorest link has."""
    physics = {"loss_db_per_km": 300.0}
    alice, _bob = swapped(tmp_path, repeaters, physics=physics, count=COUNT, block_pairs=1000)
    assert alice["fidelity"] == 1
    passed = 10 ** (-2 * 3 / 10)  # two fibres of 10 m
    error = sqrt(passed * (1 - passed) / 1000)
    below = {1: 0.564, 3: 1.029}[repeaters]  # least of 2 and of 4 normal variables, on average
    blocks = alice["emitted"] / 1000
    assert abs(alice["shared"] / alice["emitted"] - passed + below * error) < 5 * error / sqrt(
        blocks
    )


def test_repeaters_of_linear_optics_join_half_of_the_pairs_each(tmp_path: Path) -> None:
    devices = {node: Device(analyser=BellAnalyser("linear")) for node in nodes(2)}
    physics = {"devices": devices, "analyser": "linear"}
    alice, _bob = swapped(tmp_path, 2, physics=physics, count=COUNT)
    assert alice["fidelity"] == 1
    share, emitted = alice["shared"] / alice["emitted"], alice["emitted"]
    assert abs(share - 1 / 4) < 5 * sqrt(3 / 16 / emitted)


def late(delay_s: float) -> Change:
    """Hold back the bits of swaps."""

    async def pass_on(message: Message) -> Message:
        if isinstance(message, Values) and message.topic == Topic.CORRECTIONS:
            await asyncio.sleep(delay_s)
        return message

    return lambda _way, message: pass_on(message)


@pytest.mark.parametrize(("after_left", "waits"), [(False, 4), (True, 6)])
def test_bits_that_are_late_cost_fidelity(tmp_path: Path, after_left: bool, waits: int) -> None:
    """Two repeaters; alice's and bob's halves wait for two messages.

    If the second swaps after the first, its two halves wait for one, too.
    """
    late_s, memory = 0.3, Memory(t1_s=1e6, t2_s=3.0)
    devices = {node: Device(memory=memory) for node in nodes(2)}
    physics: dict[str, Any] = {"devices": devices, "change": late(late_s)}
    physics["order"] = partial(order_swaps, after_left=after_left)
    options = {"count": COUNT, "sample": SAMPLE, "block_pairs": 16_384}
    alice, bob = swapped(tmp_path, 2, physics=physics, **options)
    assert bob["waited_ms"] == pytest.approx(2000 * late_s, abs=150)
    assert alice["fidelity"] == pytest.approx(dephased(waits * late_s / 3)[0], abs=0.035)
