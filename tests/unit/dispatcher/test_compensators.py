"""Compensators of polarisation, against scipy and simulations apart; 5 sigma, seed 1."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import uvloop
from compensators_scene import (
    COUNT,
    HOSTS,
    IDEAL,
    RATE_HZ,
    errors,
    expected,
    laboratory,
    require,
    turns,
    wrong,
)
from five_sigma import within
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dispatcher.devices.retarders import settings_for
from dispatcher.fiber.noise import Pattern, Schedule
from dispatcher.fiber.turn import Turn
from dispatcher.layer.compensation import Compensation
from dispatcher.refusal import Refusal
from dispatcher.sabot.draws import Draws
from evidence.laboratory import Laboratory
from wire.config import DispatcherConfig, Fiber, FiberEnd
from wire.dispatcher_pb2 import AdjustFiberRequest, CompensateRequest
from wire.parameters.physics import (
    BadParameter,
    Compensator,
    Device,
    PairSource,
)


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize(("every_s", "rms_rad"), [(0.005, 0.8), (0.4, 0.8), (0.05, 2.0)])
def test_errors_grow_with_the_interval_between_looks(every_s: float, rms_rad: float) -> None:
    compensator = replace(IDEAL, every_s=every_s)
    found = wrong(compensator, polarization_drift_rad_per_sqrt_km=rms_rad)
    require(found, expected(rms_rad, every_s))


def test_a_look_that_is_wrong_turns_light() -> None:
    found = wrong(replace(IDEAL, every_s=0.02, error_rad=0.6))
    require(found, expected(0.8, 0.02, error_rad=0.6))


def test_the_earlier_setting_holds_until_the_reference_is_measured() -> None:
    found = wrong(replace(IDEAL, every_s=0.05, measuring_s=0.03))
    require(found, expected(0.8, 0.05, late_s=0.03))


def test_an_interrupting_reference_loses_light_in_place_of_errors() -> None:
    """Of 500 pulses 100 come while it measures: photons are 0.01 to 0.05 s behind their look."""
    part = replace(IDEAL, every_s=0.05, measuring_s=0.01, reference="interrupting")
    found = wrong(part)
    assert found.size == COUNT * 0.8
    require(found, expected(0.8, 0.05, early_s=0.01))


def test_retarders_interrupt_for_as_long_as_they_move() -> None:
    """The first look has them go from 0 to Euler angles, of which there are two sets."""
    part = replace(IDEAL, every_s=100.0, speed_rad_per_s=4.0, reference="interrupting")
    there = laboratory(part, polarization_drift_time_s=1e9)
    found = uvloop.run(errors(there))
    history = there.layer.history.of_model("alice", "alice-q0", "0 PolarizationDrift")
    assert history.latest_values is not None
    assert not found.any()
    wanted = turns(history.latest_values[1].reshape(1, -1, 3))[0].inv()
    a, b, c = wanted.as_euler("zxz")
    moves = [max(np.mod(each, 2 * np.pi)) for each in ([a, b, c], [a + np.pi, -b, c + np.pi])]
    assert COUNT - found.size == np.ceil(min(moves) / 4 * RATE_HZ)


@pytest.mark.parametrize("drift", [0.0, 0.8])
def test_reference_light_and_insertion_lose_their_share(drift: float) -> None:
    part = replace(IDEAL, every_s=1.0, reference_share=0.25, insertion_loss_db=3.0)
    found = wrong(part, polarization_drift_rad_per_sqrt_km=drift)
    assert within(found.size, COUNT, 0.75 * 10**-0.3)


def rotation(settings: NDArray[np.float64]) -> Rotation:
    """Return retarders about Z, X, Z and X, one after the other."""
    whole = Rotation.identity()
    for number, retardance in enumerate(settings):
        whole = Rotation.from_rotvec(retardance * np.eye(3)[0 if number % 2 else 2]) * whole
    return whole


def rotations(count: int) -> tuple[NDArray[np.float64], Rotation]:
    """Return any turns, as quaternions and as rotations."""
    found = np.random.default_rng(1).standard_normal((count, 4))
    found /= np.linalg.norm(found, axis=1, keepdims=True)
    return found, Rotation.from_quat(found[:, [1, 2, 3, 0]])


@pytest.mark.parametrize("retarders", [3, 4])
@pytest.mark.parametrize("range_rad", [2 * np.pi, 12.0])
def test_three_retarders_of_a_whole_turn_make_any_turn(retarders: int, range_rad: float) -> None:
    held = np.zeros(retarders)
    for target, wanted in zip(*rotations(200), strict=True):
        held = settings_for(target, held, range_rad)
        assert ((held >= 0) & (held <= range_rad)).all()
        assert (rotation(held) * wanted.inv()).magnitude() < 1e-9


@pytest.mark.parametrize("retarders", [3, 4])
def test_what_is_out_of_range_is_clipped(retarders: int) -> None:
    """A turn about X is left to what its one retarder, or two, can do, or something better.

    Nothing is better than the best of all settings on a grid of a twentieth of the range.
    """
    range_rad, step_rad = 1.2, 0.06
    grid = np.stack(np.meshgrid(*[np.arange(0, 1.21, step_rad)] * 3, indexing="ij"), axis=-1)
    three = Rotation.from_rotvec(grid.reshape(-1, 3)[:, :1] * [0, 0, 1])
    for axis, name in (1, 0), (2, 2):
        each = grid.reshape(-1, 3)[:, axis, None] * np.eye(3)[name]
        three = Rotation.from_rotvec(each) * three
    for turn_rad in np.linspace(0.1, 6.2, 9):
        wanted = Rotation.from_rotvec([turn_rad, 0, 0])
        target = np.array([np.cos(turn_rad / 2), np.sin(turn_rad / 2), 0, 0])
        held = settings_for(target, np.zeros(retarders), range_rad)
        left = (rotation(held) * wanted.inv()).magnitude()
        reach_rad = range_rad * (retarders - 2)
        assert left <= max(min(turn_rad - reach_rad, 2 * np.pi - turn_rad), 0) + 1e-9
        if retarders == 3:
            assert left >= (three * wanted.inv()).magnitude().min() - 3 * step_rad
        assert ((held >= 0) & (held <= range_rad)).all()


def test_a_fourth_retarder_spares_ways_back() -> None:
    """Of turns that wander by .05 rad three have to go back by a radian and more now and then."""
    steps = Rotation.from_rotvec(np.random.default_rng(1).standard_normal((500, 3)) * 0.05)
    long_moves = {}
    for retarders in (3, 4):
        held, moves, turn = np.zeros(retarders), [], Rotation.identity()
        for step in steps:
            turn = step * turn
            new = settings_for(turn.as_quat()[[3, 0, 1, 2]], held, 2 * np.pi)
            moves.append(np.abs(new - held).max())
            held = new
        long_moves[retarders] = int((np.array(moves) > 1).sum())
    assert long_moves[3] > 5
    assert long_moves[4] < long_moves[3] / 3


@pytest.mark.parametrize("retarders", [3, 4])
def test_retarders_that_make_a_turn_already_do_not_move(retarders: int) -> None:
    random = np.random.default_rng(1)
    for held in random.random((200, retarders)) * 2 * np.pi:
        target = rotation(held).as_quat()[[3, 0, 1, 2]]
        assert settings_for(target, held, 2 * np.pi) == pytest.approx(held, abs=1e-6)


def looked(*angles_rad: float) -> Turn:
    """Return a turn of which reference light has met these angles about Z, look by look."""
    halves = np.array(angles_rad) / 2
    met = np.stack([np.cos(halves), *np.zeros((2, halves.size)), np.sin(halves)], axis=1)
    return Turn(np.zeros(1, np.int64), met[-1:], met)


def test_retarders_move_from_where_the_look_before_has_left_them() -> None:
    """At 1 rad/s both about Z take half of 2 pi - 2, 2.14 s; for the same turn again no time."""
    part = replace(IDEAL, every_s=10.0, speed_rad_per_s=1.0, reference="interrupting")
    compensation = Compensation({"bob": Device(compensator=part)}, Draws(1))
    times_ns = np.array([0, 10, 20]) * 1_000_000_000
    leaves = Schedule(0, Pattern(1e8, 300))
    ends = FiberEnd("alice", "alice-q0"), FiberEnd("bob", "bob-q0")
    turn = looked(0.0, 2.0, 2.0)
    dark = compensation.correct(ends, {"bob": times_ns}, turn, leaves).dark
    assert dark is not None
    assert np.flatnonzero(dark).tolist() == list(range(100, 122))


def test_reference_light_meets_the_turns_of_fibres_in_their_order() -> None:
    """That of any light, as Rotation has it: the later one is by the left."""
    quaternions, whole = rotations(40)
    for number in range(0, 40, 2):
        two = quaternions[number : number + 2, None]
        one, other = (Turn(np.zeros(1, np.int64), each, each) for each in two)
        both = one.after(other)
        wanted = (whole[number] * whole[number + 1]).as_quat()[[3, 0, 1, 2]]
        assert both.looked is not None
        for found in (both.quaternions[0], both.looked[0]):
            assert abs(found @ wanted) == pytest.approx(1)


def test_calibration_goes_on_at_the_interval_that_was_set_last() -> None:
    compensation = Compensation({"bob": Device(compensator=IDEAL)}, Draws(1))
    compensation.light_begins(0)
    compensation.look("bob", 10_000_000_000, 2.0)
    compensation.look_now("bob", 21_000_000_000)
    (times_ns,) = compensation.looks(21_000_000_000, 26_000_000_000).values()
    assert (times_ns[-3:] / 1e9).tolist() == [21, 23, 25]


async def calibrated(there: Laboratory) -> None:
    """Let drift go on for a hundred times its duration, with and without a new look."""
    assert not (await errors(there, 6)).any()
    await there.wait(10.0)
    assert (await errors(there, 600, 1)).any()
    request = AdjustFiberRequest(a="bob", b="alice", calibrate=True)
    await there.table.handle("runner", "adjust_fiber", request)
    assert not (await errors(there, 6, 2)).any()
    await there.wait(10.0)
    began_ns = there.clock.now_ns()
    await there.table.handle("bob", "compensate", CompensateRequest(every_s=5.0))
    for number in (3, 4, 5):
        await there.clock.wait_until(began_ns + (number - 3) * 5_000_000_000)
        assert not (await errors(there, 6, number)).any()


def test_calibration_and_the_host_itself_have_a_compensator_look() -> None:
    uvloop.run(calibrated(laboratory(replace(IDEAL, every_s=1e6))))


def test_looks_go_on_while_no_light_comes() -> None:
    """Light comes 1 us behind a look, 50 drift times behind other light: next to none is wrong."""

    async def found() -> int:
        there = laboratory(replace(IDEAL, every_s=5.0))
        wrong, began_ns = int((await errors(there, 6)).sum()), there.clock.now_ns()
        await there.table.handle("bob", "compensate", CompensateRequest(every_s=5.0))
        for number in range(1, 21):
            await there.clock.wait_until(began_ns + number * 5_000_000_000 + 1000)
            wrong += int((await errors(there, 6, number)).sum())
        return wrong

    assert uvloop.run(found()) == 0


def test_passive_compensation_leaves_light_exactly_as_it_was() -> None:
    there = laboratory(Compensator(), birefringence="compensated")
    assert not uvloop.run(errors(there)).any()
    assert there.layer.exact


@pytest.mark.parametrize(
    ("part", "refusal"),
    [
        (Compensator(2), "bob: retarders 2: choose 0, 3 or 4"),
        (
            Compensator(3, reference="interrupting", reference_share=0.1),
            "bob: reference_share 0.1 with the reference 'interrupting'",
        ),
        (
            Compensator(3, reference="error-rate", reference_share=0.1),
            "bob: reference_share 0.1 with the reference 'error-rate'",
        ),
    ],
)
def test_compensators_that_cannot_be_are_refused(part: Compensator, refusal: str) -> None:
    with pytest.raises(BadParameter, match=refusal):
        part.check("bob")


@pytest.mark.parametrize(
    ("part", "every_s", "refusal"),
    [(Compensator(), 5.0, "bob has no compensator"), (IDEAL, 0.0, "every_s 0.0: choose 0.001 to")],
)
def test_looks_that_cannot_be_are_refused(part: Compensator, every_s: float, refusal: str) -> None:
    there = laboratory(part)
    with pytest.raises(Refusal, match=refusal):
        uvloop.run(there.table.handle("bob", "compensate", CompensateRequest(every_s=every_s)))


def test_light_of_time_bins_gets_one_polarisation_back() -> None:
    """Of halves that fibres scramble three in four pairs are Phi+, see the page of devices."""

    async def found(compensator: Compensator) -> NDArray[np.int64]:
        drift = {"polarization_drift_rad_per_sqrt_km": 4.0, "polarization_drift_time_s": 1e9}
        there = laboratory(compensator, encoding="time-bin", **drift)
        alice, bob = there.host("alice"), there.host("bob")
        await alice.create(1000)
        await alice.send({(0, 0): "alice-q0", (0, 1): "alice-q1"})
        for half in (0, 1):
            await bob.receive((0, half), f"bob-q{half}")
        return np.bincount(await bob.bell_measure((0, 0), (0, 1)), minlength=4)

    assert uvloop.run(found(IDEAL))[0] == 1000
    assert uvloop.run(found(Compensator()))[0] < 1000


def test_pulses_of_a_laser_are_lost_to_an_interrupting_reference() -> None:
    """Without drift nothing else needs their photons: of clicks, .9 in time."""
    part = Compensator(3, every_s=0.05, measuring_s=0.005, reference="interrupting")
    laser = PairSource(statistics="poisson", mean_pairs=0.5)

    async def clicks(part: Compensator) -> int:
        ends = FiberEnd("alice", "alice-q0"), FiberEnd("bob", "bob-q0")
        devices = {"alice": Device(laser), "bob": Device(compensator=part)}
        tokens = dict.fromkeys(HOSTS, "")
        there = Laboratory(DispatcherConfig("", "", 1, tokens, [Fiber(*ends)], [], devices=devices))
        return (await errors(there)).size

    assert uvloop.run(clicks(Compensator())) != 0
    assert within(uvloop.run(clicks(part)), COUNT, 0.9 * -np.expm1(-0.5))


def kept(limit: float) -> float:
    """Return how likely any turn leaves no more errors than a limit below a half.

    Of a turn by any axis w² + y² is uniform, s, and y² / s is cos² of any angle: on average of Z
    and X (1 + s cos(2 angle)) / 2 is wrong.
    """
    c = 1 - 2 * limit
    return float((np.arccos(c) - c * np.arccosh(1 / c)) / np.pi)


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("limit", [0.25, 0.4])
def test_an_error_rate_beyond_its_limit_has_light_interrupted(limit: float) -> None:
    """Each of 300 looks sees another turn, of 4 rad rms: any; it takes 100 of 200 pulses."""
    part = replace(IDEAL, every_s=0.02, measuring_s=0.01, reference="error-rate", error_limit=limit)
    drift = {"polarization_drift_rad_per_sqrt_km": 4.0, "polarization_drift_time_s": 1e-3}
    lost = COUNT - wrong(part, **drift).size
    assert lost % 100 == 0
    assert within(lost // 100, 300, 1 - kept(limit))


def test_an_error_rate_at_its_limit_interrupts_nothing() -> None:
    part = replace(IDEAL, every_s=0.02, measuring_s=0.01, reference="error-rate", error_limit=0.0)
    assert wrong(part, polarization_drift_rad_per_sqrt_km=0.0).size == COUNT


def test_an_error_rate_is_undone_as_reference_light_is() -> None:
    part = replace(IDEAL, every_s=0.05, measuring_s=0.01, reference="error-rate")
    found = wrong(part)
    assert found.size == COUNT * 0.8
    require(found, expected(0.8, 0.05, early_s=0.01))


def test_an_error_rate_within_its_limit_moves_nothing() -> None:
    """Errors are those of light that nothing undoes, by the page of fibres."""
    part = replace(IDEAL, every_s=0.05, measuring_s=0.01, reference="error-rate", error_limit=1.0)
    found = wrong(part, polarization_drift_rad_per_sqrt_km=0.2)
    assert found.size == COUNT
    require(found, ((1 - np.exp(-(0.2**2) / 3)) / 2, 0.0))


def test_there_is_no_error_rate_without_data() -> None:
    """The setting that the first block has found holds for the next one, which finds no errors."""

    async def found() -> list[NDArray[np.bool_]]:
        looks: dict[str, Any] = {"every_s": 0.05, "measuring_s": 0.01, "error_limit": 1e-4}
        part = replace(IDEAL, reference="error-rate", **looks)
        there = laboratory(part, polarization_drift_time_s=1e9)
        blocks = [await errors(there, 1000)]
        await there.wait(10.01)
        return [*blocks, await errors(there, 1000, 1)]

    first, second = uvloop.run(found())
    assert (first.size, second.size) == (900, 1000)
    assert not first.any()
    assert not second.any()
