"""Photons in states that their host has chosen."""

import io
import math
from collections.abc import Awaitable, Callable
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pytest
import uvloop
from five_sigma import within

from dispatcher.build import build_layer
from dispatcher.devices.source import emit, most_extra_pairs
from dispatcher.operations.blocks import Operations
from dispatcher.operations.emission import STATES
from dispatcher.photon_random import PhotonRandom
from dispatcher.refusal import Refusal
from dispatcher.sabot.backend import Bytes
from dispatcher.sabot.draws import Draws
from evidence.laboratory import SESSION, JumpingClock, Laboratory, LaboratoryHost, block_id
from wire.config import DispatcherConfig, Fiber, FiberEnd
from wire.dispatcher_pb2 import CreateRequest, Feedback, Gate, MeasureRequest
from wire.outcomes import NO_CLICK
from wire.parameters.physics import BadParameter, Device, PairSource

Backend = Literal["chp", "stim", "dense"]
COUNT = 6_000
CHOSEN = np.random.default_rng(1).integers(0, len(STATES), COUNT, dtype=np.uint8)
Z, X, Y = range(3)


def configuration(backend: Backend = "chp") -> DispatcherConfig:
    """Return alice and bob, and a fibre of 3 dB between them."""
    ends = FiberEnd("alice", "alice-q0"), FiberEnd("bob", "bob-q0")
    fiber = Fiber(*ends, length_km=15, loss_db_per_km=0.2)
    return DispatcherConfig("", "", 1, {}, [fiber], [], backend=backend)


def run(backend: Backend, act: Callable[[LaboratoryHost], Awaitable[Bytes]]) -> Bytes:
    """Return what alice measures; the seed is 1."""

    async def inside() -> Bytes:
        return await act(Laboratory(configuration(backend)).host("alice"))

    return uvloop.run(inside())


@pytest.mark.parametrize("backend", ["chp", "stim", "dense"])
def test_each_state_tells_its_sign_in_its_own_basis_and_nothing_in_the_others(
    backend: Backend,
) -> None:
    for turn in range(3):
        bases = (CHOSEN // 2 + turn) % 3

        async def act(alice: LaboratoryHost, bases: Bytes = bases) -> Bytes:
            await alice.prepare(CHOSEN)
            return await alice.measure((0, 0), bases=bases)

        found = run(backend, act)
        if turn == 0:
            np.testing.assert_array_equal(found, CHOSEN & 1)
        else:
            for state in range(len(STATES)):
                own = found[state == CHOSEN]
                assert within(int(own.sum()), own.size, 0.5)


@pytest.mark.parametrize("backend", ["chp", "stim", "dense"])
@pytest.mark.parametrize("state", range(len(STATES)))
def test_a_block_of_one_state_and_of_one_photon_is_prepared(backend: Backend, state: int) -> None:
    async def act(alice: LaboratoryHost) -> Bytes:
        for number, count in enumerate((1, 5)):
            await alice.prepare(np.full(count, state, dtype=np.uint8), number)
        one = await alice.measure((0, 0), state // 2)  # type: ignore[arg-type]
        return np.append(one, await alice.measure((1, 0), state // 2))  # type: ignore[arg-type]

    assert run(backend, act).tolist() == [state & 1] * 6


def test_what_is_prepared_passes_gates_and_fibres() -> None:
    async def scene() -> None:
        laboratory = Laboratory(configuration())
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        await alice.prepare(CHOSEN)
        await alice.apply((0, 0), gates=[Gate(name=Gate.H)])
        await alice.send({(0, 0): "alice-q0"})
        await bob.receive((0, 0), "bob-q0")
        # H exchanges Z and X, and turns |+i> into |-i>.
        bases = np.array([X, Z, Y], dtype=np.uint8)[CHOSEN // 2]
        found = await bob.measure((0, 0), bases=bases)
        seen = found != NO_CLICK
        assert within(int(seen.sum()), COUNT, 10**-0.3)
        expected = (CHOSEN & 1) ^ (CHOSEN // 2 == Y)
        np.testing.assert_array_equal(found[seen], expected[seen])

    uvloop.run(scene())


def test_states_bases_and_outcomes_may_be_packed() -> None:
    """Beside the fibre's loss, known without error: each photon is measured in its own basis."""
    chosen = CHOSEN[CHOSEN // 2 != Y][:3_899]  # fills neither bytes of four nor of eight

    async def scene() -> Feedback:
        laboratory = Laboratory(configuration())
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        bits = np.stack([chosen & 1, chosen >> 1], axis=1)
        states = np.packbits(bits, bitorder="little").tobytes()
        create = CreateRequest(session=SESSION, count=3_899, state=CreateRequest.PREPARED)
        create.state_dibits = states
        await laboratory.act("alice", "create", create)
        await alice.send({(0, 0): "alice-q0"})
        await bob.receive((0, 0), "bob-q0")
        request = MeasureRequest(block=block_id((0, 0)), packed=True)
        request.basis_bits = np.packbits(chosen // 2).tobytes()
        return await laboratory.act("bob", "measure", request)

    feedback = uvloop.run(scene())
    assert (feedback.photons, feedback.outcomes) == (3_899, b"")
    assert (len(feedback.bits), len(feedback.missed)) == (488, 488)
    found, missed = (
        np.unpackbits(np.frombuffer(packed, np.uint8))[:3_899]
        for packed in (feedback.bits, feedback.missed)
    )
    seen = missed == 0
    assert int(seen.sum()) == feedback.clicks
    assert within(feedback.clicks, 3_899, 10**-0.3)
    np.testing.assert_array_equal(found[seen], (chosen & 1)[seen])


def test_the_event_says_which_states_there_are_and_which_a_photon_has() -> None:
    log = io.StringIO()
    config = replace(configuration(), per_qubit=3)
    operations = Operations(build_layer(config, JumpingClock(), log))
    request = CreateRequest(session=7, count=5, state=CreateRequest.PREPARED, states=b"\0\5\2\0\0")
    operations.create("alice", request)
    whole, *photons = log.getvalue().splitlines()
    assert whole.endswith("prepared: |0>=3 |+>=1 |-i>=1")
    assert [line.split()[-1] for line in photons] == ["|0>", "|-i>", "|+>"]


def test_pulses_have_as_many_photons_as_their_intensity_says() -> None:
    """Seen are 1 - e^-m of them, as of any Poisson number; signal, weak decoy and vacuum."""
    means, count = (0.6, 0.2, 0.0), 90_000

    async def run() -> list[int]:
        laser = Device(PairSource("poisson", means[0], decoys=means[1:]))
        tokens = {"alice": ""}
        config = DispatcherConfig("", "", 1, tokens, [], [], devices={"alice": laser})
        alice = Laboratory(config).host("alice")
        levels = (np.arange(count) % 3).astype(np.uint8)
        await alice.prepare(np.zeros(count, np.uint8), levels=levels)
        seen = await alice.measure((0, 0)) != NO_CLICK
        return [int(seen[levels == level].sum()) for level in range(3)]

    for mean, seen in zip(means, uvloop.run(run()), strict=True):
        assert within(seen, count // 3, -np.expm1(-mean))


@pytest.mark.parametrize(
    ("levels", "decoys", "says"),
    [
        (b"\0\1\3", (0.2, 0.0), "levels"),
        (b"\0\1", (0.2, 0.0), "2 bytes for 3"),
        (b"\0\1\0", None, "levels"),
    ],
)
def test_levels_that_a_source_does_not_have_are_refused(
    levels: bytes, decoys: tuple[float, ...] | None, says: str
) -> None:
    async def run() -> None:
        laser = Device(PairSource("poisson", 0.6, decoys=decoys))
        config = DispatcherConfig("", "", 1, {"alice": ""}, [], [], devices={"alice": laser})
        alice = Laboratory(config).host("alice")
        await alice.prepare(np.zeros(3, np.uint8), levels=np.frombuffer(levels, np.uint8))

    with pytest.raises(Refusal, match=says):
        uvloop.run(run())


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"decoys": (0.2, 0.0)}, "choose poisson"),
        ({"statistics": "poisson", "mean_pairs": 0.5, "decoys": (0.3, 0.2)}, "together below"),
        ({"statistics": "poisson", "mean_pairs": 0.5, "decoys": (0.1, 0.1)}, "still weaker"),
        ({"statistics": "poisson", "mean_pairs": 0.5, "decoys": (0.1,)}, "decoys"),
    ],
)
def test_decoys_that_tell_nothing_are_refused(given: dict[str, Any], says: str) -> None:
    with pytest.raises(BadParameter, match=says):
        PairSource(**given).check("alice, source")


@pytest.mark.parametrize("g2", [0.01, 0.1, 0.49])
def test_g2_is_that_of_the_photons_counted(g2: float) -> None:
    """<n (n - 1)> / <n>^2 of pulses whose photons are counted; 100,000 pulses."""
    count = 100_000
    source = PairSource(g2=g2)
    found = emit(source, PhotonRandom(Draws(1), (7, 0, 0), "source", count)).pairs
    assert found is not None
    assert set(np.unique(found).tolist()) == {1, 2}
    photons = found.astype(float)
    counted = (photons * (photons - 1)).mean() / photons.mean() ** 2
    several = int((found == 2).sum())
    assert counted == pytest.approx(g2, abs=5 * g2 / several**0.5)
    assert several <= most_extra_pairs(source, count)


@pytest.mark.parametrize("basis", [Z, X, Y])
def test_prepared_states_are_wrong_as_often_as_the_error_says(basis: int) -> None:
    count, error = 60_000, 0.03

    async def run() -> int:
        device = Device(PairSource(preparation_error=error))
        config = DispatcherConfig("", "", 1, {"alice": ""}, [], [], devices={"alice": device})
        alice = Laboratory(config).host("alice")
        states = (2 * basis + np.arange(count) % 2).astype(np.uint8)
        await alice.prepare(states)
        bits = await alice.measure((0, 0), bases=np.full(count, basis, np.uint8))
        return int(np.count_nonzero(bits != states & 1))

    assert within(uvloop.run(run()), count, error)


def test_g2_of_light_that_is_not_single_is_refused() -> None:
    with pytest.raises(BadParameter, match=r"g2 0\.1 with statistics"):
        PairSource("poisson", 0.1, g2=0.1).check("alice, source")


@pytest.mark.parametrize("statistics", ["poisson", "thermal"])
@pytest.mark.parametrize("efficiency", [0.1, 0.6, 1.0])
def test_photons_come_as_their_pairs_are_heralded(statistics: str, efficiency: float) -> None:
    """P(n) (1 - (1 - e)^n) with P(n) = exp(-m) m^n / n! or m^n / (1 + m)^(n + 1), term by term."""
    count, mean = 200_000, 0.4
    source = PairSource(statistics, mean, heralding_efficiency=efficiency)
    draws = PhotonRandom(Draws(1), (7, 0, 0), "source", count)
    found = emit(source, draws, prepared=True).pairs
    assert found is not None
    likely = math.exp(-mean) if statistics == "poisson" else 1 / (1 + mean)
    several = 0.0
    for photons in range(1, 40):
        likely *= mean / photons if statistics == "poisson" else mean / (1 + mean)
        heralded = likely * (1 - (1 - efficiency) ** photons)
        several += heralded if photons > 1 else 0.0
        if photons < 4:
            assert within(int((found == photons).sum()), count, heralded)
    assert source.multi_photon == pytest.approx(several, rel=1e-9)
    pairs = emit(source, draws).pairs  # of which both halves travel: nobody looks at one
    assert pairs is not None
    dark = math.exp(-mean) if statistics == "poisson" else 1 / (1 + mean)
    assert within(int((pairs == 0).sum()), count, dark)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"heralding_efficiency": 0.5}, "choose poisson or thermal pairs"),
        (
            {"statistics": "poisson", "mean_pairs": 0.1, "heralding_efficiency": 1.5},
            ": choose 0 to 1",
        ),
        (
            {
                "statistics": "poisson",
                "mean_pairs": 0.5,
                "decoys": (0.1, 0.0),
                "heralding_efficiency": 0.5,
            },
            "which is of no laser",
        ),
    ],
)
def test_heralding_that_cannot_be_is_refused(given: dict[str, Any], says: str) -> None:
    with pytest.raises(BadParameter, match=says):
        PairSource(**given).check("alice, source")
