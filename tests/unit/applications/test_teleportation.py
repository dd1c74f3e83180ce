"""Teleportation between whole stacks over loopback, with a real dispatcher."""

import asyncio
import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from math import cos, exp, pi, sin, sqrt
from pathlib import Path
from typing import Any

import pytest
from limits import SOON_S
from stacks_scene import Judge, accepted, ask, grant, network, refusal

from dispatcher.sabot import capacity
from hosts import network_loop
from hosts.service_socket import ServiceSocket
from hosts.stack_socket import QuantumSocketError
from wire.config import PathOptics
from wire.parameters.physics import BellAnalyser, Device, Memory

COUNT = 20_000
DENSE: dict[str, Any] = {"backend": "dense"}
GIVEN = {"1.1,-0.4": 1.1, "2.5,3": 2.5, "pi,0": pi, "pi/2,1": pi / 2}  # their thetas


def test_every_state_arrives_over_ideal_fibres(tmp_path: Path) -> None:
    began = time.monotonic()
    alice, bob = ask(tmp_path, "teleport", count=COUNT)
    took_ms = (time.monotonic() - began) * 1e3
    for summary in (alice, bob):
        assert summary["states"] == summary["arrived"] == COUNT
        assert summary["fidelity"] == 1
        assert 0 < summary["waited_ms"] < took_ms


@pytest.mark.parametrize("state", ["haar", "pi/3,pi/4", "random", "-i"])
def test_any_state_arrives_over_ideal_fibres_on_dense(tmp_path: Path, state: str) -> None:
    alice, _bob = ask(tmp_path, "teleport", physics=DENSE, count=5000, state=state)
    assert (alice["arrived"], alice["fidelity"]) == (5000, 1)


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("rotation", [1, 2, 3])
@pytest.mark.parametrize("path", [(4, 1), (5, 2)])
def test_a_known_rotation_is_undone(tmp_path: Path, path: tuple[int, int], rotation: int) -> None:
    physics = {"optics": [PathOptics(*path, rotation=rotation)]}
    alice, _bob = ask(tmp_path, "teleport", judge(rotation), physics, count=2000)
    assert (alice["arrived"], alice["fidelity"]) == (2000, 1)


@pytest.mark.parametrize("rotation", [1, 2, 3])
def test_a_rotation_that_no_path_has_is_undone_all_the_same(tmp_path: Path, rotation: int) -> None:
    alice, _bob = ask(tmp_path, "teleport", judge(rotation), count=2000)
    assert alice["fidelity"] == pytest.approx(1 / 3, abs=5 * sqrt(2 / 9 / 2000))


def failure(folder: Path, physics: dict[str, Any], **options: Any) -> tuple[str, str]:
    """Run a session that must fail; return the results of alice and bob."""

    def asked() -> tuple[str, str]:
        with ThreadPoolExecutor(1) as pool, ServiceSocket(folder / "alice.sock") as asking:
            listening: Future[None] = Future()
            bob = pool.submit(accepted, folder, "teleport", listening)
            listening.result(SOON_S)
            asking.settimeout(SOON_S)
            with pytest.raises(QuantumSocketError) as caught:
                list(asking.request("teleport", ("bob", 9), **options))
            with pytest.raises(QuantumSocketError) as theirs:
                bob.result(SOON_S)
        return str(caught.value), str(theirs.value)

    async def run() -> tuple[str, str]:
        async with network(folder, **physics):
            return await asyncio.to_thread(asked)

    return network_loop.run(run())


def judge(rotation: int) -> Judge:
    """Return a controller that tells bob of a rotation."""
    return lambda setup: replace(grant(setup), rotation=rotation)


@pytest.mark.parametrize(
    ("state", "backend"),
    [("random", "chp"), ("random", "dense"), ("haar", "dense"), ("1.1,-0.4", "dense")],
)
def test_depolarised_pairs_teleport_with_the_fidelity_of_theory(
    tmp_path: Path, state: str, backend: str
) -> None:
    """That of the six cardinal states is that of all states."""
    share = 0.2  # of each photon, X, Y and Z each with probability share / 4
    physics = {"depolarizing": share, "backend": backend}
    _alice, bob = ask(tmp_path, "teleport", physics=physics, count=COUNT, state=state)
    pair = (1 + 3 * (1 - share) ** 4) / 4  # each half passes two fibres
    fidelity = (2 * pair + 1) / 3
    assert abs(bob["fidelity"] - fidelity) < 5 * sqrt(fidelity * (1 - fidelity) / COUNT)


def mean_fidelity(kept: float) -> float:
    """Return the mean over all states if so much of the coherence is kept, and all of Z."""
    return 1 / 2 + (2 * kept + 1) / 6


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("state", ["random", "haar", "1.1,-0.4", "2.5,3", "pi,0", "pi/2,1"])
def test_each_state_suffers_from_dephasing_as_its_direction_says(
    tmp_path: Path, state: str
) -> None:
    """Random ones as cardinal ones do on average."""
    dephasing = 0.3
    physics = {"dephasing": dephasing, **DENSE}
    alice, _bob = ask(tmp_path, "teleport", physics=physics, count=COUNT, state=state)
    kept = (1 - 2 * dephasing) ** 4  # each half passes two fibres
    fidelity = mean_fidelity(kept)
    if state in GIVEN:
        fidelity = (1 + cos(GIVEN[state]) ** 2 + kept * sin(GIVEN[state]) ** 2) / 2
    assert abs(alice["fidelity"] - fidelity) <= 5 * sqrt(fidelity * (1 - fidelity) / COUNT)


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize(("state", "backend"), [("random", "chp"), ("haar", "dense")])
@pytest.mark.parametrize("memory", [Memory(1e6, 0.02), Memory(0.04, 0.02), Memory(0.02, 0.03)])
def test_waiting_in_memory_for_the_bits_costs_fidelity(
    tmp_path: Path, memory: Memory, state: str, backend: str
) -> None:
    physics = {"devices": {"bob": Device(memory=memory)}, "backend": backend}
    block: dict[str, Any] = {"count": COUNT, "block_pairs": COUNT}  # so that all wait equally long
    began_s = time.monotonic()
    _alice, bob = ask(tmp_path, "teleport", physics=physics, state=state, **block)
    waited_s = bob["waited_ms"] / 1000
    assert 0 < waited_s < time.monotonic() - began_s
    fidelity = 1 / 2 + (2 * exp(-waited_s / memory.t2_s) + exp(-waited_s / memory.t1_s)) / 6
    assert bob["fidelity"] < 0.995
    assert abs(bob["fidelity"] - fidelity) < 5 * sqrt(fidelity * (1 - fidelity) / COUNT)


@pytest.mark.parametrize("backend", ["chp", "stim"])
@pytest.mark.parametrize("state", ["haar", "1.1,-0.4"])
def test_other_backends_refuse_what_is_no_stabiliser_state(
    tmp_path: Path, state: str, backend: str
) -> None:
    report = failure(tmp_path, physics={"backend": backend}, state=state, count=100)
    for text in report:
        assert f"simulates with backend {backend}; start it with --backend dense" in text


def test_state_vectors_that_are_too_large_are_told_with_their_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(capacity, "MAX_AMPLITUDES", 8 * 1000 - 1)  # 3 qubits for each state
    assert ask(tmp_path, "teleport", physics=DENSE, state="haar", count=999)[0]["fidelity"] == 1
    for text in failure(tmp_path, physics=DENSE, state="haar", count=1000):
        assert "exceed the limit of 7,999; use smaller blocks" in text


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
        ({"state": "180,0"}, "theta is 180, choose 0 to 3.14159 rad"),
        ({"state": 3}, "state 3: choose one of random, 0, 1"),
        ({"count": 0}, "count 0: choose 1 to"),
        ({"count": True}, "count True: choose 1 to"),
        ({"colour": "red"}, "a session has no colour: choose one of host, port"),
        ({"rate_hz": 100, "block_pairs": 1000}, "take more than 5 s"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_sent(
    tmp_path: Path, options: dict[str, Any], words: str
) -> None:
    assert words in refusal(tmp_path, "teleport", **options)


def test_an_unknown_service_is_refused(tmp_path: Path) -> None:
    words = "unknown service 'oracle': choose one of"
    assert words in refusal(tmp_path, "oracle")


def test_without_a_listening_application_there_is_no_session(tmp_path: Path) -> None:
    assert "no application listens on port 9" in refusal(tmp_path, "teleport")
