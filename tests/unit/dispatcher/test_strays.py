"""Crosstalk of a switch: each photon strays by itself, into an output in use or a dark port.

5 sigma, the seed is 1. Of Poisson pulses of mean m, a part X of whose photons strays, independent
Poisson pulses of m(1 - X) and m X leave by both outputs (the splitting of a Poisson process).
"""

from collections.abc import Awaitable, Callable
from math import exp
from typing import Any

import numpy as np
import pytest
import uvloop
from five_sigma import within

from dispatcher.fiber.classical_light import ClassicalLight
from evidence.laboratory import Laboratory
from wire.config import DispatcherConfig, Fiber, FiberEnd, QuantumSwitch
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Device, PairSource

COUNT = 100_000
PORTS = {1: "charlie-q0", 2: "charlie-q1", 3: "alice-q0", 4: "bob-q0"}
STRAYS = 0.3  # of all photons
CROSSTALK_DB = -10 * float(np.log10(STRAYS))


def run(
    act: Callable[[Laboratory], Awaitable[None]], source: PairSource, **of_charlies_fiber: Any
) -> None:
    """Let something happen in a network of one switch, whose ports lead to charlie, alice, bob."""

    async def inside() -> None:
        fibers = [
            Fiber(
                FiberEnd(end.partition("-")[0], end),
                FiberEnd("q1", str(port)),
                **(of_charlies_fiber if end == "charlie-q0" else {}),
            )
            for port, end in PORTS.items()
        ]
        switch = QuantumSwitch("q1", crosstalk_db=CROSSTALK_DB)
        hosts = dict.fromkeys(("alice", "bob", "charlie"), "")
        config = DispatcherConfig("", "", 1, hosts, fibers, [switch])
        config.devices.update(charlie=Device(source=source))
        await act(Laboratory(config))

    uvloop.run(inside())


async def seen(laboratory: Laboratory, host: str, half: int = 0) -> np.ndarray:
    """Return in which pulses a host sees something of a half; nowhere if nothing has come."""
    if await laboratory.host(host).receive((0, half), f"{host}-q0") is None:
        return np.zeros(COUNT, dtype=bool)
    bits = await laboratory.host(host).measure((0, half))
    clicked: np.ndarray = bits != NO_CLICK
    return clicked


@pytest.mark.parametrize("mean", [0.4, 1.9])
def test_photons_of_one_pulse_leave_by_both_outputs(mean: float) -> None:
    async def act(laboratory: Laboratory) -> None:
        await laboratory.connect("q1", {1: 3, 2: 4})
        await laboratory.host("charlie").prepare(np.zeros(COUNT, np.uint8))
        await laboratory.host("charlie").send({(0, 0): "charlie-q0"})
        alice, bob = await seen(laboratory, "alice"), await seen(laboratory, "bob")
        right, wrong = 1 - exp(-mean * (1 - STRAYS)), 1 - exp(-mean * STRAYS)
        assert within(int(alice.sum()), COUNT, right)
        assert within(int(bob.sum()), COUNT, wrong)
        assert within(int((alice & bob).sum()), COUNT, right * wrong)
        assert laboratory.layer.sabot.live_qubits == 0
        assert laboratory.layer.exact

    run(act, PairSource(statistics="poisson", mean_pairs=mean))


def test_pairs_of_one_pulse_stray_half_by_half() -> None:
    """Coincidences: 1 - 2 exp(-m q) + exp(-m(1 - X^2)), where q = 1 - X of either half stays.

    .332 for m = 1.3 and 3 dB, where .181 is that of pulses that stray as a whole. Strays come to
    the other end under the name of a half that it does not measure.
    """
    mean, stays = 1.3, 1 - STRAYS

    async def act(laboratory: Laboratory) -> None:
        await laboratory.connect("q1", {1: 3, 2: 4})
        charlie = laboratory.host("charlie")
        await charlie.create(COUNT)
        await charlie.send({(0, 0): "charlie-q0", (0, 1): "charlie-q1"})
        both = await seen(laboratory, "alice", 0) & await seen(laboratory, "bob", 1)
        expected = 1 - 2 * exp(-mean * stays) + exp(-mean * (1 - STRAYS**2))
        assert within(int(both.sum()), COUNT, expected)

    run(act, PairSource(statistics="poisson", mean_pairs=mean))


@pytest.mark.parametrize("mean", [None, 1.9])
def test_light_on_the_only_open_path_is_lost_into_dark_ports(mean: float | None) -> None:
    source = PairSource() if mean is None else PairSource(statistics="poisson", mean_pairs=mean)

    async def act(laboratory: Laboratory) -> None:
        await laboratory.connect("q1", {1: 3})
        await laboratory.host("charlie").prepare(np.zeros(COUNT, np.uint8))
        await laboratory.host("charlie").send({(0, 0): "charlie-q0"})
        alice = await seen(laboratory, "alice")
        expected = 1 - STRAYS if mean is None else 1 - exp(-mean * (1 - STRAYS))
        assert within(int(alice.sum()), COUNT, expected)
        assert not (await seen(laboratory, "bob")).any()
        assert laboratory.layer.sabot.live_qubits == 0

    run(act, source)


def test_noise_photons_stray_as_others_do() -> None:
    """Of Raman photons of mean m a pulse m(1 - X) and m X come to both hosts; no other light."""
    light: dict[str, Any] = {"classical_mw": 0.5, "length_km": 10.0, "pulse_window_s": 2e-8}

    async def act(laboratory: Laboratory) -> None:
        await laboratory.connect("q1", {1: 3, 2: 4})
        (mean,) = {
            model.mean_now
            for line in laboratory.layer.network.between("charlie", "q1")
            for model in line.noise.values()
            if isinstance(model, ClassicalLight) and model.mean_now
        }
        await laboratory.host("charlie").prepare(np.zeros(COUNT, np.uint8))
        await laboratory.host("charlie").send({(0, 0): "charlie-q0"})
        alice, bob = await seen(laboratory, "alice"), await seen(laboratory, "bob")
        right, wrong = 1 - exp(-mean * (1 - STRAYS)), 1 - exp(-mean * STRAYS)
        assert mean > 0.2
        assert within(int(alice.sum()), COUNT, right)
        assert within(int(bob.sum()), COUNT, wrong)

    dim = PairSource(statistics="poisson", mean_pairs=0.0)
    run(act, dim, **light)
