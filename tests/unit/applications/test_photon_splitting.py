"""Key distribution with a host on the fibre who splits photon numbers; the seed is 1.

Poisson pulses of mean m: without her 1 - exp(-m t) of them are seen behind a transmission t.
"""

import asyncio
from math import exp, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from limits import SOON_S
from numpy.typing import NDArray
from stacks_scene import live_qubits, network, requested

from applications.interception.attacks import PathLosses
from applications.qkd.alice import Alice
from applications.qkd.bob import Bob
from applications.qkd.sifting import Announced, Known, Record
from hosts import network_loop
from hosts.service_socket import ServiceSocket
from hosts.stack_socket import QuantumSocketError
from wire.parameters.physics import Detectors, Device, Memory, PairSource

BY_EVE, PAST_EVE = [(1, 6), (7, 2)], [(1, 2)]
LASER = Device(PairSource("poisson", 0.5))
DECOYS = Device(PairSource("poisson", 0.5, decoys=(0.1, 0.0)))


def clicks(pulses: NDArray[np.int64], transmission: float) -> float:
    """Return how many pulses click on average: photon by photon, from all ways that they can go."""
    return float(sum(n * (1 - (1 - transmission) ** k) for k, n in enumerate(pulses.tolist())))


@pytest.mark.by_day(every=3)
@pytest.mark.parametrize("expected_db", [0.0, 1.0, 3.0, 8.0, 20.0])
@pytest.mark.parametrize("onward_db", [0.0, 10.0])
@pytest.mark.parametrize("mean", [0.05, 0.5, 2.0])
def test_as_many_pulses_click_as_without_her(
    expected_db: float, onward_db: float, mean: float
) -> None:
    """Where she would have to let more pass than there are, all of them do."""
    pulses = np.bincount(np.random.default_rng(1).poisson(mean, 200_000))
    single, several = PathLosses(expected_db + onward_db, onward_db).sent_on(pulses.tolist())
    onward = 10 ** (-onward_db / 10)
    sent = pulses * np.where(np.arange(pulses.size) == 1, single, several)
    left = np.append(np.array([0, sent[1]]), np.zeros(pulses.size))
    left[1 : pulses.size - 1] += sent[2:]
    wanted = clicks(pulses, 10 ** (-(expected_db + onward_db) / 10))
    found = clicks(left, onward)
    if single < 1:
        assert found == pytest.approx(wanted, rel=1e-9)
    else:
        assert found <= wanted
    assert (several == 1) or (single == 0)


def test_no_light_needs_no_choice() -> None:
    assert PathLosses(3.0, 0.0).sent_on([10]) == (0.0, 0.0)
    assert PathLosses(3.0, 0.0).sent_on([10, 0, 0]) == (0.0, 0.0)


def test_photons_that_all_come_alone_are_all_sent_on_where_nothing_is_lost() -> None:
    assert PathLosses().sent_on([5, 10]) == (1.0, 1.0)


def attacked(
    folder: Path, laser: Device, expected_db: float, by_eve: bool = True, **options: Any
) -> tuple[list[dict[str, Any]] | str, dict[str, Any]]:
    """Run BB84; return both ends' summaries, or the refusal, and what eve tells in the end."""

    def report() -> list[dict[str, Any]] | str:
        try:
            return requested(folder, "bb84", **options)
        except QuantumSocketError as error:
            return str(error)

    def asked() -> tuple[list[dict[str, Any]] | str, dict[str, Any]]:
        with ServiceSocket(folder / "eve.sock") as eve:
            eve.settimeout(SOON_S)
            if not by_eve:
                return report(), {}
            eve.intercept(attack="split", expected_db=expected_db)
            ends = report()
            eve.shutdown()
            return ends, eve.summary

    async def run() -> tuple[list[dict[str, Any]] | str, dict[str, Any]]:
        paths, loss_db = (BY_EVE, 0.0) if by_eve else (PAST_EVE, expected_db / 2)
        devices = {"alice": laser}
        async with network(folder, paths=paths, devices=devices, connectors_db=loss_db):
            ends = await asyncio.to_thread(asked)
            assert await live_qubits(folder) == 0
            return ends

    return network_loop.run(run())


def errors(mine: Record, yours: Record) -> int:
    """Return how many bits in the same basis differ."""
    same = mine.bases == yours.bases
    return int(np.count_nonzero(mine.outcomes[same] != yours.outcomes[same]))


def known(monkeypatch: pytest.MonkeyPatch) -> tuple[list[Known], list[Announced]]:
    """Return the lists of what alice and bob will know of their blocks of light."""
    hers, his = list[Known](), list[Announced]()
    for end, records in ((Alice, hers), (Bob, his)):

        def noted(self: Any, record: Record, add: Any = end.add_block, to: Any = records) -> Any:
            to.append(record)
            return add(self, record)

        monkeypatch.setattr(end, "add_block", noted)
    return hers, his


def test_nothing_shows_while_the_rate_of_errors_and_of_pulses_seen_is_all_that_is_looked_at(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hers, his = known(monkeypatch)
    ends, eve = attacked(tmp_path, LASER, 6.0, count=20_000, bound="asymptotic")
    gain = 1 - exp(-0.5 * 10**-0.6)
    pulses = sum(record.photons for record in his)
    seen = sum(record.clicked.size for record in his)
    assert abs(seen - gain * pulses) < 5 * sqrt(gain * pulses)
    wrong = sum(
        errors(mine.of(yours.clicked), yours.of(yours.clicked))
        for mine, yours in zip(hers, his, strict=True)
    )
    assert wrong == 0
    several = 1 - 1.5 * exp(-0.5)
    assert abs(eve["multi_photon"] - several * pulses) < 5 * sqrt(several * pulses)
    assert eve["photons"] == pulses
    assert eve["single_photon"] + eve["multi_photon"] - eve["held_back"] == seen
    # Of the bits that count, GLLP takes those that she has: there is a key of what is left.
    assert not isinstance(ends, str)
    for end in ends:
        single = end["single_photon_fraction"]
        assert abs(1 - single - several / gain) < 5 * sqrt(several / seen)


def test_where_pulses_of_several_photons_are_all_that_is_seen_there_is_no_key(
    tmp_path: Path,
) -> None:
    figures, eve = attacked(tmp_path, LASER, 8.0, count=20_000)
    assert isinstance(figures, str)
    assert "which an eavesdropper can divide" in figures
    assert eve["held_back"] > eve["single_photon"]


def test_decoys_find_her_where_there_is_a_key_without_her(tmp_path: Path) -> None:
    """At 4 dB the weak pulses are seen too rarely; s1 / n of endless keys by eq. 3 of 1311.7129."""
    spied, alone = tmp_path / "1", tmp_path / "2"
    for folder in (spied, alone):
        folder.mkdir()
    options: dict[str, Any] = {"count": 50_000, "bound": "asymptotic"}
    without, _nobody = attacked(alone, DECOYS, 4.0, by_eve=False, **options)
    with_her, _eve = attacked(spied, DECOYS, 4.0, **options)
    assert not isinstance(without, str)
    assert not isinstance(with_her, str)
    unspied, found = without[0], with_her[0]
    for report, share in ((unspied, 0.6887), (found, 0.5330)):
        assert abs(report["single_photon_fraction"] - share) < 0.06
    assert found["key_bits"] < 0.85 * unspied["key_bits"]
    assert found["qber"] == unspied["qber"] == 0


def test_what_has_no_room_in_the_memory_is_let_go(tmp_path: Path) -> None:
    def asked() -> dict[str, Any]:
        with ServiceSocket(tmp_path / "eve.sock") as eve:
            eve.settimeout(SOON_S)
            eve.intercept(attack="split")
            requested(tmp_path, "bb84", count=20_000, block_pairs=10_000)
            eve.shutdown()
            return eve.summary

    async def run() -> dict[str, Any]:
        devices = {"alice": Device(PairSource(g2=0.1)), "eve": Device(memory=Memory(capacity=1000))}
        async with network(tmp_path, paths=BY_EVE, devices=devices):
            summary = await asyncio.to_thread(asked)
            assert await live_qubits(tmp_path) == 0
            return summary

    eve = network_loop.run(run())
    assert eve["multi_photon"] - 1000 <= eve["discarded"] <= eve["multi_photon"]


def test_a_host_without_a_memory_cannot_split(tmp_path: Path) -> None:
    def asked() -> str:
        with ServiceSocket(tmp_path / "eve.sock") as eve:
            eve.settimeout(SOON_S)
            with pytest.raises(QuantumSocketError) as caught:
                eve.intercept(attack="split")
            return str(caught.value)

    async def run() -> str:
        devices = {"eve": Device(memory=Memory(capacity=0), detectors=Detectors(efficiency=0.5))}
        async with network(tmp_path, devices=devices):
            return await asyncio.to_thread(asked)

    assert "wait in a memory, and this host has none" in network_loop.run(run())
