"""Keys by way of a relay that nobody trusts, over loopback; the seed is 1."""

import asyncio
from dataclasses import replace
from itertools import product
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from limits import SOON_S
from stacks_scene import Judge, ask, grant, network, requested

from evidence.curves.relay_theory import diagonal, rectilinear
from hosts.middleware.session.values import numbers_of, values
from hosts.service_socket import ServiceSocket
from hosts.stack_socket import QuantumSocketError
from wire.config import PathOptics
from wire.metadata.header import Message
from wire.metadata.setup import Setup
from wire.metadata.values import Topic, Values
from wire.outcomes import Pauli
from wire.parameters.physics import BellAnalyser, Detectors, Device, PairSource

PATHS = [(1, 4), (2, 5)]
BY_EVE = [(1, 6), (7, 4), (2, 5)]
COUNT = 20_000
RELAY = Device(analyser=BellAnalyser("beam-splitter"))
PSI = (1, 3)


def mdi(folder: Path, judge: Judge = grant, **words: Any) -> list[dict[str, Any]]:
    """Return the results of both ends; `physics` are words for fibres and hosts."""
    given = {"paths": PATHS, "analyser": "beam-splitter", "devices": {"charlie": RELAY}}
    physics = {**given, **words.pop("physics", {})}
    return ask(folder, "mdi", judge, physics, **{"count": COUNT, **words})


def test_half_of_single_photons_are_told_of_and_errors_are_those_of_the_fibres(
    tmp_path: Path,
) -> None:
    """A beam splitter tells two Bell states of four; four fibres of p depolarise both photons."""
    share = 0.01
    alice, bob = mdi(tmp_path, physics={"depolarizing": share})
    qber = (1 - (1 - share) ** 4) / 2
    assert abs(alice["qber"] - qber) < 5 * sqrt(qber * (1 - qber) / alice["disclosed_bits"])
    assert abs(alice["raw_bits"] - alice["photons"] / 2) < 5 * sqrt(alice["photons"] / 4)
    for name in ("key_bits", "first_key_id", "last_key_id", "qber", "photons"):
        assert alice[name] == bob[name]
    assert alice["key_bits"] > 0


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("analyser", ["beam-splitter", "complete", "linear"])
@pytest.mark.parametrize("rotation", list(Pauli))
def test_bits_fit_whatever_is_told_and_however_paths_turn(
    tmp_path: Path, analyser: str, rotation: Pauli
) -> None:
    def judge(setup: Setup) -> Setup:
        return replace(grant(setup), rotation=rotation)

    optics = [PathOptics(*PATHS[0], rotation=rotation)]
    relay = Device(analyser=BellAnalyser(analyser))
    alice, _bob = mdi(
        tmp_path,
        judge,
        count=3000,
        bound="asymptotic",
        physics={"optics": optics, "analyser": analyser, "devices": {"charlie": relay}},
    )
    assert alice["qber"] == 0


class Liar:
    """Changes what a relay answers; what alice tells bob of it stays as it is."""

    def __init__(self, kind: str) -> None:
        """Take Psi- for Psi+, or invent a state for half of all pulses that it knows none of."""
        self._kind, self._known = kind, np.zeros(0, bool)
        self._random = np.random.default_rng(1)

    def __call__(self, way: str, message: Message) -> Message:
        if not isinstance(message, Values) or way != "back":
            return message
        reports = numbers_of(message)
        if self._kind == "invented" and message.topic == Topic.ARRIVED:
            self._known = reports.astype(bool)
            reports = np.where(self._random.random(reports.size) < 0.5, 1, reports)
            self._said = reports.astype(bool)
        elif self._kind == "invented":
            states = self._random.choice(np.array(PSI, np.uint32), self._said.size)
            states[self._known] = reports
            reports = states[self._said]
        elif message.topic == Topic.OUTCOMES:
            reports = reports ^ np.uint32(2)
        return values(message.session, message.topic, message.block, reports, message.width)


@pytest.mark.parametrize(("kind", "qber"), [("swapped", 1 / 2), ("invented", 1 / 4)])
def test_a_relay_that_lies_causes_errors_and_no_key(tmp_path: Path, kind: str, qber: float) -> None:
    """Psi- for Psi+ turns all bits of X, which are half.

    Of the pulses half are known, and half of the others, which are Phi, invented: a third of all,
    of which every bit of Z is wrong and half of those of X.
    """
    with pytest.raises(QuantumSocketError, match="noise or an eavesdropper") as refused:
        mdi(tmp_path, physics={"change": Liar(kind)})
    value = float(str(refused.value).split("QBER ")[1].split(")")[0])
    assert abs(value - qber) < 5 * sqrt(qber * (1 - qber) / 2000)


def test_who_measures_on_the_way_to_the_relay_is_seen(tmp_path: Path) -> None:
    fraction = 0.2

    def asked() -> list[dict[str, Any]]:
        with ServiceSocket(tmp_path / "eve.sock") as eve:
            eve.settimeout(SOON_S)
            eve.intercept(fraction)
            return requested(tmp_path, "mdi", count=COUNT)

    async def run() -> list[dict[str, Any]]:
        async with network(tmp_path, paths=BY_EVE, devices={"charlie": RELAY}):
            return await asyncio.to_thread(asked)

    alice, _bob = asyncio.run(run())
    qber = fraction / 4
    assert abs(alice["qber"] - qber) < 5 * sqrt(qber * (1 - qber) / alice["disclosed_bits"])


def lasers(mean: float, decoys: tuple[float, float] | None = (0.1, 0.0)) -> dict[str, Device]:
    """Return lasers at both ends, and a relay with dark counts."""
    laser = Device(PairSource("poisson", mean, decoys=decoys))
    return {"alice": laser, "bob": laser, "charlie": RELAY}


def test_decoys_of_both_ends_make_a_key(tmp_path: Path) -> None:
    """As many bits as the mean over the phases says; the error rate is of a sample of Z."""
    mean, count = 0.4, 5_000
    physics = {"devices": lasers(mean)}
    alice, bob = mdi(tmp_path, count=count, bound="asymptotic", physics=physics)
    means = list(zip((mean, 0.1, 0.0), (0.5, 0.35, 0.15), strict=True))
    in_z, in_x = (
        sum(p * q * formula(a, b, 0.0, 0.0)[0] for (a, p), (b, q) in product(means, repeat=2)) / 4
        for formula in (rectilinear, diagonal)
    )
    expected = (in_z + in_x) * alice["photons"]
    assert abs(alice["sifted_bits"] - expected) < 5 * sqrt(expected)
    assert alice["qber"] == 0  # of Z: pulses alike never make both polarisations click
    disclosed = in_z / 10 * alice["photons"]
    assert abs(alice["disclosed_bits"] - disclosed) < 5 * sqrt(disclosed)
    assert alice["key_bits"] == bob["key_bits"] > 0
    assert alice["first_key_id"] == bob["first_key_id"]


def test_lasers_without_decoys_bring_no_key(tmp_path: Path) -> None:
    with pytest.raises(QuantumSocketError, match="noise or an eavesdropper"):
        mdi(tmp_path, physics={"devices": lasers(0.4, None)})


@pytest.mark.parametrize("without", ["alice", "bob"])
def test_decoys_of_one_end_are_refused_at_once(tmp_path: Path, without: str) -> None:
    devices = {**lasers(0.4), without: Device(PairSource("poisson", 0.4))}
    with pytest.raises(QuantumSocketError, match=r"give the sources of .* decoys, or neither"):
        mdi(tmp_path, physics={"devices": devices})


def test_a_relay_to_which_no_light_comes_ends_the_session(tmp_path: Path) -> None:
    dark = {"charlie": replace(RELAY, detectors=Detectors(1e-9))}
    with pytest.raises(QuantumSocketError, match="of 3 blocks in a row no photon was measured"):
        mdi(tmp_path, count=1000, block_pairs=1000, physics={"devices": dark})
