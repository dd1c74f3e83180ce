"""Light of the shorter way waits for the other: 10^(-dB / 10) of it is left; 5 sigma, seed 1."""

import numpy as np
import pytest
import uvloop
from five_sigma import within

from dispatcher.sabot.backend import Bytes
from evidence.laboratory import Laboratory
from wire.config import DispatcherConfig, Fiber, FiberEnd
from wire.outcomes import NO_CLICK
from wire.parameters.physics import BellAnalyser, Device, PairSource

COUNT = 100_000
COLOUR_MHZ = 193_400_000


async def outcomes(
    analyser: BellAnalyser,
    stored: bool,
    lengths_km: tuple[float, float],
    source: PairSource = PairSource(),  # noqa: B008 - immutable
    apart_mhz: int = 0,
) -> tuple[Bytes, Laboratory]:
    """Return the outcomes of Phi+ whose halves go these ways to bob, and the laboratory."""
    fibers = [
        Fiber(FiberEnd("alice", f"alice-q{i}"), FiberEnd("bob", f"bob-q{i}"), length_km=length_km)
        for i, length_km in enumerate(lengths_km)
    ]
    devices = {
        "alice": Device(source),
        "bob": Device(analyser=analyser),
    }
    tokens = dict.fromkeys(devices, "")
    config = DispatcherConfig("", "", 1, tokens, fibers, [], devices=devices)
    laboratory = Laboratory(config)
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    await alice.create(COUNT)
    if apart_mhz:
        for half, colour_mhz in enumerate((COLOUR_MHZ, COLOUR_MHZ + apart_mhz)):
            await alice.send({(0, half): f"alice-q{half}"}, frequency_mhz=colour_mhz)
    else:
        await alice.send({(0, 0): "alice-q0", (0, 1): "alice-q1"})
    for half in (0, 1):
        await bob.receive((0, half), f"bob-q{half}")
        if stored:
            await bob.store((0, half))
    return await bob.bell_measure((0, 0), (0, 1)), laboratory


@pytest.mark.parametrize(
    ("db_per_km", "stored", "lengths_km", "loss_db"),
    [
        (0.2, False, (0.01, 0.02), 0.0),
        (0.2, False, (1.0, 11.0), 2.0),
        (0.2, False, (11.0, 1.0), 2.0),
        (0.2, False, (5.0, 5.0), 0.0),
        (0.0, False, (1.0, 2_000.0), 0.0),
        (0.2, True, (1.0, 11.0), 0.0),
    ],
)
def test_so_much_fibre_as_the_ways_differ_by_costs_light(
    db_per_km: float, stored: bool, lengths_km: tuple[float, float], loss_db: float
) -> None:
    found, laboratory = uvloop.run(
        outcomes(BellAnalyser(delay_line_db_per_km=db_per_km), stored, lengths_km)
    )
    seen = int(np.count_nonzero(found != NO_CLICK))
    assert within(seen, COUNT, 10 ** (-loss_db / 10))
    assert not found[found != NO_CLICK].any()
    assert laboratory.layer.photons_lost == COUNT - seen
    assert laboratory.layer.photons_lost_waiting == COUNT - seen


def test_two_thousand_kilometres_leave_nothing() -> None:
    found, _laboratory = uvloop.run(outcomes(BellAnalyser(), False, (0.0, 2_000.0)))
    assert (found == NO_CLICK).all()


def test_without_a_delay_line_two_thousand_kilometres_are_no_coincidence() -> None:
    found, laboratory = uvloop.run(outcomes(BellAnalyser(delay_line_km=0.0), False, (0.0, 2_000.0)))
    assert (found == NO_CLICK).all()
    assert not laboratory.layer.photons_lost  # they come 9.8 ms apart


@pytest.mark.parametrize("bandwidth_nm", [1e-5, 3e-5])
def test_photons_that_come_apart_interfere_as_hong_ou_and_mandel_saw(bandwidth_nm: float) -> None:
    """P = [1 - exp(-(s tau)^2)] / 2: 10 m are tau = 49 ns, s = 2 pi (193.4 THz)^2 / c for 1 m."""
    tau_s = 10 / 2.04e8
    s = 2 * np.pi * 193.4e12**2 / 299_792_458 * bandwidth_nm * 1e-9
    source = PairSource(bandwidth_nm=bandwidth_nm)
    analyser = BellAnalyser(delay_line_km=0.0)
    found, _laboratory = uvloop.run(outcomes(analyser, False, (0.02, 0.01), source))
    wrong = int(np.count_nonzero(found == 2))
    assert set(np.unique(found)) <= {0, 2}
    assert within(wrong, COUNT, (1 - np.exp(-((s * tau_s) ** 2))) / 2)


def test_a_delay_line_too_short_leaves_the_rest() -> None:
    """Of 11 km it takes out 10; the last 4.9 us are beyond the window of 1 us."""
    near, far = BellAnalyser(delay_line_km=11.0), BellAnalyser(delay_line_km=10.0)
    assert (uvloop.run(outcomes(near, False, (1.0, 12.0)))[0] != NO_CLICK).any()
    assert (uvloop.run(outcomes(far, False, (1.0, 12.0)))[0] == NO_CLICK).all()


@pytest.mark.parametrize(("apart_km", "rad_per_s"), [(5.2e-5, 1e9), (6e-5, 3e9), (9e-7, 3.7e11)])
def test_ways_of_less_than_a_nanosecond_are_not_equal(apart_km: float, rad_per_s: float) -> None:
    """P = [1 - exp(-(s tau)^2)] / 2 by the lengths of both fibres: 5.2 cm are .255 ns."""
    analyser = BellAnalyser(bandwidth_rad_per_s=rad_per_s, delay_line_km=0.0)
    found, _laboratory = uvloop.run(outcomes(analyser, False, (5.2e-5 + apart_km, 5.2e-5)))
    tau_s = apart_km * 1e3 / 2.04e8
    wrong = (1 - np.exp(-((rad_per_s * tau_s) ** 2))) / 2
    assert within(int(np.count_nonzero(found == 2)), COUNT, wrong)


@pytest.mark.parametrize("stored", [False, True])
@pytest.mark.parametrize("bandwidth_nm", [0.0, 0.1])
@pytest.mark.parametrize("apart_mhz", [12_500, 300_000])
def test_photons_of_two_colours_interfere_less(
    bandwidth_nm: float, apart_mhz: int, stored: bool
) -> None:
    """exp(-(d / 2 s)^2) is left, of light without a width nothing; a memory keeps the colour."""
    s = 2 * np.pi * 193.4e12**2 / 299_792_458 * bandwidth_nm * 1e-9
    kept = np.exp(-((2e6 * np.pi * apart_mhz / (2 * s)) ** 2)) if s else 0.0
    source = PairSource(bandwidth_nm=bandwidth_nm)
    found, _laboratory = uvloop.run(
        outcomes(BellAnalyser(), stored, (0.01, 0.01), source, apart_mhz)
    )
    assert within(int(np.count_nonzero(found == 2)), COUNT, (1 - kept) / 2)
