"""Pairs, of which only those are simulated that may click; the seeds are 1 to 50."""

import math
from typing import Any

import numpy as np
import pytest
import uvloop
from five_sigma import within
from numpy.typing import NDArray

from dispatcher.layer.layer import PhysicalLayer
from dispatcher.layer.ownership import Block, BlockName
from dispatcher.layer.weak_pairs import Pairs, WeakHalf
from dispatcher.layer.weak_pulses import BasesAt, Photons, WeakPulses
from dispatcher.operations import weak_light
from dispatcher.photon_random import PhotonRandom
from dispatcher.sabot.backend import Bytes
from dispatcher.sabot.draws import Draws, PhotonDraws
from dispatcher.sabot.registers import Register
from evidence.laboratory import SESSION, Laboratory
from wire.config import DispatcherConfig, Fiber, FiberEnd, QuantumSwitch
from wire.keyed import KeyedChoices
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Detectors, Device, Memory, PairSource

SEEDS = range(1, 51)
PULSES = 40_000
KEYS = bytes(range(16)), bytes(range(16, 32))
HOSTS = "alice", "bob"


def chosen(random: np.random.Generator) -> tuple[DispatcherConfig, int]:
    """Return a source behind a switch from alice and bob, and its rate; all of it at random."""

    def some(least: float, most: float) -> float:
        return float(random.choice([least, random.uniform(least, most)]))

    source = PairSource(
        "poisson",
        mean_pairs=random.uniform(0.01, 2),
        fidelity=some(0.5, 1),
        jitter_ps=some(0, 400),
        bandwidth_nm=some(0, 1),
    )
    devices = {"charlie": Device(source)}
    fibers, ports = list[Fiber](), iter(range(1, 5))
    for half, host in enumerate(HOSTS):
        devices[host] = Device(
            detectors=Detectors(
                efficiency=random.uniform(0.05, 1),
                efficiency_mismatch=some(0, 0.6),
                dark_count_hz=some(0, 1e7),
                gate_s=random.uniform(0.2e-9, 1e-9),
                dead_time_s=some(0, 2e-7),
                afterpulse_probability=some(0, 0.3),
                jitter_ps=some(0, 300),
                readout_error=some(0, 0.1),
            )
        )
        for node, port in ("charlie", f"charlie-q{half}"), (host, f"{host}-q0"):
            fiber = Fiber(
                FiberEnd(node, port),
                FiberEnd("q1", str(next(ports))),
                length_km=random.uniform(0.1, 20),
                loss_db_per_km=some(0, 1),
                connectors_db=some(0, 5),
                depolarizing=some(0, 0.3),
                dephasing=some(0, 0.3),
                pauli_x=some(0, 0.1),
                pauli_y=some(0, 0.1),
                dispersion_ps_per_nm_km=some(0, 10),
            )
            fibers.append(fiber)
    switch = QuantumSwitch("q1", insertion_loss_db=some(0, 3), rotation=int(random.integers(4)))
    tokens, seed = dict.fromkeys(devices, ""), int(random.integers(1 << 30))
    config = DispatcherConfig("", "", seed, tokens, fibers, [switch], devices=devices)
    return config, int(random.choice([100_000_000, 1_000_000_000]))


async def shared(laboratory: Laboratory, number: int, pulses: int, rate_hz: int) -> None:
    """Send the halves of pairs to alice and bob."""
    charlie = laboratory.host("charlie")
    await charlie.create(pulses, number)
    await charlie.send({(number, half): f"charlie-q{half}" for half in (0, 1)}, rate_hz)
    for half, host in enumerate(HOSTS):
        await laboratory.host(host).receive((number, half), f"{host}-q0")


async def exchanged(config: DispatcherConfig, rate_hz: int, halves: list[int]) -> list[list[int]]:
    """Return the outcomes of a block by keys, and of one along all axes, by both hosts in order."""
    random, laboratory = np.random.default_rng(config.seed), Laboratory(config)
    await laboratory.connect("q1", {1: 2, 3: 4})
    seen = list[list[int]]()
    for number in (0, 1):
        await shared(laboratory, number, PULSES, rate_hz)
        bases = random.integers(0, 3, (2, PULSES), dtype=np.uint8)
        for half in halves:
            host = laboratory.host(HOSTS[half])
            if number:
                seen.append((await host.measure((1, half), bases=bases[half])).tolist())
            else:
                at, bits = await host.clicks((0, half), KEYS[half])
                seen.append(at.tolist() + bits.tolist())
    return seen


def every_photon(light: WeakPulses, _share: float = 1.0) -> Photons:
    return light.below(1.0)


class Entangled:
    """Measures all pairs of blocks as entangled qubits, the second half after the first."""

    def __init__(self) -> None:
        self._left: dict[int, Register] = {}

    def measured(
        self,
        layer: PhysicalLayer,
        light: WeakHalf,
        photons: Photons,
        _random: PhotonRandom,
        bases: BasesAt,
    ) -> Bytes:
        """Let an outcome that is free be the bit of its pair and axis, as noise has flipped it."""
        values, paulis, sabot = bases(photons.pulses), light.paulis(photons), layer.sabot
        mine = self._left.pop(id(light.pairs), None)
        if mine is None:
            halves = sabot.bell_pairs(photons.pulses.size)
            mine, self._left[id(light.pairs)] = halves[light.half], halves[1 - light.half]
        sabot.pauli(mine, paulis)
        flips = np.choose(values, [paulis & 1, paulis >> 1, paulis & 1 ^ paulis >> 1])
        bits = light.states(photons, values) & 1 ^ flips
        return sabot.measure(mine, values, PhotonDraws(lambda: bits, lambda: np.zeros(bits.size)))


def nothing_weak(_layer: PhysicalLayer, why: str, *blocks: Block) -> None:
    assert all(block.weak is None for block in blocks), why


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("seed", SEEDS)
def test_what_clicks_is_the_same_if_all_pairs_are_entangled_qubits(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    config, rate_hz = chosen(np.random.default_rng(seed))
    halves = [0, 1] if seed % 2 else [1, 0]
    monkeypatch.setattr(weak_light, "draw", nothing_weak)
    sparse = uvloop.run(exchanged(config, rate_hz, halves))
    assert all(set(each) > {NO_CLICK} for each in sparse[2:])
    monkeypatch.setattr(WeakPulses, "photons", every_photon)
    monkeypatch.setattr(weak_light, "_measured", Entangled().measured)
    assert uvloop.run(exchanged(config, rate_hz, halves)) == sparse


@pytest.mark.parametrize("seed", SEEDS)
def test_counters_on_the_way_are_those_of_the_lost_photons(seed: int) -> None:
    """Losses leave a Poisson distribution one; as many pairs come to both ways."""
    config, rate_hz = chosen(np.random.default_rng(seed))
    (switch,) = config.switches

    async def act() -> list[float]:
        laboratory = Laboratory(config)
        await laboratory.connect("q1", {1: 2, 3: 4})
        charlie = laboratory.host("charlie")
        await charlie.create(PULSES)
        await charlie.send({(0, half): f"charlie-q{half}" for half in (0, 1)}, rate_hz)
        ports = laboratory.layer.network.switches["q1"].ports
        near, far = (ports[1], ports[3]), (ports[2], ports[4])
        counts: list[float] = [laboratory.table.blocks.pairs_created]
        for come, gone in zip(near, far, strict=True):
            counts += [come.photons_in, come.photons_lost, gone.photons_out]
        return [*counts, laboratory.layer.photons_lost]

    pairs = PULSES * config.devices["charlie"].source.mean_pairs
    expected, lost = [pairs], 0.0
    for half in (0, 1):
        through = [pairs]
        for loss_db in (
            config.fibers[2 * half].loss_db,
            switch.insertion_loss_db,
            config.fibers[2 * half + 1].loss_db,
        ):
            through.append(through[-1] * 10 ** (-loss_db / 10))
        expected += [through[1], through[1] - through[2], through[2]]
        lost += pairs - through[3]
    for seen, mean in zip(uvloop.run(act())[:-1], expected, strict=True):
        assert abs(seen - mean) <= 5 * math.sqrt(mean)
    # Photons of a pair are lost at both ways: the variance is twice that of one way at most.
    assert abs(uvloop.run(act())[-1] - lost) <= 5 * math.sqrt(2 * lost)


def network(
    detectors: Detectors,
    *ways: dict[str, Any],
    mean: float,
    memory: Memory = Memory(),  # noqa: B008 (it is frozen)
    encoding: str = "polarization",
) -> Laboratory:
    """Return a source between alice and bob, with fibres of these settings."""
    source = PairSource("poisson", mean, encoding=encoding)
    devices = {"charlie": Device(source, detectors=Detectors(encoding=encoding))}
    devices |= dict.fromkeys(HOSTS, Device(detectors=detectors, memory=memory))
    fibers = [
        Fiber(FiberEnd("charlie", f"charlie-q{half}"), FiberEnd(host, f"{host}-q0"), **way)
        for half, (host, way) in enumerate(zip(HOSTS, ways, strict=True))
    ]
    tokens = dict.fromkeys(devices, "")
    return Laboratory(DispatcherConfig("", "", 1, tokens, fibers, [], devices=devices))


def test_a_billion_pulses_have_the_coincidences_and_errors_of_poisson_pairs() -> None:
    """Mean m, transmissions s and t: 1 - e^(-ms) - e^(-mt) + e^(-m(s+t-st)) of pulses click twice.

    Along one axis half of all but the pulses of one pair alone that both have seen err. The seed
    is 1.
    """
    mean, count, first, second = 0.05, 1_000_000_000, 1e-3, 2e-3

    async def act() -> list[tuple[NDArray[np.int64], Bytes]]:
        losses = [{"connectors_db": -10 * math.log10(2 * each)} for each in (first, second)]
        laboratory = network(Detectors(efficiency=0.5), *losses, mean=mean)
        await shared(laboratory, 0, count, 1_000_000_000)
        clicks = [
            await laboratory.host(host).clicks((0, half), KEYS[half])
            for half, host in enumerate(HOSTS)
        ]
        assert not laboratory.layer.drawn_for
        return clicks

    (at, bits), (other_at, other_bits) = uvloop.run(act())
    assert within(at.size, count, -math.expm1(-mean * first))
    assert within(other_at.size, count, -math.expm1(-mean * second))
    both, mine, theirs = np.intersect1d(at, other_at, return_indices=True)
    accidental = math.expm1(-mean * first) * math.expm1(-mean * second)
    together = math.exp(-mean * (first + second)) * math.expm1(mean * first * second)
    assert within(both.size, count, accidental + together)
    same = KeyedChoices(KEYS[0], count).bases(both) == KeyedChoices(KEYS[1], count).bases(both)
    wrong = same & (bits[mine] != other_bits[theirs])
    alone = mean * first * second * math.exp(-mean * (first + second - first * second))
    error = 1 - alone / (accidental + together)
    assert within(int(wrong.sum()), int(same.sum()), error / 2)


DRIFTING = {"phase_drift_rad_per_sqrt_km": 1e-9}
LONG = {"length_km": 20.0}
IN_BINS = "time-bin"
NEVER = 2
BASES = np.arange(PULSES, dtype=np.uint8) % 3


@pytest.mark.parametrize(
    ("ways", "stored", "why"),
    [
        (({}, {}), NEVER, []),
        (({}, DRIFTING), NEVER, ["PhaseDrift"]),
        ((DRIFTING, LONG), NEVER, ["PhaseDrift"]),  # while the other half flies
        ((LONG, DRIFTING), NEVER, ["PhaseDrift"]),
        (({}, {}), 0, ["an operation of bob"]),
        (({}, {}), 1, ["an operation of bob"]),
    ],
)
def test_pairs_stay_pairs_where_they_have_to_be_drawn(
    ways: tuple[dict[str, Any], dict[str, Any]], stored: int, why: list[str]
) -> None:
    """Halves of Phi+ agree along Z and X and differ along Y, also if one is drawn later.

    Bob stores his half after this number of measured halves. The mean is so low that pulses with
    several pairs, which err, are few: m / 2 of them at most.
    """
    mean = 0.02
    laboratory = network(Detectors(encoding=IN_BINS), *ways, mean=mean, encoding=IN_BINS)

    async def run() -> list[Bytes]:
        await shared(laboratory, 0, PULSES, 1_000_000_000)
        outcomes = list[Bytes]()
        for half, host in enumerate(HOSTS):
            if half == stored:
                await laboratory.host("bob").store((0, 1))
            outcomes.append(await laboratory.host(host).measure((0, half), bases=BASES))
        return outcomes

    mine, theirs = uvloop.run(run())
    assert list(laboratory.layer.drawn_for) == why
    assert np.array_equal(mine == NO_CLICK, theirs == NO_CLICK)
    seen = mine != NO_CLICK
    assert within(int(seen.sum()), PULSES, -math.expm1(-mean))
    for basis in range(3):
        some = seen & (basis == BASES)
        wrong = int(((mine[some] == theirs[some]) == (basis == 2)).sum())
        assert wrong <= mean / 2 * some.sum() + 5 * math.sqrt(mean / 2 * some.sum())


def test_a_half_whose_other_one_is_gone_is_fair_along_all_axes() -> None:
    async def run() -> tuple[Bytes, list[str]]:
        laboratory = network(Detectors(), {}, {}, mean=0.1)
        await shared(laboratory, 0, PULSES, 1_000_000_000)
        await laboratory.host("bob").discard((0, 1))
        await laboratory.host("alice").store((0, 0))
        outcomes = await laboratory.host("alice").measure((0, 0), bases=BASES)
        return outcomes, list(laboratory.layer.drawn_for)

    outcomes, drawn_for = uvloop.run(run())
    assert drawn_for == ["an operation of alice"]
    for basis in range(3):
        some = outcomes[(basis == BASES) & (outcomes != NO_CLICK)]
        assert within(int(some.sum()), some.size, 0.5)


def test_bits_of_pairs_and_axes_tell_nothing_of_each_other() -> None:
    """Of neighbours in a cell, too, half agree, whichever their axes: as fair coins do."""
    pairs = Pairs(PULSES, 1.0, PhotonRandom(Draws(1), (1, 2, 3), "source", PULSES))
    keys = np.sort(pairs.below((1.0, 1.0))[0].keys)
    axes = [pairs.bits(keys, np.full(keys.size, axis, np.uint8)) for axis in range(3)]
    for one in range(3):
        assert within(int(axes[one].sum()), keys.size, 0.5)
        for other in range(3):
            for later in range(int(one >= other), 4):
                agreed = axes[one][: keys.size - later] == axes[other][later:]
                assert within(int(agreed.sum()), agreed.size, 0.5), (one, other, later)


@pytest.mark.parametrize("first", [0, 1])
def test_pairs_violate_bells_inequality_whichever_half_is_measured_first(first: int) -> None:
    """Alice has Z or X, bob Z+X or Z-X: each of the four correlations is 1 / sqrt 2."""
    settings = np.array([[0, 3], [0, 4], [1, 3], [1, 4]], np.uint8)
    bases = np.tile(settings, (PULSES // 4, 1)).T.copy()
    mean = 0.02

    async def run() -> tuple[list[Bytes], list[str]]:
        laboratory = network(Detectors(), {}, {}, mean=mean)
        await shared(laboratory, 0, PULSES, 1_000_000_000)
        outcomes = [np.zeros(0, np.uint8)] * 2
        for half in (first, 1 - first):
            host = laboratory.host(HOSTS[half])
            outcomes[half] = await host.measure((0, half), bases=bases[half])
        return outcomes, list(laboratory.layer.drawn_for)

    (mine, theirs), drawn_for = uvloop.run(run())
    assert drawn_for == ["pairs measured between Z and X"]
    for number, (hers, his) in enumerate(settings):
        some = (np.arange(PULSES) % 4 == number) & (mine != NO_CLICK)
        opposite = (hers, his) == (1, 4)
        wrong = int(((mine[some] != theirs[some]) ^ opposite).sum())
        expected, count = (1 - math.sqrt(0.5)) / 2, int(some.sum())
        spread = 5 * math.sqrt(expected * (1 - expected) * count)
        assert abs(wrong - expected * count) <= spread + mean * count


def test_pairs_that_have_waited_in_a_memory_that_decays_are_drawn() -> None:
    """After a thousand times its lifetime half of the bits are wrong."""
    memory = Memory(depolarizing_s=1e-3)
    laboratory = network(Detectors(), {}, {}, mean=0.1, memory=memory)

    async def run() -> list[Bytes]:
        await shared(laboratory, 0, PULSES, 1_000_000_000)
        await laboratory.wait(1.0)
        return [
            await laboratory.host(host).measure((0, half), bases=BASES)
            for half, host in enumerate(HOSTS)
        ]

    mine, theirs = uvloop.run(run())
    assert list(laboratory.layer.drawn_for) == ["the memory of alice"]
    seen = (mine != NO_CLICK) & (theirs != NO_CLICK)
    assert within(int((mine[seen] != theirs[seen]).sum()), int(seen.sum()), 0.5)


def test_pairs_of_too_many_pulses_are_not_drawn_all() -> None:
    async def run() -> None:
        laboratory = network(Detectors(), {}, DRIFTING, mean=0.1, encoding=IN_BINS)
        charlie = laboratory.host("charlie")
        await charlie.create(1_000_000_000)
        with pytest.raises(Exception, match="make smaller blocks"):
            await charlie.send({(0, 1): "charlie-q1"})
        with pytest.raises(Exception, match="make smaller blocks"):
            await charlie.bell_measure((0, 0), (0, 1))
        with pytest.raises(Exception, match="make smaller blocks, or measure by a key"):
            await charlie.measure((0, 0))
        await charlie.discard((0, 0))
        await charlie.discard((0, 1))

    uvloop.run(run())


def test_both_halves_of_pairs_share_one_draw_of_their_jitter() -> None:
    devices = {"charlie": Device(PairSource("poisson", mean_pairs=0.5, jitter_ps=20.0))}
    fibers = [
        Fiber(FiberEnd("charlie", f"charlie-q{half}"), FiberEnd(host, f"{host}-q0"))
        for half, host in enumerate(HOSTS)
    ]
    tokens = dict.fromkeys(("charlie", *HOSTS), "")
    laboratory = Laboratory(DispatcherConfig("", "", 1, tokens, fibers, [], devices=devices))
    uvloop.run(shared(laboratory, 0, 100, 1_000_000_000))
    layer = laboratory.layer
    one, other = (
        weak_light.require(layer, BlockName(SESSION, 0, half), host)
        for half, host in enumerate(HOSTS)
    )
    assert one.pulses.delays_ps is not None
    assert one.pulses.delays_ps is other.pulses.delays_ps
    assert np.array_equal(one.pulses.delays_ps != 0, one.register.present)  # of light alone
