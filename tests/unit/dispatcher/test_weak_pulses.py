"""Weak pulses, of which only those are simulated that may click; the seeds are 1 to 50."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import uvloop
from five_sigma import within
from numpy.typing import NDArray

from dispatcher.layer.layer import PhysicalLayer
from dispatcher.layer.ownership import Block
from dispatcher.layer.weak_pulses import BasesAt, Photons, WeakPulses
from dispatcher.operations import emission, weak_light
from dispatcher.operations.adjustment import adjust
from dispatcher.photon_random import PhotonRandom
from dispatcher.refusal import Refusal
from dispatcher.sabot.backend import Bytes
from evidence.laboratory import Laboratory
from wire.config import DispatcherConfig, Fiber, FiberEnd, QuantumSwitch
from wire.dispatcher_pb2 import AdjustFiberRequest, CreateRequest, PulseKey
from wire.keyed import KeyedChoices
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Detectors, Device, PairSource

SEEDS = range(1, 51)
PULSES = 10_000
SHARES = 0.5, 0.3, 0.2
KEY = bytes(range(16))


def every_photon(light: WeakPulses, _share: float = 1.0) -> Photons:
    """Return all photons that have left the source, whatever becomes of them."""
    return light.below(1.0)


def measured_as_qubits(
    layer: PhysicalLayer,
    light: WeakPulses,
    photons: Photons,
    random: PhotonRandom,
    bases: BasesAt,
) -> Bytes:
    values, sabot = bases(photons.pulses), layer.sabot
    register = emission.prepare(sabot, light.states(photons, values))
    sabot.pauli(register, light.paulis(photons))
    return sabot.measure(register, values, light.draws(photons, random))


def nothing_weak(_layer: PhysicalLayer, why: str, *blocks: Block) -> None:
    assert all(block.weak is None for block in blocks), why


def chosen(random: np.random.Generator) -> tuple[DispatcherConfig, int]:
    """Return a network with a switch between alice and bob, and its rate; all of it at random."""

    def some(least: float, most: float) -> float:
        return float(random.choice([least, random.uniform(least, most)]))

    means = sorted(random.uniform(0, 0.5, 2), reverse=True)
    source = PairSource(
        "poisson",
        mean_pairs=float(sum(means) + random.uniform(0.01, 2)),
        decoys=(means[0], means[1]),
        jitter_ps=some(0, 400),
        preparation_error=some(0, 0.2),
        bandwidth_nm=some(0, 1),
    )
    detectors = Detectors(
        efficiency=random.uniform(0.05, 1),
        efficiency_mismatch=some(0, 0.6),
        dark_count_hz=some(0, 1e7),
        gate_s=random.uniform(0.2e-9, 1e-9),
        dead_time_s=some(0, 2e-7),
        afterpulse_probability=some(0, 0.3),
        jitter_ps=some(0, 300),
        readout_error=some(0, 0.1),
    )
    fiber = Fiber(
        FiberEnd("alice", "alice-q0"),
        FiberEnd("q1", "1"),
        length_km=random.uniform(0.1, 20),
        loss_db_per_km=some(0, 1),
        connectors_db=some(0, 5),
        depolarizing=some(0, 0.3),
        dephasing=some(0, 0.3),
        pauli_x=some(0, 0.1),
        pauli_y=some(0, 0.1),
    )
    second = replace(fiber, a=FiberEnd("q1", "2"), b=FiberEnd("bob", "bob-q0"))
    switch = QuantumSwitch("q1", insertion_loss_db=some(0, 3), rotation=int(random.integers(4)))
    devices = {"alice": Device(source), "bob": Device(detectors=detectors)}
    tokens, seed = dict.fromkeys(devices, ""), int(random.integers(1 << 30))
    fibers = [fiber, second]
    config = DispatcherConfig("", "", seed, tokens, fibers, [switch], devices=devices)
    return config, int(random.choice([100_000_000, 1_000_000_000]))


async def exchanged(config: DispatcherConfig, rate_hz: int, pulses: int = PULSES) -> list[int]:
    """Return bob's outcomes of two blocks, and his clicks of one whose states a key chooses."""
    random, laboratory = np.random.default_rng(config.seed), Laboratory(config)
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    await laboratory.connect("q1", {1: 2})
    seen = list[int]()
    await alice.emit(pulses, 2, KEY, SHARES)
    await alice.send({(2, 0): "alice-q0"}, rate_hz)
    await bob.receive((2, 0), "bob-q0")
    for values in await bob.clicks((2, 0), KEY):
        seen += values.tolist()
    for number in range(2):
        states = random.integers(0, 6, pulses, dtype=np.uint8)
        bases = random.integers(0, 3, pulses, dtype=np.uint8)
        levels = random.integers(0, 3, pulses, dtype=np.uint8)
        await alice.prepare(states, number, levels)
        await alice.send({(number, 0): "alice-q0"}, rate_hz)
        await bob.receive((number, 0), "bob-q0")
        seen += (await bob.measure((number, 0), bases=bases)).tolist()
    return seen


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("seed", SEEDS)
def test_what_clicks_is_the_same_if_every_photon_is_simulated(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    config, rate_hz = chosen(np.random.default_rng(seed))
    monkeypatch.setattr(weak_light, "draw", nothing_weak)
    sparse = uvloop.run(exchanged(config, rate_hz))
    assert set(sparse) > {NO_CLICK}
    monkeypatch.setattr(WeakPulses, "photons", every_photon)
    monkeypatch.setattr(weak_light, "_measured", measured_as_qubits)
    assert uvloop.run(exchanged(config, rate_hz)) == sparse


async def counted(config: DispatcherConfig, rate_hz: int) -> list[float]:
    """Return photons that are lost, into the switch, lost there, and out of it."""
    laboratory = Laboratory(config)
    await laboratory.connect("q1", {1: 2})
    await laboratory.host("alice").emit(PULSES, 0, KEY, SHARES)
    await laboratory.host("alice").send({(0, 0): "alice-q0"}, rate_hz)
    near, far = (laboratory.layer.network.switches["q1"].ports[port] for port in (1, 2))
    return [
        laboratory.layer.photons_lost,
        near.photons_in,
        near.photons_lost,
        far.photons_out,
    ]


@pytest.mark.parametrize("seed", SEEDS)
def test_counters_on_the_way_are_those_of_the_lost_photons(seed: int) -> None:
    """Losses leave a Poisson distribution one, of the mean that comes through."""
    config, rate_hz = chosen(np.random.default_rng(seed))
    (first, second), (switch,) = config.fibers, config.switches
    photons = PULSES * np.dot(SHARES, config.devices["alice"].source.intensities)
    through = [photons]
    for loss_db in (first.loss_db, switch.insertion_loss_db, second.loss_db):
        through.append(through[-1] * 10 ** (-loss_db / 10))
    lost = photons - through[3]
    expected = [lost, through[1], through[1] - through[2], through[2]]
    for seen, mean in zip(uvloop.run(counted(config, rate_hz)), expected, strict=True):
        assert abs(seen - mean) <= 5 * math.sqrt(mean)


def test_a_billion_pulses_have_the_gains_and_errors_of_their_intensities() -> None:
    """Of m photons a share t is seen: 1 - (1 - d)^2 e^(-m t); the seed is 1.

    The error rate is that of dark counts, and of both detectors at a time, half of which are wrong.
    """
    means, shares, count, dark = (0.5, 0.1, 0.0), (0.5, 0.35, 0.15), 1_000_000_000, 1e-6
    source = PairSource("poisson", mean_pairs=means[0], decoys=means[1:])
    detectors = Detectors(efficiency=0.2, dark_count_hz=-math.log1p(-dark) * 1e9)
    devices = {"alice": Device(source), "bob": Device(detectors=detectors)}
    ends = FiberEnd("alice", "alice-q0"), FiberEnd("bob", "bob-q0")
    fiber, tokens = Fiber(*ends, connectors_db=30.0), dict.fromkeys(devices, "")
    config = DispatcherConfig("", "", 1, tokens, [fiber], [], devices=devices)

    async def act() -> tuple[NDArray[np.int64], Bytes]:
        laboratory = Laboratory(config)
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        await alice.emit(count, 0, KEY, shares)
        await alice.send({(0, 0): "alice-q0"})
        await bob.receive((0, 0), "bob-q0")
        return await bob.clicks((0, 0), KEY[::-1])

    at, bits = uvloop.run(act())
    sent, bases = KeyedChoices(KEY, count, shares), KeyedChoices(KEY[::-1], count).bases(at)
    levels = sent.levels(at)
    assert levels is not None
    same = bases == sent.bases(at)
    wrong = same & (bits != sent.states(at) & 1)
    for level, (mean, share) in enumerate(zip(means, shares, strict=True)):
        none, light = (1 - dark) ** 2, math.exp(-mean * 0.2e-3)
        own = levels == level
        assert within(int(own.sum()), round(count * share), 1 - none * light)
        other = (dark * light + dark * (1 - light)) - dark**2 * light / 2 - dark * (1 - light) / 2
        assert within(int((own & wrong).sum()), int((own & same).sum()), other / (1 - none * light))


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        ({"key": PulseKey(key=b"short")}, "a key of 5 bytes; send 16"),
        ({"key": PulseKey(key=KEY, shares=[0.5, 0.5])}, "send one each"),
        ({"key": PulseKey(key=KEY, shares=[0.5, 0.5, 0.5])}, "send one each"),
        ({"key": PulseKey(key=KEY, shares=[math.nan, 0.5, 0.5])}, "send one each"),
        ({"key": PulseKey(key=KEY), "states": b"0"}, "a key and states"),
        ({"key": PulseKey(key=KEY), "levels": b"0"}, "a key and levels"),
        ({"key": PulseKey(key=KEY), "count": 0}, "count is 0"),
        ({"key": PulseKey(key=KEY), "state": CreateRequest.ZEROS}, "send PREPARED"),
    ],
)
def test_keys_that_choose_nothing_are_refused(fields: dict[str, Any], text: str) -> None:
    laser = Device(PairSource("poisson", 0.5, decoys=(0.1, 0.0)))
    config = DispatcherConfig("", "", 1, {"alice": ""}, [], [], devices={"alice": laser})
    wanted = {"session": 1, "count": 10, "state": CreateRequest.PREPARED} | fields
    with pytest.raises(Refusal, match=text):
        uvloop.run(Laboratory(config).act("alice", "create", CreateRequest(**wanted)))


def test_photons_of_too_many_pulses_are_not_drawn_all() -> None:
    laser = Device(PairSource("poisson", 0.5))
    config = DispatcherConfig("", "", 1, {"alice": ""}, [], [], devices={"alice": laser})

    async def act() -> None:
        alice = Laboratory(config).host("alice")
        await alice.emit(1_000_000_000, 0, KEY)
        with pytest.raises(Refusal, match="make smaller blocks"):
            await alice.apply((0, 0))
        with pytest.raises(Refusal, match="make smaller blocks"):
            await alice.clicks((0, 0), KEY)
        await alice.discard((0, 0))

    uvloop.run(act())


@pytest.mark.parametrize(
    ("noise", "why"),
    [
        ({"connectors_db": 3.0, "depolarizing": 0.1, "dephasing": 0.1, "pauli_x": 0.1}, []),
        ({"polarization_drift_rad_per_sqrt_km": 0.1, "length_km": 1.0}, ["PolarizationDrift"]),
        ({"pdl_db": 1.0}, ["PolarizationDependentLoss"]),
        ({"burst_depolarizing": 0.1, "burst_start_hz": 1e3, "burst_end_hz": 1e5}, ["Bursts"]),
    ],
)
def test_noise_that_is_not_of_each_photon_has_all_pulses_drawn(
    noise: dict[str, Any], why: list[str]
) -> None:
    """Bob sees 1 - e^(-m t) of the pulses all the same."""
    devices = {"alice": Device(PairSource("poisson", 0.5))}
    ends = FiberEnd("alice", "alice-q0"), FiberEnd("bob", "bob-q0")
    fiber = Fiber(*ends, **noise)
    config = DispatcherConfig("", "", 1, {"alice": ""}, [fiber], [], devices=devices)

    async def act() -> tuple[int, list[str]]:
        laboratory = Laboratory(config)
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        await alice.emit(PULSES, 0, KEY)
        await alice.send({(0, 0): "alice-q0"}, 1_000_000)
        await bob.receive((0, 0), "bob-q0")
        at, _bits = await bob.clicks((0, 0), KEY)
        return at.size, list(laboratory.layer.drawn_for)

    seen, drawn_for = uvloop.run(act())
    assert drawn_for == why
    if "pdl_db" not in noise:  # which loses some
        transmission = 10 ** (-noise.get("connectors_db", 0) / 10)
        assert within(seen, PULSES, -math.expm1(-0.5 * transmission))


@pytest.mark.parametrize("fraction", [0.0, 0.4])
def test_a_tap_leaves_long_blocks_sparse_and_errs_with_a_quarter(fraction: float) -> None:
    devices = {"alice": Device(PairSource("poisson", 0.5))}
    fiber = Fiber(FiberEnd("alice", "alice-q0"), FiberEnd("bob", "bob-q0"), connectors_db=40.0)
    config = DispatcherConfig("", "", 1, {"alice": ""}, [fiber], [], devices=devices)
    count, theirs = 1_000_000_000, KEY[::-1]

    async def act() -> tuple[NDArray[np.int64], Bytes, list[str]]:
        laboratory = Laboratory(config)
        for tapped in (1.0, fraction):
            adjust(laboratory.layer, "", AdjustFiberRequest(a="alice", b="bob", tapped=tapped))
        await laboratory.wait(1)
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        await alice.emit(count, 0, KEY)
        await alice.send({(0, 0): "alice-q0"})
        await bob.receive((0, 0), "bob-q0")
        return *await bob.clicks((0, 0), theirs), list(laboratory.layer.drawn_for)

    at, bits, drawn_for = uvloop.run(act())
    assert not drawn_for
    sent = KeyedChoices(KEY, count)
    same = KeyedChoices(theirs, count).bases(at) == sent.bases(at)
    wrong = same & (bits != sent.states(at) & 1)
    assert within(int(wrong.sum()), int(same.sum()), fraction / 4)
