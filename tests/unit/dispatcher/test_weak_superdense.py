"""Superdense coding by pairs, of which only those are simulated that may click; seeds 1 to 50."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import uvloop
from five_sigma import within
from numpy.typing import NDArray

from dispatcher.approximations import SEVERAL_PAIRS
from dispatcher.layer.layer import PhysicalLayer
from dispatcher.layer.ownership import Block
from dispatcher.layer.weak_pairs import WeakHalf
from dispatcher.layer.weak_pulses import Photons
from dispatcher.operations import weak_bell, weak_light
from dispatcher.sabot.backend import Bytes
from dispatcher.sabot.draws import PhotonDraws
from evidence.laboratory import Laboratory, block_id
from wire import dibits
from wire.config import DispatcherConfig, Fiber, FiberEnd, QuantumSwitch
from wire.dispatcher_pb2 import Feedback, Gate
from wire.outcomes import NO_CLICK
from wire.parameters.physics import (
    BEAM_SPLITTER,
    BellAnalyser,
    Detectors,
    Device,
    Gates,
    Memory,
    PairSource,
)

SEEDS = range(1, 51)
PULSES = 10_001  # the last byte of dibits is not full
WAYS = (("charlie-q0", "alice-q0"), ("charlie-q1", "bob-q0"), ("alice-q1", "bob-q1"))
RATE_HZ = 1_000_000_000
IDEAL = Device()


def chosen(random: np.random.Generator) -> tuple[DispatcherConfig, list[int]]:
    """Return a network through a switch, and the rates of charlie and alice; all at random."""

    def some(least: float, most: float) -> float:
        return float(random.choice([least, random.uniform(least, most)]))

    source = PairSource(
        "poisson",
        mean_pairs=random.uniform(0.01, 1),
        fidelity=some(0.5, 1),
        jitter_ps=some(0, 400),
        bandwidth_nm=some(0, 1),
    )
    detectors = Detectors(
        efficiency=some(0.05, 1),
        efficiency_mismatch=some(0, 0.6),
        dark_count_hz=some(0, 1e8),
        gate_s=random.uniform(0.2e-9, 1e-9),
        dead_time_s=some(0, 2e-7),
        afterpulse_probability=some(0, 0.3),
        jitter_ps=some(0, 300),
        readout_error=some(0, 0.1),
    )
    analyser = BellAnalyser(
        str(random.choice(["complete", "linear"])),
        visibility=some(0.5, 1),
        coincidence_window_s=float(random.choice([1e-6, 5e-10])),
        delay_line_km=float(random.choice([2_000.0, 0.0])),
    )
    devices = {
        "charlie": Device(source),
        "alice": Device(gates=Gates(one_qubit_depolarizing=some(0, 0.4))),
        "bob": Device(detectors=detectors, analyser=analyser),
    }
    fibers = []
    for number, way in enumerate(WAYS):
        for end, port in zip(way, (2 * number + 1, 2 * number + 2), strict=True):
            fiber = Fiber(
                FiberEnd(end.partition("-")[0], end),
                FiberEnd("q1", str(port)),
                length_km=random.uniform(0.1, 3),
                connectors_db=some(0, 3),
                depolarizing=some(0, 0.2),
                dephasing=some(0, 0.2),
                pauli_x=some(0, 0.1),
                dispersion_ps_per_nm_km=some(0, 10),
            )
            fibers.append(fiber)
    switch = QuantumSwitch("q1", insertion_loss_db=some(0, 2), rotation=int(random.integers(4)))
    tokens, seed = dict.fromkeys(devices, ""), int(random.integers(1 << 30))
    config = DispatcherConfig("", "", seed, tokens, fibers, [switch], devices=devices)
    rate_hz = int(random.choice([100_000_000, RATE_HZ]))
    return config, [rate_hz, int(rate_hz * random.choice([1, 1, 0.9]))]


async def coded(
    laboratory: Laboratory, paulis: Bytes, number: int, packed: bool, *rates_hz: int
) -> Feedback:
    """Let alice send dibits by halves 0 of pairs, or half 1 of odd blocks; bob measures."""
    charlie, alice, bob = map(laboratory.host, ("charlie", "alice", "bob"))
    mine = number % 2
    await charlie.create(paulis.size, number)
    ports = {(number, half): f"charlie-q{half ^ mine}" for half in (0, 1)}
    await charlie.send(ports, rates_hz[0])
    await alice.receive((number, mine), "alice-q0")
    await bob.receive((number, 1 - mine), "bob-q0")
    message = {"dibits": dibits.pack(paulis, "little")} if packed else {"paulis": paulis.tobytes()}
    await alice._act("apply", block=block_id((number, mine)), **message)
    await alice.send({(number, mine): "alice-q1"}, rates_hz[1])
    await bob.receive((number, mine), "bob-q1")
    halves = (number, 0), (number, 1)
    first, second = halves if packed else halves[::-1]
    return await bob._act(
        "bell_measure", first=block_id(first), second=block_id(second), packed=packed
    )


def symbols(reply: Feedback, count: int) -> Bytes:
    """Return the outcomes of a reply, packed or not."""
    if not reply.dibits:
        return np.frombuffer(reply.outcomes, np.uint8)
    values = dibits.unpack(reply.dibits, count, "little")
    missed = np.unpackbits(np.frombuffer(reply.missed, np.uint8))
    assert not missed[count:].any()
    return np.where(missed[:count], np.uint8(NO_CLICK), values)


async def exchanged(config: DispatcherConfig, rates_hz: list[int]) -> list[Any]:
    """Return outcomes and counts of clicks of four blocks, half of them packed."""
    random, laboratory = np.random.default_rng(config.seed), Laboratory(config)
    await laboratory.connect("q1", {1: 2, 3: 4, 5: 6})
    seen = list[Any]()
    for number in range(4):
        paulis = random.integers(0, 4, PULSES, dtype=np.uint8)
        reply = await coded(laboratory, paulis, number, number < 2, *rates_hz)
        outcomes = symbols(reply, PULSES)
        assert reply.coincidences == int((outcomes != NO_CLICK).sum())
        seen += [outcomes.tolist(), reply.clicks]
    assert not laboratory.layer.ownership.count
    return seen


def every_pair(
    first: WeakHalf, second: WeakHalf, _shares: tuple[float, float]
) -> tuple[Photons, Photons]:
    came = first.pairs.below([1.0, 1.0])
    return came[first.half], came[second.half]


def entangled(
    layer: PhysicalLayer, lights: tuple[WeakHalf, WeakHalf], whole: tuple[Photons, Photons]
) -> Bytes:
    """Make entangled qubits of pairs, let them meet their Paulis, and Bell-measure them."""
    registers = layer.sabot.bell_pairs(whole[0].pulses.size)
    for register, light, photons in zip(registers, lights, whole, strict=True):
        layer.sabot.pauli(register, light.paulis(photons))
    none = PhotonDraws.given(np.zeros(whole[0].pulses.size, np.uint8))
    return layer.sabot.bell_measure(*registers, (none, none))


def nothing_weak(_layer: PhysicalLayer, why: str, *blocks: Block) -> None:
    assert all(block.weak is None for block in blocks), why


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("seed", SEEDS)
def test_outcomes_are_the_same_if_all_pairs_are_entangled_qubits(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    config, rates_hz = chosen(np.random.default_rng(seed))
    monkeypatch.setattr(weak_light, "draw", nothing_weak)
    sparse = uvloop.run(exchanged(config, rates_hz))
    assert all(sparse[1::2])
    monkeypatch.setattr(weak_bell, "seen_together", every_pair)
    monkeypatch.setattr(weak_bell, "measured", entangled)
    assert uvloop.run(exchanged(config, rates_hz)) == sparse


@pytest.mark.by_day(every=5)
@pytest.mark.parametrize("seed", SEEDS)
def test_as_many_outcomes_are_right_as_of_pairs_simulated_one_by_one(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both ways are random here, with a seed of their own each: 5 sigma of a difference.

    With one pair in most pulses: interference of further pairs is nobody's model.
    """
    config, rates_hz = chosen(np.random.default_rng(seed))
    source = replace(config.devices["charlie"].source, mean_pairs=0.05)
    config.devices["charlie"] = Device(source)

    async def act() -> NDArray[np.int64]:
        random, laboratory = np.random.default_rng(1), Laboratory(config)
        await laboratory.connect("q1", {1: 2, 3: 4, 5: 6})
        counts = np.zeros(3, np.int64)  # right, wrong, and clicks
        for number in range(3):
            paulis = random.integers(0, 4, 40_000, dtype=np.uint8)
            reply = await coded(laboratory, paulis, number, True, *rates_hz)
            right = int((symbols(reply, paulis.size) == paulis).sum())
            counts += right, reply.coincidences - right, reply.clicks
        return counts

    sparse = uvloop.run(act())
    monkeypatch.setattr(weak_bell, "obstacle", drawn_whole)
    dense = uvloop.run(act())
    # A dead time makes the spread of clicks smaller, and afterpulses twice as large at most.
    assert (abs(sparse - dense) <= 5 * np.sqrt(2 * (sparse + dense) + 1)).all(), (sparse, dense)


def drawn_whole(_layer: PhysicalLayer, _node: str, first: Block, second: Block) -> str | None:
    return None if first.weak is None and second.weak is None else "this test"


def network(*ways: dict[str, Any], mean: float = 0.05, bob: Device = IDEAL) -> Laboratory:
    devices = {"charlie": Device(PairSource("poisson", mean)), "bob": bob, "alice": IDEAL}
    fibers = [
        Fiber(*(FiberEnd(end.partition("-")[0], end) for end in ends), **way)
        for ends, way in zip(WAYS, ways, strict=True)
    ]
    tokens = dict.fromkeys(devices, "")
    return Laboratory(DispatcherConfig("", "", 1, tokens, fibers, [], devices=devices))


def test_eight_million_pulses_have_the_outcomes_of_poisson_pairs() -> None:
    """Mean m; both photons are seen with s and t: either arm clicks for light of any pair.

    No light of a pair clicks in the first arm, or the second, with e^(-ms) and e^(-mt); in neither
    with e^(-m(s + t - st)). An outcome is right if it is of one pair alone, and by chance once
    in four of photons of two pairs. The seed is 1.
    """
    mean, count, first, second = 0.05, 8_000_000, 8e-3, 2e-2
    losses = [-10 * math.log10(2 * second), -10 * math.log10(2 * second), -10 * math.log10(0.4)]
    laboratory = network(
        *({"connectors_db": loss_db} for loss_db in losses),
        bob=Device(detectors=Detectors(efficiency=0.5)),
    )
    paulis = np.random.default_rng(1).integers(0, 4, count, dtype=np.uint8)
    # Half 0 passes two fibres: .5 * 2 * second * .4 is `first`.
    reply = uvloop.run(coded(laboratory, paulis, 0, True, RATE_HZ, RATE_HZ))
    assert not laboratory.layer.drawn_for
    both = 1 - math.exp(-mean * first) - math.exp(-mean * second)
    both += math.exp(-mean * (first + second - first * second))
    assert within(reply.coincidences, count, both)
    outcomes = symbols(reply, count)
    alone = mean * first * second * math.exp(-mean * (first + second - first * second))
    right = int((outcomes == paulis).sum())
    by_chance = (both - alone) * np.array([1 / 4, 1])  # a pair among several may tell, too
    assert right >= count * (alone + by_chance[0]) - 5 * math.sqrt(count * both)
    assert right <= count * (alone + by_chance[1]) + 5 * math.sqrt(count * both)
    assert 0 < laboratory.layer.approximations.sizes[SEVERAL_PAIRS] <= 1


@pytest.mark.parametrize(
    ("bob", "gates", "why"),
    [
        (IDEAL, [], []),
        (Device(analyser=BellAnalyser("linear")), [], []),
        (Device(analyser=BellAnalyser("gates")), [], ["a Bell measurement by gates"]),
        (
            Device(analyser=BellAnalyser(BEAM_SPLITTER)),
            [],
            [f"a Bell measurement by {BEAM_SPLITTER}"],
        ),
        (IDEAL, [Gate(name=Gate.H)] * 2, ["an operation of alice"]),
        (Device(memory=Memory(t2_s=1.0)), [], ["the memory of bob"]),
    ],
)
def test_pairs_that_cannot_be_thinned_are_drawn_and_say_why(
    bob: Device, gates: list[Gate], why: list[str]
) -> None:
    """All the same nearly all outcomes are right that the analyser tells apart."""
    mean = 0.02
    laboratory = network(*[{"length_km": 1.0}] * 3, mean=mean, bob=bob)
    paulis = np.arange(PULSES, dtype=np.uint8) % 4

    async def act() -> Bytes:
        charlie, host = laboratory.host("charlie"), laboratory.host("alice")
        await charlie.create(PULSES)
        await charlie.send({(0, half): f"charlie-q{half}" for half in (0, 1)})
        await host.receive((0, 0), "alice-q0")
        await laboratory.host("bob").receive((0, 1), "bob-q0")
        await host.apply((0, 0), paulis, gates)
        await host.send({(0, 0): "alice-q1"})
        await laboratory.host("bob").receive((0, 0), "bob-q1")
        return await laboratory.host("bob").bell_measure((0, 0), (0, 1))

    outcomes = uvloop.run(act())
    assert list(laboratory.layer.drawn_for) == why
    reported = paulis % 2 == 1 if bob.analyser.kind in ("linear", BEAM_SPLITTER) else paulis < 4
    seen = reported & (outcomes != NO_CLICK)
    delay_line = 1 if why and "gates" in why[0] else 10 ** (-0.2 * 1.0 / 10)
    assert within(int(seen.sum()), int(reported.sum()), -math.expm1(-mean * delay_line))
    wrong = int((outcomes[seen] != paulis[seen]).sum())
    assert wrong <= mean * seen.sum() + 5 * math.sqrt(mean * seen.sum())


def test_halves_of_unlike_pairs_are_drawn_before_they_are_bell_measured() -> None:
    laboratory = network({}, {}, {}, mean=0.1)

    async def act() -> Bytes:
        charlie = laboratory.host("charlie")
        for number in range(2):
            await charlie.create(PULSES, number)
        return await charlie.bell_measure((0, 0), (1, 1))

    outcomes = uvloop.run(act())
    assert list(laboratory.layer.drawn_for) == ["a Bell measurement of photons of unlike pairs"]
    lit = math.expm1(-0.1) ** 2
    assert within(int((outcomes != NO_CLICK).sum()), PULSES, lit)


def test_paulis_of_pulses_are_met_where_photons_are_drawn_later() -> None:
    """X flips bits along Z; the block is stored, which draws it, after two Paulis that make X."""
    laboratory = network({}, {}, {}, mean=0.3)

    async def act() -> list[Bytes]:
        charlie = laboratory.host("charlie")
        await charlie.create(PULSES)
        await charlie.send({(0, half): f"charlie-q{half}" for half in (0, 1)})
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        await alice.receive((0, 0), "alice-q0")
        await bob.receive((0, 1), "bob-q0")
        for pauli in (3, 2):
            await alice.apply((0, 0), np.full(PULSES, pauli, np.uint8))
        assert not laboratory.layer.drawn_for
        await alice.store((0, 0))
        return [await host.measure((0, half)) for half, host in enumerate((alice, bob))]

    mine, theirs = uvloop.run(act())
    seen = mine != NO_CLICK
    assert np.array_equal(seen, theirs != NO_CLICK)
    agree = int((mine[seen] == theirs[seen]).sum())
    several = 0.3 / 2 / 2 * 1.1  # of pulses with light, and half of them agree by chance
    assert agree <= several * seen.sum()
