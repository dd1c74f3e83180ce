"""Distribution between memories that emit, by a station: whole stacks over loopback, seed 1."""

import asyncio
from dataclasses import replace
from math import sqrt
from pathlib import Path
from typing import Any

import pytest
from stacks_scene import ask, grant, network, requested
from test_node_kinds import require_estimate

from hosts import network_loop
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.offers import check_light
from hosts.stack_socket import QuantumSocketError
from wire.config import PathOptics
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import MemoryState, Service
from wire.parameters.physics import BellAnalyser, Device, Emitter, Memory, PairSource

ATTEMPTS = [(1, 4), (2, 5)]  # alice's and bob's first fibres to charlie's
STATION = Device(PairSource("none"), Memory(capacity=0), analyser=BellAnalyser("linear"))


def scene(**emitter: Any) -> dict[str, Any]:
    """Return the physics of two such memories and a station."""
    ions = Device(PairSource("none"), emitter=Emitter("two-click", modes=1000, **emitter))
    return {"devices": {"alice": ions, "bob": ions, "charlie": STATION}, "paths": ATTEMPTS}


def test_memories_that_emit_share_pairs_that_a_station_heralds(tmp_path: Path) -> None:
    efficiency, count = 0.4, 3000
    physics = scene(efficiency=efficiency)
    alice, bob = ask(tmp_path, "distribute", physics=physics, count=count, sample=0.2)
    assert alice["pairs"] == bob["pairs"] == count
    assert alice["fidelity"] == 1.0
    p = efficiency**2 / 2  # Barrett and Kok
    expected = p * alice["attempts"]
    assert abs(alice["emitted"] - expected) < 5 * sqrt(expected * (1 - p)) + 1000 * p


def test_errors_of_emission_are_in_the_pairs(tmp_path: Path) -> None:
    """Two Werner states of qubit and photon, swapped: F F' + (1 - F)(1 - F') / 3."""
    fidelity = 0.95
    swapped = fidelity**2 + (1 - fidelity) ** 2 / 3
    options: dict[str, Any] = {"count": 2000, "sample": 0.5}
    alice, _bob = ask(tmp_path, "distribute", physics=scene(fidelity=fidelity), **options)
    require_estimate(alice, swapped)


@pytest.mark.parametrize("rotation", [1, 2, 3])
def test_known_rotations_of_a_way_are_undone(tmp_path: Path, rotation: int) -> None:
    def judge(setup: Setup) -> Setup:
        assert setup.memory == MemoryState.HERALDED
        return replace(grant(setup), rotation=rotation)

    physics = scene() | {"optics": [PathOptics(*ATTEMPTS[0], rotation=rotation)]}
    alice, _bob = ask(tmp_path, "distribute", judge, physics, count=300, sample=0.5)
    assert alice["fidelity"] == 1.0


def test_nothing_that_a_station_refuses_goes_on(tmp_path: Path) -> None:
    """Where the light of an end comes to another host, both ends hear why."""
    physics = scene() | {"paths": [ATTEMPTS[0]]}

    async def run() -> str:
        async with network(tmp_path, **physics):
            with pytest.raises(QuantumSocketError) as caught:
                await asyncio.to_thread(requested, tmp_path, "distribute", count=10)
        return str(caught.value)

    assert "light that leaves bob-q0 of bob comes out nowhere" in network_loop.run(run())


def test_a_service_without_stations_refuses_memories_that_emit() -> None:
    setup = Setup(1, Service["BB84"], 1, "10.0.0.3", 1, 1, 1, memory=MemoryState.HERALDED)
    with pytest.raises(SessionError, match="memory 1 for bb84: choose 0"):
        check_light(setup)
