"""Pulses of several pairs against an enumeration of outcomes; 5 sigma, the seed is 1."""

from collections.abc import Awaitable, Callable
from itertools import product

import numpy as np
import pytest
import uvloop
from five_sigma import within

from dispatcher.devices.source import pair_probabilities
from evidence.laboratory import Laboratory
from wire.config import DispatcherConfig, Fiber, FiberEnd
from wire.dispatcher_pb2 import Gate, MeasureRequest
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Detectors, Device, Memory, PairSource

COUNT = 200_000
MOST = 40  # pairs in a pulse that are enumerated; rarer than 1e-12 here
Z, X = MeasureRequest.Z, MeasureRequest.X


def pulses_told(statistics: str, mean: float, arrives: float, error: float = 0.0) -> np.ndarray:
    """Return how likely both ends tell each pair of bits, 2 for none; shape (3, 3).

    Each pair has a fair bit at one end and at the other the same, but for an error, and either half
    arrives for itself. An end whose two detectors both click tells a fair bit.
    """
    one = np.zeros((4, 4))  # of a pair: which detectors click at either end, as two bits
    for bit, wrong, here, there in product((0, 1), repeat=4):
        likely = 0.5 * (error if wrong else 1 - error)
        likely *= (arrives if here else 1 - arrives) * (arrives if there else 1 - arrives)
        one[here << bit, there << (bit ^ wrong)] += likely
    return told_of(one, statistics, mean)


def arms_told(statistics: str, mean: float, arrives: float) -> np.ndarray:
    """Return how likely the arms of a Bell analyser tell phase and parity of Phi+, 2 for none.

    Both photons of a pair tell Phi+; one alone takes either detector of its arm.
    """
    lost = 1 - arrives
    one = np.zeros((4, 4))
    one[1, 1] = arrives**2
    one[0, 0] = lost**2
    one[1, 0] = one[2, 0] = one[0, 1] = one[0, 2] = arrives * lost / 2
    return told_of(one, statistics, mean)


def told_of(one: np.ndarray, statistics: str, mean: float) -> np.ndarray:
    """Return what two pairs of detectors tell of pulses, by which click for one pair."""
    clicks, of_all = np.zeros((4, 4)), np.zeros((4, 4))
    clicks[0, 0] = 1.0
    for pairs in range(MOST + 1):
        of_all += pair_probabilities(statistics, mean)[pairs] * clicks
        more = np.zeros((4, 4))
        for (a, b), (c, d) in product(np.ndindex(4, 4), repeat=2):
            more[a | c, b | d] += clicks[a, b] * one[c, d]
        clicks = more
    tells = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0], [0.5, 0.5, 0]])
    reports: np.ndarray = tells.T @ of_all @ tells
    return reports


def error_rate(report: np.ndarray) -> float:
    """Return how often bits differ where there are two."""
    return float((report[0, 1] + report[1, 0]) / report[:2, :2].sum())


FIGURES = [
    ("poisson", 0.1, 1.0, 0.0125),
    ("poisson", 0.5, 0.1, 0.1556),
    ("thermal", 0.1, 1.0, 0.0238),
]


@pytest.mark.parametrize(("statistics", "mean", "arrives", "figure"), FIGURES)
def test_the_enumeration_gives_the_known_error_rates(
    statistics: str, mean: float, arrives: float, figure: float
) -> None:
    assert error_rate(pulses_told(statistics, mean, arrives)) == pytest.approx(figure, abs=6e-5)


def run(
    source: PairSource,
    act: Callable[[Laboratory], Awaitable[None]],
    loss_db: float = 0.0,
    device: Device = Device(),  # noqa: B008 (it is frozen)
) -> None:
    """Let something happen to a source charlie between alice and bob, behind so much loss."""

    async def inside() -> None:
        ends = [("charlie-q0", "alice-q0"), ("charlie-q1", "bob-q0")]
        fibers = [
            Fiber(*(FiberEnd(end.partition("-")[0], end) for end in way), connectors_db=loss_db)
            for way in ends
        ]
        devices = {"charlie": Device(source=source), "alice": device, "bob": device}
        config = DispatcherConfig("", "", 1, dict.fromkeys(devices, ""), fibers, [])
        config.devices.update(devices)
        await act(Laboratory(config))

    uvloop.run(inside())


async def share(laboratory: Laboratory) -> None:
    """Send the halves of pairs to alice and bob."""
    charlie = laboratory.host("charlie")
    await charlie.create(COUNT)
    await charlie.send({(0, 0): "charlie-q0", (0, 1): "charlie-q1"})
    await laboratory.host("alice").receive((0, 0), "alice-q0")
    await laboratory.host("bob").receive((0, 1), "bob-q0")


async def outcomes(laboratory: Laboratory, basis: MeasureRequest.Basis) -> np.ndarray:
    """Return how often both ends tell each pair of bits, 2 for none."""
    found = [
        await laboratory.host(name).measure((0, half), basis)
        for half, name in enumerate(("alice", "bob"))
    ]
    bits = [np.minimum(each, 2) for each in found]
    return np.bincount(bits[0] * 3 + bits[1], minlength=9).reshape(3, 3)


@pytest.mark.parametrize("basis", [Z, X])
@pytest.mark.parametrize(
    ("statistics", "mean", "loss_db", "fidelity"),
    [
        ("poisson", 0.1, 0.0, 1.0),
        ("poisson", 0.5, 10.0, 1.0),
        ("thermal", 0.1, 0.0, 1.0),
        ("thermal", 0.8, 3.0, 1.0),
        ("poisson", 0.8, 1.0, 0.85),
        ("thermal", 0.8, 1.0, 0.85),
    ],
)
def test_each_pair_of_a_pulse_has_its_own_outcome_and_survival(
    statistics: str, mean: float, loss_db: float, fidelity: float, basis: MeasureRequest.Basis
) -> None:
    wrong = 2 * (1 - fidelity) / 3  # of a Werner pair
    expected = pulses_told(statistics, mean, 10 ** (-loss_db / 10), wrong)

    async def act(laboratory: Laboratory) -> None:
        await share(laboratory)
        found = await outcomes(laboratory, basis)
        assert all(
            within(int(count), COUNT, likely)
            for count, likely in zip(found.flat, expected.flat, strict=True)
        )

    run(PairSource(statistics=statistics, mean_pairs=mean, fidelity=fidelity), act, loss_db)


@pytest.mark.parametrize("efficiency", [0.3, 0.9])
def test_inefficient_detectors_and_memories_are_as_loss(efficiency: float) -> None:
    source = PairSource(statistics="poisson", mean_pairs=0.8)
    expected = pulses_told("poisson", 0.8, efficiency)

    async def act(laboratory: Laboratory) -> None:
        await share(laboratory)
        if stored:
            await laboratory.host("alice").store((0, 0))
            await laboratory.host("bob").store((0, 1))
        found = await outcomes(laboratory, Z)
        assert all(
            within(int(count), COUNT, likely)
            for count, likely in zip(found.flat, expected.flat, strict=True)
        )

    stored = False
    run(source, act, device=Device(detectors=Detectors(efficiency=efficiency)))
    stored = True
    run(source, act, device=Device(memory=Memory(efficiency=efficiency)))


def test_gates_and_paulis_act_on_all_photons_of_a_pulse() -> None:
    """H at one end and measuring X there is measuring Z; X at the other flips its bits."""
    expected = pulses_told("poisson", 1.0, 1.0, error=1.0)

    async def act(laboratory: Laboratory) -> None:
        await share(laboratory)
        await laboratory.host("alice").apply((0, 0), gates=[Gate(name=Gate.H)])
        await laboratory.host("bob").apply((0, 1), np.ones(COUNT, np.uint8))
        alice = await laboratory.host("alice").measure((0, 0), X)
        bob = await laboratory.host("bob").measure((0, 1), Z)
        found = np.bincount(np.minimum(alice, 2) * 3 + np.minimum(bob, 2), minlength=9)
        assert all(
            within(int(count), COUNT, likely)
            for count, likely in zip(found, expected.flat, strict=True)
        )

    run(PairSource(statistics="poisson", mean_pairs=1.0), act)


def test_gathered_pulses_take_their_extra_pairs_photons_along() -> None:
    expected = pulses_told("poisson", 1.0, 1.0)

    async def act(laboratory: Laboratory) -> None:
        await share(laboratory)
        order = np.random.default_rng(1).permutation(COUNT)
        await laboratory.host("alice").gather((0, 0), {(0, 0): order})
        await laboratory.host("bob").gather((0, 1), {(0, 1): order})
        found = await outcomes(laboratory, Z)
        assert all(
            within(int(count), COUNT, likely)
            for count, likely in zip(found.flat, expected.flat, strict=True)
        )

    run(PairSource(statistics="poisson", mean_pairs=1.0), act)


def test_a_bell_analyser_sees_the_extra_pairs_pairs_of_a_pulse() -> None:
    """An approximation: photons of two pairs interfere, too."""
    report = arms_told("poisson", 1.0, 0.5)
    expected = [report[phase, parity] for phase, parity in ((0, 0), (0, 1), (1, 0), (1, 1))]

    async def act(laboratory: Laboratory) -> None:
        charlie, bob = laboratory.host("charlie"), laboratory.host("bob")
        await charlie.create(COUNT)
        await charlie.send({(0, 0): "charlie-q1"})
        await charlie.send({(0, 1): "charlie-q1"})
        for half in (0, 1):
            await bob.receive((0, half), "bob-q0")
        found = np.bincount(await bob.bell_measure((0, 0), (0, 1)), minlength=4)
        assert all(within(int(n), COUNT, p) for n, p in zip(found, expected, strict=False))
        assert not laboratory.layer.exact

    loss_db = -10 * np.log10(0.5)
    run(PairSource(statistics="poisson", mean_pairs=1.0), act, float(loss_db))


def test_nothing_is_left_of_pulses_that_were_measured() -> None:
    async def act(laboratory: Laboratory) -> None:
        await share(laboratory)
        await outcomes(laboratory, Z)
        assert laboratory.layer.sabot.live_qubits == 0
        await share(laboratory)
        await laboratory.host("alice").discard((0, 0))
        await laboratory.host("bob").discard((0, 1))
        assert laboratory.layer.sabot.live_qubits == 0

    run(PairSource(statistics="poisson", mean_pairs=1.0), act)


def test_weak_pulses_in_given_states_are_seen_as_their_photons_are() -> None:
    """Poisson of mean m behind a transmission t is seen with 1 - e^(-m t), in its basis rightly."""
    mean, loss_db = 0.4, 3.0
    seen = 1 - np.exp(-mean * 10 ** (-loss_db / 10))

    async def act(laboratory: Laboratory) -> None:
        charlie, bob = laboratory.host("charlie"), laboratory.host("bob")
        states = np.random.default_rng(1).integers(0, 4, COUNT, dtype=np.uint8)
        await charlie.prepare(states)
        await charlie.send({(0, 0): "charlie-q1"})
        await bob.receive((0, 0), "bob-q0")
        bases = np.random.default_rng(2).integers(0, 2, COUNT, dtype=np.uint8)
        bits = await bob.measure((0, 0), bases=bases)
        clicked, same = bits != NO_CLICK, bases == states >> 1
        assert within(int(clicked.sum()), COUNT, float(seen))
        assert (bits == states & 1)[clicked & same].all()
        other = clicked & ~same
        assert within(int((bits == states & 1)[other].sum()), int(other.sum()), 0.5)

    run(PairSource(statistics="poisson", mean_pairs=mean), act, loss_db)
