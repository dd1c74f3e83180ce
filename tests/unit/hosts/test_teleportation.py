"""Teleportation between whole stacks over loopback, with a real dispatcher."""

from dataclasses import replace
from math import exp, sqrt
from pathlib import Path
from typing import Any

import pytest
from stacks_scene import Judge, ask, grant, refusal

from wire.config import PathOptics
from wire.physics import BellAnalyser, Device, Memory

COUNT = 20_000


def test_every_state_arrives_over_ideal_fibres(tmp_path: Path) -> None:
    alice, bob = ask(tmp_path, "teleport", count=COUNT)
    for summary in (alice, bob):
        assert summary["states"] == summary["arrived"] == COUNT
        assert summary["fidelity"] == 1
        assert 0 < summary["waited_ms"] < 1000


@pytest.mark.parametrize("rotation", [1, 2, 3])
@pytest.mark.parametrize("path", [(4, 1), (5, 2)])
def test_a_known_rotation_is_undone(tmp_path: Path, path: tuple[int, int], rotation: int) -> None:
    physics = {"optics": [PathOptics(*path, rotation=rotation)]}
    alice, _bob = ask(tmp_path, "teleport", told(rotation), physics, count=2000)
    assert (alice["arrived"], alice["fidelity"]) == (2000, 1)


@pytest.mark.parametrize("rotation", [1, 2, 3])
def test_a_rotation_that_no_path_has_is_undone_all_the_same(tmp_path: Path, rotation: int) -> None:
    alice, _bob = ask(tmp_path, "teleport", told(rotation), count=2000)
    assert alice["fidelity"] == pytest.approx(1 / 3, abs=5 * sqrt(2 / 9 / 2000))


def told(rotation: int) -> Judge:
    """Return a controller that tells bob of a rotation."""
    return lambda setup: replace(grant(setup), rotation=rotation)


def test_depolarised_pairs_teleport_with_the_fidelity_of_theory(tmp_path: Path) -> None:
    share = 0.2  # of each photon, X, Y and Z each with probability share / 4
    _alice, bob = ask(tmp_path, "teleport", physics={"depolarizing": share}, count=COUNT)
    pair = (1 + 3 * (1 - share) ** 4) / 4  # each half passes two fibres
    fidelity = (2 * pair + 1) / 3
    assert abs(bob["fidelity"] - fidelity) < 5 * sqrt(fidelity * (1 - fidelity) / COUNT)


def test_waiting_in_memory_for_the_bits_costs_fidelity(tmp_path: Path) -> None:
    memory = Memory(t1_s=1e6, t2_s=0.02)
    physics = {"devices": {"bob": Device(memory=memory)}}
    _alice, bob = ask(tmp_path, "teleport", physics=physics, count=COUNT, block_pairs=1000)
    assert bob["fidelity"] < 0.995
    # Dephasing leaves the two states of Z alone.
    expected = 1 / 3 + 2 / 3 * (1 + exp(-bob["waited_ms"] / 1000 / memory.t2_s)) / 2
    assert bob["fidelity"] == pytest.approx(expected, abs=0.02)


def test_lost_light_is_not_counted_as_wrong(tmp_path: Path) -> None:
    alice, _bob = ask(tmp_path, "teleport", physics={"loss_db_per_km": 300.0}, count=COUNT)
    passed = 10 ** (-4 * 3 / 10)  # two fibres of 10 m for each half
    error = sqrt(passed * (1 - passed) / COUNT)
    assert abs(alice["arrived"] / COUNT - passed) < 5 * error
    assert alice["fidelity"] == 1


def test_linear_optics_teleport_half_of_the_states(tmp_path: Path) -> None:
    devices = {"alice": Device(analyser=BellAnalyser("linear"))}
    alice, _bob = ask(
        tmp_path, "teleport", physics={"devices": devices, "analyser": "linear"}, count=COUNT
    )
    assert abs(alice["arrived"] / COUNT - 0.5) < 5 * sqrt(0.25 / COUNT)
    assert alice["fidelity"] == 1


@pytest.mark.parametrize("state", ["0", "1", "+", "-", "+i", "-i"])
def test_one_state_can_be_asked_for(tmp_path: Path, state: str) -> None:
    alice, _bob = ask(tmp_path, "teleport", count=500, state=state)
    assert (alice["arrived"], alice["fidelity"]) == (500, 1)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"state": "up"}, "state 'up': choose one of random, 0, 1"),
        ({"count": 0}, "count is 0: choose 1 to"),
        ({"count": True}, "count is True: choose 1 to"),
        ({"colour": "red"}, "unknown or missing option"),
        ({"rate_hz": 100, "block_pairs": 1000}, "take more than 5 s"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_sent(
    tmp_path: Path, options: dict[str, Any], words: str
) -> None:
    assert words in refusal(tmp_path, "teleport", **options)


def test_an_unknown_service_is_refused(tmp_path: Path) -> None:
    words = "unknown service 'telepathy': choose one of"
    assert words in refusal(tmp_path, "telepathy")


def test_without_a_listening_application_there_is_no_session(tmp_path: Path) -> None:
    assert "no application listens on port 9" in refusal(tmp_path, "teleport")
