"""Keys by pairs with a CHSH test, over loopback; the seed is 1.

Depolarising of p leaves 1 - p of all correlations: S = 2 sqrt 2 (1 - p). Measuring a part f in Z or
X leaves half of the correlations of these: S = 2 sqrt 2 (1 - f / 2).
"""

import asyncio
from dataclasses import replace
from math import sqrt
from pathlib import Path
from typing import Any

import pytest
from limits import SOON_S
from stacks_scene import Judge, ask, grant, network, requested

from hosts import network_loop
from hosts.service_socket import ServiceSocket
from hosts.stack_socket import QuantumSocketError
from wire.config import PathOptics
from wire.metadata.setup import Setup
from wire.outcomes import Pauli

PATHS, BY_EVE = [(4, 1), (5, 2)], [(4, 1), (5, 6), (7, 2)]
FIBERS = 4  # that both halves of a pair have passed together
COUNT = 30_000


def e91(folder: Path, judge: Judge = grant, **words: Any) -> list[dict[str, Any]]:
    """Return the results of both ends; `physics` are words for the fibres."""
    physics = {"paths": PATHS, **words.pop("physics", {})}
    return ask(folder, "e91", judge, physics, **{"count": COUNT, **words})


def error(s: float, pairs: int) -> float:
    """Return the standard error of S, of four correlations of S/(2 sqrt 2 sqrt 2) each."""
    return sqrt(16 * (1 - (s / 4) ** 2) / pairs)


@pytest.mark.parametrize("share", [0.0, 0.03])
def test_s_is_that_of_the_pairs_and_there_is_a_key(tmp_path: Path, share: float) -> None:
    alice, bob = e91(tmp_path, physics={"depolarizing": share})
    s = 2 * sqrt(2) * (1 - share) ** FIBERS
    assert abs(alice["chsh"] - s) < 5 * error(s, alice["chsh_pairs"])
    assert alice["chsh_error"] == pytest.approx(error(s, alice["chsh_pairs"]), rel=0.05)
    assert abs(alice["chsh_pairs"] - 0.2 * alice["photons"]) < 5 * sqrt(0.16 * alice["photons"])
    for name in ("chsh", "chsh_pairs", "key_bits", "first_key_id"):
        assert alice[name] == bob[name]
    assert alice["key_bits"] > 0


@pytest.mark.parametrize("rotation", [Pauli.X, Pauli.Z, Pauli.XZ])
def test_a_known_rotation_of_the_path_is_undone(tmp_path: Path, rotation: Pauli) -> None:
    def judge(setup: Setup) -> Setup:
        return replace(grant(setup), rotation=rotation)

    optics = [PathOptics(*PATHS[1], rotation=rotation)]
    alice, _bob = e91(tmp_path, judge, physics={"optics": optics})
    assert abs(alice["chsh"] - 2 * sqrt(2)) < 5 * error(2 * sqrt(2), alice["chsh_pairs"])
    assert alice["qber"] == 0


def spied(folder: Path, fraction: float, **options: Any) -> list[dict[str, Any]] | str:
    """Return the results of both ends where eve measures a fraction, or the refusal."""

    def asked() -> list[dict[str, Any]] | str:
        with ServiceSocket(folder / "eve.sock") as eve:
            eve.settimeout(SOON_S)
            eve.intercept(fraction)
            try:
                return requested(folder, "e91", count=COUNT, **options)
            except QuantumSocketError as refused:
                return str(refused)

    async def run() -> list[dict[str, Any]] | str:
        async with network(folder, paths=BY_EVE):
            return await asyncio.to_thread(asked)

    return network_loop.run(run())


def test_who_measures_a_fifth_lowers_s_by_a_tenth(tmp_path: Path) -> None:
    figures = spied(tmp_path, 0.2)
    assert not isinstance(figures, str)
    s = 2 * sqrt(2) * 0.9
    for end in figures:
        assert abs(end["chsh"] - s) < 5 * error(s, end["chsh_pairs"])
        assert abs(end["qber"] - 0.05) < 5 * sqrt(0.05 / end["disclosed_bits"])


def test_an_s_within_the_margin_gives_no_key_though_the_error_rate_would(tmp_path: Path) -> None:
    figures = spied(tmp_path, 0.2, chsh_margin=0.75)
    assert isinstance(figures, str)
    assert "must be above 2.7500: noise, an eavesdropper" in figures


def test_who_measures_everything_leaves_what_local_variables_explain(tmp_path: Path) -> None:
    figures = spied(tmp_path, 1.0)
    assert isinstance(figures, str)
    s = float(figures.split("S is ")[1].split()[0])
    assert abs(s - sqrt(2)) < 5 * error(sqrt(2), 10_000)
