"""Polarisation-dependent loss and mode dispersion, against matrices and sums; 5 sigma, seed 1."""

from typing import Any

import numpy as np
import pytest
import uvloop
from five_sigma import within
from noise_cases import passage

from dispatcher.approximations import MODE_DISPERSION
from dispatcher.fiber.polarization_modes import PolarizationModeDispersion
from dispatcher.sabot.backend import Bytes
from evidence.laboratory import Laboratory
from wire.config import DispatcherConfig, Fiber, FiberEnd
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Detectors, Device, PairSource

COUNT = 120_000
SIGMAS = np.array([[[0, 1], [1, 0]], [[0, -1j], [1j, 0]], [[1, 0], [0, -1]]])


def axes(count: int) -> np.ndarray:
    """Return vectors of any direction, of three normal components."""
    found: np.ndarray = np.random.default_rng(1).standard_normal((count, 3))
    return found


def sent(bandwidth_nm: float = 0.0, encoding: str = "polarization", **fiber: Any) -> Bytes:
    """Send the six cardinal states, each measured in its basis: 0 right, 1 wrong, 255 lost."""

    async def inside() -> Bytes:
        device = Device(
            PairSource(bandwidth_nm=bandwidth_nm, encoding=encoding),
            detectors=Detectors(encoding=encoding),
        )
        devices = dict.fromkeys(("alice", "bob"), device)
        ends = FiberEnd("alice", "alice-q0"), FiberEnd("bob", "bob-q0")
        fibers = [Fiber(*ends, polarization_drift_time_s=1e-9, **fiber)]
        tokens = dict.fromkeys(devices, "")
        config = DispatcherConfig("", "", 1, tokens, fibers, [], devices=devices)
        laboratory = Laboratory(config)
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        states = (np.arange(COUNT) % 6).astype(np.uint8)
        await alice.prepare(states)
        await alice.send({(0, 0): "alice-q0"})
        await bob.receive((0, 0), "bob-q0")
        bits = await bob.measure((0, 0), bases=states >> np.uint8(1))
        return np.where(bits == NO_CLICK, bits, bits ^ (states & np.uint8(1)))

    return uvloop.run(inside())


@pytest.mark.parametrize("loss_db", [1.0, 6.0, 40.0])
def test_dependent_loss_is_the_mean_of_filters_about_all_axes(loss_db: float) -> None:
    """|0> behind diag(1, t) about many axes: what comes through, and what of it is |1>."""
    amplitude = 10 ** (-loss_db / 20)
    units = axes(200_000)
    units /= np.linalg.norm(units, axis=1, keepdims=True)
    mean, half = (1 + amplitude) / 2, (1 - amplitude) / 2
    filters = mean * np.eye(2) + half * np.einsum("na,aij->nij", units, SIGMAS)
    right, wrong = (np.abs(filters[:, i, 0]) ** 2 for i in (0, 1))
    found = sent(pdl_db=loss_db)
    came = int(np.count_nonzero(found != NO_CLICK))
    assert within(came, COUNT, float((right + wrong).mean()))
    share = float(wrong.mean() / (right + wrong).mean())
    assert abs(np.count_nonzero(found == 1) - came * share) < 6 * (came * share) ** 0.5


def test_mode_dispersion_is_the_mean_over_colours_and_delays() -> None:
    """Each colour w is turned by w tau about the axis: |0> becomes |1> with (1 - n_z^2) sin^2."""
    bandwidth_nm, mean_ps = 1.0, 2.0
    width = 2 * np.pi * 193.4e12**2 / 299_792_458 * bandwidth_nm * 1e-9 * 1e-12  # rad/ps
    vectors = axes(400_000) * mean_ps / np.sqrt(8 / np.pi)
    delays = np.linalg.norm(vectors, axis=1)
    colours = np.random.default_rng(2).standard_normal(delays.size) * width
    wrong = (1 - (vectors[:, 2] / delays) ** 2) * np.sin(colours * delays / 2) ** 2
    found = sent(bandwidth_nm, length_km=4.0, pmd_ps_per_sqrt_km=mean_ps / 2)
    assert (found != NO_CLICK).all()
    share = float(wrong.mean())
    assert abs(np.count_nonzero(found) - COUNT * share) < 6 * (COUNT * share) ** 0.5


def test_a_result_says_what_one_axis_for_all_would_change() -> None:
    """(1 - exp(-(s d)^2 / 2)) / 2 of the photons meet n.sigma, d the delay between both."""
    width_rad_per_s, here = 1e12, passage(1000)
    here.width_rad_per_s = width_rad_per_s
    effect = PolarizationModeDispersion(1.0, 100.0).effect(here)
    assert effect.delays_ps is not None
    delay_s = 2e-12 * float(np.abs(effect.delays_ps).max())
    most = (1 - np.exp(-((width_rad_per_s * delay_s) ** 2) / 2)) / 2
    assert effect.approximations.sizes == {MODE_DISPERSION: pytest.approx(most)}


def test_delays_are_maxwell_distributed_and_go_either_way() -> None:
    """Half the delay, whose mean is D and mean square 3 pi D^2 / 8; none is wrong in one colour."""
    effect = PolarizationModeDispersion(8.0, 1e-9).effect(passage())
    assert effect.delays_ps is not None
    assert effect.paulis is not None
    sizes = 2 * np.abs(effect.delays_ps)
    count = sizes.size
    spread = (3 * np.pi / 8 - 1) ** 0.5 * 8.0 / count**0.5
    assert abs(sizes.mean() - 8.0) < 5 * spread
    assert (sizes**2).mean() == pytest.approx(3 * np.pi / 8 * 64, rel=0.02)
    assert within(int((effect.delays_ps > 0).sum()), count, 0.5)
    assert not effect.paulis.any()


def test_a_bit_in_time_bins_does_not_see_them_but_is_lost_by_polarisation_as_others_are() -> None:
    """Of 6 dB (1 + t^2) / 2 come through: to loss it does not matter what a qubit is in."""
    assert not sent(1.0, "time-bin", pmd_ps_per_sqrt_km=100.0).any()
    found = sent(1.0, "time-bin", pdl_db=6.0)
    came = found[found != NO_CLICK]
    assert not came.any()
    assert within(came.size, COUNT, (1 + 10 ** (-6 / 10)) / 2)
